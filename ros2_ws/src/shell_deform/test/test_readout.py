# SPDX-License-Identifier: Apache-2.0
"""Strains, stresses and energy of states whose answer is known."""

import numpy as np
import pytest

from shell_deform.readout import principal, read_out, thickness_warning, von_mises
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

RADIUS, THICKNESS, YOUNG, POISSON = 1.0, 0.02, 1e6, 0.3


@pytest.fixture(scope='module')
def model(sphere):
    return sphere(RADIUS, THICKNESS, subdivisions=2, young=YOUNG, poisson=POISSON)


def test_undeformed_shell_is_free_of_strain_and_keeps_its_volume(model):
    fields = read_out(model, model.rest)
    assert np.abs(fields.membrane_strain).max() < 1e-12
    assert np.abs(fields.curvature_change).max() < 1e-10
    assert fields.volume == pytest.approx(4 / 3 * np.pi, rel=1e-3)
    assert fields.warnings == ()


def test_blown_up_sphere_has_equal_strains_and_the_stress_of_its_law(model):
    stretch = 1e-3
    fields = read_out(model, (1 + stretch) * model.rest)
    strain = stretch + 0.5 * stretch**2
    np.testing.assert_allclose(fields.membrane_strain[:, :2], strain, rtol=1e-9)
    assert np.abs(fields.membrane_strain[:, 2]).max() < 1e-12
    middle = 0.5 * (fields.outer_stress + fields.inner_stress)
    np.testing.assert_allclose(middle[:, :2], YOUNG / (1 - POISSON) * strain, rtol=1e-9)


def test_bending_strains_the_faces_by_half_the_thickness_times_the_curvature(model):
    bent = model.rest * np.array([1.0, 1.0, 0.95])
    fields = read_out(model, bent)
    np.testing.assert_allclose(
        fields.inner_strain - fields.outer_strain, THICKNESS * fields.curvature_change, atol=1e-14
    )


def test_outward_normal_makes_a_flattened_pole_short_outside(model):
    flattened = model.rest.copy()
    flattened[:, 2] *= 0.9
    fields = read_out(model, flattened)
    pole = np.argmax(fields.points[:, 2])
    assert fields.outer_strain[pole, 0] < fields.inner_strain[pole, 0]


def test_energy_density_adds_up_to_the_strain_energy(model):
    bent = model.rest * np.array([1.0, 1.0, 0.9])
    fields = read_out(model, bent)
    total = float(model.shell.weights @ fields.energy_density)
    assert total == pytest.approx(model.shell.energy('koiter', bent), rel=1e-12)


def test_strains_under_a_pin_match_the_stated_size(ball):
    pole = np.array([0.0, 0.0, 1.0])
    pins = (ball.contact(pole, 2e-3), ball.contact(-pole, 2e-3))
    state = EquilibriumSolver(ball).solve(displaced(pins, [12e-3, 12e-3]))
    fields = read_out(ball, state.positions, yield_stress=1e3)
    membrane = np.abs(principal(fields.membrane_strain)).max()
    assert 0.02 < membrane < 0.08
    assert len(fields.warnings) == 2
    assert 'surface strain' in fields.warnings[0] and 'yield stress' in fields.warnings[1]


def test_principal_values_and_equivalent_stress_of_known_states():
    np.testing.assert_allclose(principal(np.array([[1.0, 1.0, 2.0]])), [[2.0, 0.0]])
    np.testing.assert_allclose(principal(np.array([[0.0, 0.0, 3.0]]), False), [[3.0, -3.0]])
    np.testing.assert_allclose(
        von_mises(np.array([[2.0, 0.0, 0.0], [0.0, 0.0, 1.0]])), [2.0, np.sqrt(3.0)]
    )


def test_a_wall_too_thick_for_its_radius_is_named_with_the_number(sphere):
    thick = sphere(1.0, 0.08, subdivisions=1)
    warning = thickness_warning(thick)
    assert warning is not None and '0.0' in warning
    assert thickness_warning(sphere(1.0, 0.02, subdivisions=1)) is None
