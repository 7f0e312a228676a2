# SPDX-License-Identifier: Apache-2.0
"""The outer face of a shell at points where bodies may touch it, and how it moves.

All that contact knows of a theory: where the outer face is at a point, how that depends on the
unknowns, and which part of the stiffness a given traction there adds. In Kirchhoff-Love theories
the face lies half a wall along the normal n of the middle surface, x + h/2 n, with n the
normalised cross product of the parameter derivatives a1, a2: a point depends on the control points
through q = (x, a1, a2) alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.surface.loop_basis import basis_rows
from shell_deform.surface.quadrature import triangle_rule

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Contact points of every triangle: some lie within a tenth of an edge from its corners, so that
# first touch is seen; more of them bind the few control points there are too often.
POINTS_PER_TRIANGLE = 6
# Contact points of every edge that ends the surface (Gauss).
POINTS_PER_EDGE = 3
# What a point depends on: x, a1 and a2.
FIELDS = 3


@dataclass(frozen=True)
class FacePoints:
    """The outer face at chosen points of one state.

    Attributes:
        at: (p,) which points. position: (p, 3) [m]. normal: (p, 3) of the middle surface.
        change: (p, 3, 3, 3) derivative of the position: [p, a, i, j] of component i by component
            j of the field a, x, a1 or a2.
        tangents: (p, 2, 3) a1 and a2. area: (p,) |a1 x a2|.
        maps: (3 p, n) from control points to x, a1 and a2 of one point after the other.
    """

    at: Index
    position: Array
    normal: Array
    change: Array
    tangents: Array
    area: Array
    maps: sp.csr_matrix


@dataclass(frozen=True)
class OuterFace:
    """Contact points of a discretised shell.

    Those on an edge of an open surface stand for the end of the wall: they lie in its middle.

    Attributes:
        shell: the discretisation. element: (p,) element of each point, whose node list it shares.
        offsets: (p + 1,) basis rows of point p. rows: (r, 3) value and parameter derivatives.
        weights: (p,) undeformed area of each point [m^2]. half: (p,) half the wall there [m].
    """

    shell: Discretisation
    element: Index
    offsets: Index
    rows: Array
    weights: Array
    half: Array

    @cached_property
    def maps(self) -> sp.csr_matrix:
        """(3 p, n) map from control points to x, a1 and a2 of one point after the other."""
        nodes = np.concatenate([self._nodes(e) for e in self.element])
        size = (len(self.element), len(self.shell.mesh.vertices))
        parts = [
            sp.csr_matrix((self.rows[:, k].copy(), nodes, self.offsets), shape=size)
            for k in range(FIELDS)
        ]
        return sp.vstack(parts).tocsr()[np.arange(FIELDS * size[0]).reshape(FIELDS, -1).T.ravel()]

    def values_at(self, points: Index) -> sp.csr_matrix:
        """(p, n) map from control points to the middle surface at chosen points."""
        return self.maps[FIELDS * points]

    def _nodes(self, element: int) -> Index:
        start, end = self.shell.node_offsets[element : element + 2]
        return self.shell.nodes[start:end]

    def positions(self, control: Array) -> Array:
        """(p, 3) all points of the outer face [m] at control positions (n, 3)."""
        x, a1, a2 = np.moveaxis((self.maps @ control).reshape(-1, FIELDS, 3), 1, 0)
        normal = np.cross(a1, a2)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return np.asarray(x + self.half[:, None] * normal)

    def at(self, control: Array, points: Index) -> FacePoints:
        """The chosen points with their derivatives."""
        maps = self.maps[(FIELDS * np.asarray(points)[:, None] + np.arange(FIELDS)).ravel()]
        fields = (maps @ control).reshape(-1, FIELDS, 3)
        x, a1, a2 = np.moveaxis(fields, 1, 0)
        cross = np.cross(a1, a2)
        area = np.linalg.norm(cross, axis=1)
        normal = cross / area[:, None]
        flat = np.eye(3) - np.einsum('pi,pj->pij', normal, normal)
        scale = (self.half[points] / area)[:, None, None]
        change = np.empty((len(points), 3, 3, 3))
        change[:, 0] = np.eye(3)
        change[:, 1] = -scale * (flat @ _crossing(a2))
        change[:, 2] = scale * (flat @ _crossing(a1))
        position = x + self.half[points][:, None] * normal
        return FacePoints(points, position, normal, change, fields[:, 1:], area, maps)

    def moved(self, face: FacePoints, step: Array) -> Array:
        """(p, 3) how the chosen points move with the control points (n, 3), to first order."""
        fields = (face.maps @ step).reshape(-1, FIELDS, 3)
        return np.einsum('paij,paj->pi', face.change, fields)

    def forces(self, face: FacePoints, force: Array) -> Array:
        """Nodal forces (n, 3) of forces (p, 3) [N] at the chosen points."""
        fields = np.einsum('paij,pi->paj', face.change, force)
        return np.asarray(face.maps.T @ fields.reshape(-1, 3))

    def blocks(self, face: FacePoints, stiffness: Array, force: Array) -> Array:
        """(p, 3, 3, 3, 3) second derivative by the fields: [p, a, i, b, j].

        Of a potential of the positions with second derivative `stiffness` (p, 3, 3) and gradient
        -`force` (p, 3).
        """
        change = face.change
        result = np.einsum('pakl,pkm,pbmn->palbn', change, stiffness, change, optimize=True)
        half = self.half[face.at]
        result[:, 1:, :, 1:, :] -= half[:, None, None, None, None] * _bent(face, force)
        return result

    def add(self, face: FacePoints, blocks: Array, data: Array) -> None:
        """Add blocks (p, 3, 3, 3, 3) at the chosen points to the values of the shell's pattern."""
        shell, pattern = self.shell, self.shell.pattern
        element = self.element[face.at]
        sizes = np.diff(shell.node_offsets)[element]
        for size in np.unique(sizes).tolist():
            chosen = np.flatnonzero(sizes == size)
            chosen = chosen[np.argsort(element[chosen], kind='stable')]
            own, which = np.unique(element[chosen], return_inverse=True)
            nodes = shell.nodes[shell.node_offsets[own][:, None] + np.arange(size)]
            rows = self.rows[self.offsets[face.at[chosen]][:, None] + np.arange(size)]
            # Points of one triangle are summed before they are added: as many columns as one has.
            nth = np.arange(len(chosen)) - np.searchsorted(which, which)
            shape = len(own), int(nth.max()) + 1
            half = rows @ blocks[chosen].reshape(-1, 3, 27)
            left = np.zeros((*shape, 3, size, 9))
            left[which, nth] = (
                half.reshape(-1, size, 3, 3, 3).transpose(0, 3, 1, 2, 4).reshape(-1, 3, size, 9)
            )
            right = np.zeros((*shape, 3, size))
            right[which, nth] = rows.transpose(0, 2, 1)
            count = 3 * shape[1]
            entries = left.reshape(len(own), count, -1).transpose(0, 2, 1) @ right.reshape(
                len(own), count, size
            )
            start = pattern.block_start[
                pattern.block_offsets[own][:, None, None]
                + size * np.arange(size)[:, None]
                + np.arange(size)
            ]
            row = pattern.row_length[nodes][:, :, None, None, None] * np.arange(3)[:, None, None]
            where = start[:, :, None, None] + row + np.arange(3)[:, None]
            data += np.bincount(where.ravel(), entries.ravel(), len(data))


def outer_face(shell: Discretisation) -> OuterFace:
    """Contact points of every active triangle of `shell`, and of the edges that end it."""
    mesh = shell.mesh
    active = np.flatnonzero(mesh.active)
    places, weights = triangle_rule(POINTS_PER_TRIANGLE)
    element = np.repeat(np.arange(len(active)), len(weights))
    places = np.tile(places, (len(active), 1))
    ends, along, shares = _edge_points(mesh.triangles[active])
    on_edge = np.arange(len(element) + len(ends)) >= len(element)
    element = np.concatenate([element, ends])
    rows = basis_rows(mesh, active[element], np.concatenate([places, along]))
    table = np.column_stack([rows.values, rows.first])
    size = (len(element), len(mesh.vertices))
    value, first, second = (
        sp.csr_matrix((table[:, k].copy(), rows.nodes, rows.node_offsets), shape=size)
        for k in range(3)
    )
    a1, a2 = first @ mesh.vertices, second @ mesh.vertices
    area = np.linalg.norm(np.cross(a1, a2), axis=1)
    # The wall is given at the shell's own points; that of a triangle's first one is near enough
    # where it varies, and exact where it does not.
    half = 0.5 * shell.thickness[shell.point_offsets[:-1]][element]
    size_of = np.concatenate([np.tile(weights, len(active)), shares[:, 0]])
    way = shares[:, 1:2] * a1[on_edge] + shares[:, 2:] * a2[on_edge]
    area[on_edge] = 2.0 * half[on_edge] * np.linalg.norm(way, axis=1)
    half[on_edge] = 0.0
    return OuterFace(
        shell,
        element.astype(np.int64),
        np.asarray(rows.node_offsets, dtype=np.int64),
        table,
        size_of * area,
        half,
    )


def _edge_points(triangles: NDArray[np.int32]) -> tuple[Index, Array, Array]:
    """Points of the edges (m, 3 triangles) that have one triangle only.

    Their triangle (e,), their parameters (e, 2) in it, and (e, 3): the share of the edge that each
    stands for, and the edge's direction in the parameters.
    """
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    rim = first[count == 1]
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    start, end = corners[rim % 3], corners[(rim % 3 + 1) % 3]
    gauss, weights = np.polynomial.legendre.leggauss(POINTS_PER_EDGE)
    at = 0.5 * (gauss + 1.0)
    places = start[:, None] + at[:, None] * (end - start)[:, None]
    way = np.repeat(end - start, POINTS_PER_EDGE, axis=0)
    shares = np.column_stack([np.tile(0.5 * weights, len(rim)), way])
    return np.repeat(rim // 3, POINTS_PER_EDGE), places.reshape(-1, 2), shares


def _crossing(vectors: Array) -> Array:
    """(p, 3, 3) matrices that take the cross product of (p, 3) with what follows."""
    result = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    result[:, 0, 1], result[:, 0, 2], result[:, 1, 2] = -z, y, -x
    return result - result.transpose(0, 2, 1)


def _bent(face: FacePoints, force: Array) -> Array:
    """(p, 2, 3, 2, 3) second derivative of force . n by (a1, a2)."""
    normal, area = face.normal, face.area
    a1, a2 = face.tangents[:, 0], face.tangents[:, 1]
    flat = np.eye(3) - np.einsum('pi,pj->pij', normal, normal)
    # Derivatives (p, 2, 3, 3) of the cross product d; n = d / |d|.
    first = np.stack([-_crossing(a2), _crossing(a1)], axis=1)
    along = np.einsum('pi,pi->p', normal, force)
    tangent = force - along[:, None] * normal
    across = np.einsum('paij,pi->paj', first, tangent)
    rising = np.einsum('paij,pi->paj', first, normal)
    result = -np.einsum('pai,pbj->paibj', across, rising)
    result -= np.einsum('pai,pbj->paibj', rising, across)
    result -= along[:, None, None, None, None] * np.einsum(
        'pakl,pkm,pbmn->palbn', first, flat, first, optimize=True
    )
    result /= (area**2)[:, None, None, None, None]
    # The cross product is bilinear in a1 and a2.
    mixed = _crossing(tangent) / area[:, None, None]
    result[:, 0, :, 1, :] -= mixed
    result[:, 1, :, 0, :] += mixed
    return result
