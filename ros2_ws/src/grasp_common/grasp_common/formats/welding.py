# SPDX-License-Identifier: Apache-2.0
"""Vertices at one place made one: STL stores each corner anew, exporters round and repeat."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

WELD_SHARE = 2.0**-20
"""Vertices closer than this share of the size of a scan may be one vertex.

For a ball of 65 mm that is 0.06 micrometres: far below any scanner, above rounding of text. The
size is that of most points, so that a stray one coarsens nothing."""

WELD_SPACING_SHARE = 2.0**-10
"""... and closer than this share of the distance between neighbouring points."""

PIECE = 2**17
"""Points or faces treated at once, so that working memory does not grow with a scan."""

MIX = np.uint64(0x9E3779B97F4A7C15)
"""Odd, its bits spread (2^64 over the golden ratio): joins the corners of a face to one hash."""


def pieces(count: int, size: int = PIECE) -> Iterator[slice]:
    """Yield slices that cover `count` rows, so that working memory does not grow with them."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def middle_and_size(points: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, float]:
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
    for piece in pieces(len(order)):
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
    for piece in pieces(len(points)):
        is_leader[piece] = number[piece] == np.arange(piece.start, piece.stop)
    rank = np.cumsum(is_leader, dtype=np.int32)
    rank -= 1
    for piece in pieces(len(points)):
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
    for piece in pieces(count):
        chosen = points[piece] if place is None else points[place[piece]]
        cells = np.rint((chosen - middle) * scale).astype(np.int64).astype(np.uint64)
        # 64 bits: two cells of ten million share a hash once in 400 000 scans
        key[piece] = (cells[:, 0] * MIX + cells[:, 1]) * MIX + cells[:, 2]
    return key
