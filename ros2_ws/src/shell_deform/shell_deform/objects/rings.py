# SPDX-License-Identifier: Apache-2.0
"""Triangulations made of rings: staggered rows that may end in hexagonal caps.

A cap around a pole is a piece of the regular triangular lattice: ring k has 6 k vertices. Beyond
its rim every ring has the same number of vertices. All vertices have six neighbours, except the
six corners of each cap's rim, which have five (together the twelve that a closed surface needs).
Vertices are given by conformal coordinates: the longitude, and the logarithm of the distance
from the pole as the plane would show it. A surface of revolution drawn from them has triangles
that keep their shape while their size changes smoothly, which is what a smooth Loop surface needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.linalg import spsolve

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

EQUILATERAL = np.sqrt(3.0) / 2.0


@dataclass(frozen=True)
class RingMesh:
    """Topology and conformal coordinates of a ring mesh.

    Attributes:
        height: (n,) conformal height; -inf at a lower pole, +inf at an upper one.
        longitude: (n,) [rad].
        triangles: (m, 3), outward if height points to the north and longitude to the east.
        row: (n,) ring number, counted from below; a cap's rings included.
    """

    height: FloatArray
    longitude: FloatArray
    triangles: IntArray
    row: IntArray


def ring_count_with_caps(cap_rings: int, rows: int, caps: int) -> int:
    """Number of vertices of :func:`ring_mesh`."""
    around = 6 * cap_rings
    cap = 1 + 3 * cap_rings * (cap_rings + 1)
    return caps * cap + around * (rows + 1 - caps)


def row_height(around: int) -> float:
    """Conformal height of a row of equilateral triangles with `around` vertices."""
    return EQUILATERAL * 2.0 * np.pi / around


def ring_mesh(
    around: int, rows: int, spacing: float, lower_cap: bool = True, upper_cap: bool = True
) -> RingMesh:
    """Rows of triangles between two rings, each closed by a cap or left open.

    Args:
        around: vertices per ring; a multiple of six if there is a cap.
        rows: rows of triangles between the two outermost full rings; none leaves a cap alone.
        spacing: conformal height of a row; :func:`row_height` makes them equilateral.
        lower_cap, upper_cap: close that end with a hexagonal cap.

    Returns:
        The mesh, the ring with height zero being the lowest full ring.
    """
    shift = 0.5 * (np.arange(rows + 1) % 2)[:, None]
    height = np.repeat(spacing * np.arange(rows + 1)[:, None], around, axis=1)
    longitude = 2.0 * np.pi * (np.arange(around) + shift) / around
    parts = [_row_faces(around, j) for j in range(rows)]
    heights, longitudes, row = [], [], [np.repeat(np.arange(rows + 1), around)]
    count = height.size
    if lower_cap or upper_cap:
        cap = _cap(around // 6, spacing, min(rows, 2 * around // 3))
        reach = min(rows + 1, len(cap.rise))
    if lower_cap:
        height[:reach] += cap.rise[:reach]
        longitude[:reach] += cap.turn[:reach]
        parts.append(cap.attached(count, np.arange(around))[:, ::-1])
        heights.append(cap.height)
        longitudes.append(cap.longitude)
        row.append(np.full(len(cap.height), -1))
        count += len(cap.height)
    if upper_cap:
        for j in range(reach):
            # On a row that is staggered against the rim, numbers start half a step later.
            late = (rows % 2) * (j % 2)
            height[rows - j] -= np.roll(cap.rise[j], late)
            longitude[rows - j] += np.roll(cap.turn[j], late)
        parts.append(cap.attached(count, rows * around + np.arange(around)))
        heights.append(rows * spacing - cap.height)
        longitudes.append(cap.longitude + np.pi * (rows % 2) / around)
        row.append(np.full(len(cap.height), rows + 1))
    return RingMesh(
        np.concatenate([height.ravel(), *heights]),
        np.concatenate([longitude.ravel(), *longitudes]),
        np.concatenate(parts),
        np.concatenate(row),
    )


@dataclass(frozen=True)
class _Cap:
    """A hexagonal cap below a ring mesh.

    Attributes:
        height, longitude: (c,) of the vertices inside the rim.
        triangles: inner vertices first, the rim's last, counter-clockwise seen from outside an
            upper cap.
        rise, turn: (k, around) how the hexagon bends the k rings from the rim on.
    """

    height: FloatArray
    longitude: FloatArray
    triangles: IntArray
    rise: FloatArray
    turn: FloatArray

    def attached(self, offset: int, rim: IntArray) -> IntArray:
        """Triangles with inner vertices numbered from `offset` and the given rim."""
        return np.concatenate([offset + np.arange(len(self.height)), rim])[self.triangles]


def _row_faces(around: int, j: int) -> IntArray:
    lower = j * around + np.arange(around)
    upper = lower + around
    next_lower, next_upper = np.roll(lower, -1), np.roll(upper, -1)
    if j % 2 == 0:
        first = np.column_stack([lower, next_lower, upper])
        second = np.column_stack([next_lower, next_upper, upper])
    else:
        first = np.column_stack([lower, next_upper, upper])
        second = np.column_stack([lower, next_lower, next_upper])
    return np.concatenate([first, second])


@lru_cache(maxsize=64)
def _cap(rings: int, spacing: float, rows: int) -> _Cap:
    """Lay out a cap below some rows of the given spacing.

    The cap and some rows beyond it are laid into a disc by the discrete harmonic map, which
    tends to the conformal one (Gu and Yau, Global conformal surface parameterization, 2003).
    """
    counts = [1] + [6 * k for k in range(1, rings + 1)]
    start = np.concatenate([[0], np.cumsum(counts)])
    faces = []
    for k in range(1, rings + 1):
        for sector in range(6):
            outer = [start[k] + (sector * k + j) % (6 * k) for j in range(k + 1)]
            inner = [start[k - 1] + (sector * (k - 1) + j) % max(1, 6 * (k - 1)) for j in range(k)]
            faces += [(outer[j], outer[j + 1], inner[j]) for j in range(k)]
            faces += [(inner[j], outer[j + 1], inner[j + 1]) for j in range(k - 1)]
    # Seen from outside an upper cap, its rings run counter-clockwise from the centre outward.
    cap = np.array(faces, dtype=np.int64)
    around = 6 * rings
    total = start[-1] + rows * around
    weights = _cotangents(cap, np.ones(3) / np.sqrt(3.0), total)
    base = 2.0 * np.pi / around
    flat = spacing / base
    cotangent = np.array([(flat**2 - 0.25) / flat, 0.5 / flat, 0.5 / flat]) / 2.0
    for j in range(rows):
        lower = start[rings] + j * around + np.arange(around)
        row = _row_faces(around, j) + start[rings]
        single = np.isin(row, lower)
        alone = np.where(single.sum(axis=1) == 1, single.argmax(axis=1), (~single).argmax(axis=1))
        turned = row[np.arange(len(row))[:, None], (alone[:, None] + np.arange(3)) % 3]
        weights = weights + _cotangents(turned, 2.0 * cotangent, total)
    edge = np.arange(total - around, total)
    free = np.arange(total - around)
    angle = 2.0 * np.pi * (np.arange(around) + 0.5 * (rows % 2)) / around
    rim = np.exp(1j * angle)
    place = spsolve(weights[free][:, free].tocsc(), -(weights[free][:, edge] @ rim))
    place = np.concatenate([place, rim])
    with np.errstate(divide='ignore'):
        level = np.log(np.abs(place))
    grown = level[start[rings] :].reshape(rows + 1, around)
    # The discrete map grows by a slightly other factor per row than the smooth one.
    scale = spacing / float(grown[-1].mean() - grown[-2].mean()) if rows > 1 else 1.0
    height = scale * level + rows * spacing
    steps = np.arange(rows + 1)[:, None]
    even = 2.0 * np.pi * (np.arange(around) + 0.5 * (steps % 2)) / around
    rings_place = place[start[rings] :].reshape(rows + 1, around)
    inner = start[rings]
    return _Cap(
        height[:inner],
        np.angle(place[:inner]),
        cap,
        height[inner:].reshape(rows + 1, around) - spacing * steps,
        np.angle(rings_place * np.exp(-1j * even)),
    )


def _cotangents(faces: IntArray, cotangent: FloatArray, total: int) -> csr_matrix:
    """Laplacian of triangles that all have the same cotangents at their three corners."""
    rows, columns, values = [], [], []
    for corner in range(3):
        i, j = faces[:, (corner + 1) % 3], faces[:, (corner + 2) % 3]
        weight = np.full(len(faces), 0.5 * cotangent[corner])
        rows += [i, j, i, j]
        columns += [j, i, i, j]
        values += [-weight, -weight, weight, weight]
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return coo_matrix(entries, (total, total)).tocsr()
