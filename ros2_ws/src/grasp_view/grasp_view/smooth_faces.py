# SPDX-License-Identifier: Apache-2.0
"""A rounder drawing of a coarse surface: every face in four, new vertices lifted off the chords.

The middle of an edge is put where the cubic through both ends, across their normals, has its
middle (A. Vlachos et al., Curved PN triangles, 2001, doi:10.1145/364338.364387). Old vertices
stay where they are, so every published number is drawn at its place.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .poses import Floats

Ints = npt.NDArray[np.integer]
# Larger surfaces look round as they are.
MOST_VERTICES = 1500


class SmoothFaces:
    """The finer topology over one mesh: (4 t) triangles over n vertices and e edge middles."""

    def __init__(self, triangles: Ints, count: int) -> None:
        """triangles (t, 3) over `count` vertices."""
        corners = np.asarray(triangles, dtype=np.int64)
        self._corners = corners
        self._count = count
        if count > MOST_VERTICES:
            self._ends = np.zeros((0, 2), dtype=np.int64)
            self.triangles: Ints = corners
            return
        sides = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        self._ends, middle = np.unique(sides, axis=0, return_inverse=True)
        a, b, c = corners.T
        ab, bc, ca = count + middle.reshape(-1, 3).T
        self.triangles = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        )

    def positions(self, vertices: Floats) -> Floats:
        """Positions (n + e, 3) over vertices (n, 3): their own, then the edge middles."""
        if not len(self._ends):
            return vertices
        a, b, c = (vertices[self._corners[:, k]] for k in range(3))
        across = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        where = self._corners.ravel()
        normals: Floats = np.stack(
            [np.bincount(where, across[:, k], minlength=self._count) for k in range(3)], axis=1
        )
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(length > 0.0, length, 1.0)
        first, second = self._ends.T
        chord = vertices[second] - vertices[first]
        start, end = normals[first], normals[second]
        rise = np.einsum('ij,ij->i', chord, start)[:, None] * start
        fall = np.einsum('ij,ij->i', chord, end)[:, None] * end
        middles = 0.5 * (vertices[first] + vertices[second]) - (rise - fall) / 8.0
        return np.concatenate([vertices, middles])

    def values(self, values: Floats) -> Floats:
        """Values (n + e,) over values (n,): means on the edges, NaN next to NaN."""
        return np.concatenate([values, values[self._ends].mean(axis=1)])
