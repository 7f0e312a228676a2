"""From errors at scan points to a colour per vertex, on one scale for the whole report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from .scene import Floats, RowScene


def nice_ceiling(value: float) -> float:
    """The smallest 1, 2, 2.5 or 5 times a power of ten that is >= value (same unit)."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    for step in (1.0, 2.0, 2.5, 5.0, 10.0):
        if value <= step * power * (1 + 1e-9):
            return float(step * power)
    return float(10.0 * power)


def error_scale(scenes: Sequence[RowScene]) -> float:
    """The one upper end (m) of the error colours: above 99 % of all errors of all rows."""
    ends = [
        float(np.percentile(np.abs(errors), 99.0))
        for scene in scenes
        for errors in (scene.nonlinear_error, scene.linear_error)
        if len(errors)
    ]
    return nice_ceiling(max(ends, default=0.0) * 1e3) * 1e-3


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
