# SPDX-License-Identifier: Apache-2.0
"""The axisymmetric solver against the tabulated columns of another independent one."""

import numpy as np
import pytest

from shell_deform.theory.gas import Gas
from shell_deform.verification.axisymmetric import (
    AxisymmetricError,
    PinnedSphere,
    forces_at,
    pole_displacements,
)
from shell_deform.verification.problem import references

RADIUS, THICKNESS = 31.25e-3, 2.5e-3
FORCES = np.array([10.631249660472593, 16.502902192616453, 20.37285499789309, 21.484910401708216])


@pytest.mark.parametrize(
    ('case', 'measure', 'poisson'),
    [
        ('koiter_disc2_nu0.5', 'koiter', 0.5),
        ('koiter_disc2_nu0.49', 'koiter', 0.49),
        ('novozhilov_disc2_nu0.5', 'paper_restored', 0.5),
        ('paper_disc2_nu0.5', 'paper', 0.5),
    ],
)
def test_it_gives_the_tabulated_forces_to_five_digits(case, measure, poisson):
    table = {row[0]: row[2] for row in references()['mission_sphere']['cases'][case]['data']}
    depths = [1.0, 2.56, 6.05, 9.12, 10.27, 12.0]
    sphere = PinnedSphere(RADIUS, THICKNESS, 1e6, poisson, 2e-3, measure)
    found = forces_at(sphere, 1e-3 * np.array(depths))
    np.testing.assert_allclose(found, [table[depth] for depth in depths], rtol=1e-5)


def test_with_trapped_air_it_gives_the_displacements_of_the_other_independent_solution():
    sphere = PinnedSphere(RADIUS, THICKNESS, 12.44e6, 0.5, 2e-3, gas=Gas('sealed'))
    found = pole_displacements(sphere, FORCES)
    np.testing.assert_allclose(1e3 * found, [2.56, 6.88, 9.83, 10.52], atol=0.006)


def test_force_and_displacement_control_agree():
    sphere = PinnedSphere(RADIUS, THICKNESS, 12.44e6, 0.5, 1e-3, gas=Gas('sealed', 5e3))
    depth = pole_displacements(sphere, FORCES[:2])
    np.testing.assert_allclose(forces_at(sphere, depth), FORCES[:2], rtol=1e-7)


def test_an_unknown_measure_is_refused():
    with pytest.raises(AxisymmetricError, match='choose one of'):
        forces_at(PinnedSphere(RADIUS, THICKNESS, 1e6, 0.5, 2e-3, 'reissner'), np.array([1e-3]))
