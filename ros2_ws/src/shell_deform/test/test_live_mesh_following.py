# SPDX-License-Identifier: Apache-2.0
"""The mesh goes where the fingers rest: when it is asked for, and how coarse it is said to be."""

from types import SimpleNamespace

import numpy as np
import pytest

from shell_deform.building import build_model
from shell_deform.live.background.coarseness import coarseness
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.mesh_following import COARSE, REST_S, MeshFollower
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import forced
from shell_deform.solve.newton import EquilibriumSolver

RADIUS = 1e-3
CONVERGED = 9.39e-3
"""Depth per finger at 20 N on a mesh of 6 000 vertices [m]."""

AXES = np.array([[0.0, 0, 1], [0.6, 0.0, 0.8], [-0.48, 0.6, 0.64]])


@pytest.fixture(scope='module')
def ball():
    return load_object('tennis_ball')


@pytest.fixture(scope='module')
def model(ball):
    return build_model(ball)


def depth(model, axis):
    """Mean depth [m] of two opposed pins at 20 N, and the coarseness under them."""
    pins = tuple(model.contact(side * 31.25e-3 * axis, RADIUS) for side in (1, -1))
    state = EquilibriumSolver(model).solve(forced(pins, [20.0, 20.0]))
    wall = float(model.shell.thickness.mean())
    return state.displacement, max(coarseness_under(model, wall, pin) for pin in pins)


def coarseness_under(model, wall, pin):
    place = model.surface.closest_point(model.rest, pin.point[None])
    middle = model.surface.evaluate(model.rest, place.triangle, place.parameters)
    return coarseness(model.surface.mesh, wall, int(place.triangle[0]), middle)


@pytest.mark.parametrize('axis', AXES)
def test_a_mesh_graded_where_the_pins_are_is_within_half_a_percent_of_the_converged_depth(
    ball, axis
):
    graded = build_model(ball, refine_at=0.0325 * np.array([axis, -axis]), refine_radius=RADIUS)
    found, left = depth(graded, axis)
    assert found == pytest.approx([CONVERGED] * 2, rel=5e-3)
    assert left < COARSE
    assert len(graded.rest) <= 700


@pytest.mark.parametrize('axis', AXES)
def test_the_stiffness_error_of_a_mesh_graded_elsewhere_covers_what_its_dents_lack(model, axis):
    found, share = depth(model, axis)
    lacking = 1.0 - found.min() / CONVERGED
    assert share > COARSE
    # at 20 N the dent grows about half again as fast as the push
    assert lacking < 2.0 * share


def test_sigma_holds_the_coarseness_of_the_mesh_as_a_stiffness_error():
    errors = ErrorModel(model=0.03)
    assert errors.on_mesh(np.array([0.0, 0.04])).model == pytest.approx(0.05)
    assert errors.on_mesh(np.zeros(0)).model == pytest.approx(0.03)


def contacts(*places, share=0.1):
    return SimpleNamespace(
        places=np.array(places, float), coarseness=np.full(len(places), float(share))
    )


RIGHT, UP = contacts([0.03, 0, 0], [-0.03, 0, 0]), contacts([0, 0, 0.03], [0, 0, -0.03])


def test_a_new_mesh_is_asked_for_once_when_contacts_rest_on_a_coarse_one():
    follower = MeshFollower()
    assert follower.look(RIGHT, RADIUS, 0.0) is None
    assert follower.look(RIGHT, RADIUS, 0.5 * REST_S) is None
    asked = follower.look(RIGHT, RADIUS, 1.1 * REST_S)
    np.testing.assert_array_equal(asked, RIGHT.places)
    assert follower.look(RIGHT, RADIUS, 3.0 * REST_S) is None


def test_contacts_that_move_on_or_rest_on_a_fine_mesh_ask_for_nothing():
    follower = MeshFollower()
    for i in range(20):
        sliding = contacts([0.03, 1e-3 * i, 0], [-0.03, 1e-3 * i, 0])
        assert follower.look(sliding, RADIUS, 0.2 * i) is None
    fine = contacts(*RIGHT.places, share=0.5 * COARSE)
    for i in range(20):
        assert follower.look(fine, RADIUS, 10.0 + i) is None


def test_fingers_that_come_back_to_a_place_of_before_are_followed_again():
    follower, now = MeshFollower(), 0.0
    for where in (RIGHT, UP, RIGHT):
        follower.look(where, RADIUS, now)
        now += 2.0 * REST_S
        assert follower.look(where, RADIUS, now) is not None
        now += 1.0
