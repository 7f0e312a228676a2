# SPDX-License-Identifier: Apache-2.0
"""The Loop limit surface of a control mesh: positions, normals, curvature, closest points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.linalg import SuperLU, splu

from .closest_point import ClosestPoints, ProjectionTables, closest_points, projection_tables
from .control_mesh import ControlMesh, FloatArray, IntArray
from .loop_basis import BasisRows, basis_rows
from .patch import CREASE, DART, REGULAR_WEIGHT, SMOOTH, smooth_limit_weight
from .patch_table import edge_weights, patch_table, vertex_kinds

__all__ = ['ClosestPoints', 'LimitSurface', 'SurfacePoints']

SHOWN_BEYOND = 0.1
"""Share of their true distance from the edge at which vertices beyond it are shown."""

_CORNER_PARAMETERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True)
class SurfacePoints:
    """Points on the limit surface.

    Attributes:
        position: (p, 3) [m].
        first: (p, 3, 2) derivatives with respect to u and v [m].
        second: (p, 3, 3) uu, uv and vv derivatives [m].
        normal: (p, 3) unit normal, outward by the right-hand rule.
    """

    position: FloatArray
    first: FloatArray
    second: FloatArray
    normal: FloatArray

    def curvatures(self) -> tuple[FloatArray, FloatArray]:
        """Mean and Gaussian curvature (p,) [1/m, 1/m2]; the mean of a sphere is -1/R."""
        metric = np.einsum('pia,pib->pab', self.first, self.first)
        form = np.einsum('pik,pi->pk', self.second, self.normal)
        determinant = metric[:, 0, 0] * metric[:, 1, 1] - metric[:, 0, 1] ** 2
        gauss = (form[:, 0] * form[:, 2] - form[:, 1] ** 2) / determinant
        mean = form[:, 0] * metric[:, 1, 1] + form[:, 2] * metric[:, 0, 0]
        mean = 0.5 * (mean - 2.0 * form[:, 1] * metric[:, 0, 1]) / determinant
        return mean, gauss


class LimitSurface:
    """Evaluates the limit surface of one mesh topology for any control points (n, 3) [m].

    What depends on the topology alone (limit matrix and its factors, normal stencils, projection
    tables) is computed on first use and kept.
    """

    def __init__(self, mesh: ControlMesh) -> None:
        self.mesh = mesh

    @cached_property
    def limit_matrix(self) -> csr_matrix:
        """(n, n) sparse matrix from control points to limit positions of the vertices.

        Vertices beyond an edge have none; they are shown close to it, see `_beside_surface`.
        """
        return _limit_matrix(self.mesh)

    @cached_property
    def _factor(self) -> SuperLU:
        return splu(csc_matrix(self.limit_matrix))

    @cached_property
    def _tangents(self) -> tuple[csr_matrix, csr_matrix, csr_matrix]:
        """Two tangents of every fan at its vertex, and the sum of a vertex's fans."""
        triangle, corner, vertex = _one_corner_per_fan(self.mesh)
        rows = basis_rows(self.mesh, triangle, _CORNER_PARAMETERS[corner])
        weights = rows.first.copy()
        table = patch_table(self.mesh)
        smooth = np.flatnonzero(vertex_kinds(self.mesh)[vertex] == SMOOTH)
        code = 3 * table.patch[triangle[smooth]] + corner[smooth]
        for value in np.unique(code).tolist():
            members = smooth[code == value]
            own = table.patches[value // 3].tangent_rows(value % 3).T
            weights[rows.node_offsets[members][:, None] + np.arange(len(own))] = own
        shape = (len(triangle), self.mesh.vertex_count)
        first = [csr_matrix((weights[:, k], rows.nodes, rows.node_offsets), shape) for k in (0, 1)]
        gather = coo_matrix((np.ones(len(vertex)), (vertex, np.arange(len(vertex)))), shape[::-1])
        return first[0], first[1], gather.tocsr()

    @cached_property
    def projection_tables(self) -> ProjectionTables:
        """Flat tables for the closest-point kernel."""
        return projection_tables(self.mesh)

    def limit_positions(self, control_points: npt.ArrayLike) -> FloatArray:
        """(n, 3) limit positions of the vertices [m]."""
        return self.limit_matrix @ np.asarray(control_points, dtype=np.float64)

    def limit_fields(self, fields: FloatArray) -> FloatArray:
        """(n, 3, j) motion of the limit positions for fields (N, j), control points first."""
        vertices, count = self.mesh.vertex_count, fields.shape[1]
        limit = self.limit_matrix @ fields[: 3 * vertices].reshape(vertices, 3 * count)
        return np.ascontiguousarray(limit.reshape(vertices, 3, count))

    def control_points(self, limit_positions: npt.ArrayLike) -> FloatArray:
        """(n, 3) control points whose limit positions are the given ones [m]."""
        return self._factor.solve(np.ascontiguousarray(limit_positions, dtype=np.float64))

    def vertex_normals(self, control_points: npt.ArrayLike) -> FloatArray:
        """(n, 3) unit normals at the vertices; the mean of the sides along a crease."""
        points = np.asarray(control_points, dtype=np.float64)
        first, second, gather = self._tangents
        return _unit(gather @ _unit(np.cross(first @ points, second @ points)))

    def vertex_tangents(self, control_points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Two tangents (n, 3) at every vertex, linear in the control points [m]."""
        points = np.asarray(control_points, dtype=np.float64)
        first, second, gather = self._tangents
        return gather @ (first @ points), gather @ (second @ points)

    def evaluate(
        self, control_points: npt.ArrayLike, triangle: npt.ArrayLike, parameters: npt.ArrayLike
    ) -> SurfacePoints:
        """Positions, derivatives and normals at points given by triangle and (u, v)."""
        rows = basis_rows(self.mesh, triangle, parameters)
        return surface_points(rows, np.asarray(control_points, dtype=np.float64))

    def closest_point(
        self,
        control_points: npt.ArrayLike,
        queries: npt.ArrayLike,
        offset: float = 0.0,
        *,
        seeds: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        threads: int | None = None,
    ) -> ClosestPoints:
        """Closest points of the active surface, moved by `offset` [m] along its normal.

        Args:
            control_points: (n, 3) [m].
            queries: (q, 3) [m], finite.
            offset: distance of the wanted surface from the limit surface along the outward
                normal [m] (half the thickness for the outer face); small against the radii of
                curvature.
            seeds: triangle (q,) and parameters (q, 2) to start from, for instance the last
                answer; without them the nearest of a dense set of samples.
            threads: threads to use (default: the processors, at most four).
        """
        points = np.ascontiguousarray(control_points, dtype=np.float64)
        return closest_points(
            self.projection_tables, points, queries, offset=offset, seeds=seeds, threads=threads
        )


def surface_points(rows: BasisRows, control_points: FloatArray) -> SurfacePoints:
    """Apply basis rows to control points (n, 3)."""
    count = len(rows.node_offsets) - 1

    def apply(weights: FloatArray) -> FloatArray:
        shape = (count, len(control_points))
        return csr_matrix((weights, rows.nodes, rows.node_offsets), shape) @ control_points

    first = np.stack([apply(rows.first[:, k]) for k in range(2)], axis=2)
    second = np.stack([apply(rows.second[:, k]) for k in range(3)], axis=2)
    normal = _unit(np.cross(first[:, :, 0], first[:, :, 1]))
    return SurfacePoints(apply(rows.values), first, second, normal)


def _limit_matrix(mesh: ControlMesh) -> csr_matrix:
    kind = vertex_kinds(mesh)
    n = mesh.vertex_count
    neighbour = np.array(
        [0.0, 0.0, 0.0]
        + [smooth_limit_weight(k) for k in range(3, 1 + max(3, int(mesh.valence.max())))]
    )
    pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    smooth = pairs[kind[pairs[:, 0]] == SMOOTH]
    half = np.flatnonzero(mesh.sharp)
    sharp = np.column_stack(
        [mesh.triangles.reshape(-1)[half], np.roll(mesh.triangles, -1, axis=1).reshape(-1)[half]]
    )
    sharp = np.unique(np.concatenate([sharp, sharp[:, ::-1]]), axis=0)
    crease = sharp[kind[sharp[:, 0]] == CREASE]
    rows = np.concatenate([smooth[:, 0], crease[:, 0]])
    columns = np.concatenate([smooth[:, 1], crease[:, 1]])
    weights = np.concatenate(
        [neighbour[mesh.valence[smooth[:, 0]]], np.full(len(crease), 1.0 / 6.0)]
    )
    special = kind == DART
    special[mesh.triangles.reshape(-1)[edge_weights(mesh, kind) != REGULAR_WEIGHT]] = True
    usual = ~(special & (kind <= DART))
    own = 1.0 - np.bincount(rows, weights, n)
    kept = usual[rows]
    blocks = [(rows[kept], columns[kept], weights[kept])]
    blocks.append((np.flatnonzero(usual), np.flatnonzero(usual), own[usual]))
    unusual = np.flatnonzero(~usual)
    if len(unusual):
        _, first = np.unique(mesh.triangles.reshape(-1), return_index=True)
        there = basis_rows(mesh, first[unusual] // 3, _CORNER_PARAMETERS[first[unusual] % 3])
        owner = np.repeat(unusual, np.diff(there.node_offsets))
        blocks.append((owner, there.nodes.astype(np.int64), there.values))
    row, column, value = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    matrix = coo_matrix((value, (row, column)), (n, n)).tocsr()
    if not mesh.active.all():
        matrix = _beside_surface(mesh) @ matrix
    matrix.eliminate_zeros()
    matrix.sort_indices()
    return matrix


def _beside_surface(mesh: ControlMesh) -> csr_matrix:
    """(n, n) map that draws vertices beyond an edge near to one on it.

    They lie on no surface. Near the edge they neither widen what is shown nor exaggerate how far
    it moves, and their control points still follow from where they are shown.
    """
    n = mesh.vertex_count
    on_surface = np.zeros(n, dtype=bool)
    on_surface[mesh.triangles[mesh.active]] = True
    pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]]).astype(np.int64)
    pairs = pairs[~on_surface[pairs[:, 0]] & on_surface[pairs[:, 1]]]
    outside, first = np.unique(pairs[:, 0], return_index=True)
    share = np.ones(n)
    share[outside] = SHOWN_BEYOND
    edge = pairs[first, 1]
    rows = np.concatenate([np.arange(n), outside])
    columns = np.concatenate([np.arange(n), edge])
    values = np.concatenate([share, np.full(len(edge), 1.0 - SHOWN_BEYOND)])
    return coo_matrix((values, (rows, columns)), (n, n)).tocsr()


def _one_corner_per_fan(mesh: ControlMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Triangle, corner and vertex of one triangle in every fan that no sharp edge cuts."""
    kind = vertex_kinds(mesh)
    origin = mesh.triangles.reshape(-1)
    closed = kind[origin] < CREASE
    _, first = np.unique(np.where(closed, origin, -1), return_index=True)
    first = first[closed[first]]
    starts = np.concatenate([first, np.flatnonzero(~closed & mesh.sharp)])
    return starts // 3, starts % 3, origin[starts].astype(np.int64)


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
