# SPDX-License-Identifier: Apache-2.0
"""The hand as simple bodies: a palm and three fingers of three links, from the joint angles.

Only a picture: the bridge publishes the contacts, nothing here enters a number. Modified
(Craig) Denavit-Hartenberg chain and lengths of the BH8-262 user manual, firmware 4.4.x,
p. 73-75; the finger's distal angle offset is the one its drivers use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .poses import Floats, Pose

PALM_HALF_WIDTH = 0.025
PROXIMAL, MIDDLE, DISTAL = 0.050, 0.070, 0.050
PALM_HEIGHT = 0.084
PAD_HEIGHT = 0.0095
PROXIMAL_OFFSET, DISTAL_OFFSET = np.radians(2.46), np.radians(50.0)
# Fingers 1 and 2 spread to opposite sides, finger 3 stands still.
SIDE = (-1.0, 1.0, 0.0)
TURN = (1.0, 1.0, -1.0)
LINK_NAMES = ('proximal', 'middle', 'distal')


@dataclass(frozen=True)
class Body:
    """A box: its centre frame in the hand frame and its edge lengths in m."""

    name: str
    pose: Pose
    size: tuple[float, float, float]


@dataclass(frozen=True)
class FingerAngles:
    """Spread, base and tip joint angle of one finger in rad."""

    spread: float
    base: float
    tip: float


def link(a: float, alpha: float, d: float, theta: float) -> Pose:
    """One step of the modified Denavit-Hartenberg chain (m, rad)."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    rotation = np.array([[ct, -st, 0.0], [st * ca, ct * ca, -sa], [st * sa, ct * sa, ca]])
    return Pose(rotation, np.array([a, -sa * d, ca * d]))


def finger_frames(finger: int, angles: FingerAngles) -> list[Pose]:
    """Joint frames 1, 2, 3 and the tip of finger 1..3 in the hand frame."""
    side, turn = SIDE[finger - 1], TURN[finger - 1]
    steps = (
        link(side * PALM_HALF_WIDTH, 0.0, PALM_HEIGHT, side * angles.spread - np.pi / 2 * turn),
        link(PROXIMAL, np.pi / 2, 0.0, angles.base + PROXIMAL_OFFSET),
        link(MIDDLE, 0.0, 0.0, angles.tip + DISTAL_OFFSET),
        link(DISTAL, -np.pi / 2, PAD_HEIGHT, 0.0),
    )
    frames = []
    here = Pose()
    for step in steps:
        here = here.after(step)
        frames.append(here)
    return frames


def _between(name: str, start: Floats, end: Floats, width: float) -> Body:
    along = end - start
    length = float(np.linalg.norm(along)) or 1e-6
    x = along / length
    helper = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    y = np.cross(helper, x)
    y /= np.linalg.norm(y)
    rotation = np.stack([x, y, np.cross(x, y)], axis=1)
    return Body(name, Pose(rotation, (start + end) / 2), (length, width, width))


def hand_bodies(fingers: Mapping[int, FingerAngles]) -> list[Body]:
    """The palm and the links of the fingers whose angles are known, in the hand frame."""
    palm = Body(
        'palm', Pose(np.eye(3), np.array([0.0, 0.0, PALM_HEIGHT / 2])), (0.1, 0.09, PALM_HEIGHT)
    )
    bodies = [palm]
    for finger, angles in sorted(fingers.items()):
        frames = finger_frames(finger, angles)
        for name, start, end, width in zip(
            LINK_NAMES, frames[:-1], frames[1:], (0.020, 0.018, 0.014), strict=True
        ):
            bodies.append(
                _between(f'finger_{finger}_{name}', start.translation, end.translation, width)
            )
    return bodies


_JOINTS = {
    'spread': 'spread',
    'inner': 'base',
    'base': 'base',
    'proximal': 'base',
    'outer': 'tip',
    'tip': 'tip',
    'distal': 'tip',
}


def finger_angles(names: Sequence[str], positions: Floats) -> dict[int, FingerAngles]:
    """Angles per finger from joint names that hold `finger_<n>` and `inner` or `outer`.

    `base`, `proximal`, `tip` and `distal` are understood too. A joint `spread` without a finger
    counts for fingers 1 and 2. Fingers without an inner joint are left out; an outer joint that
    is missing follows the inner one at one third (the gears' ratio before breakaway). Positions
    in rad.
    """
    found: dict[tuple[int, str], float] = {}
    for name, position in zip(names, positions, strict=False):
        text = name.lower()
        part = next((_JOINTS[word] for word in _JOINTS if word in text), None)
        if part is None or not np.isfinite(position):
            continue
        numbers = [n for n in (1, 2, 3) if f'finger_{n}' in text or f'finger{n}' in text]
        for n in numbers or ((1, 2) if part == 'spread' else ()):
            found[n, part] = float(position)
    return {
        n: FingerAngles(
            found.get((n, 'spread'), 0.0),
            found[n, 'base'],
            found.get((n, 'tip'), found[n, 'base'] / 3.0),
        )
        for n in (1, 2, 3)
        if (n, 'base') in found
    }
