# SPDX-License-Identifier: Apache-2.0
"""Exact middle surfaces of the primitives: nearest point, normal, outline."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

NEWTON_STEPS = 60


class ClosedTarget:
    """A surface without outline."""

    def outline(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """No point of a closed surface lies on an outline."""
        return points, np.zeros((len(points), 2, 3))


class SphereTarget(ClosedTarget):
    """A sphere about the origin."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points and normals along the radii."""
        normal = points / np.linalg.norm(points, axis=1, keepdims=True)
        return self.radius * normal, normal


class EllipsoidTarget(ClosedTarget):
    """The surface a given depth inside an ellipsoid about the origin, along its normals."""

    def __init__(self, half_axes: FloatArray, depth: float) -> None:
        self._half_axes = half_axes
        self._depth = depth

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points by Newton's method on the distance along the normal.

        The foot x of a point p obeys x_i = p_i a_i^2 / (a_i^2 + t) with sum (x_i / a_i)^2 = 1;
        the sum falls monotonically in t, so that Newton from the left converges.
        """
        squared = self._half_axes**2
        least = squared.min()
        scaled = np.abs(points) * self._half_axes
        t = np.max(scaled - squared, axis=1)
        t = np.maximum(t, -least * (1.0 - 1e-9))
        for _ in range(NEWTON_STEPS):
            ratio = scaled / (squared + t[:, None])
            value = (ratio**2).sum(axis=1) - 1.0
            slope = -2.0 * (ratio**2 / (squared + t[:, None])).sum(axis=1)
            step = -value / slope
            t = t + step
            if np.abs(step).max() <= 1e-15 * least:
                break
        foot = points * squared / (squared + t[:, None])
        normal = foot / squared
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return foot - self._depth * normal, normal
