# SPDX-License-Identifier: Apache-2.0
"""Least-squares control points whose limit surface lies on a given smooth surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix, vstack

from shell_deform.factor.analysis import analyse, factorise

from .control_mesh import BoolArray, ControlMesh, FloatArray, moved
from .limit import LimitSurface
from .loop_basis import BasisRows, basis_rows, quadrature_basis

HOLD = 1e-3
"""Weight, relative to the data, that keeps control points where the data leave them free."""

STEADY = 1.0
"""The same against sliding within the surface, where large triangles beside small ones would."""

THIN_TRIANGLE = 20.0
"""Triangles with a smaller angle [degrees] bend badly."""

MOST_THIN = 0.0025
"""Share of the surface that they may cover. On the cup of the recordings under pins of 1 mm forces
are 1, 2, 4, 14, 24 and 250 % too large where they cover 0.14, 0.17, 0.29, 0.8, 1.0 and 7.3 % of it
(1000, 700, 500, 350, 250 and 150 control vertices beside 1500)."""


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


def fit_limit_surface(
    mesh: ControlMesh, target: Target, iterations: int = 6, slide: float = 0.0
) -> ControlMesh:
    """Move control points until the limit surface lies on `target` in the least-squares sense.

    Distances are measured along the target's normal at six points of every triangle and across
    its outline at three points of every boundary edge, small triangles counting like large ones;
    the triangulation slides over the surface no further than it must.

    Args:
        mesh: start; its limit surface should be near the target already.
        iterations: Gauss-Newton steps.
        slide: weight, relative to the data, against sliding beside `HOLD`.
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
        hold = np.tile(HOLD * np.eye(3), (len(points), 1, 1))
        if slide:
            _, normal = target.project(points)
            hold += slide * (np.eye(3) - normal[:, :, None] * normal[:, None, :])
        points = _solve(vstack(blocks).tocsr(), np.concatenate(rights), points, hold)
    return moved(mesh, points)


def fit_report(mesh: ControlMesh, target: Target) -> FitReport:
    """Distance of the limit surface from `target` at twelve points per triangle, and the mesh."""
    basis = quadrature_basis(mesh, 12)
    rows = basis_rows(mesh, basis.triangle[basis.element], basis.parameters)
    points = _matrix(rows, mesh.vertex_count) @ mesh.vertices
    foot, _ = target.project(points)
    distance = np.linalg.norm(points - foot, axis=1)
    corners = mesh.vertices[mesh.triangles]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    return FitReport(
        vertices=mesh.vertex_count,
        irregular_vertices=len(mesh.irregular_vertices),
        rms_error_m=float(np.sqrt(np.mean(distance**2))),
        maximum_error_m=float(distance.max()),
        shortest_edge_m=float(length.min()),
        longest_edge_m=float(length.max()),
        smallest_angle_deg=float(_angles(corners)[0].min()),
    )


def interpolating(mesh: ControlMesh) -> ControlMesh:
    """Return the mesh whose limit surface passes through the vertices of `mesh`."""
    return moved(mesh, LimitSurface(mesh).control_points(mesh.vertices))


def raised(mesh: ControlMesh, target: Target) -> ControlMesh:
    """`interpolating` without its part within `target`, on which the vertices lie."""
    away = LimitSurface(mesh).control_points(mesh.vertices) - mesh.vertices
    _, normal = target.project(mesh.vertices)
    return moved(mesh, mesh.vertices + np.einsum('ij,ij->i', away, normal)[:, None] * normal)


def thin_share(mesh: ControlMesh) -> float:
    """Share of the active surface on triangles with an angle below `THIN_TRIANGLE` [-]."""
    angle, area = _angles(mesh.vertices[mesh.triangles[mesh.active]])
    return float(area[angle < THIN_TRIANGLE].sum() / area.sum())


def thinnest(mesh: ControlMesh) -> float:
    """Smallest angle of an active triangle [degrees]."""
    return float(_angles(mesh.vertices[mesh.triangles[mesh.active]])[0].min())


def _angles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Smallest angle [degrees] and area [m^2] of triangles by their corners (t, 3, 3)."""
    edges = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(edges, axis=2)
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    # The smallest angle is opposite the shortest edge.
    sine = 2.0 * area * length.min(axis=1) / length.prod(axis=1)
    return np.degrees(np.arcsin(np.minimum(1.0, sine))), area


def _solve(
    matrix: csr_matrix, right: FloatArray, points: FloatArray, hold: FloatArray
) -> FloatArray:
    """Least squares; `hold` (n, 3, 3): what keeps each point, relative to the data."""
    normal = matrix.T @ matrix
    count = np.arange(len(points) + 1)
    held = bsr_matrix((float(normal.diagonal().mean()) * hold, count[:-1], count))
    system = (normal + held.tocsr()).tobsr((3, 3))
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
