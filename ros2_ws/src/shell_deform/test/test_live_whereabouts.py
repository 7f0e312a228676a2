# SPDX-License-Identifier: Apache-2.0
"""What doubt about the fingers' places says of object and dents, beside drawn fingers."""

from __future__ import annotations

from dataclasses import replace

import live_hand
import numpy as np
import pytest

from shell_deform.building import build_model
from shell_deform.live.background.shear_dent import ShearDent
from shell_deform.live.tick.contact_cloud import ContactReader
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.live.tick.whereabouts import point_sigma, whereabouts
from shell_deform.objects import load_object

RADIUS, SIGMA = 0.03, 5e-4


def around(count):
    """Points (k, 3) around a ball's equator and its inward normals."""
    angle = 2.0 * np.pi * np.arange(count) / count
    outward = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return RADIUS * outward, -outward


def told(points, normals, sigma, by_fingers=True):
    return whereabouts(np.arange(len(points)), points, normals, sigma, by_fingers)


def test_two_opposed_fingers_shift_and_turn_what_they_hold():
    known = told(*around(2), np.full(2, SIGMA))
    covariance = known.pose_root @ known.pose_root.T
    shift, turn = np.sqrt(np.diag(covariance)).reshape(2, 3)
    assert shift == pytest.approx(np.full(3, SIGMA / np.sqrt(2.0)))
    # No point tells a turn about the line between them.
    assert turn == pytest.approx([0.0, *np.full(2, SIGMA / (np.sqrt(2.0) * RADIUS))])
    assert known.along_surface == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('count', [3, 4, 6])
def test_more_fingers_are_off_as_drawn_ones_are(count):
    points, normals = around(count)
    points[0, 2] += 0.4 * RADIUS
    sigma = SIGMA * np.linspace(0.5, 1.5, count)
    known = told(points, normals, sigma)
    rows = np.concatenate([np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3, 3))], axis=2)
    for axis in range(3):
        rows[:, :, 3 + axis] = np.cross(np.eye(3)[axis], points)
    off = sigma[:, None] * np.random.default_rng(7).normal(size=(20000, count, 3))
    weight = (1.0 / sigma).repeat(3)
    fitted = np.linalg.lstsq(
        rows.reshape(-1, 6) * weight[:, None], (off.reshape(len(off), -1) * weight).T, rcond=None
    )[0]
    covariance = known.pose_root @ known.pose_root.T
    drawn = np.cov(fitted)
    scale = np.sqrt(np.diag(drawn))
    assert covariance / np.outer(scale, scale) == pytest.approx(
        drawn / np.outer(scale, scale), abs=0.04
    )
    left = off - (rows.reshape(-1, 6) @ fitted).T.reshape(off.shape)
    along = left - np.einsum('dki,ki->dk', left, normals)[:, :, None] * normals
    spread = np.sqrt(0.5 * np.mean(np.sum(along**2, axis=2), axis=0))
    assert known.along_surface == pytest.approx(spread, rel=0.04)


@pytest.mark.parametrize(('count', 'by_fingers'), [(1, True), (3, False)])
def test_a_pose_that_no_fingers_tell_leaves_all_of_it_to_the_dents(count, by_fingers):
    known = told(*around(count), np.full(count, SIGMA), by_fingers)
    assert known.pose_root.shape == (6, 0)
    assert known.along_surface == pytest.approx(SIGMA)


@pytest.mark.parametrize('second', [[0.03, 1e-4, 0.0], [0.03, 0.0, 0.0]])
def test_fingers_in_one_place_tell_no_turn(second):
    points = np.array([[0.03, 0.0, 0.0], second])
    known = told(points, -np.eye(3)[[0, 0]], np.full(2, SIGMA))
    worst = np.linalg.norm(known.pose_root[3:], axis=0).max() * RADIUS
    assert np.isfinite(known.pose_root).all() and worst < 2.0 * SIGMA


@pytest.mark.parametrize('odd', [np.nan, np.inf, -1.0])
def test_a_sigma_that_is_none_counts_as_not_told(odd):
    sample = live_hand.opposed([1.0, 1.0])
    assert point_sigma(sample).tolist() == [0.0, 0.0]
    sample = replace(sample, sigma_point=np.array([odd, SIGMA]))
    assert point_sigma(sample).tolist() == [0.0, SIGMA]
    known = whereabouts(sample.finger, sample.point, sample.normal, point_sigma(sample), True)
    assert known.pose_root.shape == (6, 0)


def test_the_sigma_of_the_points_comes_from_the_hand():
    sample = replace(live_hand.opposed([1.0, 1.0]), sigma_point=np.array([3e-4, np.nan]))
    read = ContactReader().read(live_hand.cloud(sample), 1)
    assert read.sigma_point == pytest.approx([3e-4, np.nan], rel=1e-6, nan_ok=True)
    assert np.isnan(live_hand.opposed([1.0, 1.0]).sigma_point).all()


@pytest.fixture(scope='module')
def squeezed():
    """What is served of a dent of 2 mm, packed, and the angle its wall has turned by; by options.

    The pins lie on the x axis of a ball.
    """
    model = build_model(load_object('tennis_ball'), 'koiter', control_vertices=150)

    def served(sigma, from_fingers=True):
        settings = live_hand.Settings(live_hand.SURE, pose_from_fingers=from_fingers)
        live = Rehearsal(model, settings)
        sample = live_hand.opposed([5.0, 5.0], [2e-3, 2e-3], radius=1e-3)
        packed = live.settle(replace(sample, sigma_point=np.full(2, sigma))).packed.astype(float)
        adopted = live.estimator.adopted
        turned = np.cross(live.memory.rest_normals, adopted.normals)
        return packed, np.linalg.norm(turned, axis=1)

    with pytest.MonkeyPatch.context() as patched:
        # What a thin wall lacks of a solid would cover the rest.
        patched.setattr(ShearDent, 'travel', lambda _, force, radius: 0.0 * force)
        yield served


def test_a_pose_told_by_fingers_is_off_as_their_points_are(squeezed):
    (sure, turned), (packed, _) = squeezed(np.nan), squeezed(SIGMA)
    assert packed[:, :7] == pytest.approx(sure[:, :7], abs=1e-9)
    still = turned < 1e-2
    assert still.sum() > 20
    # A ball does not show that it turns; it shifts alike in every direction.
    shifted = np.hypot(sure[still, 7], SIGMA / np.sqrt(2.0))
    assert packed[still, 7] == pytest.approx(shifted, rel=0.03)


def test_where_something_else_tells_the_pose_a_dent_may_lie_elsewhere(squeezed):
    (sure, turned), (packed, _) = squeezed(np.nan), squeezed(SIGMA, from_fingers=False)
    assert packed[:, 7] == pytest.approx(np.hypot(sure[:, 7], SIGMA * np.sin(turned)), rel=0.05)
    assert packed[:, 7].max() > 1.3 * sure[:, 7].max() > packed[turned < 1e-3, 7].max()
