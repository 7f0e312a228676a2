# SPDX-License-Identifier: Apache-2.0
"""From errors at scan points to a colour per vertex, each theory on a scale of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .scene import Floats, RowScene


def nice_ceiling(value: float) -> float:
    """The smallest of 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten that is >= value."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    for step in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0):
        if value <= step * power * (1 + 1e-9):
            return float(step * power)
    return float(10.0 * power)


@dataclass(frozen=True)
class ErrorScales:
    """Upper ends (m) of the error colours of the two theories, for all rows of a report."""

    nonlinear: float
    linear: float


def error_scales(scenes: Sequence[RowScene]) -> ErrorScales:
    """For each theory a round number above 95 % of its errors in every row.

    On the linear theory's scale the residual of the nonlinear one would be one dark colour. The
    few larger errors would hide all the others; the colour bar says that it is open upwards.
    """

    def end(of_rows: Sequence[Floats]) -> float:
        ends = [float(np.percentile(np.abs(errors), 95.0)) for errors in of_rows if len(errors)]
        return nice_ceiling(max(ends, default=0.0) * 1e3) * 1e-3

    return ErrorScales(
        end([scene.nonlinear_error for scene in scenes]),
        end([scene.linear_error for scene in scenes]),
    )


def vertex_errors(vertices: Floats, points: Floats, errors: Floats, radius: float) -> Floats:
    """(v,) m, mean unsigned error of the scan points that belong to each vertex; NaN = not seen.

    A point belongs to a vertex if it is no further away than its own error plus `radius` m.
    """
    if not len(points):
        return np.full(len(vertices), np.nan)
    size = np.abs(errors)
    count = min(12, len(points))
    distance, index = cKDTree(points).query(vertices, k=count)
    distance, index = distance.reshape(-1, count), index.reshape(-1, count)
    weight = (distance <= size[index] + radius).astype(float)
    total = weight.sum(axis=1)
    return np.where(total > 0, (weight * size[index]).sum(axis=1) / np.maximum(total, 1.0), np.nan)


def seen_radius(scene: RowScene) -> float:
    """How far (m) a scan point speaks for the surface: the faces' longest typical edge."""
    corners = scene.rest[scene.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return max(1.0e-3, 1.2 * float(np.percentile(edges, 90.0)))


def scan_displacement(scene: RowScene) -> Floats:
    """(p,) m, how far each scan point lies inside the rest face, for the scan's grey tones.

    What the scene gives, else the height below the tangent plane of the nearest rest vertex:
    on a vertex spacing s and a radius R that is off by at most s^2 / 4 R.
    """
    if scene.scan_displacement is not None:
        return scene.scan_displacement
    normals = np.zeros_like(scene.rest)
    a, b, c = (scene.rest[scene.triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    for k in range(3):
        np.add.at(normals, scene.triangles[:, k], face)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    _, index = cKDTree(scene.rest).query(scene.scan_points)
    moved = scene.rest[index] - scene.scan_points
    return np.einsum('ij,ij->i', moved, normals[index])
