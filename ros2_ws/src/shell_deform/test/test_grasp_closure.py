# SPDX-License-Identifier: Apache-2.0
"""Force closure: closed forms, brute force, sensitivities and the probability of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grasp_sets import closed_by_edges, leaning_pins, random_grasp, three_pins, two_pads
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from shell_deform.grasp.closure import STEEPEST, closure
from shell_deform.grasp.contacts import GraspError, contacts
from shell_deform.grasp.probability import (
    DRAWS,
    Sigmas,
    both_below,
    closure_probability,
    closure_sigma,
    share_within,
)
from shell_deform.live.tick.grasp_draws import EVERY, ClosureDraws


@pytest.mark.parametrize('degrees', [5.0, 15.0, 25.0, 40.0])
def test_two_pins_need_the_angle_between_their_line_and_their_normals(degrees):
    grasp = leaning_pins(np.radians(degrees), 0.3, arm=1e-6)
    found = closure(grasp)
    assert found.needed_friction(grasp) == pytest.approx(np.tan(np.radians(degrees)), rel=1e-5)
    assert found.closed == (np.tan(np.radians(degrees)) < 0.3)


def test_two_points_never_resist_a_turn_about_their_line():
    found = closure(leaning_pins(0.1, 0.8, arm=0.0))
    assert not found.closed
    assert 'turn about the line' in found.why
    assert found.needed == pytest.approx(np.tan(0.1) / 0.8, rel=1e-6)


def test_pins_face_to_face_need_no_friction():
    assert closure(two_pads(0.3)).needed < 1e-9
    assert closure(three_pins(0.3)).needed < 1e-9
    assert closure(three_pins(0.3)).closed


@pytest.mark.parametrize(
    ('grasp', 'why'),
    [
        (contacts(np.zeros((0, 3)), np.zeros((0, 3)), 1.0, 0.5), 'no contact'),
        (contacts(np.zeros((1, 3)), np.eye(3)[:1], 1.0, 0.5), 'one contact holds nothing'),
        (contacts(np.ones((2, 3)), np.eye(3)[[0, 0]], 1.0, 0.5, 1e-3), 'in one place'),
        (two_pads(0.0), 'without friction'),
        (
            contacts(0.03 * np.eye(3)[:2], np.array([[-0.6, 0.0, -0.8]] * 2), 5.0, 0.5, 1e-3),
            'cannot balance a squeeze',
        ),
    ],
)
def test_what_cannot_close_says_why(grasp, why):
    found = closure(grasp)
    assert not found.closed
    assert why in found.why
    assert np.isfinite(found.needed)
    assert closure_probability(grasp, found, _sigmas(grasp.count)) == 0.0


def test_a_friction_of_ten_closes_what_faces():
    assert closure(leaning_pins(0.6, 10.0)).closed
    assert not closure(leaning_pins(1.5, 10.0)).closed


def test_impossible_numbers_are_named():
    with pytest.raises(GraspError, match='friction'):
        two_pads(-0.1)
    with pytest.raises(GraspError, match='push of a contact is'):
        two_pads(0.3, push=np.nan)


def test_two_points_do_not_close_for_a_third_that_cannot_press():
    """Whatever the first two could do alone: the third lies outside its cone at any push.

    Balanced forces of three points lie in the plane through them; the third normal leans out of
    it by 40 degrees.
    """
    lean = np.radians(40.0)
    grasp = three_pins(0.7)
    normal = grasp.normal.copy()
    normal[:2] = np.array([[-np.sqrt(0.75), 0.5, 0.0], [np.sqrt(0.75), -0.5, 0.0]])
    normal[2] = np.cos(lean) * normal[2] + [0.0, 0.0, np.sin(lean)]
    found = closure(contacts(grasp.point, normal, 10.0, 0.7))
    assert not found.closed
    assert 0.7 * found.needed == pytest.approx(np.tan(lean), rel=1e-5)
    assert closure(contacts(grasp.point, normal, 10.0, 0.85)).closed
    assert closure(contacts(grasp.point, normal, 10.0, 0.7), 0.3).needed == pytest.approx(
        found.needed, rel=1e-5
    )


def _agreement(count, edges, seed):
    rng = np.random.default_rng(seed)
    right, far = 0, []
    for _ in range(count):
        grasp = random_grasp(rng, int(rng.integers(3, 6)), rng.uniform(0.1, 1.2), arm=0.0)
        found = closure(grasp)
        if found.closed == closed_by_edges(grasp, edges):
            right += 1
        else:
            far.append(abs(found.needed - 1.0))
    return right / count, max(far, default=0.0)


def test_brute_force_over_cone_edges_finds_the_same_grasps_closed():
    share, farthest = _agreement(150, 180, 1)
    assert share >= 0.99
    assert farthest < 1.0 - np.cos(np.pi / 180) + 1e-6


@pytest.mark.soak
@pytest.mark.timeout(3000)
def test_brute_force_over_cone_edges_on_ten_thousand_grasps():
    share, farthest = _agreement(10_000, 720, 2)
    assert share >= 0.995
    assert farthest < 1.0 - np.cos(np.pi / 720) + 1e-6


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 5))
def test_neither_frame_nor_order_nor_size_changes_the_needed_friction(seed, count):
    rng = np.random.default_rng(seed)
    grasp = random_grasp(rng, count, 0.5)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    order = rng.permutation(count)
    other = contacts(
        (5.0 * grasp.point @ turn.T + rng.normal(size=3))[order],
        (grasp.normal @ turn.T)[order],
        grasp.push,
        0.5,
        5.0 * grasp.arm,
    )
    one, two = closure(grasp).needed, closure(other).needed
    assert two == pytest.approx(one, rel=1e-5, abs=1e-5)


def test_a_guess_saves_time_and_changes_nothing():
    rng = np.random.default_rng(12)
    for _ in range(40):
        grasp = random_grasp(rng, int(rng.integers(2, 6)), 0.5)
        alone = closure(grasp)
        for guess in (alone.needed, 1.1 * alone.needed, 0.7 * alone.needed):
            found = closure(grasp, guess)
            assert found.needed == pytest.approx(alone.needed, rel=1e-5)
            assert found.closed == alone.closed


def test_the_sensitivities_are_those_of_finite_differences():
    rng = np.random.default_rng(4)
    for count in (2, 3, 4):
        grasp = random_grasp(rng, count, 0.6)
        found = closure(grasp)
        while not len(found.squeeze) or found.needed > 0.5 * STEEPEST / 0.6:
            grasp = random_grasp(rng, count, 0.6)
            found = closure(grasp)
        point, normal = rng.normal(size=(2, count, 3))
        step = 1e-6
        values = []
        for side in (1.0, -1.0):
            turned = grasp.normal + side * step * np.cross(normal, grasp.normal)
            turned /= np.linalg.norm(turned, axis=1)[:, None]
            moved = contacts(
                grasp.point + side * step * 0.03 * point, turned, grasp.push, 0.6, grasp.arm
            )
            values.append(closure(moved).needed)
        expected = 0.03 * np.sum(found.by_point * point) + np.sum(found.by_normal * normal)
        assert (values[0] - values[1]) / (2.0 * step) == pytest.approx(expected, rel=2e-3)


def test_the_joint_probability_of_two_normal_variables():
    from scipy.stats import multivariate_normal

    for a, b, r in ((0.3, -0.5, 0.6), (1.0, 1.0, -0.8), (0.0, 0.0, 0.0), (-1.0, 2.0, 0.95)):
        expected = multivariate_normal.cdf([a, b], cov=[[1.0, r], [r, 1.0]])
        assert both_below(a, b, r) == pytest.approx(float(expected), abs=1e-4)


def _sigmas(count, turn=0.05, friction=0.1):
    return Sigmas(np.full(count, 1e-3), np.full(count, turn), friction)


def _near_the_edge(rng, count, sigmas):
    """A grasp near the edge of closure, and its closure."""
    while True:
        friction = rng.uniform(0.2, 0.9)
        lean = (0.35 if count == 2 else 0.5) * rng.normal(size=(count, 3))
        base = rng.normal(size=(count, 3))
        base /= np.linalg.norm(base, axis=1)[:, None]
        if count == 2:
            base = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
        elif count == 3:
            angle = np.radians([0.0, 120.0, 240.0]) + 0.3 * rng.normal(size=3)
            base = np.stack([np.cos(angle), np.sin(angle), 0.1 * rng.normal(size=3)], axis=1)
        normal = -base + lean
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        grasp = contacts(0.03 * base, normal, 10.0, friction, 1.3e-3)
        found = closure(grasp)
        if abs(found.needed - 1.0) < 3.0 * closure_sigma(grasp, found, sigmas):
            return grasp, found


def _drawn(rng, grasp, sigmas):
    """A grasp with errors of these sigmas."""
    turn = sigmas.normal[:, None] * rng.normal(size=(grasp.count, 3))
    turned = grasp.normal + np.cross(turn, grasp.normal)
    return contacts(
        grasp.point + sigmas.point[:, None] * rng.normal(size=(grasp.count, 3)),
        turned / np.linalg.norm(turned, axis=1)[:, None],
        10.0,
        np.maximum(grasp.friction * (1.0 + sigmas.friction * rng.normal()), 0.0),
        grasp.arm,
    )


def _calibration(grasps, draws, sigmas, seed):
    """Of ten bins of the probability: how far it is from the share of closed draws, and noise.

    Many draws of each grasp: with one, the noise of a bin is as large as the goal. Those that are
    all but sure, which are most, tell little of it and get an eighth of them.
    """
    rng, count = np.random.default_rng(seed), len(sigmas.point)
    told, true, noise = np.zeros((3, grasps))
    for i in range(grasps):
        grasp, found = _near_the_edge(rng, count, sigmas)
        told[i] = closure_probability(grasp, found, sigmas)
        own = draws if 0.05 < told[i] < 0.95 else -(-draws // 8)
        true[i] = np.mean([closure(_drawn(rng, grasp, sigmas)).closed for _ in range(own)])
        noise[i] = told[i] * (1.0 - told[i]) / own
    bins = np.minimum((10.0 * told).astype(int), 9)
    error = [(told - true)[bins == number] for number in range(10)]
    away = np.array([abs(here.sum()) / max(len(here), 1) for here in error])
    spread = [noise[bins == number] for number in range(10)]
    known = np.array([np.sqrt(here.sum()) / max(len(here), 1) for here in spread])
    print(count, np.round(away, 4).tolist(), np.round(known, 4).tolist())
    return away, known


@pytest.mark.parametrize('wobble', [0.02, 0.2])
@pytest.mark.parametrize('angle', [0.0, 0.1, 0.4, 1.3, 1.9])
def test_the_share_of_turned_normals_within_a_cone_is_that_of_draws(angle, wobble):
    rng, limit = np.random.default_rng(17), np.array([0.0, 0.05, 0.15, 0.45, 1.25, 1.5])
    turn = wobble * rng.normal(size=(2, 40_000))
    length = np.sqrt(1.0 + turn[0] ** 2 + turn[1] ** 2)
    away = np.arccos((np.cos(angle) + turn[0] * np.sin(angle)) / length)
    drawn = (away[:, None] < limit).mean(axis=0)
    noise = np.sqrt(drawn * (1.0 - drawn) / len(away))
    assert np.all(np.abs(share_within(angle, wobble, limit) - drawn) < 1e-3 + 4.0 * noise)


@pytest.mark.parametrize('lean', [0.0, 0.2])
def test_turns_across_the_angle_of_two_contacts_only_widen_it(lean):
    """Normals that turn by 0.1 rad about each axis: the angle itself, drawn."""
    rng, turn = np.random.default_rng(18), 0.1
    grasp = leaning_pins(lean, np.tan(0.25), arm=1e-6)
    sigmas = Sigmas(np.full(2, 1e-9), np.full(2, turn), 0.0)
    line = (grasp.point[1] - grasp.point[0]) / np.linalg.norm(grasp.point[1] - grasp.point[0])
    inside = np.ones(200_000, bool)
    for normal, towards in zip(grasp.normal, (line, -line), strict=True):
        drawn = normal + np.cross(turn * rng.normal(size=(200_000, 3)), normal)
        along = drawn @ towards / np.linalg.norm(drawn, axis=1)
        inside &= np.arccos(np.abs(along)) < 0.25
    told = closure_probability(grasp, closure(grasp), sigmas)
    assert told == pytest.approx(inside.mean(), abs=0.005)


@pytest.mark.parametrize('count', [2, 3, 4])
def test_the_probability_of_closure_is_kept_by_draws(count):
    grasps, draws = (200, 16) if count == 2 else (60, 40)
    away, noise = _calibration(grasps, draws, _sigmas(count), 5)
    assert np.all(away < 0.03 + 4.0 * noise)


@pytest.mark.parametrize(
    ('angles', 'height', 'friction', 'turn'),
    [
        ([0.0, 120.0, 240.0], 0.2, 0.25, 0.02),
        ([0.0, 120.0, 240.0], 0.2, 0.25, 0.1),
        ([0.0, 90.0, 180.0], 0.0, 0.25, 0.1),
        ([0.0, 90.0, 180.0, 270.0], 0.3, 0.5, 0.1),
    ],
)
def test_the_probability_of_grasps_alike_on_all_sides(angles, height, friction, turn):
    """What they need has a kink at the grasp itself: any turn of a normal makes it more."""
    turns = np.radians(angles)
    outward = np.stack([np.cos(turns), np.sin(turns), height + 0.0 * turns], axis=1)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    grasp = contacts(0.03 * outward, -outward, 10.0, friction, 1.3e-3)
    sigmas = Sigmas(np.full(len(turns), 1e-3), np.full(len(turns), turn), 0.2)
    told = closure_probability(grasp, closure(grasp), sigmas)
    rng = np.random.default_rng(7)
    drawn = np.mean([closure(_drawn(rng, grasp, sigmas)).closed for _ in range(400)])
    assert told == pytest.approx(drawn, abs=0.03 + 3.0 * np.sqrt(drawn * (1.0 - drawn) / 400.0))


def test_a_tick_tells_the_same_probability_a_draw_at_a_time():
    sigmas = _sigmas(4)
    grasp, found = _near_the_edge(np.random.default_rng(1), 4, sigmas)
    draws, told = ClosureDraws(), []
    for sample in range(EVERY * DRAWS + 1):
        # Another equilibrium every eight samples: draws go on, none is begun anew.
        found = found if sample % 8 else replace(found)
        told.append(draws.probability(grasp, found, sigmas, 'task'))
    far = (1.0 - found.needed) / closure_sigma(grasp, found, sigmas)
    assert told[0] == pytest.approx(ndtr(far))
    assert told[-1] == pytest.approx(closure_probability(grasp, found, sigmas), abs=1e-9)


@pytest.mark.soak
@pytest.mark.timeout(3000)
@pytest.mark.parametrize(('turn', 'friction'), [(0.05, 0.1), (0.2, 0.3)])
@pytest.mark.parametrize('count', [2, 3, 4, 5])
def test_the_probability_of_closure_is_kept_within_three_percent(count, turn, friction):
    away, _ = _calibration(2_000, 64, _sigmas(count, turn, friction), 6)
    assert np.all(away < 0.03)
