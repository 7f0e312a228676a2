"""Closest point on a limit surface: nearest sample, then Newton across the patches.

No library evaluates the Loop limit surface, so none can project onto it. The search starts at the
nearest of a dense set of surface samples (SciPy's kd-tree) and walks from triangle to triangle by
Newton steps on the squared distance, falling back to the intrinsic Gauss-Newton direction, which
is the same on both sides of an edge, wherever a step makes no progress.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..compiled import HAVE_NUMBA, writable
from . import closest_point_plain
from .box_spline import COEFFICIENTS
from .control_mesh import BoolArray, ControlMesh, FloatArray, IntArray
from .loop_basis import basis_rows
from .patch import Patch
from .patch_table import PatchTable, patch_table

MAXIMUM_THREADS = 4
SAMPLE_DIVISIONS = 3
FEW_POINTS = 1000


@dataclass(frozen=True)
class ClosestPoints:
    """Answers to q queries.

    Attributes:
        triangle: (q,) triangle of the foot point.
        parameters: (q, 2) its (u, v).
        position: (q, 3) closest point on the offset surface [m].
        normal: (q, 3) outward unit normal there.
        distance: (q,) signed distance, positive outside [m].
        on_boundary: (q,) True where the foot point lies on the boundary of the surface, so that
            the query is beside the surface and not above or below it.
    """

    triangle: IntArray
    parameters: FloatArray
    position: FloatArray
    normal: FloatArray
    distance: FloatArray
    on_boundary: BoolArray


@dataclass(frozen=True, eq=False)
class ProjectionTables:
    """What the kernel needs to know about a mesh, as flat arrays.

    Attributes:
        mesh: the mesh.
        patch, node_offsets, nodes: patch number and control points of each triangle.
        neighbour: (3m,) half-edge on the other side of each half-edge, or -1 where the active
            surface ends.
        sizes: (c,) control points of each patch.
        halvings: (c,) how often to split each patch towards an irregular corner.
        child: (c, 4) patch numbers of the children, -1 for regular patches.
        child_offset: (c, 4) start of each child's matrix in `matrices`.
        polynomial_offset: (c,) start of each regular patch's matrix in `matrices`, else -1.
        matrices: all matrices in row order: child control points, or the fifteen monomial
            coefficients, from the patch's control points.
        sample_triangle, sample_parameters: where the starting samples lie.
        samples: (s, n) sparse matrix from control points to samples.
    """

    mesh: ControlMesh
    patch: IntArray
    node_offsets: IntArray
    nodes: IntArray
    neighbour: IntArray
    sizes: IntArray
    halvings: IntArray
    child: IntArray
    child_offset: IntArray
    polynomial_offset: IntArray
    matrices: FloatArray
    sample_triangle: IntArray
    sample_parameters: FloatArray
    samples: csr_matrix


def projection_tables(mesh: ControlMesh) -> ProjectionTables:
    """Flatten the patches of `mesh` and lay the starting samples."""
    table = patch_table(mesh)
    patches = _with_descendants(table)
    number = {patch: i for i, patch in enumerate(patches)}
    child = np.full((len(patches), 4), -1, dtype=np.int64)
    child_offset = np.full((len(patches), 4), -1, dtype=np.int64)
    polynomial_offset = np.full(len(patches), -1, dtype=np.int64)
    blocks: list[FloatArray] = []
    used = 0
    for index, patch in enumerate(patches):
        if patch.is_regular:
            polynomial_offset[index] = used
            blocks.append((COEFFICIENTS.T @ patch.to_box).ravel())
            used += len(blocks[-1])
            continue
        for piece, (other, matrix) in enumerate(patch.children):
            child[index, piece], child_offset[index, piece] = number[other], used
            blocks.append(matrix.ravel())
            used += len(blocks[-1])
    twins, active = mesh.twins, mesh.active
    neighbour = np.where((twins >= 0) & active[twins // 3], twins, -1)
    triangle, parameters = _sample_places(mesh)
    rows = basis_rows(mesh, triangle, parameters)
    shape = (len(triangle), mesh.vertex_count)
    return ProjectionTables(
        mesh, table.patch, table.node_offsets, table.nodes.astype(np.int64), neighbour,
        np.array([patch.size for patch in patches], dtype=np.int64),
        np.array([patch.halvings for patch in patches], dtype=np.int64), child, child_offset,
        polynomial_offset, np.concatenate(blocks), triangle, parameters,
        csr_matrix((rows.values, rows.nodes, rows.node_offsets), shape),
    )  # fmt: skip


def closest_points(
    tables: ProjectionTables,
    control_points: FloatArray,
    queries: npt.ArrayLike,
    *,
    offset: float = 0.0,
    seeds: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    threads: int | None = None,
) -> ClosestPoints:
    """Project queries (q, 3) [m] onto the active limit surface; see `LimitSurface.closest_point`.

    Raises:
        ValueError: a query is not finite or has no three coordinates.
    """
    points = writable(np.asarray(queries, dtype=np.float64))
    control_points = writable(control_points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f'queries have shape {points.shape}; (q, 3) is needed')
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise ValueError(f'query {bad} is not finite: {points[bad]}')
    count = threads if threads is not None else min(MAXIMUM_THREADS, os.cpu_count() or 1)
    triangle, parameters = _seeds(tables, control_points, points, seeds, count)
    project = _project_compiled if HAVE_NUMBA else _project_plain
    position, normal, on_boundary = project(
        tables, control_points, points, triangle, parameters, count
    )
    position += offset * normal
    away = points - position
    along = np.einsum('ij,ij->i', away, normal)
    beside = np.copysign(np.linalg.norm(away, axis=1), along)
    distance = np.where(on_boundary, beside, along)
    return ClosestPoints(triangle, parameters, position, normal, distance, on_boundary)


def _project_plain(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
    threads: int,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    return closest_point_plain.project_points(
        tables.mesh, tables.neighbour, control_points, points, triangle, parameters
    )


def _project_compiled(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
    threads: int,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    from .closest_point_kernel import project_points

    position, normal = np.empty_like(points), np.empty_like(points)
    on_boundary = np.zeros(len(points), dtype=np.bool_)
    polynomials = _polynomials(tables, control_points)

    def work(part: slice) -> None:
        project_points(
            points[part], triangle[part], parameters[part], position[part], normal[part],
            on_boundary[part], control_points, polynomials, tables.patch, tables.node_offsets,
            tables.nodes, tables.neighbour, tables.sizes, tables.halvings, tables.child,
            tables.child_offset, tables.polynomial_offset, tables.matrices,
        )  # fmt: skip

    if threads == 1 or len(points) < FEW_POINTS:
        work(slice(0, len(points)))
    else:
        bounds = [i * len(points) // threads for i in range(threads + 1)]
        parts = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, parts))
    return position, normal, on_boundary


def _seeds(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    seeds: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    threads: int,
) -> tuple[IntArray, FloatArray]:
    if seeds is not None:
        return (
            np.array(seeds[0], dtype=np.int64),
            np.array(seeds[1], dtype=np.float64).reshape(-1, 2),
        )
    tree = cKDTree(tables.samples @ control_points)
    _, nearest = tree.query(points, workers=threads)
    return tables.sample_triangle[nearest], tables.sample_parameters[nearest]


def _polynomials(tables: ProjectionTables, control_points: FloatArray) -> FloatArray:
    """(m, 15, 3) monomial coefficients of every regular triangle; zero for the others."""
    result = np.zeros((len(tables.patch), 15, 3))
    for index in np.unique(tables.patch).tolist():
        start = tables.polynomial_offset[index]
        if start < 0:
            continue
        members = np.flatnonzero(tables.patch == index)
        size = int(tables.sizes[index])
        matrix = tables.matrices[start : start + 15 * size].reshape(15, size)
        nodes = tables.nodes[tables.node_offsets[members][:, None] + np.arange(size)]
        result[members] = matrix @ control_points[nodes]
    return result


def _with_descendants(table: PatchTable) -> list[Patch]:
    patches = list(table.patches)
    known = set(patches)
    for patch in patches:
        if patch.is_regular:
            continue
        for child, _ in patch.children:
            if child not in known:
                known.add(child)
                patches.append(child)
    return patches


def _sample_places(mesh: ControlMesh) -> tuple[IntArray, FloatArray]:
    """Samples at the centres of the small triangles that split each active triangle."""
    n = SAMPLE_DIVISIONS
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(n) for j in range(n - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(n) for j in range(n - 1 - i)]
    places = np.array(upright + turned) / n
    active = np.flatnonzero(mesh.active)
    return np.repeat(active, len(places)), np.tile(places, (len(active), 1))
