# SPDX-License-Identifier: Apache-2.0
"""Opposed grasps: pins on antipodal points, the object's pose between them."""

import math

import pytest

from barrett_hand_bridge.grasp import GraspError, aligned_pin, opposed_grasp, pin_gap
from barrett_hand_bridge.hand import ENCODER_262
from barrett_hand_bridge.kinematics import HandGeometry, Pin, finger_frames, pin_direction


def test_pins_stand_exactly_the_width_apart():
    grasp = opposed_grasp(HandGeometry(), Pin(), 0.065)
    assert pin_gap(HandGeometry(), Pin(), grasp.inner) == pytest.approx(0.065, abs=1e-12)


def test_object_lies_on_the_palm_axis_with_its_axis_along_the_pins():
    grasp = opposed_grasp(HandGeometry(), Pin(), 0.065)
    x, y, z = grasp.object_centre
    assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert 0.15 < z < 0.25
    assert math.hypot(*grasp.object_rotation) == pytest.approx(1.0)


def test_aligned_pins_point_at_each_other():
    pin = aligned_pin(HandGeometry(), Pin(lean_rad=0.3), 0.065)
    grasp = opposed_grasp(HandGeometry(), pin, 0.065)
    frames = finger_frames(HandGeometry(), 1, grasp.spread, grasp.inner, grasp.inner / 3)
    assert pin_direction(frames, pin) == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)


def test_default_pin_is_aligned_for_the_tennis_ball():
    assert aligned_pin(HandGeometry(), Pin(), 0.065).lean_rad == pytest.approx(
        Pin().lean_rad, abs=1e-4
    )


def test_counts_round_to_the_open_side():
    grasp = opposed_grasp(HandGeometry(), Pin(), 0.065)
    counts = grasp.counts(ENCODER_262)
    assert counts[1] * ENCODER_262.finger_rad_per_count <= grasp.inner
    assert counts[4] == 1575


def test_an_impossible_width_is_refused():
    with pytest.raises(GraspError, match='never stand 0.5 m apart'):
        opposed_grasp(HandGeometry(), Pin(), 0.5)
