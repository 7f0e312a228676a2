# SPDX-License-Identifier: Apache-2.0
"""Everything about an undeformed shell that never changes, at its quadrature points.

Basis rows in the reference frame of each point, weights, wall stiffness, and a sparsity pattern
whose values are refilled at every Newton step. The quadrature points of an element share its node
list.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.theory.reference import ReferencePoints

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
        return csr_matrix_of(values, self.indices, self.indptr)


def csr_matrix_of(
    values: Array, indices: NDArray[np.int32], indptr: NDArray[np.int32]
) -> sp.csr_matrix:
    """A square CSR matrix of these very arrays, columns sorted.

    The constructor of SciPy makes new arrays of the pattern; a factor knows one by its identity.
    """
    size = len(indptr) - 1
    result = sp.csr_matrix((size, size))
    result.data, result.indices, result.indptr = values, indices, indptr
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
class ShellPoints:
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

    @property
    def area(self) -> float:
        """Area of the undeformed middle surface [m^2]."""
        return float(self.weights.sum())
