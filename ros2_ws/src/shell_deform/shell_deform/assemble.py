"""Strain energy, its gradient and its tangent stiffness over a whole Loop surface.

A `Discretisation` holds everything about the undeformed shell that never changes: basis rows in
the reference frame of each quadrature point, weights, wall stiffness, and a sparsity pattern whose
values are refilled at every Newton step. Positions are control points (n, 3) [m]; the quadrature
points of an element share its node list.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform import assemble_numpy
from shell_deform.compiled import HAVE_NUMBA
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.loop_basis import QuadratureBasis, quadrature_basis
from shell_deform.theory import THEORIES
from shell_deform.theory.material import Material
from shell_deform.theory.reference import (
    ReferencePoints,
    frame_coefficients,
    frame_rows,
    reference_points,
)

if HAVE_NUMBA:
    from shell_deform import assemble_kernels

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class StiffnessPattern:
    """Fixed CSR pattern of 3 x 3 blocks, and where each element's blocks go in its values."""

    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    block_offsets: Index
    block_start: Index
    row_length: Index

    def matrix(self, values: Array) -> sp.csr_matrix:
        """The sparse matrix (3 n, 3 n) of these values, sharing memory."""
        size = len(self.indptr) - 1
        result = sp.csr_matrix((size, size))
        result.data, result.indices, result.indptr = values, self.indices, self.indptr
        result.has_sorted_indices = True
        return result


def stiffness_pattern(node_offsets: Index, nodes: Index, size: int) -> StiffnessPattern:
    """Pattern of `size` control points coupled by elements with the given node lists."""
    counts = np.diff(node_offsets)
    incidence = sp.csr_matrix(
        (np.ones(len(nodes), dtype=np.int8), nodes, node_offsets), shape=(len(counts), size)
    )
    graph = (incidence.astype(np.int32).T @ incidence.astype(np.int32)).tocsr()
    graph = (graph + sp.identity(size, dtype=np.int32, format='csr')).tocsr()
    graph.sort_indices()
    blocks = np.diff(graph.indptr).astype(np.int64)
    length = 3 * blocks
    indptr = np.zeros(3 * size + 1, dtype=np.int32)
    indptr[1:] = np.cumsum(np.repeat(length, 3))
    block_columns = 3 * graph.indices[:, None] + np.arange(3)
    indices = np.concatenate(
        [
            np.tile(block_columns[graph.indptr[i] : graph.indptr[i + 1]].ravel(), 3)
            for i in range(size)
        ]
    ).astype(np.int32)
    graph.data = np.arange(len(graph.indices), dtype=np.int64)
    block_offsets = np.concatenate([[0], np.cumsum(counts**2)]).astype(np.int64)
    rows = np.concatenate(
        [
            np.repeat(nodes[a:b], b - a)
            for a, b in zip(node_offsets, node_offsets[1:], strict=False)
        ]
    )
    columns = np.concatenate(
        [np.tile(nodes[a:b], b - a) for a, b in zip(node_offsets, node_offsets[1:], strict=False)]
    )
    ordinal = np.asarray(graph[rows, columns]).ravel()
    within = ordinal - graph.indptr[rows]
    return StiffnessPattern(
        indptr=indptr,
        indices=indices,
        block_offsets=block_offsets,
        block_start=9 * graph.indptr[rows].astype(np.int64) + 3 * within,
        row_length=length,
    )


@dataclass(frozen=True)
class Discretisation:
    """The undeformed shell at its quadrature points; see the module docstring.

    Attributes:
        mesh: control mesh whose limit surface is the undeformed middle surface.
        node_offsets, nodes: node list of element e is nodes[node_offsets[e]:node_offsets[e + 1]].
        point_offsets: quadrature points of element e, likewise.
        row_offsets: basis rows of point p, likewise.
        values: (r,) basis values. rows: (r, 5) derivatives along the reference frame.
        reference: frames, curvature and area element at the points.
        weights: (p,) area of each point [m^2].
        thickness: (p,) wall thickness [m].
        membrane, bending: (p, 3, 3) wall stiffness [N/m], [N m].
    """

    mesh: ControlMesh
    node_offsets: Index
    nodes: Index
    point_offsets: Index
    row_offsets: Index
    values: Array
    rows: Array
    reference: ReferencePoints
    weights: Array
    thickness: Array
    membrane: Array
    bending: Array

    @cached_property
    def pattern(self) -> StiffnessPattern:
        """Sparsity of the tangent stiffness."""
        return stiffness_pattern(self.node_offsets, self.nodes, len(self.mesh.vertices))

    @cached_property
    def row_nodes(self) -> Index:
        """(r,) control point of every basis row entry."""
        element = np.repeat(np.arange(len(self.node_offsets) - 1), np.diff(self.point_offsets))
        return np.concatenate(
            [self.nodes[self.node_offsets[e] : self.node_offsets[e + 1]] for e in element]
        )

    def value_matrix(self) -> sp.csr_matrix:
        """(p, n) sparse map from control values to values at the quadrature points."""
        size = (len(self.weights), len(self.mesh.vertices))
        return sp.csr_matrix((self.values, self.row_nodes, self.row_offsets), shape=size)

    def stiffened(self, factor: float) -> Discretisation:
        """The same shell with `factor` times the modulus, to which the wall is proportional."""
        return replace(self, membrane=factor * self.membrane, bending=factor * self.bending)

    @property
    def area(self) -> float:
        """Area of the undeformed middle surface [m^2]."""
        return float(self.weights.sum())

    def derivatives(self, positions: Array) -> Array:
        """Derivative vectors q (p, 5, 3) of control positions (n, 3) at every point."""
        return assemble_numpy.derivatives(self, positions)

    def energy(self, theory: str, positions: Array) -> float:
        """Strain energy [J] of control positions (n, 3)."""
        return self.gradient(theory, positions)[0]

    def gradient(self, theory: str, positions: Array) -> tuple[float, Array]:
        """Strain energy [J] and its gradient (n, 3) [N]."""
        if not HAVE_NUMBA:
            return assemble_numpy.shell_gradient(self, theory, positions)
        gradient = np.zeros_like(positions)
        code = THEORIES[theory].code
        arguments: Any = (code, *self._kernel_arguments(), positions, gradient)
        return assemble_kernels.shell_gradient(*arguments), gradient

    def tangent(self, theory: str, positions: Array) -> tuple[float, Array, Array]:
        """Strain energy [J], gradient (n, 3) [N] and stiffness values [N/m] of `pattern`."""
        if not HAVE_NUMBA:
            return assemble_numpy.shell_tangent(self, theory, positions)
        gradient = np.zeros_like(positions)
        data = np.zeros(len(self.pattern.indices))
        arguments: Any = (
            THEORIES[theory].code,
            *self._kernel_arguments(),
            positions,
            gradient,
            *self._scatter_arguments(),
            data,
        )
        return assemble_kernels.shell_tangent(*arguments), gradient, data

    def volume(self, positions: Array) -> tuple[float, Array]:
        """Volume inside the middle surface [m^3] and its gradient (n, 3) [m^2]."""
        if not HAVE_NUMBA:
            return assemble_numpy.volume_gradient(self, positions)
        gradient = np.zeros_like(positions)
        arguments: Any = (*self._volume_arguments(), positions, gradient)
        return assemble_kernels.volume_gradient(*arguments), gradient

    def add_pressure_stiffness(self, pressure: float, positions: Array, data: Array) -> None:
        """Add -pressure [Pa] times the second derivative of the volume to stiffness values."""
        if not HAVE_NUMBA:
            assemble_numpy.add_pressure_stiffness(self, pressure, positions, data)
            return
        arguments: Any = (
            pressure,
            *self._volume_arguments(),
            positions,
            *self._scatter_arguments(),
            data,
        )
        assemble_kernels.volume_tangent(*arguments)

    def _kernel_arguments(self) -> Any:
        reference = self.reference
        return (
            *self._volume_arguments()[:5],
            reference.tangents,
            reference.second,
            reference.curvature,
            self.weights,
            self.membrane,
            self.bending,
        )

    def _volume_arguments(self) -> Any:
        return (
            self.node_offsets,
            self.nodes,
            self.point_offsets,
            self.row_offsets,
            self.rows,
            self.values,
            self.weights,
        )

    def _scatter_arguments(self) -> Any:
        return self.pattern.block_offsets, self.pattern.block_start, self.pattern.row_length


def discretise(
    mesh: ControlMesh,
    material: Material,
    thickness: float | Array,
    basis: QuadratureBasis | None = None,
) -> Discretisation:
    """Discretise the limit surface of `mesh` as a wall of `thickness` [m].

    `thickness` is one number or one per control vertex (n,). `basis` defaults to three points per
    triangle, with the irregular ones refined.
    """
    basis = basis if basis is not None else quadrature_basis(mesh, 3, refine_irregular=2)
    element = np.asarray(basis.element, dtype=np.int64)
    if np.any(np.diff(element) < 0):
        raise ValueError('quadrature points must be sorted by element')
    rows_of = np.diff(basis.row_offsets)
    values, first, second = basis.values, basis.first, basis.second
    row_offsets = np.asarray(basis.row_offsets, dtype=np.int64)
    nodes = np.asarray(basis.nodes, dtype=np.int64)
    node_offsets = np.asarray(basis.node_offsets, dtype=np.int64)
    global_nodes = np.concatenate([nodes[node_offsets[e] : node_offsets[e + 1]] for e in element])
    point_of_row = np.repeat(np.arange(len(element)), rows_of)
    size = (len(element), len(mesh.vertices))

    def surface(row_values: Array) -> Array:
        matrix = sp.csr_matrix((row_values, global_nodes, row_offsets), shape=size)
        return np.asarray(matrix @ mesh.vertices)

    parameter_first = np.stack([surface(first[:, i]) for i in range(2)], axis=2)
    coefficients = frame_coefficients(parameter_first)
    rows = frame_rows(first, second, coefficients[point_of_row])
    q = np.stack([surface(rows[:, i]) for i in range(5)], axis=1)
    area = np.linalg.norm(np.cross(parameter_first[..., 0], parameter_first[..., 1]), axis=1)
    wall = np.broadcast_to(np.asarray(thickness, dtype=float), (len(mesh.vertices),))
    h = np.asarray(sp.csr_matrix((values, global_nodes, row_offsets), shape=size) @ wall)
    law = material.plane_stress
    return Discretisation(
        mesh=mesh,
        node_offsets=node_offsets,
        nodes=nodes,
        point_offsets=np.searchsorted(element, np.arange(len(node_offsets))).astype(np.int64),
        row_offsets=row_offsets,
        values=np.ascontiguousarray(values),
        rows=rows,
        reference=reference_points(q, area),
        weights=basis.weight * area,
        thickness=h,
        membrane=h[:, None, None] * law,
        bending=h[:, None, None] ** 3 / 12.0 * law,
    )
