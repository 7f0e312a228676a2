# SPDX-License-Identifier: Apache-2.0
"""The paper's minimiser and its set-up, beside Newton's method and the whole ball."""

import numpy as np
import pytest

from shell_deform.solve.conjugate_gradient import _compliance, initial_field, minimise
from shell_deform.solve.equilibrium import LoadCaseError, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.verification.paper_setup import compare, patch

Z = np.array([0.0, 0.0, 1.0])


def pins(model, radius=4e-3):
    return (model.contact(Z, radius), model.contact(-Z, radius))


def test_conjugate_gradients_reach_newtons_state(ball):
    case = forced(pins(ball), [0.6, 0.6])
    newton = EquilibriumSolver(ball).solve(case)
    found = minimise(ball, case)
    assert found.converged, found.message
    np.testing.assert_allclose(found.displacement, newton.displacement, rtol=1e-3)
    assert found.energy == pytest.approx(newton.energy, rel=1e-4)


def test_what_a_pin_is_taken_to_give_is_reissners_point_force_on_a_sphere(ball):
    young, poisson, radius, wall = 1e6, 0.5, 31.25e-3, 2.5e-3
    reissner = radius * np.sqrt(3.0 * (1.0 - poisson**2)) / (4.0 * young * wall**2)
    assert _compliance(ball, ball.contact(Z, 4e-3)) == pytest.approx(reissner, rel=0.02)


def test_initial_field_is_a_cone_as_high_as_the_force(ball):
    case = forced(pins(ball), [0.2, 0.4])
    field = initial_field(ball, case, 0.01)
    top, bottom = (np.linalg.norm(field[ball.rest[:, 2] * sign > 0], axis=1) for sign in (1, -1))
    assert bottom.max() == pytest.approx(2.0 * top.max(), rel=1e-6)
    near = np.linalg.norm(ball.rest - case.contacts[0].point, axis=1)
    inside = near < 0.01
    slope = top[inside[ball.rest[:, 2] > 0]] / (1.0 - near[inside] / 0.01)
    np.testing.assert_allclose(slope, slope[0])
    assert np.all(field[(near > 0.011) & (ball.rest[:, 2] > 0)] == 0.0)


def test_the_papers_patch_is_stiffer_than_the_ball_it_is_cut_from():
    rows = {(row.setup, row.method): row for row in compare(0.5, cells=12)}
    small = rows['45 x 45 mm patch', 'Newton']
    whole = rows['whole ball', 'Newton']
    assert 0.6 * whole.depth < small.depth < 0.9 * whole.depth
    for setup, newton in (('45 x 45 mm patch', small), ('whole ball', whole)):
        assert rows[setup, 'conjugate gradients'].depth == pytest.approx(newton.depth, rel=2e-3)


def test_the_patch_carries_the_published_forces_of_a_clamped_cap():
    # Circular patch of arc radius 22.5 mm, Koiter, E 1 MPa: the square one is a little softer.
    cap = {2.56e-3: 1.04, 6.05e-3: 1.55, 9.12e-3: 1.85, 10.27e-3: 1.96}
    model = patch(18, 'koiter')
    solver, state = EquilibriumSolver(model), None
    contact = model.contact(31.25e-3 * Z, 2e-3)
    for depth, force in cap.items():
        state = solver.solve(displaced((contact,), [depth]), state)
        assert 0.94 * force < state.force[0] < force


def test_a_prescribed_motion_is_refused(ball):
    with pytest.raises(LoadCaseError, match='force'):
        minimise(ball, displaced(pins(ball), [1e-3, 1e-3]))
