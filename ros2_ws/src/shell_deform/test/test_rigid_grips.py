# SPDX-License-Identifier: Apache-2.0
"""Grips: what a rigid body in any pose does to the part of a shell that it holds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from shell_deform.building import boundary_vertices, build_model
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject
from shell_deform.objects.shell_object import Cylinder
from shell_deform.solve.equilibrium import LoadCaseError, gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports import hold_position
from shell_deform.supports.grips import (
    GripError,
    between,
    carried,
    grip,
    longest_share,
    refuse_few,
    turned_together,
)

X, Y, Z = np.eye(3)
STILL = np.zeros(6)
RADIUS, LENGTH, WALL, YOUNG = 0.02, 0.08, 1e-3, 2e6


@pytest.fixture(scope='module')
def shell():
    tube = ShellObject('tube', Cylinder(2 * RADIUS + WALL, LENGTH, 'open'), WALL, YOUNG, 0.3)
    return build_model(tube, control_vertices=400).shell


def ends(shell):
    rim, _ = boundary_vertices(shell.mesh)
    height = shell.surface.limit_positions(shell.mesh.vertices)[rim, 2]
    return rim[height < 0], rim[height > 0]


def tube(shell, free=None, theory='koiter'):
    """The tube held at both ends; the upper grip may shift along `free`."""
    lower, upper = (hold_position(shell, end, np.eye(3)) for end in ends(shell))
    grips = (
        grip('lower', shell, [lower], -0.5 * LENGTH * Z),
        grip('upper', shell, [upper], 0.5 * LENGTH * Z, free),
    )
    return EquilibriumSolver(ShellModel(shell, theory, grips=grips))


def twisted(solver, angle, start=None, force=None):
    motion = np.array([STILL, [*np.zeros(3), *(angle * Z)]])
    state = solver.solve(gripped(motion, force), start)
    assert state.converged, state.message
    return state


def test_a_small_twist_needs_the_torque_of_a_thin_tube(shell):
    angle = 1e-3
    state = twisted(tube(shell), angle)
    exact = YOUNG / 2.6 * 2 * np.pi * RADIUS**3 * WALL * (1 + WALL**2 / (4 * RADIUS**2))
    torque = exact * angle / LENGTH
    np.testing.assert_allclose(state.grip_wrench[1, 3:], [0, 0, torque], atol=5e-3 * torque)


def test_the_two_grips_balance_each_other(shell):
    solver = tube(shell)
    state = solver.solve(gripped(np.array([STILL, [2e-3, 0, 1e-3, 0.1, 0.2, 0.3]])))
    assert state.converged
    force, torque = state.grip_wrench[:, :3], state.grip_wrench[:, 3:]
    size = np.abs(force).max()
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-6 * size)
    at = [g.origin + pose[:3] for g, pose in zip(solver.model.grips, state.grip_pose, strict=True)]
    moment = torque.sum(axis=0) + np.cross(at[0], force[0]) + np.cross(at[1], force[1])
    np.testing.assert_allclose(moment, 0, atol=1e-6 * size * LENGTH)


def test_a_grip_that_may_shift_does_so_without_force(shell):
    state = twisted(tube(shell, Z[None]), 0.5)
    assert state.grip_pose[1, 2] < -1e-5
    assert abs(state.grip_wrench[1, 2]) < 1e-6 * state.grip_wrench[1, 5] / RADIUS


def test_a_grip_pulls_with_the_force_that_is_asked_of_it(shell):
    force = np.array([np.zeros(3), 0.5 * Z])
    state = twisted(tube(shell, Z[None]), 0.0, force=force)
    assert state.grip_wrench[1, 2] == pytest.approx(0.5, rel=1e-6)
    stretch = 0.5 * LENGTH / (YOUNG * 2 * np.pi * RADIUS * WALL)
    assert state.grip_pose[1, 2] == pytest.approx(stretch, rel=0.02)


@pytest.mark.parametrize('axis', [X, Y, Z, np.array([1.0, 2.0, -2.0]) / 3.0])
def test_the_whole_grasp_turned_by_180_degrees_has_the_same_energy(shell, axis):
    solver = tube(shell)
    held = np.array([STILL, [5e-4, 0, 5e-4, 0, 0.02, 0.05]])
    before = solver.solve(gripped(held))
    assert before.converged
    turn, where = Rotation.from_rotvec(np.pi * axis), np.array([0.3, -0.1, 0.2])
    turned = []
    for grip_, motion in zip(solver.model.grips, held, strict=True):
        at = turn.apply(grip_.origin + motion[:3]) + where
        rotation = (turn * Rotation.from_rotvec(motion[3:])).as_rotvec()
        turned.append([*(at - grip_.origin), *rotation])
    after = solver.solve(gripped(np.array(turned)), before)
    assert after.converged
    assert after.energy == pytest.approx(before.energy, rel=1e-10)
    np.testing.assert_allclose(
        turn.apply(before.grip_wrench[1, :3]),
        after.grip_wrench[1, :3],
        atol=1e-6 * np.abs(before.grip_wrench[1, :3]).max(),
    )


def test_a_turn_of_more_than_half_a_circle_goes_on_round():
    first, last = np.zeros((1, 6)), np.array([[0, 0, 0, 0, 0, 7.0]])
    np.testing.assert_allclose(between(first, last, 0.75), 0.75 * last)
    np.testing.assert_allclose(between(0.5 * last, last, 0.5), 0.75 * last)


def test_a_force_where_the_pose_is_prescribed_is_refused(shell):
    with pytest.raises(GripError, match='upper.*free it along that axis'):
        twisted(tube(shell), 0.0, force=np.array([np.zeros(3), X]))


def test_grips_that_hold_the_same_part_are_refused(shell):
    upper = hold_position(shell, ends(shell)[1], np.eye(3))
    one, two = (grip(name, shell, [upper], np.zeros(3)) for name in ('left', 'right'))
    with pytest.raises(GripError, match='grip right and grip left hold the same part'):
        ShellModel(shell, grips=(one, two))


@pytest.mark.parametrize('points', [np.zeros((0, 3)), np.eye(3)[:2], np.outer([0, 1, 2, 3], X)])
def test_too_few_points_fix_no_pose(points):
    with pytest.raises(GripError, match='a pose needs three that are not in line: make it wider'):
        refuse_few('upper', points, 'make it wider')


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_a_pose_that_is_not_finite_is_refused(bad):
    with pytest.raises(LoadCaseError, match='pose of a grip is not finite'):
        gripped(np.array([[0, 0, 0, 0, 0, bad]]))


def test_a_grip_that_tears_the_tube_apart_ends_with_the_last_good_state(shell):
    solver = tube(shell)
    state = solver.solve(gripped(np.array([STILL, [0, 0, -1.5 * LENGTH, 0, 0, 0]])))
    assert not state.converged and '% of the load case' in state.message
    assert 0.0 < state.load_fraction < 1.0
    assert np.isfinite(state.positions).all()


finite = st.floats(-3.0, 3.0)
motions = st.tuples(*[finite] * 6).map(lambda values: np.array([values]))


@given(motions, motions)
def test_the_way_between_two_poses_begins_and_ends_at_them(first, last):
    for fraction, end in ((0.0, first), (1.0, last)):
        found = between(first, last, fraction)
        np.testing.assert_allclose(found[:, :3], end[:, :3], atol=1e-12)
        turn = Rotation.from_rotvec(found[0, 3:]) * Rotation.from_rotvec(end[0, 3:]).inv()
        assert turn.magnitude() < 1e-7


@given(motions, motions, st.floats(0.0, 1.0))
def test_every_pose_on_the_way_keeps_distances(first, last, fraction):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])
    moved = carried(points, np.ones(3), between(first, last, fraction)[0])
    before = np.linalg.norm(points[:, None] - points, axis=2)
    np.testing.assert_allclose(np.linalg.norm(moved[:, None] - moved, axis=2), before, atol=1e-9)


def test_ten_turns_in_one_load_case_are_not_taken_for_none(shell):
    solver = tube(shell)
    motion = np.zeros((len(solver.model.grips), 6))
    motion[-1, 3:] = 20.0 * np.pi * Z
    found = solver.solve(gripped(motion))
    assert not found.converged and found.energy > 1e-6


def test_grips_that_turn_together_by_whole_turns_are_where_they_were(shell):
    solver = tube(shell)
    motion = turned_together(solver.model.grips, np.zeros(3), np.array([0.0, 4.0 * np.pi, 0.0]))
    found = solver.solve(gripped(motion))
    assert found.converged and found.energy < 1e-12


def test_turns_are_wound_up_in_steps_and_what_moves_together_in_one():
    still, once = np.zeros((2, 6)), np.zeros((2, 6))
    once[1, 5] = 2.0 * np.pi
    assert longest_share(still, once, together=True) <= 1.0 / 12.0 + 1e-12
    assert longest_share(still, once / 2.0, together=True) == 1.0
    once[0, 5] = 2.0 * np.pi
    assert longest_share(still, once, together=True) == 1.0
    assert longest_share(still, once, together=False) < 0.1
