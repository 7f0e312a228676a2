# SPDX-License-Identifier: Apache-2.0
"""Control meshes on rectangular grids, and the surfaces that they carry."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .shell_object import ObjectError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def grid(width: float, height: float, vertices: int) -> tuple[FloatArray, IntArray]:
    """A rectangle about the origin in nearly square cells, each cut along a diagonal.

    All inner vertices have six neighbours.

    Returns:
        Vertices (n, 2) [m] and triangles (m, 3), counter-clockwise.
    """
    cell = math.sqrt(width * height / vertices)
    columns = max(2, round(width / cell))
    rows = max(2, round(vertices / (columns + 1)) - 1)
    x, y = np.meshgrid(
        np.linspace(-0.5 * width, 0.5 * width, columns + 1),
        np.linspace(-0.5 * height, 0.5 * height, rows + 1),
        indexing='ij',
    )
    number = np.arange(x.size).reshape(x.shape)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return np.column_stack([x.ravel(), y.ravel()]), faces


class HalfCylinderTarget:
    """The half y >= 0 of a cylinder about z."""

    def __init__(self, radius: float, length: float) -> None:
        self.radius = radius
        self.length = length

    def place(self, flat: FloatArray) -> FloatArray:
        """Points (n, 3) of unrolled ones (n, 2): arc length from the crown, and z."""
        angle = 0.5 * np.pi + flat[:, 0] / self.radius
        x, y = self.radius * np.cos(angle), self.radius * np.sin(angle)
        return np.column_stack([x, y, flat[:, 1]])

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points and normals of the whole cylinder."""
        normal = points * [1.0, 1.0, 0.0]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return self.radius * normal + points * [0.0, 0.0, 1.0], normal

    def outline(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points of the straight edges and of the end arcs, and directions across."""
        foot, normal = self.project(points)
        to_end = 0.5 * self.length - np.abs(points[:, 2])
        at_end = to_end < np.abs(points[:, 1])
        foot[at_end, 2] = np.copysign(0.5 * self.length, points[at_end, 2])
        straight = np.stack([np.copysign(self.radius, points[:, 0]), 0 * to_end, points[:, 2]], 1)
        foot[~at_end] = straight[~at_end]
        across = np.where(at_end[:, None], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
        radial = np.where(at_end[:, None], normal, [1.0, 0.0, 0.0])
        return foot, np.stack([radial, across], axis=1)


class HeightFieldTarget:
    """The surface a given depth below heights over a rectangular grid, along its normals."""

    def __init__(self, heights: FloatArray, spacing: float, depth: float) -> None:
        columns, rows = heights.shape
        self.width, self.height = spacing * (columns - 1), spacing * (rows - 1)
        x = np.linspace(-0.5 * self.width, 0.5 * self.width, columns)
        y = np.linspace(-0.5 * self.height, 0.5 * self.height, rows)
        order = min(3, columns - 1, rows - 1)
        # Deferred: it takes a quarter of the start of a process that builds a ball.
        from scipy.interpolate import RectBivariateSpline

        self._spline = RectBivariateSpline(x, y, heights, kx=order, ky=order, s=0)
        self._depth = depth
        self._half = 0.5 * np.array([self.width, self.height])

    def place(self, flat: FloatArray) -> FloatArray:
        """Points (n, 3) of the middle surface below places (n, 2) of the upper face."""
        top, normal = self._top(flat)
        return top - self._depth * normal

    def _top(self, flat: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y = flat.T
        top = np.column_stack([flat, self._spline.ev(x, y)])
        slopes = [self._spline.ev(x, y, dx=1), self._spline.ev(x, y, dy=1)]
        normal = np.column_stack([-slopes[0], -slopes[1], np.ones(len(flat))])
        return top, normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points: slide over the upper face until the residual is normal to it."""
        flat = np.clip(points[:, :2], -self._half, self._half)
        for _ in range(30):
            top, normal = self._top(flat)
            residual = points - (top - self._depth * normal)
            along = residual - np.einsum('ij,ij->i', residual, normal)[:, None] * normal
            moved = np.clip(flat + along[:, :2], -self._half, self._half)
            done = np.abs(moved - flat).max() < 1e-13
            flat = moved
            if done:
                break
        top, normal = self._top(flat)
        return top - self._depth * normal, normal

    def outline(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points of the rectangle's rim, and directions across it."""
        flat = np.clip(points[:, :2], -self._half, self._half)
        gap = self._half - np.abs(flat)
        side = np.argmin(gap, axis=1)
        index = np.arange(len(flat))
        flat[index, side] = np.copysign(self._half[side], flat[index, side])
        for _ in range(30):
            top, normal = self._top(flat)
            residual = points - (top - self._depth * normal)
            step = residual[index, 1 - side]
            flat[index, 1 - side] = np.clip(
                flat[index, 1 - side] + step, -self._half[1 - side], self._half[1 - side]
            )
        top, normal = self._top(flat)
        free = np.zeros((len(flat), 3))
        free[index, 1 - side] = 1.0
        tangent = free - np.einsum('ij,ij->i', free, normal)[:, None] * normal
        across = np.cross(normal, tangent)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        return top - self._depth * normal, np.stack([normal, across], axis=1)


def read_heights(path: Path) -> FloatArray:
    """Heights (columns along x, rows along y) [m] from a .npy, .csv or white-space text file.

    Raises:
        ObjectError: no such table, fewer than 3 x 3 values, or a value that is not finite.
    """
    try:
        if path.suffix == '.npy':
            heights = np.load(path, allow_pickle=False)
        else:
            heights = np.loadtxt(path, delimiter=',' if path.suffix == '.csv' else None, ndmin=2)
        heights = np.asarray(heights, dtype=np.float64)
    except (OSError, ValueError, TypeError) as error:
        raise ObjectError(f'{path}: no table of heights: {error}') from error
    if heights.ndim != 2 or min(heights.shape) < 3:
        raise ObjectError(f'{path}: heights have shape {heights.shape}; at least 3 x 3 are needed')
    if not np.isfinite(heights).all():
        column, row = np.argwhere(~np.isfinite(heights))[0]
        raise ObjectError(f'{path}: the height in column {column}, row {row} is not finite')
    return heights
