# SPDX-License-Identifier: Apache-2.0
"""Equilibria against independent solutions, and what they promise."""

import numpy as np
import pytest

from shell_deform.solve.equilibrium import LoadCaseError, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.theory.gas import Gas

# Force per pole [N] at pole displacement [mm], E 1 MPa, R 31.25, h 2.5, nu 0.5, pin radius 2 mm:
# an independent axisymmetric shell solution.
KOITER = {0.01: 0.0051382, 1.0: 0.4354723, 4.0: 1.0507244, 8.0: 1.3476179, 12.0: 1.6447264}
PAPER = {0.01: 0.0051981, 1.0: 0.4343544, 4.0: 1.0123818, 8.0: 1.3084488, 12.0: 1.60949}
RESTORED = {0.01: 0.0051931, 1.0: 0.4348495, 4.0: 1.0216131, 8.0: 1.3252606, 12.0: 1.6283302}


def poles(model, radius=2e-3):
    top = np.array([0.0, 0.0, 1.0])
    return (model.contact(top, radius), model.contact(-top, radius))


@pytest.mark.parametrize(
    ('theory', 'table'), [('koiter', KOITER), ('paper', PAPER), ('paper_restored', RESTORED)]
)
def test_squeezed_ball_follows_the_independent_solution(ball, theory, table):
    model = ball.with_theory(theory)
    solver = EquilibriumSolver(model)
    state = None
    for depth, reference in table.items():
        state = solver.solve(displaced(poles(model), [1e-3 * depth] * 2), state)
        assert state.converged, state.message
        np.testing.assert_allclose(state.force, reference, rtol=6e-3)


def test_newton_converges_from_rest_to_twelve_millimetres_in_one_call(ball):
    state = EquilibriumSolver(ball).solve(displaced(poles(ball), [12e-3, 12e-3]))
    assert state.converged, state.message
    np.testing.assert_allclose(state.force, KOITER[12.0], rtol=6e-3)


def test_force_and_motion_control_meet_at_the_same_state(ball):
    solver = EquilibriumSolver(ball)
    pushed = solver.solve(forced(poles(ball), [0.8, 0.8]))
    moved = solver.solve(displaced(poles(ball), pushed.displacement))
    np.testing.assert_allclose(moved.force, 0.8, rtol=1e-6)
    np.testing.assert_allclose(moved.positions, pushed.positions, atol=1e-9)


def test_reactions_balance_the_loads(ball):
    solver = EquilibriumSolver(ball, NewtonOptions(tolerance=1e-11))
    state = solver.solve(displaced(poles(ball), [3e-3, 3e-3]))
    assert np.abs(state.unbalance[:3]).max() < 1e-8 * state.force[0]
    assert np.abs(state.unbalance[3:]).max() < 1e-8 * state.force[0] * 31.25e-3


def test_unequal_pushes_on_a_free_ball_are_solved_and_their_unbalance_reported(ball):
    state = EquilibriumSolver(ball).solve(forced(poles(ball), [0.50, 0.52]))
    assert state.converged, state.message
    assert state.unbalance[2] == pytest.approx(-0.50 + 0.52, abs=1e-6)


def test_held_contacts_keep_the_ball_from_rolling(ball):
    solver = EquilibriumSolver(ball, NewtonOptions(stability=True))
    state = solver.solve(displaced(poles(ball), [9e-3, 9e-3]))
    moved = state.positions - ball.rest
    assert state.negative_modes == 0 and state.stable
    for contact in poles(ball):
        assert np.abs(contact.spread @ moved @ np.array([[1.0, 0], [0, 1], [0, 0]])).max() < 1e-9
    equator = np.abs(ball.rest[:, 2]) < 1e-6
    turn = np.cross(ball.rest[equator], moved[equator])
    assert np.abs(turn[:, :2].mean(axis=0)).max() < 1e-8


def test_linear_theory_is_the_first_order_answer(ball):
    depth = [2e-6, 2e-6]
    linear = EquilibriumSolver(ball.with_theory('linear'))
    paper = EquilibriumSolver(ball.with_theory('paper'))
    first = linear.solve(displaced(poles(ball), depth))
    second = paper.solve(displaced(poles(ball), depth))
    np.testing.assert_allclose(first.force, second.force, rtol=1e-3)
    twice = linear.solve(displaced(poles(ball), [4e-6, 4e-6]))
    np.testing.assert_allclose(twice.force, 2 * first.force, rtol=1e-9)


def test_linear_theory_is_three_times_too_stiff_at_four_wall_thicknesses(ball):
    linear = EquilibriumSolver(ball.with_theory('linear'))
    state = linear.solve(displaced(poles(ball), [10e-3, 10e-3]))
    assert state.force[0] / 1.4910905 == pytest.approx(3.5, rel=0.02)


def test_trapped_air_adds_about_a_tenth_of_the_force_at_ten_millimetres(sphere):
    open_ball = sphere(31.25e-3, 2.5e-3, subdivisions=3, young=13e6)
    sealed = sphere(31.25e-3, 2.5e-3, subdivisions=3, young=13e6, gas=Gas('sealed'))
    depth = [10.27e-3] * 2
    free = EquilibriumSolver(open_ball).solve(displaced(poles(open_ball), depth))
    held = EquilibriumSolver(sealed).solve(displaced(poles(sealed), depth))
    assert held.gas_pressure == pytest.approx(4.0e3, rel=0.08)
    assert (held.force - free.force)[0] == pytest.approx(2.1, rel=0.1)


def test_a_load_that_cannot_be_carried_gives_the_last_good_state_and_says_so(ball):
    solver = EquilibriumSolver(ball, NewtonOptions(smallest_step=1 / 4))
    state = solver.solve(displaced(poles(ball), [60e-3, 60e-3]))
    assert not state.converged
    assert 'of the load case' in state.message
    assert np.all(np.isfinite(state.positions))
    assert 0.0 <= state.load_fraction < 1.0


def test_a_load_case_prescribes_force_or_motion_at_each_contact(ball):
    with pytest.raises(LoadCaseError, match='exactly one'):
        forced(poles(ball), [np.nan, 1.0])
    with pytest.raises(LoadCaseError, match='finite'):
        forced(poles(ball), [np.inf, 1.0])


def test_pins_in_one_place_push_together_and_move_together(ball):
    pole, other = poles(ball)
    solver = EquilibriumSolver(ball)
    alone = solver.solve(forced((pole, other), [4.0, 4.0]))
    twice = solver.solve(forced((pole, pole, other), [1.0, 3.0, 4.0]))
    assert np.allclose(twice.positions, alone.positions, atol=1e-9)
    with pytest.raises(LoadCaseError, match='contacts 1 and 2 are in one place'):
        displaced((pole, pole, other), [1e-3, 2e-3, 1e-3])


def test_any_modulus_from_soft_gel_to_steel_needs_the_same_iterations(sphere):
    counts = []
    for young in (1e3, 1e6, 210e9):
        model = sphere(31.25e-3, 2.5e-3, subdivisions=2, young=young)
        state = EquilibriumSolver(model).solve(displaced(poles(model, 8e-3), [2e-3, 2e-3]))
        assert state.converged, state.message
        counts.append(state.iterations)
    assert max(counts) - min(counts) <= 1
