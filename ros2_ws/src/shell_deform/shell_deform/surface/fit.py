# SPDX-License-Identifier: Apache-2.0
"""Least-squares control points whose limit surface lies on a given smooth surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_matrix, diags, vstack

from shell_deform.factor.analysis import analyse, factorise

from .control_mesh import BoolArray, ControlMesh, FloatArray, moved
from .limit import LimitSurface
from .loop_basis import BasisRows, basis_rows, quadrature_basis

HOLD = 1e-3
"""Weight, relative to the data, that keeps control points where the data leave them free."""


class Target(Protocol):
    """A surface that knows its nearest point, and its outline if it is open."""

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (p, 3) [m] and outward unit normals (p, 3)."""

    def outline(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest points (p, 3) [m] of the outline and two directions (p, 2, 3) across it."""


@dataclass(frozen=True)
class FitReport:
    """How well a limit surface lies on its target, and how good its mesh is.

    Attributes:
        vertices, irregular_vertices: counts.
        rms_error_m, maximum_error_m: distance of the limit surface from the target.
        shortest_edge_m, longest_edge_m: edges of the control mesh.
        smallest_angle_deg: smallest angle of any triangle of the control mesh.
    """

    vertices: int
    irregular_vertices: int
    rms_error_m: float
    maximum_error_m: float
    shortest_edge_m: float
    longest_edge_m: float
    smallest_angle_deg: float


def fit_limit_surface(mesh: ControlMesh, target: Target, iterations: int = 6) -> ControlMesh:
    """Move control points until the limit surface lies on `target` in the least-squares sense.

    Distances are measured along the target's normal at six points of every triangle and across
    its outline at three points of every boundary edge, small triangles counting like large ones;
    the triangulation slides over the surface no further than it must.

    Args:
        mesh: start; its limit surface should be near the target already.
        iterations: Gauss-Newton steps.
    """
    inner, outer = _inner_rows(mesh), _outline_rows(mesh)
    weights = np.sqrt(quadrature_basis(mesh, 6, 1).weight)
    points = mesh.vertices.copy()
    for _ in range(iterations):
        blocks, rights = [], []
        foot, normal = target.project(inner @ points)
        blocks.append(_directed(inner, normal * weights[:, None]))
        rights.append(weights * np.einsum('ij,ij->i', normal, foot))
        if outer.shape[0]:
            foot, across = target.outline(outer @ points)
            edge_scale = float(weights.mean())
            for k in range(2):
                blocks.append(_directed(outer, across[:, k] * edge_scale))
                rights.append(edge_scale * np.einsum('ij,ij->i', across[:, k], foot))
        points = _solve(vstack(blocks).tocsr(), np.concatenate(rights), points)
    return moved(mesh, points)


def fit_report(mesh: ControlMesh, target: Target) -> FitReport:
    """Distance of the limit surface from `target` at twelve points per triangle, and the mesh."""
    basis = quadrature_basis(mesh, 12)
    rows = basis_rows(mesh, basis.triangle[basis.element], basis.parameters)
    points = _matrix(rows, mesh.vertex_count) @ mesh.vertices
    foot, _ = target.project(points)
    distance = np.linalg.norm(points - foot, axis=1)
    sides = mesh.vertices[np.roll(mesh.triangles, -1, axis=1)] - mesh.vertices[mesh.triangles]
    length = np.linalg.norm(sides, axis=2)
    cosine = -np.einsum('tij,tij->ti', sides, np.roll(sides, 1, axis=1))
    cosine /= length * np.roll(length, 1, axis=1)
    return FitReport(
        vertices=mesh.vertex_count,
        irregular_vertices=len(mesh.irregular_vertices),
        rms_error_m=float(np.sqrt(np.mean(distance**2))),
        maximum_error_m=float(distance.max()),
        shortest_edge_m=float(length.min()),
        longest_edge_m=float(length.max()),
        smallest_angle_deg=float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)).min())),
    )


def interpolating(mesh: ControlMesh) -> ControlMesh:
    """Return the mesh whose limit surface passes through the vertices of `mesh`."""
    return moved(mesh, LimitSurface(mesh).control_points(mesh.vertices))


def _solve(matrix: csr_matrix, right: FloatArray, points: FloatArray) -> FloatArray:
    normal = matrix.T @ matrix
    hold = HOLD * float(normal.diagonal().mean())
    system = (normal + diags(np.full(normal.shape[0], hold))).tobsr((3, 3))
    system.sort_indices()
    pattern = csr_matrix((np.ones(len(system.indices)), system.indices, system.indptr))
    factor = factorise(analyse(pattern, points, of_vertices=True), system)
    step = factor.solve(matrix.T @ (right - matrix @ points.ravel()))
    return points + step.reshape(-1, 3)


def _directed(rows: csr_matrix, direction: FloatArray) -> csr_matrix:
    """(p, 3 n) rows that measure a point along its own direction."""
    counts = np.diff(rows.indptr)
    data = rows.data[:, None] * np.repeat(direction, counts, axis=0)
    columns = 3 * rows.indices[:, None] + np.arange(3)
    shape = (rows.shape[0], 3 * rows.shape[1])
    return csr_matrix((data.ravel(), columns.ravel(), 3 * rows.indptr), shape)


def _inner_rows(mesh: ControlMesh) -> csr_matrix:
    basis = quadrature_basis(mesh, 6, 1)
    rows = basis_rows(mesh, basis.triangle[basis.element], basis.parameters)
    return _matrix(rows, mesh.vertex_count)


def _outline_rows(mesh: ControlMesh) -> csr_matrix:
    half = np.flatnonzero(boundary_half_edges(mesh))
    start = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    share = np.array([0.0, 1 / 3, 2 / 3])[:, None, None]
    places = (1 - share) * start[half % 3] + share * start[(half + 1) % 3]
    rows = basis_rows(mesh, np.tile(half // 3, 3), places.reshape(-1, 2))
    return _matrix(rows, mesh.vertex_count)


def boundary_half_edges(mesh: ControlMesh) -> BoolArray:
    """(3m,) True for half-edges where the active surface ends."""
    beyond = (mesh.twins < 0) | ~mesh.active[mesh.twins // 3]
    return beyond & np.repeat(mesh.active, 3)


def _matrix(rows: BasisRows, n: int) -> csr_matrix:
    return csr_matrix(
        (rows.values, rows.nodes, rows.node_offsets), (len(rows.node_offsets) - 1, n)
    )
