# SPDX-License-Identifier: Apache-2.0
"""The grips of an object while they move: poses in, and the surface that follows them.

About an equilibrium the surface answers linearly to where the grips have what they hold, which is
exact at the grips for turns of any size. What turns with all of them is taken out before, so that
the wall between them is right for it, too.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shell_deform.live.pose import Pose

Array = NDArray[np.float64]

AFFINE = 12
"""Numbers of a grip that the surface is linear in, see `affine`."""

NO_TURN = 1e-9
"""Turns below this have no axis [rad]."""


def affine(motions: Array) -> Array:
    """(g, 12) of `motions` (g, 6): rotation matrix less the identity by rows, then shift [m]."""
    turns = Rotation.from_rotvec(motions[:, 3:]).as_matrix() - np.eye(3)
    return np.concatenate([turns.reshape(len(motions), 9), motions[:, :3]], axis=1)


def unwrapped(turn: Array, before: Array) -> Array:
    """Rotation vector `turn` (3,) [rad] as it goes on from the one `before` (3,).

    It goes on round instead of jumping by a whole turn.
    """
    # A whole turn is none: it goes on about the axis of the one before.
    known = turn if np.linalg.norm(turn) > NO_TURN else before
    if not np.linalg.norm(known) > NO_TURN:
        return turn
    axis = known / np.linalg.norm(known)
    rounds = round(float((before @ axis - turn @ axis) / (2.0 * np.pi)))
    return np.asarray(turn + 2.0 * np.pi * rounds * axis)


def topic_of(name: str) -> str:
    """The name of a grip as part of the name of a topic: letters, digits, single underscores."""
    return re.sub('[^A-Za-z0-9]+', '_', name.replace('-', 'minus ')).strip('_')


@dataclass(frozen=True)
class GripPlan:
    """Which grips an object has.

    Attributes:
        names: of the g grips. origins: (g, 3) about which they turn, undeformed [m].
        alone: whether they are all that holds the object, and free along none of the axes, which
            do not turn with it.
    """

    names: tuple[str, ...]
    origins: Array
    alone: bool

    @property
    def topics(self) -> list[str]:
        """Their names as parts of names of topics."""
        return [topic_of(name) for name in self.names]


class GripPoses:
    """Where the grips are now, as their newest poses say."""

    def __init__(self, plan: GripPlan) -> None:
        self.plan = plan
        self.motion = np.zeros((len(plan.names), 6))

    @property
    def away(self) -> bool:
        """Whether any of them is not where it took hold."""
        return bool(self.motion.any())

    def goes_on_from(self, other: GripPoses | None) -> None:
        """The grips of the same object built anew are where they were."""
        if other is not None and other.plan.names == self.plan.names:
            self.motion = other.motion

    def take(self, number: int, pose: Pose, placed: Pose) -> None:
        """Grip `number` is at `pose`: its point, and how it has turned since it took hold.

        In the frame of the contacts, in which the object lies as `placed`.
        """
        turn = placed.rotation.T @ pose.rotation @ placed.rotation
        motion = self.motion.copy()
        motion[number, :3] = placed.to_object(pose.translation) - self.plan.origins[number]
        motion[number, 3:] = unwrapped(
            Rotation.from_matrix(turn).as_rotvec(), self.motion[number, 3:]
        )
        self.motion = motion


class Followed(NamedTuple):
    """How the object follows its grips from one of their poses to another.

    Attributes:
        turn: (3, 3) of all of it, then shift: (3,) [m]. inputs: (12 g,) of the columns, before
            that turn. step: how far the grips go beside it, radians or shares of the object.
    """

    turn: Array
    shift: Array
    inputs: Array
    step: float

    def carried(self, points: Array) -> Array:
        """Points (n, 3) [m] after turn and shift."""
        return np.ascontiguousarray(points @ self.turn.T + self.shift)


def followed(plan: GripPlan, before: Array, now: Array, size: float, free: bool) -> Followed:
    """From the motions `before` to `now`, both (g, 6), of an object of `size` [m].

    `free`: whether nothing but the grips holds it, so that it may turn with them.
    """
    turn, shift, own = np.eye(3), np.zeros(3), now
    if free and plan.alone and not np.array_equal(before, now):
        turns = Rotation.from_rotvec(now[:, 3:]) * Rotation.from_rotvec(before[:, 3:]).inv()
        common = turns.mean()
        turn = common.as_matrix()
        here, there = plan.origins + before[:, :3], plan.origins + now[:, :3]
        shift = (there - here @ turn.T).mean(axis=0)
        own = np.concatenate(
            [
                (there - shift) @ turn - plan.origins,
                (common.inv() * Rotation.from_rotvec(now[:, 3:])).as_rotvec(),
            ],
            axis=1,
        )
    change = affine(own) - affine(before)
    angle = np.linalg.norm(change[:, :9], axis=1).max() / np.sqrt(2.0)
    far = np.linalg.norm(change[:, 9:], axis=1).max() / size
    return Followed(turn, shift, change.reshape(-1), float(angle + far))
