# SPDX-License-Identifier: Apache-2.0
"""A scan in memory: welded points in metres, optional triangles, and what was done to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grasp_common.formats.welding import MIX, middle_and_size, pieces, weld

STRAY_FACTOR = 100.0
"""Points further from the middle than this many sizes of the scan are no part of it."""


@dataclass(frozen=True)
class Scan:
    """A scan: `points` (n, 3) [m], `triangles` (m, 3) int32 into them or None for a cloud.

    `unit` is the unit of the file, `unit_inferred` whether the size decided it, `source` names
    where the scan came from, `notes` say what was inferred, repaired or left out. `view` (n,): the
    number of the view that each point is from, None where nobody says.
    """

    points: np.ndarray
    triangles: np.ndarray | None
    unit: str
    unit_inferred: bool
    source: str
    notes: tuple[str, ...] = ()
    view: np.ndarray | None = None

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
    Without welding, a mean over STL vertices would weight each by its number of faces. Both
    arrays are worked on where they are and hold nothing of use afterwards: a large scan is not
    in memory twice.
    """
    notes = []
    good = _finite(points)
    if not good.all():
        notes.append(f'{np.count_nonzero(~good)} points with NaN or infinite coordinates dropped')
    middle, size = middle_and_size(points, good)
    strays = _drop_strays(points, good, middle, size)
    if strays:
        notes.append(
            f'{strays} points dropped that lie more than {STRAY_FACTOR:g} times the size of the '
            'scan away from it'
        )
    kept, to_welded = weld(points, good, middle, size)
    if len(kept) < np.count_nonzero(good):
        notes.append(f'{np.count_nonzero(good)} points welded to {len(kept)}')
    welded = _gathered(points, kept)
    del kept, good, points
    if triangles is None:
        return Cleaned(welded, None, tuple(notes))
    given = len(triangles)
    triangles = _without_degenerate(welded, triangles, to_welded)
    del to_welded
    triangles = _without_repeated(triangles)
    if len(triangles) < given:
        notes.append(f'{given - len(triangles)} degenerate or repeated faces dropped')
    if len(triangles) == 0:
        return Cleaned(welded, None, tuple(notes))
    return Cleaned(welded, triangles, tuple(notes))


def _finite(points: np.ndarray) -> np.ndarray:
    """Return which points (n,) are lengths.

    Coordinates of 1e30 and more are none either and would overflow when squared.
    """
    good = np.empty(len(points), bool)
    for piece in pieces(len(points)):
        good[piece] = np.all(np.abs(points[piece]) < 1e30, axis=1)
    return good


def _gathered(rows: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Move the rows `kept` (ascending) of an array to its front and return them."""
    if len(kept) == len(rows):
        return rows
    for piece in pieces(len(kept)):
        rows[piece] = rows[kept[piece]]
    front = rows[: len(kept)]
    # a small front must not keep the large array in memory
    return front if 2 * len(kept) > len(rows) else front.copy()


def _drop_strays(points: np.ndarray, good: np.ndarray, middle: np.ndarray, size: float) -> int:
    """Mark points that are far from all others as not good; returns how many."""
    before = int(np.count_nonzero(good))
    for piece in pieces(len(points)):
        with np.errstate(invalid='ignore'):
            near = np.abs(points[piece] - middle).max(axis=1) <= STRAY_FACTOR * size
        good[piece] &= near
    return before - int(np.count_nonzero(good))


def _without_degenerate(
    points: np.ndarray, triangles: np.ndarray, new_index: np.ndarray
) -> np.ndarray:
    """Rename the corners of faces (m, 3) and keep those with area, repeated ones once a piece.

    A file of few vertices and very many faces shrinks here, before all are sorted together.
    """
    kept = 0
    for piece in pieces(len(triangles)):
        faces = new_index[triangles[piece]]
        faces = faces[(faces >= 0).all(axis=1)]
        distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
        faces = faces[distinct & (faces[:, 2] != faces[:, 0])]
        faces = faces[np.any(_face_vectors(points, faces) != 0.0, axis=1)]
        faces = faces[_first_of_each(faces)]
        triangles[kept : kept + len(faces)] = faces
        kept += len(faces)
    return triangles[:kept]


def _without_repeated(triangles: np.ndarray) -> np.ndarray:
    """Keep each triple of corners (m, 3) once, where it appears first."""
    return np.ascontiguousarray(_gathered(triangles, _first_of_each(triangles)), np.int32)


def _first_of_each(triangles: np.ndarray) -> np.ndarray:
    """Return the indices (k,), ascending, of the first face of each triple of corners."""
    key = np.empty(len(triangles), np.uint64)
    for piece in pieces(len(triangles)):
        low, middle, high = np.sort(triangles[piece], axis=1).astype(np.uint64).T
        key[piece] = (low * MIX + middle) * MIX + high
    order = np.argsort(key, kind='stable')
    repeated = np.zeros(len(triangles), bool)
    for piece in pieces(len(triangles) - 1):
        before, after = order[piece], order[piece.start + 1 : piece.stop + 1]
        same = np.flatnonzero(key[before] == key[after])
        # faces of one hash are compared, so that none is lost by chance
        first, second = (np.sort(triangles[part[same]], axis=1) for part in (before, after))
        repeated[after[same[(first == second).all(axis=1)]]] = True
    return np.flatnonzero(~repeated)
