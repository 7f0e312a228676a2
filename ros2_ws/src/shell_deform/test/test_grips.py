# SPDX-License-Identifier: Apache-2.0
"""Two-pin grips on bodies that are no balls: contacts out of line, thin walls that snap."""

import numpy as np
import pytest
import trimesh

from shell_deform.assemble.discretisation import discretise
from shell_deform.building import build_model
from shell_deform.live.background.condensed import contact_rows
from shell_deform.model import ShellModel
from shell_deform.objects.shell_object import Revolution, ShellObject
from shell_deform.solve.equilibrium import End, displaced, forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.surface.control_mesh import control_mesh
from shell_deform.theory.material import Material


@pytest.fixture(scope='module')
def blob():
    """A closed body without any symmetry, 7 cm, walls of 0.8 mm, stiff plastic."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    x, y, z = ball.vertices.T
    radius = 1 + 0.15 * x * y + 0.2 * z**3 + 0.12 * np.cos(3 * np.arctan2(y, x)) * (1 - z**2)
    points = 0.035 * ball.vertices * radius[:, None] * [1.3, 1.0, 0.9]
    shell = discretise(control_mesh(points, ball.faces), Material(2e9, 0.35), 0.8e-3)
    return ShellModel(shell)


@pytest.fixture(scope='module')
def bottle():
    profile = ((0.0, -0.1), (0.028, -0.1), (0.032, -0.095), (0.032, 0.04), (0.028, 0.055),
               (0.013, 0.08), (0.013, 0.1))  # fmt: skip
    described = ShellObject('bottle', Revolution(profile), 0.3e-3, 2.7e9, 0.38)
    return build_model(described, control_vertices=400)


def grips(model, count, seed=0):
    """Pairs of places on opposite sides, half of them well out of line: (count, 2, 3) [m]."""
    random = np.random.default_rng(seed)
    rest = model.surface.limit_positions(model.rest)
    middle, size = 0.5 * (rest.min(axis=0) + rest.max(axis=0)), np.ptp(rest, axis=0)
    found = []
    while len(found) < count:
        along = random.normal(size=3) * [1.0, 1.0, 0.3]
        back = -along + (0.4 * random.normal(size=3) if len(found) % 2 else 0.0)
        start = middle + [0.0, 0.0, 0.3 * size[2] * random.uniform(-1, 1)]
        far = np.linalg.norm(size)
        foot = model.surface.closest_point(
            model.rest,
            [start + far * side / np.linalg.norm(side) for side in (along, back)],
        )
        if not foot.on_boundary.any() and foot.normal[0] @ foot.normal[1] < -0.5:
            found.append(foot.position)
    return np.array(found)


def pins(model, places):
    return tuple(model.contact(place, 2e-3) for place in places)


def test_forces_on_a_free_form_body_are_solved_wherever_two_pins_grip_it(blob):
    solver = EquilibriumSolver(blob)
    for places in grips(blob, 24):
        state = None
        for force in (0.02, 1.0, 20.0):
            state = solver.solve(forced(pins(blob, places), [force, force]), state)
            assert state.converged, f'{places.tolist()} at {force} N: {state.message}'
            assert (state.displacement > 0).all()


def test_the_moment_of_pins_out_of_line_is_held_and_reported(blob):
    solver = EquilibriumSolver(blob)
    for places in grips(blob, 6)[1::2]:
        first, second = pins(blob, places)
        state = solver.solve(forced((first, second), [1.0, 1.0]))
        moment = np.cross(first.point, first.axis) + np.cross(second.point, second.axis)
        np.testing.assert_allclose(state.unbalance[:3], first.axis + second.axis, atol=1e-9)
        # the patch is curved and moves a little: its centre of force is not quite its centre
        np.testing.assert_allclose(state.unbalance[3:], moment, atol=2e-3)


def test_two_held_pins_leave_one_rigid_motion_free_wherever_they_are(blob):
    for places in grips(blob, 12):
        assert contact_rows(blob, pins(blob, places)).left.shape[1] == 1


def test_force_and_motion_control_agree_out_of_line(blob):
    solver = EquilibriumSolver(blob)
    contacts = pins(blob, grips(blob, 2)[1])
    pushed = solver.solve(forced(contacts, [5.0, 5.0]))
    moved = solver.solve(displaced(contacts, pushed.displacement))
    # motion control also fixes the one rigid motion that force control leaves to the body
    assert moved.converged
    np.testing.assert_allclose(moved.force.sum(), 10.0, rtol=0.05)


def test_a_thin_bottle_is_followed_to_its_snap_and_the_end_has_a_type(bottle):
    solver = EquilibriumSolver(bottle, NewtonOptions(stability=True))
    ends = []
    for places in grips(bottle, 6):
        state, rows = solver.rest(), 0
        for force in (0.1, 1.0, 20.0):
            found = solver.solve(forced(pins(bottle, places), [force, force]), state)
            if not found.converged:
                break
            state, rows = found, rows + 1
        ends.append(found.end)
        assert rows >= 2
        assert found.converged or found.end is End.SNAP, found.message
        if not found.converged:
            assert 'snaps' in found.message and 0.0 < found.load_fraction < 1.0
            assert found.force[0] < 20.0
    assert End.SNAP in ends
