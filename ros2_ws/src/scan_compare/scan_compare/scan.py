"""A scan in memory: welded points in metres, optional triangles, and what was done to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

WELD_SHARE = 2.0**-20
"""Vertices closer than this share of the size of a scan may be one vertex.

For a ball of 65 mm that is 0.06 micrometres: far below any scanner, above rounding of text. The
size is that of most points, so that a stray one coarsens nothing."""

WELD_SPACING_SHARE = 2.0**-10
"""... and closer than this share of the distance between neighbouring points."""

STRAY_FACTOR = 100.0
"""Points further from the middle than this many sizes of the scan are no part of it."""

PIECE = 2**17
"""Points or faces treated at once, so that working memory does not grow with a scan."""

MIX = np.uint64(0x9E3779B97F4A7C15)
"""Odd, its bits spread (2^64 over the golden ratio): joins the corners of a face to one hash."""


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
    middle, size = _middle_and_size(points, good)
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


def _pieces(count: int, size: int = PIECE) -> Iterator[slice]:
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def _finite(points: np.ndarray) -> np.ndarray:
    """Return which points (n,) are lengths.

    Coordinates of 1e30 and more are none either and would overflow when squared.
    """
    good = np.empty(len(points), bool)
    for piece in _pieces(len(points)):
        good[piece] = np.all(np.abs(points[piece]) < 1e30, axis=1)
    return good


def _gathered(rows: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Move the rows `kept` (ascending) of an array to its front and return them."""
    if len(kept) == len(rows):
        return rows
    for piece in _pieces(len(kept)):
        rows[piece] = rows[kept[piece]]
    front = rows[: len(kept)]
    # a small front must not keep the large array in memory
    return front if 2 * len(kept) > len(rows) else front.copy()


def _middle_and_size(points: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the median (3,) of the good points and the largest side of the box of most of them.

    Most: between the 5 % and 95 % quantiles of each coordinate. Where they are all in one place
    the size is that of the box of all points.
    """
    low, middle, high = np.zeros(3), np.zeros(3), np.zeros(3)
    if not good.any():
        return middle, 0.0
    whole = bool(good.all())
    for axis in range(3):
        # one coordinate after the other: a quantile works on a copy
        values = points[:, axis] if whole else points[good, axis]
        low[axis], middle[axis], high[axis] = np.quantile(values, (0.05, 0.5, 0.95))
        if high[axis] == low[axis]:
            middle[axis] = low[axis]
    size = float((high - low).max())
    if size == 0.0:
        size = max(float(np.ptp(points[good, axis])) for axis in range(3))
    return middle, size


def _drop_strays(points: np.ndarray, good: np.ndarray, middle: np.ndarray, size: float) -> int:
    """Mark points that are far from all others as not good; returns how many."""
    before = int(np.count_nonzero(good))
    for piece in _pieces(len(points)):
        with np.errstate(invalid='ignore'):
            near = np.abs(points[piece] - middle).max(axis=1) <= STRAY_FACTOR * size
        good[piece] &= near
    return before - int(np.count_nonzero(good))


def weld(
    points: np.ndarray, good: np.ndarray, middle: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find the points that share a cell of a fine grid, among those (n,) that are `good`.

    middle (3,), size: where the points lie; the cells follow from size and number of them.
    Returns the indices of the first point of each cell (k,), ascending, and, for each given
    point, its place among them (n,) int32, -1 where it is not good.
    """
    number = np.full(len(points), -1, np.int32)
    place = None if good.all() else np.flatnonzero(good).astype(np.int32)
    key = _cell_keys(points, place, middle, size)
    order = np.argsort(key, kind='stable')
    last_key, leader = None, 0
    for piece in _pieces(len(order)):
        member = order[piece]
        sorted_key = key[member]
        begins = np.empty(len(member), bool)
        begins[0] = sorted_key[0] != last_key
        begins[1:] = sorted_key[1:] != sorted_key[:-1]
        # the sort is stable: the first of each group is the one that appeared first
        leaders = np.concatenate(([leader], member[begins]))
        last_key, leader = sorted_key[-1], leaders[-1]
        own = leaders[np.cumsum(begins)]
        if place is None:
            number[member] = own
        else:
            number[place[member]] = place[own]
    del key, order
    is_leader = np.empty(len(points), bool)
    for piece in _pieces(len(points)):
        is_leader[piece] = number[piece] == np.arange(piece.start, piece.stop)
    rank = np.cumsum(is_leader, dtype=np.int32)
    rank -= 1
    for piece in _pieces(len(points)):
        number[piece] = np.where(number[piece] < 0, -1, rank[number[piece]])
    del rank
    return np.flatnonzero(is_leader), number


def _cell_keys(
    points: np.ndarray, place: np.ndarray | None, middle: np.ndarray, size: float
) -> np.ndarray:
    """Return a hash (n,) for each point, or each at `place`, of its cell of the welding grid."""
    count = len(points) if place is None else len(place)
    key = np.zeros(count, np.uint64)
    if count == 0:
        return key
    # points of a surface lie about size / sqrt(count) apart
    cell = size * min(WELD_SHARE, WELD_SPACING_SHARE / count**0.5)
    scale = 1.0 / cell if cell > 0.0 else 0.0
    for piece in _pieces(count):
        chosen = points[piece] if place is None else points[place[piece]]
        cells = np.rint((chosen - middle) * scale).astype(np.int64).astype(np.uint64)
        # 64 bits: two cells of ten million share a hash once in 400 000 scans
        key[piece] = (cells[:, 0] * MIX + cells[:, 1]) * MIX + cells[:, 2]
    return key


def _without_degenerate(
    points: np.ndarray, triangles: np.ndarray, new_index: np.ndarray
) -> np.ndarray:
    """Rename the corners of faces (m, 3) and keep those with area, repeated ones once a piece.

    A file of few vertices and very many faces shrinks here, before all are sorted together.
    """
    kept = 0
    for piece in _pieces(len(triangles)):
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
    for piece in _pieces(len(triangles)):
        low, middle, high = np.sort(triangles[piece], axis=1).astype(np.uint64).T
        key[piece] = (low * MIX + middle) * MIX + high
    order = np.argsort(key, kind='stable')
    repeated = np.zeros(len(triangles), bool)
    for piece in _pieces(len(triangles) - 1):
        before, after = order[piece], order[piece.start + 1 : piece.stop + 1]
        same = np.flatnonzero(key[before] == key[after])
        # faces of one hash are compared, so that none is lost by chance
        first, second = (np.sort(triangles[part[same]], axis=1) for part in (before, after))
        repeated[after[same[(first == second).all(axis=1)]]] = True
    return np.flatnonzero(~repeated)
