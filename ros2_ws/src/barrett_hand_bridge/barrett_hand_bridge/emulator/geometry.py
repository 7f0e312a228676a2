# SPDX-License-Identifier: Apache-2.0
"""Where an emulated finger is: plane geometry of one finger, turned about its own spread axis.

A finger moves in a vertical plane. With u measured outward from the finger's spread axis and z
along the palm's axis, the inner link stands at the angle a and the pad surface of the outer link
at the angle b from u. Lengths and angles: BH8-262 manual for firmware 4.4, pages 73 to 76.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector = tuple[float, float, float]

FINGERS = (1, 2, 3)


@dataclass(frozen=True)
class FingerDimensions:
    """Link lengths in m and built-in angles in rad of the three equal fingers."""

    spread_axis_from_centre_m: float = 0.025
    knuckle_from_spread_axis_m: float = 0.050
    knuckle_height_m: float = 0.084
    inner_link_m: float = 0.070
    outer_link_m: float = 0.050
    pad_height_m: float = 0.0095
    inner_link_angle_rad: float = math.radians(2.46)
    outer_link_angle_rad: float = math.radians(50.0)


@dataclass(frozen=True)
class MountedPin:
    """A pin on the pad: where its foot stands and where it points, as mounted.

    `forward_m` moves the foot along the outer link from the pad's reference point, `sideways_m`
    across it; `lean_rad` leans the pin from the pad normal towards the end of the finger.
    """

    length_m: float = 0.040
    forward_m: float = 0.020
    sideways_m: float = 0.0
    lean_rad: float = math.radians(30.75)


@dataclass(frozen=True)
class FingerPose:
    """Points and directions of one finger in the hand frame (m), and its angle in the plane."""

    knuckle: Vector
    outer_joint: Vector
    pin_tip: Vector
    along: Vector
    pad_normal: Vector
    axis: Vector


def subtract(a: Vector, b: Vector) -> Vector:
    """A minus b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vector, factor: float) -> Vector:
    """A times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def unit(a: Vector) -> Vector:
    """A divided by its length, which must not be zero."""
    length = math.sqrt(dot(a, a))
    return (a[0] / length, a[1] / length, a[2] / length)


def finger_azimuth(finger: int, spread_rad: float) -> float:
    """Direction in which a finger points outward: 1 and 2 mirror each other, 3 is fixed."""
    if finger == 1:
        return -math.pi / 2 - spread_rad
    if finger == 2:
        return -math.pi / 2 + spread_rad
    return math.pi / 2


def finger_pose(
    dimensions: FingerDimensions,
    pin: MountedPin,
    finger: int,
    spread_rad: float,
    inner_rad: float,
    outer_rad: float,
) -> FingerPose:
    """Pose of a finger from its joint angles in rad; `outer_rad` is relative to the inner link."""
    azimuth = finger_azimuth(finger, spread_rad)
    outward = (math.cos(azimuth), math.sin(azimuth))
    sideways = (-outward[1], outward[0])
    base_x = {1: -1.0, 2: 1.0, 3: 0.0}[finger] * dimensions.spread_axis_from_centre_m
    a = inner_rad + dimensions.inner_link_angle_rad
    b = a + outer_rad + dimensions.outer_link_angle_rad

    def point(u: float, z: float, v: float = 0.0) -> Vector:
        return (
            base_x + outward[0] * u + sideways[0] * v,
            outward[1] * u + sideways[1] * v,
            z,
        )

    def direction(u: float, z: float) -> Vector:
        return (outward[0] * u, outward[1] * u, z)

    knuckle_u, knuckle_z = dimensions.knuckle_from_spread_axis_m, dimensions.knuckle_height_m
    joint_u = knuckle_u + dimensions.inner_link_m * math.cos(a)
    joint_z = knuckle_z + dimensions.inner_link_m * math.sin(a)
    along = dimensions.outer_link_m + pin.forward_m + pin.length_m * math.sin(pin.lean_rad)
    away = dimensions.pad_height_m + pin.length_m * math.cos(pin.lean_rad)
    tip_u = joint_u + along * math.cos(b) - away * math.sin(b)
    tip_z = joint_z + along * math.sin(b) + away * math.cos(b)
    return FingerPose(
        knuckle=point(knuckle_u, knuckle_z),
        outer_joint=point(joint_u, joint_z),
        pin_tip=point(tip_u, tip_z, pin.sideways_m),
        along=direction(math.cos(b), math.sin(b)),
        pad_normal=direction(-math.sin(b), math.cos(b)),
        axis=(outward[1], -outward[0], 0.0),
    )


def opening_torque(pose: FingerPose, point: Vector, force_on_finger: Vector) -> float:
    """Torque in N m about the outer joint that tries to open the finger."""
    lever = subtract(point, pose.outer_joint)
    return -dot(pose.axis, cross(lever, force_on_finger))


def knuckle_torque(pose: FingerPose, point: Vector, force_on_finger: Vector) -> float:
    """Torque in N m about the inner joint that tries to open the finger."""
    return -dot(pose.axis, cross(subtract(point, pose.knuckle), force_on_finger))
