# SPDX-License-Identifier: Apache-2.0
"""Control points whose limit surface follows the points of a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.spatial import cKDTree

from .closest_point import ClosestPoints
from .control_mesh import ControlMesh, FloatArray, IntArray, moved
from .fit import HOLD, boundary_half_edges
from .limit import LimitSurface
from .loop_basis import basis_rows

SMOOTHINGS = (1e-3, 1e-2, 1e-1, 1.0)
"""Weights of the bending of the control net against one mean scan point per vertex.

The largest one that leaves nothing systematic is taken: what it smooths away is scanner noise,
which would otherwise live on in the curvature."""

UNSEEN = 0.02
"""Systematic part of the distance, as a share of its root mean square, that counts as nothing."""

CELLS = 4
"""Each triangle is divided that often along its sides; points are averaged per cell."""

OUTLIER = 5.0
"""Points further away than that many robust standard deviations do not count."""

ITERATIONS = 3


@dataclass(frozen=True)
class ScanFit:
    """A fitted control mesh and what is left of the scan.

    Attributes:
        mesh: its limit surface is the middle surface.
        distance: (q,) signed distance of every scan point from the scanned face [m].
        triangle: (q,) triangle nearest to every scan point.
        counted: (q,) False for outliers and for points beside the surface.
        rms_m: root mean square of the counted distances, scanner noise included [m].
        systematic_m: the part of it that does not average out within a small part of a triangle
            [m]; zero where the noise hides it.
    """

    mesh: ControlMesh
    distance: FloatArray
    triangle: IntArray
    counted: npt.NDArray[np.bool_]
    rms_m: float
    systematic_m: float


def fit_scan(
    mesh: ControlMesh,
    points: FloatArray,
    rim: FloatArray,
    half_wall: float | FloatArray,
) -> ScanFit:
    """Fit a control mesh to scan points by least squares along its normals.

    Args:
        mesh: even triangles near the scanned face; vertices on the rim near the scanned rim.
        points: (q, 3) scan of one face [m].
        rim: (r, 3) scan points on the object's open rim [m]; empty for a closed object.
        half_wall: distance from the middle surface to the scanned face along the outward normal
            [m], one number or one per vertex (n,); zero if the middle surface was scanned.
    """
    surface = LimitSurface(mesh)
    wall = np.broadcast_to(np.asarray(half_wall, dtype=np.float64), (mesh.vertex_count,))
    control = surface.control_points(
        mesh.vertices - wall[:, None] * surface.vertex_normals(mesh.vertices)
    )
    if not mesh.is_closed and len(rim):
        for _ in range(2):
            control = _fit_rim(surface, control, rim, wall)
    found, distance, counted = _measured(surface, control, points, wall, None)
    for _ in range(ITERATIONS):
        control = control + _step(surface, control, found, distance, counted, SMOOTHINGS[0])
        seeds = (found.triangle, found.parameters)
        found, distance, counted = _measured(surface, control, points, wall, seeds)
    rms, systematic = _spread(found, distance, counted)
    for smoothing in SMOOTHINGS[1:]:
        trial = control + _step(surface, control, found, distance, counted, smoothing)
        seeds = (found.triangle, found.parameters)
        measured = _measured(surface, trial, points, wall, seeds)
        trial_rms, trial_systematic = _spread(*measured)
        if trial_systematic > UNSEEN * trial_rms:
            break
        control, (found, distance, counted) = trial, measured
        rms, systematic = trial_rms, trial_systematic
    return ScanFit(moved(mesh, control), distance, found.triangle, counted, rms, systematic)


def _measured(
    surface: LimitSurface,
    control: FloatArray,
    points: FloatArray,
    wall: FloatArray,
    seeds: tuple[IntArray, FloatArray] | None,
) -> tuple[ClosestPoints, FloatArray, npt.NDArray[np.bool_]]:
    found = surface.closest_point(control, points, seeds=seeds)
    corners = wall[surface.mesh.triangles[found.triangle]]
    u, v = found.parameters.T
    distance = found.distance - (
        (1.0 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
    )
    # About zero, not about the median: the first surface may lie off all points alike.
    spread = 1.4826 * float(np.median(np.abs(distance)))
    near = np.abs(distance) <= OUTLIER * max(spread, 1e-12 + 1e-6 * float(np.ptp(points)))
    return found, distance, near & ~found.on_boundary


def _cells(found: ClosestPoints) -> IntArray:
    """Number of the small triangle, of CELLS^2 per triangle, in which each foot point lies."""
    u, v = np.clip(found.parameters, 0.0, 1.0).T * CELLS
    i, j = np.minimum(u.astype(np.int64), CELLS - 1), np.minimum(v.astype(np.int64), CELLS - 1)
    upper = (u - i) + (v - j) > 1.0
    return ((found.triangle * CELLS + i) * CELLS + j) * 2 + upper


def _step(
    surface: LimitSurface,
    control: FloatArray,
    found: ClosestPoints,
    distance: FloatArray,
    counted: npt.NDArray[np.bool_],
    smoothing: float,
) -> FloatArray:
    """(n, 3) motion of the control points along the vertex normals."""
    mesh, n = surface.mesh, surface.mesh.vertex_count
    _, cell, count = np.unique(_cells(found)[counted], return_inverse=True, return_counts=True)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(cell, values[counted]) / count

    triangle = np.round(mean(found.triangle.astype(np.float64))).astype(np.int64)
    parameters = np.column_stack([mean(found.parameters[:, k]) for k in range(2)])
    facing = np.column_stack([mean(found.normal[:, k]) for k in range(3)])
    normals = surface.vertex_normals(control)
    rows = basis_rows(mesh, triangle, parameters)
    owner = np.repeat(np.arange(len(triangle)), np.diff(rows.node_offsets))
    weights = rows.values * np.einsum('ij,ij->i', normals[rows.nodes], facing[owner])
    matrix = csr_matrix((weights, rows.nodes, rows.node_offsets), (len(triangle), n))
    data = matrix.T @ diags(count.astype(np.float64)) @ matrix
    right = matrix.T @ (count * mean(distance))
    bending = _bending(mesh)
    own = [diags(normals[:, k]) @ bending for k in range(3)]
    along = sum(own[k] @ diags(normals[:, k]) for k in range(3))
    rough = sum(own[k] @ control[:, k] for k in range(3))
    strength = smoothing * counted.sum() / n
    system = (data + strength * (along.T @ along)).tocsr()
    right = right - strength * (along.T @ rough)
    free = np.ones(n, dtype=bool)
    free[mesh.boundary_vertices] = False
    kept = np.flatnonzero(free)
    system, right = system[kept][:, kept], right[kept]
    system = (system + diags(np.full(len(kept), 1e-9 * float(system.diagonal().mean())))).tocsr()
    step = np.zeros(n)
    step[kept] = _solve_positive(system, right, np.zeros(len(kept)), 1e-8)
    return step[:, None] * normals


def _bending(mesh: ControlMesh) -> csr_matrix:
    """Twice the difference from the mean of the neighbours; rim vertices count no more."""
    n = mesh.vertex_count
    pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (n, n)).tocsr()
    inner = np.ones(n)
    inner[mesh.boundary_vertices] = 0.0
    laplace = diags(inner) @ (diags(1.0 / mesh.valence) @ graph - diags(np.ones(n)))
    return (laplace @ laplace).tocsr()


def _fit_rim(
    surface: LimitSurface, control: FloatArray, rim: FloatArray, wall: FloatArray
) -> FloatArray:
    """Move boundary control points so that the limit curve follows the scanned rim."""
    mesh, n = surface.mesh, surface.mesh.vertex_count
    half = np.flatnonzero(boundary_half_edges(mesh))
    start = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    share = (np.arange(8) / 8.0)[:, None, None]
    places = ((1 - share) * start[half % 3] + share * start[(half + 1) % 3]).reshape(-1, 2)
    triangle = np.tile(half // 3, 8)
    there = surface.evaluate(control, triangle, places)
    origin = mesh.triangles.reshape(-1)[half]
    depth = np.tile(wall[origin], 8)[:, None]
    _, nearest = cKDTree(there.position + depth * there.normal).query(rim)
    inward = rim - depth[nearest] * there.normal[nearest]
    rows = basis_rows(mesh, triangle[nearest], places[nearest])
    matrix = csr_matrix((rows.values, rows.nodes, rows.node_offsets), (len(rim), n))
    border = mesh.boundary_vertices
    curve = matrix[:, border]
    system = (curve.T @ curve).tocsr()
    mean = float(system.diagonal().mean())
    system = (system + diags(np.full(len(border), 0.1 * HOLD * mean))).tocsr()
    gap = curve.T @ (inward - matrix @ control)
    result = control.copy()
    for k in range(3):
        result[border, k] += _solve_positive(system, gap[:, k], np.zeros(len(border)), 1e-8)
    return result


def _spread(
    found: ClosestPoints, distance: FloatArray, counted: npt.NDArray[np.bool_]
) -> tuple[float, float]:
    """Root mean square of the counted distances, and of their systematic part.

    The systematic part is that of the cell means, less what the noise within the cells leaves in
    them.
    """
    _, cell, count = np.unique(_cells(found)[counted], return_inverse=True, return_counts=True)
    rms = float(np.sqrt(np.mean(distance[counted] ** 2)))
    mean = np.bincount(cell, distance[counted]) / count
    within = np.bincount(cell, (distance[counted] - mean[cell]) ** 2)
    many = count > 1
    if not many.any():
        return rms, rms
    noise = within[many].sum() / (count[many] - 1).sum()
    squared = (mean[many] ** 2 - noise / count[many]).mean()
    return rms, float(np.sqrt(max(squared, 0.0)))


def _solve_positive(
    matrix: csr_matrix, right: FloatArray, start: FloatArray, tolerance: float = 1e-12
) -> FloatArray:
    """Conjugate gradients with diagonal scaling for a symmetric positive definite matrix.

    Well conditioned fits converge in some dozens of steps, without the fill-in of a factor.
    """
    inverse = 1.0 / matrix.diagonal()
    x = start.copy()
    residual = right - matrix @ x
    scaled = inverse * residual
    direction, product = scaled.copy(), float(residual @ scaled)
    goal = tolerance**2 * float(right @ (inverse * right))
    for _ in range(4 * len(right)):
        if product <= goal:
            break
        image = matrix @ direction
        step = product / float(direction @ image)
        x += step * direction
        residual -= step * image
        scaled = inverse * residual
        previous, product = product, float(residual @ scaled)
        direction = scaled + (product / previous) * direction
    return x
