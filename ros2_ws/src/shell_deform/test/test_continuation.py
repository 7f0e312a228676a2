# SPDX-License-Identifier: Apache-2.0
"""Paths through limit points, and how near a state is to its snap."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from shell_deform.solve.borders import borders
from shell_deform.solve.continuation import ArcLengthOptions, carried_on, follow_path
from shell_deform.solve.equilibrium import displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.prediction import StepLoads
from shell_deform.solve.stability import snap_margin
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.verification import snap
from shell_deform.verification.linear_course import unheld


@pytest.fixture(scope='module')
def thick_roof():
    return snap.roof_path(12.7, cells=12, largest_step=0.4)


def test_roof_snaps_through_at_the_published_load(thick_roof):
    table = snap.path_table(thick_roof)
    turns = snap.turning_points(table[:, 1])
    assert len(turns) == 2
    assert table[turns[0], 1] == pytest.approx(0.7412, rel=0.015)
    assert table[turns[0], 0] == pytest.approx(10.9, abs=0.6)
    assert table[-1, 1] > 1.0


def test_published_loads_are_met_on_the_way_to_the_limit(thick_roof):
    table = snap.path_table(thick_roof)
    loads = np.interp(snap.THICK_ROOF[:, 1], table[:, 0], table[:, 1])
    np.testing.assert_allclose(loads, snap.THICK_ROOF[:, 0], rtol=0.02)


def test_thin_roof_snaps_back_the_deflection_turns_too():
    path = snap.roof_path(6.35, cells=10)
    table = snap.path_table(path)
    assert path.message == ''
    assert len(snap.turning_points(table[:, 1])) == 2
    assert len(snap.turning_points(table[:, 0])) == 2
    assert table[:, 1].min() < 0.0


def test_every_point_of_a_path_is_an_equilibrium_that_newton_keeps(thick_roof):
    model, case = snap.roof(12.7, cells=12)
    solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0))
    for point in thick_roof.points[10:40:12]:
        held = unheld(displaced(case.contacts, point.state.displacement))
        again = solver.solve(held, point.state)
        assert again.converged, again.message
        np.testing.assert_allclose(again.force, point.factor * case.force, rtol=1e-5)


def test_stiffness_vanishes_at_the_limit_load_and_the_inertia_counts_one_mode_beyond(thick_roof):
    model, case = snap.roof(12.7, cells=12)
    solver = EquilibriumSolver(model)
    table = snap.path_table(thick_roof)
    limit = int(snap.turning_points(table[:, 1])[0])
    rest, margins = None, []
    for k in (0, limit // 2, limit - 1, limit + 3):
        margin = snap_margin(solver, case, thick_roof.points[k].state, rest)
        rest = margin.rest_stiffness
        margins.append(margin)
    values = [margin.margin for margin in margins]
    assert values[0] == pytest.approx(1.0, abs=0.15)
    assert values[0] > values[1] > values[2] > 0.0 > values[3]
    assert values[2] < 0.15
    assert [margin.negative_modes for margin in margins] == [0, 0, 0, 1]


def test_softest_motion_of_the_roof_is_downward_under_the_force(thick_roof):
    model, case = snap.roof(12.7, cells=12)
    limit = int(snap.turning_points(snap.path_table(thick_roof)[:, 1])[0])
    margin = snap_margin(EquilibriumSolver(model), case, thick_roof.points[limit].state)
    (contact,) = case.contacts
    along = abs(contact.centre @ margin.mode @ contact.axis)
    assert along > 0.8 * np.linalg.norm(contact.centre @ margin.mode)


def test_squeezed_ball_never_gives_a_false_alarm(ball):
    top = np.array([0.0, 0.0, 1.0])
    pins = (ball.contact(top, 2e-3), ball.contact(-top, 2e-3))
    solver = EquilibriumSolver(ball)
    state, rest = solver.rest(), None
    for depth in (1e-5, 4e-3, 12e-3):
        state = solver.solve(displaced(pins, [depth, depth]), state)
        margin = snap_margin(solver, forced(pins, state.force), state, rest)
        rest = margin.rest_stiffness
        assert margin.negative_modes == 0
        assert margin.margin > 0.03
    assert margin.margin < 1.0


def test_smallest_stiffness_is_that_of_the_dense_eigenvalue_problem(sphere):
    model = sphere(1.0, 0.05, subdivisions=1, poisson=0.3)
    top = np.array([0.0, 0.0, 1.0])
    pins = (model.contact(top, 0.2), model.contact(-top, 0.2))
    solver = EquilibriumSolver(model)
    margin = snap_margin(solver, forced(pins, [0.0, 0.0]), solver.rest())
    matrix = model.rest_tangent.stiffness.toarray()
    rows = np.concatenate([pin.held_rows().reshape(3, -1) for pin in pins])
    allowed = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :]
    weight = model.shell.value_matrix().T @ model.shell.weights / model.shell.area
    values = eigh(
        allowed @ matrix @ allowed.T,
        allowed @ np.diag(np.repeat(weight, 3)) @ allowed.T,
        eigvals_only=True,
    )
    smallest = values[values > 1e-6 * values[-1]][0]
    assert margin.stiffness == pytest.approx(smallest, rel=0.02)


def test_a_path_that_cannot_go_on_says_where_it_stopped():
    model, case = snap.roof(12.7, cells=6)
    path = follow_path(EquilibriumSolver(model), case, ArcLengthOptions(400.0, 400.0, 300.0))
    assert path.points == ()
    assert 'at load factor' in path.message


@pytest.mark.parametrize(('load', 'snaps'), [(400.0, False), (700.0, True)])
def test_by_arc_length_a_load_is_carried_whole_and_a_snap_on_the_way_is_told(load, snaps):
    """The quarter of the roof snaps at 0.74 of 750 N and carries more behind that."""
    model, case = snap.roof(12.7, cells=6)
    solver = EquilibriumSolver(model, NewtonOptions(largest_move=40.0))
    present = solver.solve(replace(case, force=np.array([200.0])))
    bordering = borders(model, case)
    goal = StepLoads(
        np.array([load]), np.full(1, np.nan), np.zeros_like(bordering.dead), np.zeros((1, 6)),
        np.zeros((0, 6)),
    )  # fmt: skip
    state, share, fell = carried_on(solver, bordering, present, goal)
    assert (share, fell) == (1.0, snaps)
    assert state.force[0] == pytest.approx(load)
    assert solver.solve(replace(case, force=state.force), state).displacement[0] == pytest.approx(
        state.displacement[0], rel=1e-6
    )
