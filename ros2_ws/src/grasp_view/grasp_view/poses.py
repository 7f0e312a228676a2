# SPDX-License-Identifier: Apache-2.0
"""Rigid poses: where one frame lies in another."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


FARTHEST_M = 1e3
"""Nothing of a scene is further away, in whatever frame."""


class PoseError(ValueError):
    """A pose that is none; the text says which number is wrong."""


def rotation_of(quaternion: npt.ArrayLike) -> Floats:
    """Rotation matrix (3, 3) of a quaternion (x, y, z, w), normalised here.

    Raises PoseError if it has no length.
    """
    x, y, z, w = np.asarray(quaternion, dtype=np.float64)
    # hypot scales before it squares: nothing overflows.
    length = math.hypot(x, y, z, w)
    if not 1e-6 <= length < math.inf:
        raise PoseError(
            f'quaternion ({x}, {y}, {z}, {w}) has no direction; identity is (0, 0, 0, 1)'
        )
    x, y, z, w = x / length, y / length, z / length, w / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_wxyz(rotation: Floats) -> Floats:
    """Quaternion (w, x, y, z) of a rotation matrix (3, 3), by its largest component."""
    trace = np.array([np.trace(rotation), *np.diag(rotation)])
    k = int(trace.argmax())
    if k == 0:
        q = np.array(
            [
                1 + trace[0],
                rotation[2, 1] - rotation[1, 2],
                rotation[0, 2] - rotation[2, 0],
                rotation[1, 0] - rotation[0, 1],
            ]
        )
    else:
        i = k - 1
        j, m = (i + 1) % 3, (i + 2) % 3
        q = np.zeros(4)
        q[0] = rotation[m, j] - rotation[j, m]
        q[1 + i] = 1 + rotation[i, i] - rotation[j, j] - rotation[m, m]
        q[1 + j] = rotation[j, i] + rotation[i, j]
        q[1 + m] = rotation[m, i] + rotation[i, m]
    return q / np.linalg.norm(q)


@dataclass(frozen=True)
class Pose:
    """Frame B in frame A: p_A = rotation @ p_B + translation; m."""

    rotation: Floats = field(default_factory=lambda: np.eye(3))
    translation: Floats = field(default_factory=lambda: np.zeros(3))

    @staticmethod
    def of(numbers: npt.ArrayLike) -> Pose:
        """From x y z qx qy qz qw (m); raises PoseError if that is no pose."""
        values = np.asarray(numbers, dtype=np.float64)
        if values.shape != (7,) or not np.isfinite(values).all():
            raise PoseError(
                f'pose {values.tolist()} is not seven finite numbers x y z qx qy qz qw'
            )
        if np.abs(values[:3]).max() > FARTHEST_M:
            raise PoseError(f'pose {values.tolist()} is further away than {FARTHEST_M:g} m')
        return Pose(rotation_of(values[3:]), values[:3])

    def points(self, points: Floats) -> Floats:
        """Points (n, 3) of B, in A."""
        return points @ self.rotation.T + self.translation

    def vectors(self, vectors: Floats) -> Floats:
        """Directions (n, 3) of B, in A."""
        return vectors @ self.rotation.T

    @property
    def inverse(self) -> Pose:
        """Frame A in frame B."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def after(self, inner: Pose) -> Pose:
        """Frame C in frame A, where `inner` is frame C in frame B."""
        return Pose(self.rotation @ inner.rotation, self.points(inner.translation[None])[0])
