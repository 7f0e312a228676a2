# SPDX-License-Identifier: Apache-2.0
"""Finds the patch of every triangle of a control mesh and the control points that shape it."""

from __future__ import annotations

import weakref
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .control_mesh import BoolArray, ControlMesh, FloatArray, IndexArray, IntArray
from .patch import (
    CORNER,
    CREASE,
    DART,
    REGULAR_WEIGHT,
    SMOOTH,
    Fan,
    Patch,
    neighbour_weight,
    patch_of,
)

_PLAIN_FANS = (
    Fan(SMOOTH, (1, 2, 3, 4, 5, 6), (REGULAR_WEIGHT,) * 6, 0, -1),
    Fan(SMOOTH, (2, 0, 6, 7, 8, 9), (REGULAR_WEIGHT,) * 6, 0, -1),
    Fan(SMOOTH, (0, 1, 9, 10, 11, 3), (REGULAR_WEIGHT,) * 6, 0, -1),
)


@dataclass(frozen=True, eq=False)
class PatchTable:
    """The patch of every triangle.

    Attributes:
        patches: the distinct patches of the mesh.
        patch: (m,) index into `patches` of each triangle.
        node_offsets: (m + 1,) start of each triangle's control points in `nodes`.
        nodes: control point numbers in the order of the patch.
    """

    patches: tuple[Patch, ...]
    patch: IntArray
    node_offsets: IntArray
    nodes: IndexArray

    def nodes_of(self, triangles: npt.NDArray[np.integer]) -> IndexArray:
        """(p, size) control points of triangles that share one patch."""
        size = self.patches[self.patch[triangles[0]]].size
        return self.nodes[self.node_offsets[triangles][:, None] + np.arange(size)]


_tables: weakref.WeakKeyDictionary[ControlMesh, PatchTable] = weakref.WeakKeyDictionary()


def patch_table(mesh: ControlMesh) -> PatchTable:
    """Return the patches of all triangles of `mesh`, computed once per mesh."""
    table = _tables.get(mesh)
    if table is None:
        table = _tables[mesh] = _build(mesh)
    return table


def vertex_kinds(mesh: ControlMesh) -> IntArray:
    """(n,) SMOOTH, DART, CREASE or CORNER for each vertex."""
    kind = np.array([SMOOTH, DART, CREASE])[np.minimum(mesh.sharp_valence, 2)]
    kind[mesh.is_corner] = CORNER
    return kind


def edge_weights(mesh: ControlMesh, kind: IntArray) -> FloatArray:
    """(3m,) share of each half-edge's origin in the new point of its edge (sharp: unused)."""
    twins, sharp, origin = mesh.twins, mesh.sharp, mesh.triangles.reshape(-1)
    excess = np.zeros(len(twins))
    for first in np.flatnonzero(sharp & (kind[origin] >= CREASE)).tolist():
        fan = [first]
        while not sharp[_previous(fan[-1])]:
            fan.append(int(twins[_previous(fan[-1])]))
        excess[fan] = neighbour_weight(int(kind[origin[first]]), len(fan)) - REGULAR_WEIGHT
    inner = np.flatnonzero(~sharp)
    weights = np.full(len(twins), REGULAR_WEIGHT)
    weights[inner] += excess[twins[inner]] - excess[inner]
    return weights


def _build(mesh: ControlMesh) -> PatchTable:
    kind = vertex_kinds(mesh)
    weights = edge_weights(mesh, kind)
    plain = _plain_triangles(mesh, kind, weights)
    patches = [patch_of(_PLAIN_FANS)]
    number = {patches[0]: 0}
    patch_index = np.zeros(mesh.triangle_count, dtype=np.int64)
    other = np.flatnonzero(~plain)
    walker = _Walker(mesh, kind, weights)
    own_nodes: list[list[int]] = []
    for triangle in other.tolist():
        patch, own = walker.patch(triangle)
        if patch not in number:
            number[patch] = len(patches)
            patches.append(patch)
        patch_index[triangle] = number[patch]
        own_nodes.append(own)
    sizes = np.full(mesh.triangle_count, 12, dtype=np.int64)
    sizes[other] = [len(own) for own in own_nodes]
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    nodes = np.empty(offsets[-1], dtype=np.int32)
    regular = np.flatnonzero(plain)
    nodes[offsets[regular][:, None] + np.arange(12)] = _plain_nodes(mesh, regular)
    for triangle, own in zip(other.tolist(), own_nodes, strict=True):
        nodes[offsets[triangle] : offsets[triangle + 1]] = own
    for array in (patch_index, offsets, nodes):
        array.setflags(write=False)
    return PatchTable(tuple(patches), patch_index, offsets, nodes)


def _plain_triangles(mesh: ControlMesh, kind: IntArray, weights: FloatArray) -> BoolArray:
    """(m,) True for triangles deep in a regular lattice."""
    plain = (kind == SMOOTH) & (mesh.valence == 6)
    plain[mesh.triangles.reshape(-1)[weights != REGULAR_WEIGHT]] = False
    return plain[mesh.triangles].all(axis=1)


def _plain_nodes(mesh: ControlMesh, triangles: IntArray) -> IndexArray:
    """(p, 12) control points of triangles deep in a regular lattice."""
    end = np.roll(mesh.triangles, -1, axis=1).reshape(-1)
    columns = [mesh.triangles[triangles]]
    for corner, (first, last) in enumerate(((2, 6), (3, 6), (3, 5))):
        half = 3 * triangles + corner
        for position in range(last):
            if position >= first:
                columns.append(end[half][:, None])
            half = mesh.twins[half - half % 3 + (half + 2) % 3]
    return np.concatenate(columns, axis=1)


def _previous(half: int) -> int:
    return half - half % 3 + (half + 2) % 3


class _Walker:
    """Walks around the corners of single triangles; plain lists, because they index fastest."""

    def __init__(self, mesh: ControlMesh, kind: IntArray, weights: FloatArray) -> None:
        self._twin = mesh.twins.tolist()
        self._sharp = mesh.sharp.tolist()
        self._origin = mesh.triangles.reshape(-1).tolist()
        self._kind = kind.tolist()
        self._weight = weights.tolist()

    def patch(self, triangle: int) -> tuple[Patch, list[int]]:
        """The patch of a triangle and its control points."""
        corners = self._origin[3 * triangle : 3 * triangle + 3]
        number = {vertex: i for i, vertex in enumerate(corners)}
        fans = []
        for corner in range(3):
            kind = self._kind[corners[corner]]
            walk = self._closed if kind < CREASE else self._open
            ring, weights, start, sharp = walk(3 * triangle + corner)
            for vertex in ring:
                number.setdefault(vertex, len(number))
            local = tuple([number[vertex] for vertex in ring])
            fans.append(Fan(kind, local, tuple(weights), start, sharp))
        return patch_of((fans[0], fans[1], fans[2])), list(number)

    def _end(self, half: int) -> int:
        return self._origin[half + 1 if half % 3 < 2 else half - 2]

    def _closed(self, first: int) -> tuple[list[int], list[float], int, int]:
        ring: list[int] = []
        weights: list[float] = []
        sharp, half = -1, first
        while True:
            if self._sharp[half]:
                sharp = len(ring)
            ring.append(self._end(half))
            weights.append(self._weight[half])
            half = self._twin[_previous(half)]
            if half == first:
                return ring, weights, 0, sharp

    def _open(self, inside: int) -> tuple[list[int], list[float], int, int]:
        half, start = inside, 0
        while not self._sharp[half]:
            twin = self._twin[half]
            half = twin + 1 if twin % 3 < 2 else twin - 2
            start += 1
        ring, weights = [self._end(half)], [self._weight[half]]
        while True:
            previous = _previous(half)
            ring.append(self._origin[previous])
            if self._sharp[previous]:
                weights.append(REGULAR_WEIGHT)
                return ring, weights, start, -1
            half = self._twin[previous]
            weights.append(self._weight[half])
