# SPDX-License-Identifier: Apache-2.0
"""The outer face of a thick wall at points where bodies may touch it, and how it moves.

What `outer_face.py` is for thin walls: the face is x(h/2) of the wall itself, with the shear of
its director and with the thickness that balances the wall at each point (the pressure of the body
does not squeeze it there). It follows from the position and 21 numbers of the point, the fields:
five derivatives of the position and six of the shear. Points on an edge of an open surface stand
for the end of the wall and lie in its middle, as those of a thin one: the position is all they
depend on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation, discretise
from shell_deform.assemble.shear_nodes import ElementUnknowns, element_unknowns
from shell_deform.assemble.stamps import stamp_points
from shell_deform.assemble.thick import ThickShell
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.contact.outer_face import POINTS_PER_TRIANGLE, outer_face
from shell_deform.surface.loop_basis import quadrature_basis

if HAVE_NUMBA:
    from shell_deform.assemble import thick_face_kernels

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FIELDS = 24
"""Numbers of a point that its place depends on: position, five derivatives of it, shear."""


@dataclass(frozen=True)
class ThickFacePoints:
    """The outer face at chosen points of one state.

    Attributes:
        at: (p,) which points. position: (p, 3) [m]. change: (p, 3, 24) its derivative by the
            fields. unknowns: (N, 3) the state.
    """

    at: Index
    position: Array
    change: Array
    unknowns: Array


@dataclass(frozen=True)
class ThickFace:
    """Contact points of a thick shell.

    Attributes:
        shell: the shell. points: the same surface with the contact points as its points.
        elements: their unknowns. ends: (e, n) map from control points to the points on edges,
            which come after the others. element: (p,) element of each point, those included.
        weights: (p,) area [m^2].
    """

    shell: ThickShell
    points: Discretisation
    elements: ElementUnknowns
    ends: sp.csr_matrix
    element: Index
    weights: Array

    @property
    def _first_end(self) -> int:
        return len(self.element) - self.ends.shape[0]

    @cached_property
    def _arguments(self) -> tuple[Any, ...]:
        points = self.points
        # The last part of a thick shell's arguments is its material.
        modulus, bulk, *_ = self.shell.kernel_arguments[3]
        return (
            (
                self.elements.offsets, self.elements.nodes, np.diff(points.node_offsets),
                self.elements.shear_counts, points.point_offsets, points.row_offsets,
            ),
            (
                points.rows, points.values, points.weights, -points.reference.curvature,
                points.thickness, self.elements.shear_offsets, self.elements.shear_rows,
            ),
            modulus, bulk,
        )  # fmt: skip

    def _points(self, unknowns: Array, at: Index, deep: bool) -> tuple[Array, Array]:
        place, change = np.zeros((len(at), 3)), np.zeros((len(at) if deep else 0, 63))
        own = at < self._first_end
        inner, moved = np.zeros((int(own.sum()), 3)), np.zeros((int(own.sum()) if deep else 0, 63))
        arguments: Any = (
            *self._arguments, np.ascontiguousarray(unknowns), at[own], self.element[at[own]],
            deep, inner, moved,
        )  # fmt: skip
        thick_face_kernels.face_points(*arguments)
        place[own] = inner
        place[~own] = self.ends[at[~own] - self._first_end] @ unknowns[: self.ends.shape[1]]
        if deep:
            change[own] = moved
        return place, change

    def positions(self, unknowns: Array) -> Array:
        """(p, 3) all points of the outer face [m] at the unknowns (N, 3)."""
        return self._points(unknowns, np.arange(len(self.element)), False)[0]

    def at(self, unknowns: Array, points: Index) -> ThickFacePoints:
        """The chosen points with their derivatives."""
        points = np.asarray(points, dtype=np.int64)
        place, change = self._points(unknowns, points, True)
        by_fields = np.zeros((len(points), 3, FIELDS))
        by_fields[:, :, :3] = np.eye(3)
        by_fields[:, :, 3:] = change.reshape(-1, 3, FIELDS - 3)
        return ThickFacePoints(points, place, by_fields, unknowns)

    def _fields(self, at: Index) -> sp.csr_matrix:
        """(24 p, 3 N) map from the unknowns to the fields of the chosen points."""
        points, parts = self.points, []
        own = np.flatnonzero(at < self._first_end)
        inner, element = at[own], self.element[at[own]]
        controls = np.diff(points.node_offsets)[element]
        which, nth = _ragged(controls)
        node = points.nodes[points.node_offsets[element][which] + nth]
        row = points.row_offsets[inner][which] + nth
        table = np.column_stack([points.values[row], points.rows[row]])
        for field in range(6):
            for i in range(3):
                parts.append((FIELDS * own[which] + 3 * field + i, 3 * node + i, table[:, field]))
        shears = self.elements.shear_counts[element]
        which, nth = _ragged(shears)
        first = self.elements.offsets[element] + controls
        node = self.elements.nodes[first[which] + nth]
        shear = self.elements.shear_rows[self.elements.shear_offsets[inner][which] + nth]
        for field in range(6):
            for a in range(2):
                value = shear[:, 2 * field + a]
                parts.append((FIELDS * own[which] + 18 + field, 3 * node + a, value))
        others = np.flatnonzero(at >= self._first_end)
        ends = self.ends[at[others] - self._first_end].tocoo()
        for i in range(3):
            parts.append((FIELDS * others[ends.row] + i, 3 * ends.col + i, ends.data))
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        shape = (FIELDS * len(at), self.shell.start.size)
        return sp.csr_matrix((values, (rows, columns)), shape=shape)

    def moved(self, face: ThickFacePoints, step: Array) -> Array:
        """(p, 3) how the chosen points move with the unknowns (N, 3), to first order."""
        fields = (self._fields(face.at) @ step.reshape(-1)).reshape(-1, FIELDS)
        return np.einsum('pif,pf->pi', face.change, fields)

    def forces(self, face: ThickFacePoints, force: Array) -> Array:
        """(N, 3) what forces (p, 3) [N] at the chosen points do on the unknowns."""
        on_fields = np.einsum('pif,pi->pf', face.change, force)
        result = self._fields(face.at).T @ on_fields.reshape(-1)
        return np.asarray(result).reshape(-1, 3)

    def blocks(self, face: ThickFacePoints, stiffness: Array, force: Array) -> Array:
        """(p, 24, 24) second derivative by the fields of a potential of the places.

        Its second derivative by those is `stiffness` (p, 3, 3), its gradient -`force` (p, 3).
        """
        change = face.change
        result = np.einsum('pif,pij,pjg->pfg', change, stiffness, change, optimize=True)
        own = face.at < self._first_end
        at = face.at[own]
        bent = np.zeros((len(at), (FIELDS - 3) ** 2))
        arguments: Any = (
            *self._arguments, np.ascontiguousarray(face.unknowns), at, self.element[at],
            np.ascontiguousarray(force[own]), bent,
        )  # fmt: skip
        thick_face_kernels.face_bends(*arguments)
        result[own, 3:, 3:] -= bent.reshape(-1, FIELDS - 3, FIELDS - 3)
        return np.asarray(result)

    def add(self, face: ThickFacePoints, blocks: Array, data: Array) -> None:
        """Add blocks (p, 24, 24) at the chosen points to the values of the shell's pattern."""
        fields, count = self._fields(face.at), len(face.at)
        inner = sp.bsr_matrix((blocks, np.arange(count), np.arange(count + 1)))
        found = (fields.T @ (inner.tocsr() @ fields)).tocoo()
        keys = found.row.astype(np.int64) * self.shell.start.size + found.col
        where = np.searchsorted(self._keys, keys)
        np.add.at(data, where, found.data)

    @cached_property
    def _keys(self) -> Index:
        """(e,) row times width plus column of every entry of the shell's pattern, ascending."""
        pattern, size = self.shell.pattern, self.shell.start.size
        row = np.repeat(np.arange(size, dtype=np.int64), np.diff(pattern.indptr))
        return row * size + pattern.indices


def _ragged(counts: Index) -> tuple[Index, Index]:
    """For lists of these lengths, one after the other: the list of each entry, its place there."""
    which = np.repeat(np.arange(len(counts)), counts)
    start = np.concatenate([[0], np.cumsum(counts)[:-1]]) if len(counts) else counts
    return which, np.arange(len(which)) - start[which]


def thick_face(shell: ThickShell) -> ThickFace:
    """Contact points of every active triangle of `shell`, and of the edges that end it."""
    mesh = shell.mesh
    basis = quadrature_basis(mesh, POINTS_PER_TRIANGLE)
    points = discretise(mesh, shell.material, shell.wall, basis)
    middle = np.asarray(points.value_matrix() @ mesh.vertices)
    unpressed = stamp_points(points, shell.surface, middle, ())
    elements = element_unknowns(
        points, shell.surface, shell.sheared, unpressed, float(np.mean(shell.wall))
    )
    thin = outer_face(shell)
    on_edge = np.flatnonzero(thin.half == 0.0)
    element = np.concatenate([basis.element, thin.element[on_edge]]).astype(np.int64)
    weights = np.concatenate([points.weights, thin.weights[on_edge]])
    return ThickFace(shell, points, elements, thin.values_at(on_edge), element, weights)
