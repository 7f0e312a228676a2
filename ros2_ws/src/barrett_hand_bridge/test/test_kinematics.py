# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics: published vectors, couplings, breakaway, the emulator's own chain."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.emulator.geometry import (
    FingerDimensions,
    MountedPin,
    finger_pose,
    opening_torque,
)
from barrett_hand_bridge.hand import ENCODER_262, ENCODER_280, HandSample
from barrett_hand_bridge.kinematics import (
    HandGeometry,
    Pin,
    finger_frames,
    gravity_torque,
    joint_angles,
    pin_direction,
    pin_end,
    torque_arm,
)

# Joint 2 and spread in degrees, finger, tip in mm, tip z axis (recomputed from the manual).
VECTORS = [
    (0, 0, 1, (-25, -142.868, 132.439), (0, 0.7929, 0.6093)),
    (0, 0, 3, (0, 142.868, 132.439), (0, -0.7929, 0.6093)),
    (60, 0, 1, (-25, -41.603, 176.542), (0, 0.7377, -0.6751)),
    (90, 0, 3, (0, -3.819, 151.079), (0, -0.1312, -0.9914)),
    (0, 90, 1, (-167.868, 0, 132.439), (0.7929, 0, 0.6093)),
    (45, 180, 2, (25, 69.446, 178.154), (0, -0.9241, -0.3820)),
]


@pytest.mark.parametrize(('joint_2', 'spread', 'finger', 'tip_mm', 'axis'), VECTORS)
def test_tip_frames_meet_the_published_vectors(joint_2, spread, finger, tip_mm, axis):
    inner = math.radians(joint_2)
    frames = finger_frames(HandGeometry(), finger, math.radians(spread), inner, inner / 3)
    assert frames.tip[:3, 3] * 1e3 == pytest.approx(tip_mm, abs=1e-3)
    assert frames.tip[:3, 2] == pytest.approx(axis, abs=1e-4)


angles = st.floats(0.0, 2.4)


@given(finger=st.sampled_from([1, 2, 3]), spread=st.floats(0, 3.1), inner=angles, outer=angles)
def test_driver_and_emulator_agree_though_they_share_no_formula(finger, spread, inner, outer):
    pin = Pin(sideways_m=0.002)
    mounted = MountedPin(sideways_m=0.002)
    frames = finger_frames(HandGeometry(), finger, spread, inner, outer)
    pose = finger_pose(FingerDimensions(), mounted, finger, spread, inner, outer)
    assert frames.tip[:3, 2] == pytest.approx(pose.pad_normal, abs=1e-12)
    assert frames.joint_3[:3, 0] == pytest.approx(pose.along, abs=1e-12)
    # The two chains count the link's sideways direction from opposite sides.
    middle = pin_end(frames, Pin())
    middle_emulated = finger_pose(
        FingerDimensions(), MountedPin(), finger, spread, inner, outer
    ).pin_tip
    assert middle == pytest.approx(middle_emulated, abs=1e-12)
    assert abs(np.linalg.norm(pin_end(frames, pin) - middle) - 0.002) < 1e-12


@given(inner=angles, spread=st.floats(0, 3.1))
def test_arm_is_the_torque_the_emulated_gauge_feels_per_newton(inner, spread):
    frames = finger_frames(HandGeometry(), 1, spread, inner, inner / 3)
    pose = finger_pose(FingerDimensions(), MountedPin(), 1, spread, inner, inner / 3)
    direction = pin_direction(frames, Pin())
    emulated = opening_torque(pose, pose.pin_tip, tuple(-direction))
    assert torque_arm(frames, pin_end(frames, Pin()), direction) == pytest.approx(emulated)


def test_arm_along_the_pad_normal_is_the_link_length_whatever_the_pin():
    frames = finger_frames(HandGeometry(), 1, 0.3, 0.5, 0.1)
    for length in (0.0, 0.01, 0.1):
        pin = Pin(length_m=length, forward_m=0.0, lean_rad=0.0)
        normal = pin_direction(frames, pin)
        assert torque_arm(frames, pin_end(frames, pin), normal) == pytest.approx(0.050)


def test_spread_of_90_degrees_makes_fingers_1_and_2_antipodal():
    ends = [
        pin_end(finger_frames(HandGeometry(), finger, math.pi / 2, 0.9, 0.3), Pin())
        for finger in (1, 2)
    ]
    assert ends[0][0] == pytest.approx(-ends[1][0])
    assert ends[0][1:] == pytest.approx(ends[1][1:], abs=1e-15)


def test_full_travel_is_140_degrees_on_both_hands():
    for scale, counts in ((ENCODER_262, 17500), (ENCODER_280, 199111)):
        sample = HandSample(0, (counts, 0, 0), 0, (None, None, None))
        assert joint_angles(sample, scale).inner[1] == pytest.approx(math.radians(140), abs=2e-6)


def test_outer_joint_turns_a_third_of_the_inner_one_before_breakaway():
    angles = joint_angles(HandSample(0, (9000, 0, 0), 0, (None,) * 3), ENCODER_262)
    assert angles.outer[1] == pytest.approx(angles.inner[1] / 3)


def test_after_breakaway_the_inner_joint_stands_and_the_outer_takes_all_motion():
    sample = HandSample(0, (9000, 0, 0), 0, (None,) * 3, breakaway_counts=(6000, None, None))
    angles = joint_angles(sample, ENCODER_262)
    assert angles.inner[1] == pytest.approx(math.radians(48.0))
    # The outer link has turned 4/3 of the motor's share relative to the palm.
    assert angles.inner[1] + angles.outer[1] == pytest.approx(math.radians(72.0 * 4 / 3))


def test_inner_encoder_of_the_280_tells_breakaway_by_itself():
    sample = HandSample(0, (99555, 0, 0), 0, (None,) * 3, inner_rad=(0.5, None, None))
    angles = joint_angles(sample, ENCODER_280)
    assert angles.inner[1] == 0.5
    assert angles.inner[1] + angles.outer[1] == pytest.approx(math.radians(70) * 4 / 3, abs=1e-4)


def test_weight_of_the_outer_link_is_worth_two_counts_when_it_lies_flat():
    geometry = HandGeometry(joint_2_offset_rad=0.0, joint_3_offset_rad=0.0)
    frames = finger_frames(geometry, 3, 0.0, 0.0, 0.0)
    torque = gravity_torque(geometry, frames, np.array([0.0, 0.0, -1.0]))
    assert torque == pytest.approx(0.1 * 9.80665 * 0.025)


def test_there_is_no_fourth_finger():
    with pytest.raises(ValueError, match='fingers 1, 2 and 3'):
        finger_frames(HandGeometry(), 4, 0.0, 0.0, 0.0)
