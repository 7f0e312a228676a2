# SPDX-License-Identifier: Apache-2.0
"""Where the fingers stand when their pins touch an object, and where the object then is.

Uses the emulator's own finger geometry: the hand frame, one plane per finger. A pin touches
straight: mounted with the lean that puts it along the object's inward normal at first touch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import fsolve

from bags.calculix import Array
from bags.scanner import Obstacle
from barrett_hand_bridge.emulator.geometry import (
    FingerDimensions,
    MountedPin,
    finger_azimuth,
    finger_pose,
)

INNER_PER_OUTER = 3.0
LINK_RADIUS_M = 0.0095
PIN_RADIUS_M = 0.001


@dataclass(frozen=True)
class Touch:
    """One finger at first touch: joint angles (rad), its pin, point and inward normal (hand)."""

    finger: int
    inner_rad: float
    pin: MountedPin
    point: tuple[float, float, float]
    inward: tuple[float, float, float]


def touch_at(
    finger: int,
    spread_rad: float,
    outward_m: float,
    pin: MountedPin,
    height_m: float | None = None,
    rise: float = 0.0,
    guess: tuple[float, float] = (0.9, 0.5),
) -> Touch:
    """The pose in which the pin's end stands `outward_m` from the finger's spread axis.

    The pin then points inward with a slope of `rise` (height per way). Without `height_m` the
    height follows from the pin's length; with it the pin's length is found. Raises ValueError
    when the finger cannot do that.
    """
    dimensions = FingerDimensions()
    azimuth = finger_azimuth(finger, spread_rad)
    outward = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    base = np.array(
        [{1: -1.0, 2: 1.0, 3: 0.0}[finger] * dimensions.spread_axis_from_centre_m, 0, 0]
    )

    def pose(inner: float, lean: float, length: float) -> tuple[Array, Array]:
        mounted = replace(pin, lean_rad=lean, length_m=length)
        found = finger_pose(
            dimensions, mounted, finger, spread_rad, inner, inner / INNER_PER_OUTER
        )
        direction = math.sin(lean) * np.array(found.along) + math.cos(lean) * np.array(
            found.pad_normal
        )
        return np.array(found.pin_tip), direction

    def off(unknown: Array) -> list[float]:
        length = pin.length_m if height_m is None else float(unknown[2])
        tip, direction = pose(float(unknown[0]), float(unknown[1]), length)
        inward = -float(direction @ outward)
        errors = [
            float((tip - base) @ outward) - outward_m,
            0.1 * (float(direction[2]) - rise * inward),
        ]
        return errors if height_m is None else [*errors, float(tip[2]) - height_m]

    start = list(guess) if height_m is None else [*guess, pin.length_m]
    found, _, code, text = fsolve(off, start, full_output=True, xtol=1e-14)
    length = pin.length_m if height_m is None else float(found[2])
    if code != 1 and max(abs(error) for error in off(found)) > 1e-9:
        raise ValueError(f'finger {finger} does not reach the contact: {text}')
    tip, direction = pose(float(found[0]), float(found[1]), length)
    mounted = replace(pin, lean_rad=float(found[1]), length_m=length)
    return Touch(finger, float(found[0]), mounted, _plain(tip), _plain(direction))


def _plain(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z


def counts_at(touches: Mapping[int, Touch], spread_rad: float) -> dict[int, float]:
    """Motor positions in counts of a BH8-262 with these touches; motor 4 is the spread."""
    counts = {f: touch.inner_rad / math.radians(140.0) * 17500.0 for f, touch in touches.items()}
    return {**counts, 4: spread_rad / math.pi * 3150.0}


def obstacles(
    fingers: Mapping[int, tuple[Array, Array, Array, Array]], palm_height_m: float = 0.06
) -> list[Obstacle]:
    """What hides the object from the scanner: links and pins of every finger, and the palm.

    Per finger: knuckle, outer joint, foot of the pin, end of the pin, all (3,) in m.
    """
    found = [
        Obstacle(
            np.array([-0.03, 0.0, palm_height_m]), np.array([0.03, 0.0, palm_height_m]), 0.045
        )
    ]
    for knuckle, joint, foot, end in fingers.values():
        found.append(Obstacle(knuckle, joint, LINK_RADIUS_M))
        found.append(Obstacle(joint, foot, LINK_RADIUS_M))
        found.append(Obstacle(foot, end, PIN_RADIUS_M))
    return found
