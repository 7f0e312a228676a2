# SPDX-License-Identifier: Apache-2.0
"""Topology of the neighbourhood that shapes one triangle, and its exact local subdivision.

The limit surface over a triangle depends on the fans of triangles around its three corners, each
cut at sharp edges. Triangles whose fans look alike share one :class:`Patch`, which knows how to
split itself into four smaller patches. After one split at most one corner is irregular; the
three other pieces are box splines, and the fourth repeats itself at half the size (J. Stam,
Evaluation of Loop subdivision surfaces, SIGGRAPH 1998 course notes).

Rules: smooth vertices after C. Loop (1987); boundaries, creases and corners are cubic B-splines
with the interior rule next to irregular boundary vertices after H. Biermann, A. Levin and
D. Zorin, Piecewise smooth subdivision surfaces with normal control, SIGGRAPH 2000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .box_spline import LATTICE

FloatArray = npt.NDArray[np.float64]

SMOOTH, DART, CREASE, CORNER = range(4)
REGULAR_WEIGHT = 0.375

CHILD_SCALE = (2.0, 2.0, 2.0, -2.0)
"""Derivative of a child's parameters with respect to its parent's."""
CHILD_SHIFT = ((0.0, 0.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 1.0))
"""Child parameters = scale x parent parameters + shift."""


class Fan(NamedTuple):
    """The triangles around one corner, as patch-local vertex numbers.

    A closed fan starts its ring with the next corner of the triangle. An open fan runs
    counter-clockwise from sharp edge to sharp edge.

    Attributes:
        kind: SMOOTH, DART, CREASE or CORNER.
        ring: neighbours of the corner, counter-clockwise.
        weights: share of the corner in the new point of each edge (both ends share 3/4).
        start: position in the ring of the triangle's next corner.
        sharp: position of the only sharp edge of a DART, else -1.
    """

    kind: int
    ring: tuple[int, ...]
    weights: tuple[float, ...]
    start: int
    sharp: int

    @property
    def is_regular(self) -> bool:
        """True where the fan is part of a regular lattice, mirrored at the boundary if open."""
        length = {SMOOTH: 6, CREASE: 4}.get(self.kind, -1)
        return len(self.ring) == length and all(w == REGULAR_WEIGHT for w in self.weights)

    def is_sharp(self, position: int) -> bool:
        """True if the edge to ring[position] is sharp."""
        if self.kind in (CREASE, CORNER):
            return position in (0, len(self.ring) - 1)
        return position == self.sharp


def smooth_ring_weight(valence: int) -> float:
    """Loop's weight of each neighbour in the new position of a smooth vertex."""
    return (0.625 - (0.375 + 0.25 * math.cos(2.0 * math.pi / valence)) ** 2) / valence


def smooth_limit_weight(valence: int) -> float:
    """Weight of each neighbour in the limit position of a smooth vertex."""
    return 1.0 / (0.375 / smooth_ring_weight(valence) + valence)


def neighbour_weight(kind: int, triangles: int) -> float:
    """Share of the smooth end of an edge whose other end has an open fan of `triangles`.

    A corner is taken as convex with a right angle, whatever its angle in space.
    """
    angle = math.pi if kind == CREASE else 0.5 * math.pi
    return (
        REGULAR_WEIGHT
        if (kind, triangles) == (CREASE, 3)
        else 0.5 - 0.25 * math.cos(angle / triangles)
    )


def own_weights(fan: Fan) -> tuple[float, ...]:
    """Share of a corner in its edges' new points if no neighbour interferes."""
    weight = REGULAR_WEIGHT
    if fan.kind in (CREASE, CORNER):
        weight = 0.75 - neighbour_weight(fan.kind, len(fan.ring) - 1)
    return tuple(
        REGULAR_WEIGHT if fan.is_sharp(position) else weight for position in range(len(fan.ring))
    )


def limit_weights(kind: int, ring_size: int, sharp: int = -1) -> FloatArray:
    """(1 + ring_size,) weights of a vertex and of its ring in the vertex's limit position."""
    weights = np.zeros(1 + ring_size)
    if kind == CORNER:
        weights[0] = 1.0
    elif kind == CREASE:
        weights[[0, 1, -1]] = 2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0
    elif kind == SMOOTH:
        weights[1:] = smooth_limit_weight(ring_size)
        weights[0] = 1.0 - ring_size * weights[1]
    else:
        weights[:] = _dart_limit_weights(ring_size, sharp)
    return weights


def _dart_limit_weights(ring_size: int, sharp: int) -> FloatArray:
    """Left eigenvector, to the eigenvalue one, of one split of the ring around a dart."""
    matrix = np.zeros((1 + ring_size, 1 + ring_size))
    matrix[0, 1:] = smooth_ring_weight(ring_size)
    matrix[0, 0] = 1.0 - ring_size * matrix[0, 1]
    for i in range(ring_size):
        own = 0.5 if i == sharp else REGULAR_WEIGHT
        matrix[1 + i, [0, 1 + i]] = own
        for j in (i - 1, i + 1):
            matrix[1 + i, 1 + j % ring_size] += 0.5 - own
    system = np.vstack([matrix.T - np.eye(1 + ring_size), np.ones(1 + ring_size)])
    right = np.zeros(2 + ring_size)
    right[-1] = 1.0
    return np.asarray(np.linalg.lstsq(system, right, rcond=None)[0], dtype=float)


@dataclass(frozen=True)
class Patch:
    """One class of triangle neighbourhoods, identified by its three fans.

    The local numbering is canonical: corners 0, 1, 2, then the rings of the corners in turn,
    each vertex where it is met first.
    """

    fans: tuple[Fan, Fan, Fan]

    @cached_property
    def size(self) -> int:
        """Number of control points that shape the triangle."""
        return 1 + max(max(fan.ring) for fan in self.fans)

    @cached_property
    def is_regular(self) -> bool:
        """True if the whole triangle is one box-spline patch."""
        return all(fan.is_regular for fan in self.fans)

    @cached_property
    def irregular_corners(self) -> tuple[bool, bool, bool]:
        """Which corners keep an irregular fan however often the triangle is split."""
        first, second, third = (
            not fan._replace(weights=(REGULAR_WEIGHT,) * len(fan.ring)).is_regular
            for fan in self.fans
        )
        return first, second, third

    def limit_row(self, corner: int) -> FloatArray:
        """(size,) weights of the control points in the limit position of a corner."""
        row, fan = np.zeros(self.size), self.fans[corner]
        if any(weight != own for weight, own in zip(fan.weights, own_weights(fan), strict=True)):
            # An irregular boundary vertex in the ring bends the rules once, in the first split.
            piece, step = self.children[corner]
            return piece.limit_row(corner) @ step
        weights = limit_weights(fan.kind, len(fan.ring), fan.sharp)
        np.add.at(row, [corner, *fan.ring], weights)
        return row

    def tangent_rows(self, corner: int) -> FloatArray:
        """(2, size) weights of two tangents at a smooth corner, in the surface's orientation."""
        rows, fan = np.zeros((2, self.size)), self.fans[corner]
        if any(weight != REGULAR_WEIGHT for weight in fan.weights):
            piece, step = self.children[corner]
            return piece.tangent_rows(corner) @ step
        angle = 2.0 * np.pi * np.arange(len(fan.ring)) / len(fan.ring)
        np.add.at(rows, (0, list(fan.ring)), np.cos(angle))
        np.add.at(rows, (1, list(fan.ring)), np.sin(angle))
        return rows

    @cached_property
    def halvings(self) -> int:
        """How often to split towards an irregular corner before round-off outweighs distance.

        Around a corner of valence three the surface shrinks by four with each split, so that
        its control points soon differ in their last digits only.
        """
        rings = [len(f.ring) for f in self.fans if f.kind in (SMOOTH, DART)]
        shrinking = min(0.375 + 0.25 * math.cos(2.0 * math.pi / n) for n in [6, *rings])
        return int(math.log(1e-8) / math.log(shrinking))

    @cached_property
    def to_box(self) -> FloatArray:
        """(12, size) the twelve box-spline points from the control points of a regular patch.

        Points beyond a boundary are mirrored: across each boundary edge they complete the
        parallelogram, which reproduces the cubic B-spline boundary exactly.
        """
        matrix = np.zeros((12, self.size))
        unit = np.eye(self.size)
        for corner, fan in enumerate(self.fans):
            centre, ring = unit[corner], [unit[i] for i in fan.ring]
            if fan.kind == CREASE:
                ring += [centre + ring[-1] - ring[-2], centre + ring[0] - ring[1]]
            ring = ring[fan.start :] + ring[: fan.start]
            matrix[corner] = centre
            for position, row in zip(_RING_POSITIONS[corner], ring, strict=True):
                matrix[position] = row
        return matrix

    @cached_property
    def children(self) -> tuple[tuple[Patch, FloatArray], ...]:
        """Four (patch, matrix): corner pieces 0, 1, 2 and the middle one, turned by half a turn.

        The matrix (child size, size) gives the child's control points.
        """
        points = _Subdivided(self.fans, self.size)
        corner = [points.corner_fan(i) for i in range(3)]
        side = [points.side_fan(i) for i in range(3)]
        v, e = points.corner_keys, points.side_keys
        pieces = (
            ((v[0], e[0], e[2]), (corner[0], side[0], side[2])),
            ((e[0], v[1], e[1]), (side[0], corner[1], side[1])),
            ((e[2], e[1], v[2]), (side[2], side[1], corner[2])),
            ((e[1], e[2], e[0]), (side[1], side[2], side[0])),
        )
        return tuple(points.piece(keys, fans) for keys, fans in pieces)


def _ring_positions() -> tuple[tuple[int, ...], ...]:
    """Position among the twelve points of each ring, starting at the corner's next corner."""
    turn = ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))
    rings = []
    for corner, first in enumerate((0, 2, 4)):
        x, y = LATTICE[corner]
        steps = turn[first:] + turn[:first]
        rings.append(tuple(LATTICE.index((x + dx, y + dy)) for dx, dy in steps))
    return tuple(rings)


_RING_POSITIONS = _ring_positions()

Key = tuple[int, int]
"""A vertex of the split patch: (i, i) a moved corner, (i, j) with i < j the point of an edge."""


class _KeyFan(NamedTuple):
    kind: int
    ring: tuple[Key, ...]
    weights: tuple[float, ...]
    sharp: int


class _Subdivided:
    """The vertices of a patch after one split, by key, with their rows and fans."""

    def __init__(self, fans: tuple[Fan, Fan, Fan], size: int) -> None:
        self._fans = fans
        self._unit = np.eye(size)
        self._rows: dict[Key, FloatArray] = {}
        self.corner_keys = tuple((i, i) for i in range(3))
        self.side_keys = tuple(_key(i, (i + 1) % 3) for i in range(3))
        for corner, fan in enumerate(fans):
            self._rows[corner, corner] = self._corner_row(corner, fan)
            for position, other in enumerate(fan.ring):
                self._rows[_key(corner, other)] = self._edge_row(corner, fan, position)

    def _corner_row(self, corner: int, fan: Fan) -> FloatArray:
        own = self._unit[corner]
        if fan.kind == CORNER:
            return own
        if fan.kind == CREASE:
            return 0.75 * own + 0.125 * (self._unit[fan.ring[0]] + self._unit[fan.ring[-1]])
        weight = smooth_ring_weight(len(fan.ring))
        return (1.0 - len(fan.ring) * weight) * own + weight * self._unit[list(fan.ring)].sum(
            axis=0
        )

    def _edge_row(self, corner: int, fan: Fan, position: int) -> FloatArray:
        own, other = self._unit[corner], self._unit[fan.ring[position]]
        if fan.is_sharp(position):
            return 0.5 * (own + other)
        before = self._unit[fan.ring[position - 1]]
        after = self._unit[fan.ring[(position + 1) % len(fan.ring)]]
        weight = fan.weights[position]
        return weight * own + (0.75 - weight) * other + 0.125 * (before + after)

    def corner_fan(self, corner: int) -> _KeyFan:
        """Fan around a moved corner."""
        fan = self._fans[corner]
        ring = tuple(_key(corner, other) for other in fan.ring)
        return _KeyFan(fan.kind, ring, own_weights(fan), fan.sharp)

    def side_fan(self, side: int) -> _KeyFan:
        """Fan around the point of the edge from corner `side` to the next corner."""
        i, j, k = side, (side + 1) % 3, (side + 2) % 3
        fan = self._fans[i]
        inner = ((j, j), _key(j, k), _key(i, k), (i, i))
        if fan.is_sharp(fan.start):
            return _KeyFan(CREASE, inner, (REGULAR_WEIGHT,) * 4, -1)
        across = fan.ring[fan.start - 1]
        ring = (*inner, _key(i, across), _key(j, across))
        weights = [REGULAR_WEIGHT] * 6
        end = self._fans[j]
        weights[0] = 0.75 - own_weights(end)[end.ring.index(i)]
        weights[3] = 0.75 - own_weights(fan)[fan.start]
        return _KeyFan(SMOOTH, ring, tuple(weights), -1)

    def piece(
        self, keys: tuple[Key, Key, Key], fans: tuple[_KeyFan, _KeyFan, _KeyFan]
    ) -> tuple[Patch, FloatArray]:
        """The patch with the given corners and fans, and its rows."""
        number: dict[Key, int] = {key: i for i, key in enumerate(keys)}
        local = []
        for corner, fan in enumerate(fans):
            start = fan.ring.index(keys[(corner + 1) % 3])
            ring, weights, sharp = fan.ring, fan.weights, fan.sharp
            if fan.kind in (SMOOTH, DART):
                ring, weights = ring[start:] + ring[:start], weights[start:] + weights[:start]
                sharp = (sharp - start) % len(ring) if sharp >= 0 else -1
                start = 0
            for key in ring:
                number.setdefault(key, len(number))
            local.append(Fan(fan.kind, tuple(number[k] for k in ring), weights, start, sharp))
        patch = _known.setdefault(
            (local[0], local[1], local[2]), Patch((local[0], local[1], local[2]))
        )
        return patch, np.stack([self._rows[key] for key in number])


def _key(i: int, j: int) -> Key:
    return (i, j) if i < j else (j, i)


_known: dict[tuple[Fan, Fan, Fan], Patch] = {}


def patch_of(fans: tuple[Fan, Fan, Fan]) -> Patch:
    """Return the one patch with these fans, so that its matrices are computed only once."""
    return _known.setdefault(fans, Patch(fans))
