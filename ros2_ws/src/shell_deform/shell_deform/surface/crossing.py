# SPDX-License-Identifier: Apache-2.0
"""Whether a surface passes through itself: a collapsed tube, a can pressed flat.

Nothing in the energy of a shell keeps two parts of it apart, so an equilibrium may be one that no
wall can take. Edges of every triangle are held against all others near that share no corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHUNK = 200_000
"""Pairs of triangles that are looked at together."""

OUTSIDE = 1e-9
"""A crossing counts so far outside of edges and triangles, of their sizes: mirrored walls meet
edge on edge."""


def crossing(triangles: Index, points: Array) -> Array | None:
    """(3,) where two triangles (t, 3) of `points` (n, 3) [m] cross, None where none do."""
    corners = points[triangles]
    centres = corners.mean(axis=1)
    sizes = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    first, second = _near(centres, sizes)
    apart = ~(triangles[first][:, :, None] == triangles[second][:, None, :]).any(axis=(1, 2))
    apart &= ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
    first, second = first[apart], second[apart]
    for begin in range(0, len(first), CHUNK):
        a, b = corners[first[begin : begin + CHUNK]], corners[second[begin : begin + CHUNK]]
        for one, other in ((a, b), (b, a)):
            for k in range(3):
                found = _pierced(one[:, k], one[:, (k + 1) % 3], other)
                if found is not None:
                    return found
    return None


def _near(centres: Array, sizes: Array) -> tuple[Index, Index]:
    """Pairs of triangles whose balls touch; large ones are looked for among small ones too."""
    found = []
    order = np.argsort(sizes)
    tree = cKDTree(centres)
    # In groups of alike size, so that a few large triangles do not widen every search.
    for group in np.array_split(order, 8):
        if not len(group):
            continue
        reach = 2.0 * float(sizes[group].max())
        for at, others in zip(group, tree.query_ball_point(centres[group], reach), strict=True):
            others = np.asarray(others, dtype=np.int64)
            others = others[sizes[others] <= sizes[at]]
            found.append(np.stack([np.full(len(others), at), others]))
    pairs = np.concatenate(found, axis=1)
    first, second = pairs[:, pairs[0] != pairs[1]]
    gap = np.linalg.norm(centres[first] - centres[second], axis=1)
    near = gap <= sizes[first] + sizes[second]
    return first[near], second[near]


def _pierced(start: Array, end: Array, other: Array) -> Array | None:
    """Where a segment (p, 3) to (p, 3) goes through its triangle (p, 3, 3); None for none."""
    along = end - start
    u, v = other[:, 1] - other[:, 0], other[:, 2] - other[:, 0]
    normal = np.cross(u, v)
    slope = np.einsum('pi,pi->p', normal, along)
    height = np.einsum('pi,pi->p', normal, other[:, 0] - start)
    with np.errstate(divide='ignore', invalid='ignore'):
        share = height / slope
        away = start + share[:, None] * along - other[:, 0]
        square = np.einsum('pi,pi->p', normal, normal)
        s = np.einsum('pi,pi->p', np.cross(away, v), normal) / square
        t = np.einsum('pi,pi->p', np.cross(u, away), normal) / square
        inside = (share > -OUTSIDE) & (share < 1.0 + OUTSIDE)
        inside &= (s > -OUTSIDE) & (t > -OUTSIDE) & (s + t < 1.0 + OUTSIDE)
    hit = np.flatnonzero(inside)
    if not len(hit):
        return None
    at = int(hit[0])
    return np.asarray(start[at] + share[at] * along[at])
