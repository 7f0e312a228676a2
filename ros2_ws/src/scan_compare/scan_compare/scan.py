"""A scan in memory: welded points in metres, optional triangles, and what was done to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

WELD_CELLS = 2**20
"""Vertices in the same cell of a grid of this many cells along the longest side are one vertex.

For a ball of 65 mm a cell is 0.06 micrometres: far below any scanner, above rounding of text."""


@dataclass(frozen=True)
class Scan:
    """A scan: `points` (n, 3) [m], `triangles` (m, 3) int32 into them or None for a cloud.

    `unit` is the unit of the file, `unit_inferred` whether the size decided it, `source` names
    where the scan came from, `notes` say what was inferred, repaired or left out.
    """

    points: np.ndarray
    triangles: np.ndarray | None
    unit: str
    unit_inferred: bool
    source: str
    notes: tuple[str, ...] = ()

    def moved(self, rotation: np.ndarray, translation: np.ndarray) -> Scan:
        """Return the scan with every point p moved to rotation @ p + translation."""
        return replace(self, points=self.points @ np.asarray(rotation).T + translation)

    def vertex_areas(self) -> np.ndarray | None:
        """Return the mesh area that each vertex stands for, (n,) [m^2]; None for a cloud."""
        if self.triangles is None:
            return None
        area = 0.5 * np.linalg.norm(_face_vectors(self.points, self.triangles), axis=1)
        return np.bincount(
            self.triangles.ravel(), np.repeat(area / 3.0, 3), minlength=len(self.points)
        )

    def vertex_normals(self) -> np.ndarray | None:
        """Return area-weighted unit normals (n, 3), zero where undefined; None for a cloud."""
        if self.triangles is None:
            return None
        vectors = _face_vectors(self.points, self.triangles)
        normals = np.empty_like(self.points)
        for axis in range(3):
            normals[:, axis] = np.bincount(
                self.triangles.ravel(),
                np.repeat(vectors[:, axis], 3),
                minlength=len(self.points),
            )
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return normals / np.where(length > 0.0, length, 1.0)


def _face_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (m, 3): normal direction times twice the area of each triangle."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


@dataclass(frozen=True)
class Cleaned:
    """Result of `clean`: welded `points`, repaired `triangles`, `notes` on what was dropped."""

    points: np.ndarray
    triangles: np.ndarray | None
    notes: tuple[str, ...]


def clean(points: np.ndarray, triangles: np.ndarray | None) -> Cleaned:
    """Drop points that are not finite, weld equal vertices, drop degenerate and repeated faces.

    points (n, 3) in any unit, triangles (m, 3) or None. The order of first appearance is kept.
    Without welding, a mean over STL vertices would weight each by its number of faces.
    """
    notes = []
    new_index, kept = _finite(points)
    if len(kept) < len(points):
        notes.append(f'{len(points) - len(kept)} points with NaN or infinite coordinates dropped')
        points = points[kept]
    welded, to_welded = weld(points)
    if len(welded) < len(points):
        notes.append(f'{len(points)} points welded to {len(welded)}')
    if triangles is None:
        return Cleaned(welded, None, tuple(notes))
    if new_index is not None:
        triangles = new_index[triangles]
        triangles = triangles[(triangles >= 0).all(axis=1)]
    triangles = to_welded[triangles]
    good = _useful_faces(welded, triangles)
    if good.size < len(triangles):
        dropped = len(triangles) - good.size
        notes.append(f'{dropped} degenerate or repeated faces dropped')
        triangles = triangles[good]
    if len(triangles) == 0:
        return Cleaned(welded, None, tuple(notes))
    return Cleaned(welded, np.ascontiguousarray(triangles, np.int32), tuple(notes))


def _finite(points: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Return new indices (-1 where dropped; None if none is dropped) and the indices kept.

    Coordinates of 1e30 and more are no lengths either and would overflow when squared.
    """
    good = np.all(np.abs(points) < 1e30, axis=1)
    kept = np.flatnonzero(good)
    if len(kept) == len(points):
        return None, kept
    new_index = np.full(len(points), -1, np.int32)
    new_index[kept] = np.arange(len(kept), dtype=np.int32)
    return new_index, kept


def weld(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge points (n, 3) of the same fine grid cell.

    Returns the points of first appearance (k, 3) in their order and, for each given point, its
    index among them (n,).
    """
    if len(points) == 0:
        return points, np.zeros(0, np.int32)
    key = _cell_keys(points)
    order = np.argsort(key, kind='stable')
    key = key[order]
    is_first = np.concatenate(([True], key[1:] != key[:-1]))
    del key
    if is_first.all():
        return points, np.arange(len(points), dtype=np.int32)
    # the sort is stable: the first of each group is the one that appeared first
    first = np.sort(order[is_first])
    group_start = np.repeat(
        order[is_first], np.diff(np.flatnonzero(np.concatenate((is_first, [True]))))
    )
    leader = np.empty(len(points), np.int32)
    leader[order] = np.searchsorted(first, group_start)
    return points[first], leader


def _cell_keys(points: np.ndarray) -> np.ndarray:
    """Return one integer per point (n,) that names its cell of the welding grid."""
    low = points.min(axis=0)
    side = float((points.max(axis=0) - low).max())
    scale = (WELD_CELLS - 1) / side if side > 0.0 else 0.0
    key = np.zeros(len(points), np.int64)
    for axis in range(3):
        cell = points[:, axis] - low[axis]
        cell *= scale
        key *= WELD_CELLS
        key += np.rint(cell, out=cell).astype(np.int64)
    return key


def _has_area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return which triangles (m,) are not flat; in pieces, to need little memory."""
    result = np.empty(len(triangles), bool)
    for start in range(0, len(triangles), 2**17):
        piece = slice(start, start + 2**17)
        result[piece] = np.any(_face_vectors(points, triangles[piece]) != 0.0, axis=1)
    return result


def _useful_faces(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the indices of faces with area, each vertex triple once, in order."""
    ordered = np.sort(triangles, axis=1)
    distinct = (ordered[:, 0] != ordered[:, 1]) & (ordered[:, 1] != ordered[:, 2])
    candidates = np.flatnonzero(distinct & _has_area(points, triangles))
    if candidates.size == 0:
        return candidates
    low, middle, high = ordered[candidates].astype(np.int64).T
    pair = low * len(points) + middle
    order = np.lexsort((high, pair))
    repeated = (np.diff(pair[order]) == 0) & (np.diff(high[order]) == 0)
    return candidates[np.sort(order[np.concatenate(([True], ~repeated))])]
