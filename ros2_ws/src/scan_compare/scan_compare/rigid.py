# SPDX-License-Identifier: Apache-2.0
"""Rigid motions: small-rotation exponentials, poses, uniformly spread rotations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pose:
    """A rigid motion x -> rotation @ x + translation; rotation (3, 3), translation (3,) [m]."""

    rotation: np.ndarray
    translation: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3)."""
        return points @ self.rotation.T + self.translation

    def inverse(self) -> Pose:
        """Return the motion that undoes this one."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def after(self, first: Pose) -> Pose:
        """Return the motion that does `first`, then this one."""
        return Pose(
            self.rotation @ first.rotation, self.rotation @ first.translation + self.translation
        )


IDENTITY = Pose(np.eye(3), np.zeros(3))


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) by |vector| radians about `vector` (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # np.sinc is sin(pi t)/(pi t): both coefficients stay exact at angle zero
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(3) + first * cross + second * cross @ cross


def rotation_angle(rotation: np.ndarray) -> float:
    """Return the angle [rad] of a rotation (3, 3)."""
    skew = rotation - rotation.T
    sine = 0.5 * np.sqrt(skew[2, 1] ** 2 + skew[0, 2] ** 2 + skew[1, 0] ** 2)
    return float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """Return the proper rotation nearest to `matrix` (3, 3); never a reflection."""
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right


def rotation_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Return rotations (..., 3, 3) of quaternions (..., 4) ordered x, y, z, w; any length."""
    unit = np.asarray(quaternion, float)
    unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
    x, y, z, w = np.moveaxis(unit, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def spread_rotations(count: int) -> np.ndarray:
    """Return `count` rotations (count, 3, 3) spread evenly over all of them, deterministically.

    Super-Fibonacci spiral on the unit quaternions (Alexa 2022, 10.1109/CVPR52688.2022.00811).
    """
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2.0 * np.pi * s / phi, 2.0 * np.pi * s / psi
    quaternions = np.column_stack(
        (inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta))
    )
    return rotation_from_quaternion(quaternions)


def pose_from_points(
    source: np.ndarray, target: np.ndarray, start_rotation: np.ndarray | None = None
) -> Pose:
    """Return the rigid motion that takes `source` (k, 3) nearest to `target` (k, 3).

    Kabsch's solution. One or two points, or points on a line, leave a spin open: it is the one
    nearest to `start_rotation` (default identity).
    """
    start = np.eye(3) if start_rotation is None else start_rotation
    return rigid_fit(source, target, np.ones(len(source)), start)


def rigid_fit(
    source: np.ndarray,
    target: np.ndarray,
    weight: np.ndarray,
    start: np.ndarray = IDENTITY.rotation,
) -> Pose:
    """Return the rigid motion (Kabsch) of `source` (k, 3) onto `target` (k, 3) by `weight` (k,).

    What the points leave open is the rotation nearest to `start` (3, 3).
    """
    total = float(weight.sum())
    from_middle, to_middle = weight @ source / total, weight @ target / total
    correlation = ((target - to_middle) * weight[:, None]).T @ (source - from_middle)
    # a weak pull towards the start decides only what the points leave open
    pull = 1e-6 * max(float(np.linalg.norm(correlation)), 1e-12)
    rotation = nearest_rotation(correlation + pull * start)
    return Pose(rotation, to_middle - rotation @ from_middle)
