# SPDX-License-Identifier: Apache-2.0
"""Fingers that do not rub: nothing holds what they press sideways."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest

from grasp_common.parameter_table import ParameterError
from shell_deform.building import build_model, object_contacts
from shell_deform.live.tick.estimator import Settings
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.node.parameters import validate
from shell_deform.objects import ShellObject, Support
from shell_deform.objects.shell_object import Cone, Contact, Sphere
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

RADIUS = 6e-3
TRAVEL = 2e-3
ANGLES = np.radians([75.0, -75.0])
SIDES = np.stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(2)], axis=1)


@pytest.fixture(scope='module')
def cup():
    """A clamped cup that two pins press 150 degrees apart: its wall draws them together."""
    places = 0.036 * SIDES + np.array([0.0, 0.0, 0.02])
    return ShellObject(
        'cup',
        Cone((0.06, 0.075), 0.08),
        1e-3,
        1e9,
        0.35,
        supports=(Support('clamped', 'lower'),),
        contacts=tuple(Contact(tuple(place.tolist()), RADIUS, 'pin') for place in places),
        control_vertices=150,
    )


@pytest.fixture(scope='module', params=['koiter', 'thick'])
def pressed(request, cup):
    """The cup, the sample of two pins on it, and its wall with them held and sliding."""
    model = build_model(cup, request.param)
    pins = object_contacts(cup, model, RADIUS)
    solver, found = EquilibriumSolver(model), {}
    for held in (True, False):
        # The other way to say so: a load case that holds none of its contacts.
        state = solver.solve(replace(displaced(pins, [TRAVEL, TRAVEL]), held=held))
        assert state.converged
        found[held] = state.force, model.surface.limit_positions(state.positions)
    axes = np.array([pin.axis for pin in pins])
    outer = np.array([pin.point for pin in pins]) - 0.5 * cup.thickness_m * axes
    sample = live_hand.sample(outer, axes, found[False][0], [TRAVEL] * 2, radius=RADIUS)
    return model, sample, found


def live(model, sample, pins_slide):
    hand = Settings(replace(live_hand.SURE, drive='motion'))
    played = Rehearsal(model, hand, pins_slide=pins_slide)
    return played, played.settle(sample, rounds=4).packed[:, :3].copy()


@pytest.fixture(scope='module')
def served(pressed):
    """What plays the cup, and the surface that it serves, by whether pins slide."""
    model, sample, _ = pressed
    return {slide: live(model, sample, slide) for slide in (True, False)}


def test_a_wall_under_pins_that_slide_is_where_it_is_without_held_pins(pressed, served):
    sliding, held = (pressed[2][holds][1] for holds in (False, True))
    away = np.linalg.norm(held - sliding, axis=1).max()
    assert away > 0.1 * TRAVEL
    assert np.linalg.norm(served[True][1] - sliding, axis=1).max() < 0.02 * away
    assert np.linalg.norm(served[False][1] - held, axis=1).max() < 0.02 * away


def test_pins_of_an_object_slide_where_they_are_said_to(cup, pressed):
    model, _, found = pressed
    sliding = object_contacts(cup, model, RADIUS, pins_slide=True)
    state = EquilibriumSolver(model).solve(displaced(sliding, [TRAVEL, TRAVEL]))
    assert state.force == pytest.approx(found[False][0], rel=1e-6)
    assert not np.isclose(state.force, found[True][0], rtol=0.02).any()


def test_pins_that_slide_bear_no_lateral_force(pressed, served):
    for slide, (played, _) in served.items():
        response = played.estimator.adopted.response
        assert response.force == pytest.approx(pressed[2][not slide][0], rel=5e-3)
        across = np.abs(response.reaction).max()
        assert across == 0.0 if slide else across > 0.05 * response.force.max()


def test_a_small_step_under_pins_that_slide_is_carried_by_the_tangent(cup, pressed, served):
    model, sample, _ = pressed
    pins = object_contacts(cup, model, RADIUS, pins_slide=True)
    way = 0.05 * TRAVEL
    further = replace(
        sample, stamp=2, travel=sample.travel + way, point=sample.point + way * sample.normal
    )
    state = EquilibriumSolver(model).solve(displaced(pins, [TRAVEL + way] * 2))
    expected = model.surface.limit_positions(state.positions)
    now = served[True][0].tick(further).packed[:, :3]
    assert np.linalg.norm(now - expected, axis=1).max() < 0.1 * way


def test_a_free_ball_between_opposite_pins_does_not_care_whether_they_slide():
    ball = ShellObject('ball', Sphere(0.065), 2.5e-3, 1e6, 0.4)
    model = build_model(ball, control_vertices=200, refine_at=[])
    sample = live_hand.opposed([1.0, 1.0], [3e-3, 3e-3], radius=4e-3)
    _, held = live(model, sample, pins_slide=False)
    _, sliding = live(model, sample, pins_slide=True)
    assert np.linalg.norm(held - sliding, axis=1).max() < 1e-5


def test_fingers_that_carry_bodies_slide_by_their_friction():
    with pytest.raises(ParameterError, match='take friction 0'):
        validate({'pins_slide': True, 'finger_body': 'barrett_fingertip'})
    validate({'pins_slide': True})
