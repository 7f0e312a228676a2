# SPDX-License-Identifier: Apache-2.0
"""The tick that sees a contact first answers it, before any equilibrium knows it."""

import math
import time
from dataclasses import replace

import live_hand
import numpy as np
import pytest
from live_hand import SURE

from shell_deform.live.background.rest_shell import packed, unpacked
from shell_deform.live.pose import Pose, rotation_of
from shell_deform.live.tick.first_touch import FirstTouch, bent
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.linearity import linear_error, softened_depth
from shell_deform.solve.equilibrium import forced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.gas import Gas

R, H = 31.25e-3, 2.5e-3
OUTER = R + 0.5 * H


@pytest.fixture(scope='module')
def model(sphere):
    return sphere(R, H, subdivisions=2, young=12.75e6, gas=Gas('sealed'))


def directions(count, seed=1):
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1)[:, None]


def grip(direction, force, travel=None, **options):
    """Two fingers that press towards each other along `direction` (3,)."""
    points = OUTER * np.array([direction, -direction])
    return live_hand.sample(
        points, -points / OUTER, [force, force], travel, radius=3e-3, **options
    )


def test_bending_is_the_curl_times_the_square_of_what_the_forces_move():
    rng = np.random.default_rng(3)
    compliance, force = rng.normal(size=(4, 4)), rng.normal(size=4)
    first, second = np.triu_indices(4)
    found = bent(compliance, 0.7) @ (force[first] * force[second])
    assert found == pytest.approx(0.7 * (compliance @ force) ** 2)


def truth(model, direction, force):
    """Equilibrium of that grip: dents (2,) [m] and the surface (n, 3)."""
    pins = tuple(model.contact(side * R * direction, 3e-3) for side in (1, -1))
    state = EquilibriumSolver(model).solve(forced(pins, [force, force]))
    return state.displacement, model.surface.limit_positions(state.positions)


def along_normal(estimator, served, surface):
    """Distance along the normal (n,) of what is served from a surface [m]."""
    away = served.packed[:, :3] - surface
    return np.abs(np.einsum('ni,ni->n', away, estimator.rest_normals))


@pytest.mark.parametrize('direction', directions(4))
def test_a_small_first_touch_anywhere_is_answered_in_its_own_tick(model, direction):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='force'))
    dent, surface = truth(model, direction, 0.5)
    served = pipeline.tick(grip(direction, 0.5))
    assert served.displacement == pytest.approx(dent, rel=0.05)
    assert np.linalg.norm(served.packed[:, :3] - surface, axis=1).max() < 0.05 * dent.max()


@pytest.mark.parametrize('force', [1.0, 8.0, 16.0])
@pytest.mark.parametrize('known', ['force', 'motion'])
def test_what_linear_theory_misses_at_first_touch_is_in_its_sigma(model, force, known):
    for direction in directions(3, seed=2):
        dent, surface = truth(model, direction, force)
        pipeline = live_hand.pipeline(model, replace(SURE, drive='fused'))
        served = pipeline.tick(grip(direction, force, dent if known == 'motion' else None))
        wrong = along_normal(pipeline.estimator, served, surface)
        assert (wrong < 1.5 * served.packed[:, 7]).all()


def test_a_travel_that_is_known_at_first_touch_is_believed_before_linear_stiffness(model):
    direction = directions(1)[0]
    dent, _ = truth(model, direction, 16.0)
    served = live_hand.pipeline(model, ErrorModel()).tick(grip(direction, 16.0, dent))
    assert served.displacement == pytest.approx(dent, rel=0.05)


def test_until_the_first_equilibrium_the_answer_says_that_it_is_taking_up(model):
    pipeline = live_hand.pipeline(model)
    sample = grip(directions(1)[0], 2.0)
    served = pipeline.tick(sample)
    assert served.taking_up and served.answer == 'taking up'
    assert served.unknown == (1, 2)
    assert math.isnan(served.nonlinear_age)
    pipeline.refresh()
    served = pipeline.tick(replace(sample, stamp=sample.stamp + 10_000_000))
    assert not served.taking_up and served.answer == 'nonlinear'
    assert served.nonlinear_age == pytest.approx(0.01)


def test_nothing_pressed_is_no_taking_up(model):
    served = live_hand.pipeline(model).tick(grip(directions(1)[0], 1.0, flags=0))
    assert served.answer == 'at rest'
    assert served.nonlinear_age == 0.0


def test_without_the_shell_at_rest_the_dent_of_a_contact_is_unknown_and_in_sigma(model):
    pipeline = live_hand.pipeline(model)
    pipeline.estimator.first_touch = None
    served = pipeline.tick(grip(directions(1)[0], 5.0, [1e-3, 1e-3]))
    assert served.max_displacement == 0.0
    assert served.packed[:, 7].min() == pytest.approx(1e-3)
    assert served.taking_up and math.isnan(served.nonlinear_age)


def test_a_finger_that_joins_a_grasp_is_answered_in_its_own_tick(model):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='force'))
    x, y = np.eye(3)[0], np.eye(3)[1]
    pipeline.settle(grip(x, 6.0))
    points = OUTER * np.array([x, -x, y])
    joined = live_hand.sample(points, -points / OUTER, [6.0, 6.0, 2.0], radius=3e-3)
    served = pipeline.tick(joined)
    assert served.unknown == (3,)
    first = served.packed.copy()
    settled = pipeline.settle(joined)
    assert settled.unknown == ()
    at = np.argmin(np.linalg.norm(pipeline.estimator.rest - R * y, axis=1))
    assert first[at, 6] == pytest.approx(settled.packed[at, 6], rel=0.4)
    wrong = np.linalg.norm(first[:, :3] - settled.packed[:, :3], axis=1)
    assert (wrong < 2.0 * first[:, 7] + 2e-5).mean() > 0.95


def test_a_finger_that_jumps_elsewhere_under_its_number_is_a_new_contact(model):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='force'))
    pipeline.settle(grip(np.eye(3)[0], 8.0))
    served = pipeline.tick(grip(np.eye(3)[1], 1.0))
    assert served.taking_up
    dent, _ = truth(model, np.eye(3)[1], 1.0)
    assert served.displacement == pytest.approx(dent, rel=0.1)


def test_contacts_whose_equilibrium_is_never_found_stay_answered_by_linear_theory(model):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='force'))
    pipeline.solver.tracker.advance = lambda target, tangents: 0.0
    contacts = grip(directions(1)[0], 2.0)
    first = pipeline.tick(contacts).max_displacement
    pipeline.refresh()
    served = pipeline.tick(contacts)
    assert served.taking_up
    assert served.max_displacement == pytest.approx(first)


def test_points_far_from_the_object_do_no_harm(model):
    pipeline = live_hand.pipeline(model)
    points = np.array([[5.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    sample = live_hand.sample(points, [[-1.0, 0, 0], [1.0, 0, 0]], [5.0, 5.0], radius=3e-3)
    assert np.isfinite(pipeline.tick(sample).packed).all()


def test_the_shell_at_rest_survives_its_way_through_shared_memory(model):
    pipeline = live_hand.pipeline(model)
    there = FirstTouch(unpacked(packed(pipeline.solver.rest_shell())))
    pose = Pose(rotation_of(np.array([0.1, 0.2, 0.3])), np.array([0.01, 0.0, 0.02]))
    contacts = grip(directions(1)[0], 1.0)
    moved = replace(
        contacts,
        point=pose.from_object(contacts.point),
        normal=contacts.normal @ pose.rotation.T,
    )
    here = pipeline.estimator.first_touch.answer(contacts, Pose(np.eye(3), np.zeros(3)))
    found = there.answer(moved, pose)
    np.testing.assert_allclose(found.compliance, here.compliance, rtol=1e-9)
    np.testing.assert_allclose(found.columns, here.columns, atol=1e-12)


def test_the_columns_are_solved_once_and_then_kept_while_the_fingers_stay(model):
    first = live_hand.pipeline(model).estimator.first_touch
    direction, here = directions(1)[0], Pose(np.eye(3), np.zeros(3))
    answer = first.answer(grip(direction, 1.0), here)
    assert first.answer(grip(direction, 5.0), here) is answer
    begun = time.perf_counter()
    for _ in range(10):
        first.answer(grip(direction, 5.0), here)
    assert time.perf_counter() - begun < 0.1


def test_the_softened_depth_obeys_the_stiffness_it_is_made_of():
    compliance, second = np.array([[2e-4]]), np.array([[8e-6]])
    for force in (0.1, 2.0, 5.0):
        depth = softened_depth(compliance, second, np.array([force]))
        share = linear_error(compliance, second, np.array([force]), np.array([depth]))
        assert depth * (1.0 - share) == pytest.approx(2e-4 * force, rel=1e-9)


def test_a_finger_that_joins_while_the_others_have_nearly_let_go_is_answered(model):
    pipeline = live_hand.pipeline(model)
    points = OUTER * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

    def held(fingers, force, travel):
        return live_hand.sample(
            points[:fingers], -points[:fingers] / OUTER, [force] * fingers, [travel] * fingers
        )

    pipeline.settle(held(2, 8.0, 1.5e-3))
    served = pipeline.tick(held(3, 0.2, 4e-5))
    assert served.unknown == (3,)
    assert np.isfinite(served.packed).all()
