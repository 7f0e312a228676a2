# SPDX-License-Identifier: Apache-2.0
"""The grasp on the deformed ball: the paper's opening question, sharing of loads, the wall."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from shell_deform.building import build_model
from shell_deform.grasp.closure import closure
from shell_deform.grasp.contacts import contacts
from shell_deform.grasp.measures import Doubt, Held, Task, measure
from shell_deform.grasp.reading import (
    body_loads,
    body_mass,
    read_contacts,
    read_response,
    wall_reader,
)
from shell_deform.grasp.slip import first_slip, first_slips
from shell_deform.grasp.stiffness import adversary_work, grasp_stiffness, rigid_share
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import LoadCase, displaced
from shell_deform.solve.newton import EquilibriumSolver

PIN = 2e-3
VERTICES = 650


class Squeezed:
    """The tennis ball between pins at polar angles from the x axis, which close along it."""

    def __init__(self, degrees, depths, young=None):
        angle = np.radians(degrees)
        at = 0.03125 * np.array(
            [[np.cos(angle), np.sin(angle), 0.0], [-np.cos(angle), np.sin(angle), 0.0]]
        )
        ball = load_object('tennis_ball')
        if young is not None:
            ball = replace(ball, young_modulus_pa=young)
        self.model = build_model(ball, control_vertices=VERTICES, refine_at=at)
        self.solver = EquilibriumSolver(self.model)
        axes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        self.pins = tuple(
            self.model.contact(p, PIN, axis=a) for p, a in zip(at, axes, strict=True)
        )
        self.states = []
        for depth in depths:
            last = self.states[-1] if self.states else None
            self.states.append(self.solver.solve(displaced(self.pins, [depth, depth]), last))
            assert self.states[-1].converged

    def grasp(self, number, friction=0.38):
        return read_contacts(self.model, self.pins, self.states[number], friction)


@cache
def _off_axis():
    return Squeezed(25.0, (1e-5, 4e-3, 8e-3, 10e-3))


@cache
def _straight():
    return Squeezed(10.0, (2e-3, 4e-3))


def test_an_open_grasp_closes_by_squeezing():
    ball = _off_axis()
    needed = [
        closure(ball.grasp(number)).needed_friction(ball.grasp(number)) for number in range(4)
    ]
    closed = [closure(ball.grasp(number)).closed for number in range(4)]
    # At first touch the geometry of the sphere alone: tan 25 degrees.
    assert needed[0] == pytest.approx(np.tan(np.radians(25.0)), rel=1e-2)
    assert np.all(np.diff(needed) < 0.0)
    assert needed[3] < 0.8 * needed[0]
    assert closed == [False, False, True, True]


def test_the_fingers_supply_what_balance_demands():
    ball = _off_axis()
    grasp = ball.grasp(2)
    line = grasp.point[1] - grasp.point[0]
    line /= np.linalg.norm(line)
    force = grasp.push[:, None] * grasp.normal + grasp.tangential
    assert np.abs(force.sum(axis=0)).max() < 1e-5 * grasp.push.max()
    assert force[0] @ line == pytest.approx(np.linalg.norm(force[0]), rel=1e-3)


def test_a_rigid_ball_keeps_its_normals():
    hard = Squeezed(25.0, (1e-5,), young=1e12)
    grasp = hard.grasp(0, 0.5)
    soft = _off_axis().grasp(0, 0.5)
    assert closure(grasp).needed == pytest.approx(closure(soft).needed, rel=1e-2)
    rest = read_contacts(
        hard.model, hard.pins, replace(hard.states[0], positions=hard.model.rest), 0.5
    )
    rigid = contacts(rest.point, rest.normal, 1.0, 0.5, rest.arm)
    assert closure(rest).needed == pytest.approx(closure(rigid).needed, rel=1e-9)


def test_unit_loads_have_unit_resultants_about_the_centre():
    ball = _straight()
    positions = ball.states[-1].positions
    centre, loads = body_loads(body_mass(ball.model), positions)
    forces = loads.reshape(-1, 3, 6)
    assert forces.sum(axis=0) == pytest.approx(np.eye(3, 6), abs=1e-12)
    moment = np.cross(positions[:, :, None] - centre[:, None], forces, axis=1).sum(axis=0)
    assert moment == pytest.approx(np.eye(3, 6, 3), abs=1e-10)


def test_the_fingers_share_out_the_whole_load():
    ball = _straight()
    found = read_response(ball.solver, ball.pins, ball.states[1], ball.grasp(1))
    assert found.force.sum(axis=0)[:, :3] == pytest.approx(-np.eye(3), abs=1e-6)


def test_first_slip_is_that_of_the_nonlinear_solve():
    """A load of the factor that the tangent finds, put on and solved for, is at the cone."""
    ball = _straight()
    friction = 0.38
    state, grasp = ball.states[1], ball.grasp(1, friction)
    found = read_response(ball.solver, ball.pins, state, grasp)
    _, loads = body_loads(body_mass(ball.model), state.positions)
    for direction in (np.array([0, 0, -1.0]), np.array([0.0, -1, 0])):
        wrench = np.append(direction, np.zeros(3))
        slip = first_slip(grasp, found.sharing, wrench)
        low, high = 0.0, 3.0 * slip.factor
        for _ in range(9):
            factor = 0.5 * (low + high)
            case = LoadCase(
                ball.pins,
                np.full(2, np.nan),
                np.full(2, 4e-3),
                dead_load=(loads @ wrench).reshape(-1, 3) * factor,
            )
            loaded = ball.solver.solve(case, state)
            assert loaded.converged
            there = read_contacts(ball.model, ball.pins, loaded, friction)
            asked = np.hypot(
                np.linalg.norm(there.tangential, axis=1), there.spin / there.arm
            ) / np.maximum(friction * there.push, 1e-9)
            if asked.max() < 1.0:
                low = factor
            else:
                high = factor
        assert slip.factor == pytest.approx(0.5 * (low + high), rel=0.02)


def test_stiffness_is_symmetric_and_the_work_that_of_its_weakest_push():
    ball = _straight()
    found = read_response(ball.solver, ball.pins, ball.states[1], ball.grasp(1))
    assert found.compliance == pytest.approx(found.compliance.T, rel=0.05, abs=1e-6)
    stiff = grasp_stiffness(found.compliance, 0.03)
    assert stiff.smallest > 0.0
    assert stiff.matrix @ found.compliance == pytest.approx(np.eye(6), abs=0.1)
    weakest = np.linalg.eigvalsh(found.compliance[:3, :3])[-1]
    assert adversary_work(found.compliance, 2.0) == pytest.approx(2.0 * weakest, rel=1e-3)


def test_a_squeeze_from_both_sides_is_pure_and_one_from_one_side_is_not():
    point = np.array([[0.03, 0, 0], [-0.03, 0, 0]])
    assert rigid_share(point, np.array([[-1e-3, 0, 0], [1e-3, 0, 0]])) < 1e-12
    assert rigid_share(point, np.array([[1e-3, 0, 0], [1e-3, 0, 0]])) == pytest.approx(1.0)


def test_the_wall_is_stressed_most_under_a_pin():
    ball = _straight()
    state = ball.states[1]
    reader = wall_reader(ball.model, ball.pins)
    wall = reader.at(state.unknowns, state.force, state.displacement)
    near = np.linalg.norm(wall.stress_at - ball.grasp(1).point, axis=1).min()
    assert near < 3.0 * PIN
    # Uniaxial at least: no stress beyond what the strain makes of it with Poisson's ratio.
    assert 0.0 < wall.strain < 0.5
    assert wall.stress < 12.75e6 * wall.strain / (1.0 - 0.5**2) * 1.5


def _doubt(count):
    return Doubt(
        np.full(count, 0.1), np.full(count, 0.2), np.full(count, 2e-4), np.full(count, 0.02)
    )


def test_all_measures_of_a_squeezed_ball_are_finite_and_agree():
    ball = _off_axis()
    found = read_response(ball.solver, ball.pins, ball.states[3], ball.grasp(3))
    held = Held(found.centre, found.sharing, found.compliance, ball.states[3].energy)
    told = measure(ball.grasp(3), held, Task(mass=0.058, friction_sigma=0.03), _doubt(2))
    plain = told.to_json()
    numbers = [v for v in plain.values() if isinstance(v, float)]
    numbers += [v for finger in plain['fingers'] for v in finger.values() if isinstance(v, float)]
    assert np.all(np.isfinite(numbers))
    assert told.closed and told.closure_probability > 0.5
    assert told.worst_capacity <= told.gravity_capacity + 1e-9
    assert told.epsilon <= told.worst_capacity + 1e-9
    assert told.window.liftable == pytest.approx(told.gravity_capacity / 9.80665)
    assert 'no gauge sees' in told.note


@pytest.mark.parametrize('count', [0, 1, 2])
@pytest.mark.parametrize('friction', [0.0, 0.4, 10.0])
@pytest.mark.parametrize('push', [0.0, 5.0])
@pytest.mark.parametrize('mass', [-1.0, 0.0, 0.1])
def test_bad_input_has_a_stated_answer(count, friction, push, mass):
    point = np.array([[0.03, 0, 0], [-0.03, 0, 0]])[:count]
    grasp = contacts(point, -point / 0.03, push, friction, 1e-3)
    told = measure(grasp, Held(np.zeros(3)), Task(mass=mass), _doubt(count))
    for value in told.to_json().values():
        if isinstance(value, float):
            assert np.isfinite(value)
    if count < 2 or friction == 0.0:
        assert not told.closed and told.why
    if mass < 0.0:
        assert told.window.limit == 'mass below zero' and not told.window.open
    if push == 0.0 or count == 0:
        assert told.gravity_capacity == 0.0


def test_coincident_contacts_hold_nothing():
    grasp = contacts(np.full((3, 3), 0.01), -np.eye(3), 5.0, 0.5, 1e-3)
    told = measure(grasp, Held(np.zeros(3)), Task(mass=0.1), _doubt(3))
    assert not told.closed
    assert 'in one place' in told.why


def test_one_pin_alone_gives_an_object_no_stiffness():
    ball = _straight()
    state = replace(ball.states[1], force=np.array([5.0, 0.0]))
    grasp = replace(ball.grasp(1), push=state.force)
    found = read_response(ball.solver, ball.pins, state, grasp)
    assert found.sharing is None and found.compliance is None


def test_a_contact_without_push_slips_at_once():
    ball = _straight()
    grasp = replace(ball.grasp(1), push=np.array([0.0, 5.0]))
    found = read_response(ball.solver, ball.pins, ball.states[1], ball.grasp(1))
    factor, contact, _ = first_slips(grasp, found.sharing, np.eye(6)[:3])
    assert np.all(factor == 0.0)
    assert np.all(contact == 0)
