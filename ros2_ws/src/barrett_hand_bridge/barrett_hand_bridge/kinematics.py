# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics of the BarrettHand's fingers with a pin on the pad.

Modified Denavit-Hartenberg chain of the BH8-262 manual for firmware 4.4, pages 73 to 76; the
lengths of that page and of six published models differ by up to 8 mm and 15 degrees, so all of
them are parameters. The fingertip frame lies on the pad's normal at the end of the outer link: x
along the link, z outward from the pad, towards the object.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from barrett_hand_bridge.hand import FINGERS, EncoderScale, HandSample

Array = npt.NDArray[np.float64]

# Gear ratios, motor to inner joint and motor to outer link relative to the palm.
INNER_RATIO = 125.0
OUTER_RATIO = 93.75
GRAVITY_M_PER_S2 = 9.80665


@dataclass(frozen=True)
class HandGeometry:
    """Link constants in m and rad; the names in brackets are those of the manual."""

    palm_offset_m: float = 0.025  # Aw
    palm_height_m: float = 0.084  # Dw
    link_1_m: float = 0.050  # A1
    link_2_m: float = 0.070  # A2
    link_3_m: float = 0.050  # A3
    pad_height_m: float = 0.0095  # D3
    joint_2_offset_rad: float = math.radians(2.46)  # Phi2
    joint_3_offset_rad: float = math.radians(50.0)  # Phi3
    outer_link_mass_kg: float = 0.1
    outer_link_centre_m: float = 0.025


@dataclass(frozen=True)
class Pin:
    """A pin mounted on a pad, in the fingertip frame.

    Its foot stands `forward_m` along x and `sideways_m` along y; it leans by `lean_rad` from z
    towards x. `radius_m` is that of its end. The two sigmas say how well it is mounted.
    """

    length_m: float = 0.040
    radius_m: float = 0.001
    forward_m: float = 0.020
    sideways_m: float = 0.0
    lean_rad: float = math.radians(30.75)
    position_sigma_m: float = 0.0005
    direction_sigma_rad: float = math.radians(3.0)

    @property
    def direction(self) -> Array:
        """Unit vector from foot to end in the fingertip frame, (3,)."""
        return np.array([math.sin(self.lean_rad), 0.0, math.cos(self.lean_rad)])

    @property
    def end(self) -> Array:
        """End of the pin in the fingertip frame, (3,) m."""
        return np.array([self.forward_m, self.sideways_m, 0.0]) + self.length_m * self.direction


@dataclass(frozen=True)
class JointAngles:
    """Joint angles of the hand in rad: the spread, and joints 2 and 3 of each finger."""

    spread: float
    inner: Mapping[int, float]
    outer: Mapping[int, float]


@dataclass(frozen=True)
class FingerFrames:
    """Poses of one finger in the hand frame, (4, 4) each: outer joint (z = its axis) and tip."""

    joint_3: Array = field(repr=False)
    tip: Array = field(repr=False)


def cross(a: Array, b: Array) -> Array:
    """Vector product of two vectors (3,): numpy's own takes ten times as long for one pair."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def length(a: Array) -> float:
    """Length of a vector."""
    return math.sqrt(float(a @ a))


def modified_dh(a: float, alpha: float, d: float, theta: float) -> Array:
    """Transform between two frames by the modified convention, (4, 4); m and rad."""
    ca, sa, ct, st = math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
    return np.array(
        [
            [ct, -st, 0.0, a],
            [st * ca, ct * ca, -sa, -sa * d],
            [st * sa, ct * sa, ca, ca * d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def finger_frames(
    geometry: HandGeometry, finger: int, spread: float, inner: float, outer: float
) -> FingerFrames:
    """Frames of a finger in the hand frame from its joint angles in rad.

    Raises:
        ValueError: no such finger.
    """
    if finger not in FINGERS:
        raise ValueError(f'finger {finger}: the hand has fingers 1, 2 and 3')
    side = {1: -1.0, 2: 1.0, 3: 0.0}[finger]
    facing = {1: 1.0, 2: 1.0, 3: -1.0}[finger]
    g = geometry
    chain = modified_dh(
        side * g.palm_offset_m, 0.0, g.palm_height_m, side * spread - facing * math.pi / 2
    )
    chain = chain @ modified_dh(g.link_1_m, math.pi / 2, 0.0, inner + g.joint_2_offset_rad)
    joint_3 = chain @ modified_dh(g.link_2_m, 0.0, 0.0, outer + g.joint_3_offset_rad)
    tip = joint_3 @ modified_dh(g.link_3_m, -math.pi / 2, g.pad_height_m, 0.0)
    return FingerFrames(joint_3, tip)


def joint_angles(sample: HandSample, scale: EncoderScale) -> JointAngles:
    """Joint angles from encoder counts: couplings, and the clutch where it has let go.

    Before breakaway the outer joint turns a third of the inner one. Afterwards the inner joint
    stands: where it let go (`breakaway_counts`), or where its own encoder says (`inner_rad`).
    """
    inner: dict[int, float] = {}
    outer: dict[int, float] = {}
    for index, finger in enumerate(FINGERS):
        motor = sample.finger_counts[index] * scale.finger_rad_per_count
        broken = sample.breakaway_counts[index]
        encoder = sample.inner_rad[index]
        if encoder is not None:
            inner[finger] = encoder
        elif broken is not None and broken < sample.finger_counts[index]:
            inner[finger] = broken * scale.finger_rad_per_count
        else:
            inner[finger] = motor
        # Joint 2 turns 1/125 of the motor; the outer link 1/93.75 of it relative to the palm.
        outer[finger] = motor * INNER_RATIO / OUTER_RATIO - inner[finger]
    return JointAngles(sample.spread_counts * scale.spread_rad_per_count, inner, outer)


def pin_end(frames: FingerFrames, pin: Pin) -> Array:
    """End of the pin in the hand frame, (3,) m."""
    return frames.tip[:3, :3] @ pin.end + frames.tip[:3, 3]


def pin_direction(frames: FingerFrames, pin: Pin) -> Array:
    """Direction of the pin in the hand frame, towards the object, (3,)."""
    direction: Array = frames.tip[:3, :3] @ pin.direction
    return direction


def torque_arm(frames: FingerFrames, point: Array, direction: Array) -> float:
    """Torque about joint 3 per newton along `direction` at `point`, in m (hand frame)."""
    lever = point - frames.joint_3[:3, 3]
    return float(frames.joint_3[:3, 2] @ cross(lever, direction))


def gravity_torque(geometry: HandGeometry, frames: FingerFrames, gravity: Array) -> float:
    """What the weight of the outer link adds to the gauge's torque, in N m.

    `gravity` is a unit vector in the hand frame, (3,), or zeros where it is not known.
    """
    centre = frames.joint_3[:3, 0] * geometry.outer_link_centre_m
    weight = gravity * geometry.outer_link_mass_kg * GRAVITY_M_PER_S2
    return -float(frames.joint_3[:3, 2] @ cross(centre, weight))
