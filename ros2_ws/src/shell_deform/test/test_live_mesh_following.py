# SPDX-License-Identifier: Apache-2.0
"""The mesh goes where the fingers rest: when it is asked for, and how coarse it is said to be."""

from types import SimpleNamespace

import live_hand
import numpy as np
import pytest

from shell_deform.building import build_model
from shell_deform.contact.finger_bodies import read_finger_bodies
from shell_deform.live.background.coarseness import coarseness
from shell_deform.live.background.contact_tracking import Touch
from shell_deform.live.background.fingers import laid
from shell_deform.live.background.load_case import load_of
from shell_deform.live.background.worker import build, share
from shell_deform.live.background.worker_link import empty_request
from shell_deform.live.pose import IDENTITY
from shell_deform.live.tick.estimator import Estimator
from shell_deform.live.tick.finger_path import FingerPath
from shell_deform.live.tick.first_touch import FirstTouch
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.mesh_following import (
    COARSE,
    COARSE_UNDER_BODIES,
    REST_S,
    MeshFollower,
)
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


def contacts(*places, share=0.1, carries=False):
    return SimpleNamespace(
        places=np.array(places, float),
        coarseness=np.full(len(places), float(share)),
        carries=carries,
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


def test_a_body_asks_for_a_mesh_where_the_one_at_hand_is_not_made_for_it():
    bodies = read_finger_bodies('barrett_fingertip')
    carried, ball = bodies.loaded()[0], load_object('tennis_ball')
    axis = np.array([0.6, 0.0, 0.8])

    def resting(model):
        touches = [
            Touch(k + 1, 0.0325 * side * axis, -side * axis, 7.5e-3, 5.0, 0.0, np.nan)
            for k, side in enumerate((1.0, -1.0))
        ]
        fingers = [laid(model, model.start, touch, carried, 0.4) for touch in touches]
        places = [finger.contact.point for finger in fingers]
        found = contacts(*places, carries=True)
        found.coarseness[:] = [finger.coarseness for finger in fingers]
        return found

    elsewhere = resting(build_model(bodies.on(ball)))
    assert elsewhere.coarseness.max() > COARSE_UNDER_BODIES
    follower = MeshFollower()
    follower.look(elsewhere, 7.5e-3, 0.0)
    places = follower.look(elsewhere, 7.5e-3, 2.0 * REST_S)
    there = resting(build_model(bodies.touching(ball, places)))
    assert there.coarseness.max() < COARSE_UNDER_BODIES
    assert MeshFollower().look(there, 7.5e-3, 9.0) is None


class Process:
    """A background process in this one: every load case is answered when it is posted."""

    def __init__(self, **options):
        given = {'object': 'tennis_ball', 'theory': 'koiter', 'bodies': 'barrett_fingertip'}
        self.solver = build({**given, 'control_vertices': 250, **options})
        self.solver.warm_up()
        self.memory, _ = share(self.solver)
        self.rest, self.given, self.answered, self._seen = self.solver.rest_shell(), [], 0, 0

    def post(self, request):
        self.given.append(int(request[0]['stamp']))
        self.answered = len(self.given)
        self.solver.take(load_of(request[0]))
        index = self.memory.free_slot()
        self.solver.fill(self.memory.slots[index])
        self.memory.publish(index, self.answered)
        return self.answered

    def newer_result(self):
        if self._seen == self.answered:
            return None
        self._seen = self.answered
        return self.memory.take()

    def handed_over(self):
        rest, self.rest = self.rest, None
        return rest


class Link:
    """What the node keeps of its background processes."""

    def __init__(self):
        self.worker, self.candidate = Process(), None

    def grade(self, places, radius, curl):
        self.candidate = Process(refine_at=places.tolist(), refine_radius=radius, curl=curl)

    def tend_candidate(self):
        return ''

    def drop_candidate(self):
        self.candidate = None


@pytest.mark.soak
def test_a_mesh_made_for_where_the_tips_rest_knows_what_they_hold_by_friction():
    link, path, follower = Link(), FingerPath('barrett_fingertip', 1e-4), MeshFollower()
    memory = link.worker.memory
    estimator = Estimator(memory.rest, memory.rest_normals, live_hand.Settings(live_hand.SURE))
    estimator.pose, estimator.first_touch = IDENTITY, FirstTouch(link.worker.handed_over())
    request = empty_request()

    def sent(number, depth, turn):
        estimator.tick(live_hand.tips_aside(number, depth, turn))
        path.take(estimator, request, link.worker, 0.4)
        while not path.feed(link.worker):
            pass
        if (slot := link.worker.newer_result()) is not None:
            estimator.adopt(slot)
        return follower.follow(link, estimator, path, 0.1 * number)

    way = live_hand.TIPS_WAY
    found, number = None, 0
    while found is None:
        number += 1
        assert number < 200
        found = sent(number, *way[min(number, len(way)) - 1])
    assert link.candidate.given == link.worker.given
    slot, _ = found
    before, after = estimator.adopted, slot.record
    assert after['coarseness'][:2].max() < COARSE_UNDER_BODIES < before.coarseness.max()
    # The mesh elsewhere was too stiff by what it said of itself.
    too_stiff = before.response.force / after['force'][:2] - 1.0
    assert (too_stiff > 0.1).all()
    assert (too_stiff < 1.5 * before.coarseness).all()
    # Nothing begins anew: what the turn had wound up by friction still is.
    wound = after['spin'][:2] / before.spin
    assert ((wound > 0.5) & (wound < 1.5)).all()
    assert after['stamp'] == before.stamp
