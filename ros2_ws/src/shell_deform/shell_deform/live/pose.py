# SPDX-License-Identifier: Apache-2.0
"""Where the object is: rigid poses between the frame of the contacts and the object's own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


FARTHEST = 10.0


class PoseError(ValueError):
    """A pose that is none."""


@dataclass(frozen=True)
class Pose:
    """The object in the frame of the contacts: x = rotation @ x_object + translation.

    Attributes:
        rotation: (3, 3) orthonormal. translation: (3,) [m].
    """

    rotation: Array
    translation: Array

    def to_object(self, points: Array) -> Array:
        """Points (p, 3) of the contacts' frame in the object's."""
        return (points - self.translation) @ self.rotation

    def from_object(self, points: Array) -> Array:
        """Points (p, 3) of the object's frame in that of the contacts."""
        return points @ self.rotation.T + self.translation

    @cached_property
    def numbers(self) -> Array:
        """(7,) x y z qx qy qz qw."""
        return np.concatenate([self.translation, quaternion(self.rotation)])


IDENTITY = Pose(np.eye(3), np.zeros(3))


def pose_of(numbers: Array | list[float], what: str = 'object pose') -> Pose:
    """Pose of x y z qx qy qz qw; raises PoseError for anything else than seven usable numbers.

    `what` it is called in the message.
    """
    values = np.asarray(numbers, dtype=float)
    if values.shape != (7,) or not np.all(np.isfinite(values)):
        raise PoseError(
            f'{what} is {values.tolist()}; seven finite numbers x y z [m] qx qy qz qw are needed'
        )
    if np.abs(values[:3]).max() > FARTHEST:
        raise PoseError(
            f'{what} is {values[:3].tolist()} m away; within {FARTHEST:g} m is allowed'
        )
    # hypot scales before it squares: nothing overflows.
    length = math.hypot(*values[3:])
    if abs(length - 1.0) > 1e-2:
        raise PoseError(
            f'the quaternion of the {what} has length {length:.4g}; give a unit quaternion'
        )
    x, y, z, w = values[3:] / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return Pose(rotation, values[:3].copy())


def quaternion(rotation: Array) -> Array:
    """(4,) x y z w of a rotation matrix, w not negative."""
    m = rotation
    squares = np.array(
        [
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        ]
    )
    big = int(np.argmax(squares))
    size = 0.5 * np.sqrt(squares[big])
    off = 0.25 / size
    products = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) * off
    sums = np.array([m[1, 2] + m[2, 1], m[0, 2] + m[2, 0], m[0, 1] + m[1, 0]]) * off
    if big == 3:
        result = np.array([*products, size])
    else:
        result = np.zeros(4)
        result[big] = size
        result[(big + 1) % 3] = sums[(big + 2) % 3]
        result[(big + 2) % 3] = sums[(big + 1) % 3]
        result[3] = products[big]
    return result if result[3] >= 0 else -result


def rotation_of(vector: Array) -> Array:
    """Rotation matrix of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3) + _cross(vector)
    axis = _cross(vector / angle)
    result: Array = np.eye(3) + np.sin(angle) * axis + (1.0 - np.cos(angle)) * (axis @ axis)
    return result


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
