# SPDX-License-Identifier: Apache-2.0
"""Joint angles that put two pins on opposite points of an object, and where it then is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from barrett_hand_bridge.hand import EncoderScale
from barrett_hand_bridge.kinematics import (
    Array,
    HandGeometry,
    Pin,
    finger_frames,
    pin_direction,
    pin_end,
)

OPPOSED_SPREAD_RAD = math.pi / 2
FINGER_TRAVEL_RAD = math.radians(140.0)


class GraspError(ValueError):
    """No such grasp exists with these links and pins."""


@dataclass(frozen=True)
class OpposedGrasp:
    """Fingers 1 and 2 facing each other: spread and joint 2 in rad, object centre in m.

    `object_rotation` is a quaternion x y z w; the object's z axis then lies along the line
    between the pins, from finger 1 to finger 2.
    """

    spread: float
    inner: float
    object_centre: tuple[float, float, float]
    object_rotation: tuple[float, float, float, float]

    def counts(self, scale: EncoderScale) -> dict[int, int]:
        """Encoder counts of motors 1, 2 and 4, rounded to the side that is more open."""
        finger = math.floor(self.inner / scale.finger_rad_per_count)
        spread = round(self.spread / scale.spread_rad_per_count)
        return {1: finger, 2: finger, 4: spread}


def pin_gap(geometry: HandGeometry, pin: Pin, inner: float) -> float:
    """Distance in m between the ends of equal pins on fingers 1 and 2, spread 90 degrees."""
    ends = _ends(geometry, pin, inner)
    return float((ends[1] - ends[0]) @ np.array([1.0, 0.0, 0.0]))


def _ends(geometry: HandGeometry, pin: Pin, inner: float) -> tuple[Array, Array]:
    frames = [
        finger_frames(geometry, finger, OPPOSED_SPREAD_RAD, inner, inner / 3.0)
        for finger in (1, 2)
    ]
    return pin_end(frames[0], pin), pin_end(frames[1], pin)


def opposed_grasp(geometry: HandGeometry, pin: Pin, width_m: float) -> OpposedGrasp:
    """The pose in which the pins of fingers 1 and 2 just touch an object of `width_m`.

    Raises:
        GraspError: the pins never come to that distance.
    """
    steps = np.linspace(0.0, FINGER_TRAVEL_RAD, 141)
    closer = [pin_gap(geometry, pin, float(inner)) < width_m for inner in steps]
    if closer[0] or not any(closer):
        raise GraspError(
            f'pins of {pin.length_m} m never stand {width_m} m apart: change length or lean'
        )
    first = closer.index(True)
    low, high = float(steps[first - 1]), float(steps[first])
    for _ in range(80):
        middle = 0.5 * (low + high)
        if pin_gap(geometry, pin, middle) > width_m:
            low = middle
        else:
            high = middle
    ends = _ends(geometry, pin, low)
    centre = 0.5 * (ends[0] + ends[1])
    half = math.sqrt(0.5)
    return OpposedGrasp(
        OPPOSED_SPREAD_RAD,
        low,
        (float(centre[0]), float(centre[1]), float(centre[2])),
        (0.0, half, 0.0, half),
    )


def aligned_pin(geometry: HandGeometry, pin: Pin, width_m: float) -> Pin:
    """The same pin leaning so that both pins lie on one line when they touch the object.

    Raises:
        GraspError: no lean does it.
    """
    lean = pin.lean_rad
    for _ in range(100):
        trial = replace(pin, lean_rad=lean)
        grasp = opposed_grasp(geometry, trial, width_m)
        frames = finger_frames(geometry, 1, grasp.spread, grasp.inner, grasp.inner / 3.0)
        direction = pin_direction(frames, trial)
        off = math.atan2(direction[2], direction[0])
        if abs(off) < 1e-12:
            return trial
        # The pin turns with the link as well: a full correction would overshoot.
        lean -= 0.5 * off
    raise GraspError(f'no lean puts pins of {pin.length_m} m on one line at {width_m} m')
