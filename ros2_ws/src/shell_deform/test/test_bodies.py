# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies: distances, their derivatives, poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.contact.bodies import (
    Body,
    BodyError,
    RoundBar,
    RoundedHull,
    ball,
    frame_of,
    plate,
    rod,
)
from shell_deform.contact.fingertip import Fingertip

TIP = Fingertip(0.0, 0.012, 0.02, ((0.1, 0.15), (0.008, 1.4)), 0.016, 0.02, 0.002)
SHAPES = {
    'fingertip': TIP,
    'flat bar': RoundBar(0.02),
    'capped bar': RoundBar(0.02, 1.0 / 0.03),
    'ball': ball(0.01),
    'rod': rod(0.005, 0.03),
    'plate': plate(0.02, 0.03, 0.002),
    'tetrahedron': RoundedHull(
        0.01 * np.array([[0, 0, 0], [1, 0, -1], [0, 1, -1], [-1, -1, -2]]), 0
    ),
}


@pytest.mark.parametrize('name', SHAPES)
def test_a_gradient_is_a_unit_vector_and_both_derivatives_are_those_of_the_value(name):
    shape = SHAPES[name]
    points = 0.02 * np.random.default_rng(3).normal(size=(500, 3)) + [0.0, 0.0, 0.01]
    here = shape.distance(points)
    # Far from a hull its bounding ball stands for it.
    outside = (here.value > 1e-5) & (np.linalg.norm(points, axis=1) < 1.9 * min(shape.size, 1.0))
    np.testing.assert_allclose(np.linalg.norm(here.normal[outside], axis=1), 1.0, atol=1e-12)
    step = 1e-7
    for i, direction in enumerate(np.eye(3) * step):
        up, down = shape.distance(points + direction), shape.distance(points - direction)
        slope = (up.value - down.value) / (2 * step)
        bend = (up.normal - down.normal) / (2 * step)
        off = np.abs(bend - here.hessian[:, i]).max(axis=1)
        assert np.mean(off[outside] < 1e-4 * np.abs(bend[outside]).max()) > 0.97
        np.testing.assert_allclose(slope[outside], here.normal[outside, i], atol=2e-4)


@given(st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_no_corner_of_a_hull_is_nearer_than_its_distance(seed):
    random = np.random.default_rng(seed)
    corners = random.normal(size=(random.integers(4, 30), 3))
    shape = RoundedHull(corners, 0.1)
    points = 2.0 * random.normal(size=(60, 3))
    found = shape.distance(points)
    nearest = np.linalg.norm(points[:, None] - corners, axis=2).min(axis=1) - 0.1
    assert np.all(found.value <= nearest + 1e-12)
    # Walking back along the gradient by the distance ends on the body.
    outside = (found.value > 1e-6) & (np.linalg.norm(points, axis=1) < 2.0 * shape.size)
    feet = points[outside] - found.value[outside, None] * found.normal[outside]
    np.testing.assert_allclose(shape.distance(feet).value, 0.0, atol=1e-9)


def test_a_ball_is_as_far_as_its_radius_says():
    points = np.random.default_rng(1).normal(size=(50, 3))
    expected = np.linalg.norm(points + [0.0, 0.0, 0.01], axis=1) - 0.01
    near = np.linalg.norm(points, axis=1) < 0.04
    np.testing.assert_allclose(ball(0.01).distance(points[near]).value, expected[near])


def test_a_body_moves_along_its_axis_and_turns_about_its_origin():
    body = Body(ball(0.01), np.array([0.1, 0.0, 0.0]), frame_of([1, 0, 0]), np.array([1.0, 0, 0]))
    pose = body.posed(0.02, np.array([0.0, 0.03, 0.0, 0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(pose.origin, [0.12, 0.03, 0.0])
    np.testing.assert_allclose(pose.turn[:, 2], [0.0, 1.0, 0.0], atol=1e-15)
    points = np.random.default_rng(2).normal(size=(5, 3))
    np.testing.assert_allclose(pose.outside(pose.inside(points)), points)


@pytest.mark.parametrize('friction', [-0.1, np.nan, np.inf])
def test_friction_below_zero_or_no_number_is_refused(friction):
    with pytest.raises(BodyError, match='friction is'):
        Body(ball(0.01), np.zeros(3), np.eye(3), np.array([0.0, 0, 1]), friction)


def test_bodies_that_cannot_be_are_refused():
    with pytest.raises(BodyError, match='rounded by 0.02 m'):
        plate(0.02, 0.03, 0.02)
    with pytest.raises(BodyError, match='without volume'):
        RoundedHull(np.zeros((1, 3)), 0.0)
    with pytest.raises(BodyError, match='in one plane'):
        RoundedHull(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]), 0.1).distance(
            np.zeros((1, 3))
        )
    with pytest.raises(BodyError, match='along the normal'):
        frame_of([0, 0, 1], [0, 0, 2])
