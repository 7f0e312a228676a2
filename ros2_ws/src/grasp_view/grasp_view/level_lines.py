# SPDX-License-Identifier: Apache-2.0
"""Lines over a triangulated surface on which a quantity, linear in each face, has one value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .poses import Floats
from .smooth_faces import Ints

MOST_LEVELS = 40


@dataclass(frozen=True)
class Crossings:
    """Where a line crosses edges: ends (s, 2, 2) of two edges a segment, weights (s, 2).

    A place is first end + weight * (second - first), of whatever lives at the vertices.
    """

    ends: Ints
    weights: Floats

    def of(self, values: Floats) -> Floats:
        """`values` (n, ...) of the vertices, at the ends of the segments: (s, 2, ...)."""
        first, second = values[self.ends[..., 0]], values[self.ends[..., 1]]
        weight = self.weights.reshape(self.weights.shape + (1,) * (first.ndim - 2))
        return np.asarray(first + weight * (second - first))


def crossings(triangles: Ints, values: Floats, level: float) -> Crossings:
    """Where `values` (n,) have `level`."""
    corners = values[triangles]
    hit = np.flatnonzero((corners.min(axis=1) < level) & (corners.max(axis=1) >= level))
    faces, height = triangles[hit], corners[hit] - level
    above = height >= 0.0
    # The corner alone on its side: both cut edges meet there.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    row = np.arange(len(hit))
    ends = np.empty((len(hit), 2, 2), dtype=np.int64)
    weights = np.empty((len(hit), 2))
    for side in (1, 2):
        other = (alone + side) % 3
        ends[:, side - 1] = np.stack([faces[row, alone], faces[row, other]], axis=1)
        drop = height[row, alone] - height[row, other]
        weights[:, side - 1] = height[row, alone] / drop
    return Crossings(ends, weights)


def level_lines(
    vertices: Floats, triangles: Ints, values: Floats, step: float
) -> list[tuple[int, Floats]]:
    """Number of the level and segments (s, 2, 3) m, at each multiple of `step`.

    The zero line is left out; at most 40 levels are drawn.
    """
    count = min(int(values.max(initial=0.0) / step), MOST_LEVELS)
    return [
        (level, crossings(triangles, values, level * step).of(vertices))
        for level in range(1, count + 1)
    ]
