# SPDX-License-Identifier: Apache-2.0
"""Closest point on a limit surface: nearest sample, then Newton across the patches.

No library evaluates the Loop limit surface, so none can project onto it. The search starts at the
nearest of a dense set of surface samples (SciPy's kd-tree) and walks from triangle to triangle by
Newton steps on the squared distance, falling back to the intrinsic Gauss-Newton direction, which
is the same on both sides of an edge, wherever a step makes no progress. Queries whose foot may not
be the nearest one are searched again from all samples near enough.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from shell_deform.compiled.cache import HAVE_NUMBA

from . import closest_point_plain
from .box_spline import COEFFICIENTS
from .closest_point_types import Feet, Patches
from .control_mesh import BoolArray, ControlMesh, FloatArray, IntArray
from .loop_basis import basis_rows
from .patch import Patch
from .patch_table import PatchTable, patch_table

if HAVE_NUMBA:
    from .closest_point_kernel import project_points

Project = Callable[..., 'Feet']

MAXIMUM_THREADS = 4
SAMPLE_DIVISIONS = 3
FEW_POINTS = 1000
DOUBTFUL_AT_ONCE = 20000
# Queries farther away than this share of all are searched for again without asking.
USUAL_SHARE = 0.99


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
    """What a search needs to know about a mesh.

    Attributes:
        mesh: the mesh. patches: its patches as flat arrays.
        smooth: (m,) whether a triangle is away from creases and boundaries.
        sample_triangle, sample_parameters: where the starting samples lie.
        samples: (s, n) sparse matrix from control points to samples.
    """

    mesh: ControlMesh
    patches: Patches
    smooth: BoolArray
    sample_triangle: IntArray
    sample_parameters: FloatArray
    samples: csr_matrix

    def has(self, control_points: FloatArray) -> bool:
        """Whether these are the control points of the mesh itself, in the same memory."""
        own = self.mesh.vertices
        return control_points is own or (
            control_points.shape == own.shape
            and control_points.__array_interface__['data'] == own.__array_interface__['data']
        )

    @cached_property
    def rest_tree(self) -> cKDTree:
        """The starting samples of the mesh as it is given, for many searches."""
        return cKDTree(self.samples @ self.mesh.vertices)

    @cached_property
    def rest_polynomials(self) -> FloatArray:
        """`_polynomials` of the mesh as it is given."""
        return _polynomials(self.patches, self.mesh.vertices)

    @cached_property
    def rest_cell_sizes(self) -> FloatArray:
        """`_cell_sizes` of the mesh as it is given."""
        return _cell_sizes(self.mesh, self.mesh.vertices)

    def cell_sizes(self, control_points: FloatArray) -> FloatArray:
        """(m,) how far any point of a triangle is from its samples, at most [m]."""
        if self.has(control_points):
            return self.rest_cell_sizes
        return _cell_sizes(self.mesh, control_points)


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
    flat = Patches(
        patch=np.array(table.patch),
        node_offsets=np.array(table.node_offsets),
        nodes=table.nodes.astype(np.int64),
        neighbour=neighbour,
        sizes=np.array([patch.size for patch in patches], dtype=np.int64),
        halvings=np.array([patch.halvings for patch in patches], dtype=np.int64),
        child=child,
        child_offset=child_offset,
        polynomial_offset=polynomial_offset,
        matrices=np.concatenate(blocks),
    )
    samples = csr_matrix((rows.values, rows.nodes, rows.node_offsets), shape)
    smooth = np.all(mesh.sharp_valence[mesh.triangles] == 0, axis=1)
    return ProjectionTables(mesh, flat, smooth, triangle, parameters, samples)


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
    points = np.ascontiguousarray(queries, dtype=np.float64)
    control_points = np.ascontiguousarray(control_points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f'queries have shape {points.shape}; (q, 3) is needed')
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise ValueError(f'query {bad} is not finite: {points[bad]}')
    count = threads if threads is not None else min(MAXIMUM_THREADS, os.cpu_count() or 1)
    project = _project_compiled if HAVE_NUMBA else _project_plain
    if seeds is not None:
        start = (
            np.array(seeds[0], dtype=np.int64),
            np.array(seeds[1], dtype=np.float64).reshape(-1, 2),
        )
        found = project(tables, control_points, points, *start, count)
    else:
        at_rest = tables.has(control_points)
        tree = tables.rest_tree if at_rest else cKDTree(tables.samples @ control_points)
        # Threads cost more than a few searches.
        count = count if len(points) >= FEW_POINTS else 1
        _, nearest = tree.query(points, workers=count)
        found = project(tables, control_points, points, *_places(tables, nearest), count)
        doubtful = _doubtful(tables, control_points, points, found, nearest, tree, count, project)
        _search_again(tables, control_points, points, found, doubtful, tree, count, project)
    position = found.position + offset * found.normal
    away = points - position
    along = np.einsum('ij,ij->i', away, found.normal)
    beside = np.copysign(np.linalg.norm(away, axis=1), along)
    distance = np.where(found.on_boundary, beside, along)
    return ClosestPoints(
        found.triangle, found.parameters, position, found.normal, distance, found.on_boundary
    )


def _places(tables: ProjectionTables, samples: IntArray) -> tuple[IntArray, FloatArray]:
    return tables.sample_triangle[samples], tables.sample_parameters[samples]


def _doubtful(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    found: Feet,
    nearest: IntArray,
    tree: cKDTree,
    threads: int,
    project: Project,
) -> IntArray:
    """Queries whose foot may not be the nearest.

    Sure is a foot away from creases and ends, beneath which the squared distance bends enough,
    and whose part of the surface stands alone: a ball of twice the distance laid against the
    sample there, on either side, contains no other sample. With few queries a second search is
    cheaper than this question.
    """
    samples = np.asarray(tree.data)
    if len(points) < len(samples):
        return np.arange(len(points))
    away = np.linalg.norm(found.position - points, axis=1)
    far = float(np.quantile(away, USUAL_SHARE))
    places = project(
        tables, control_points, samples, *_places(tables, np.arange(len(samples))), threads
    )
    alone = np.ones(len(samples), dtype=bool)
    for side in (2.0 * far, -2.0 * far):
        gap, _ = tree.query(samples + side * places.normal, workers=threads)
        alone &= gap >= (1.0 - 1e-9) * abs(side)
    wandered = np.linalg.norm(found.position - samples[nearest], axis=1)
    sure = found.sure & tables.smooth[found.triangle] & alone[nearest] & (away <= far)
    cell = float(tables.cell_sizes(control_points)[tables.mesh.active].max())
    return np.flatnonzero(~sure | (wandered > 2.0 * cell))


def _search_again(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    found: Feet,
    doubtful: IntArray,
    tree: cKDTree,
    threads: int,
    project: Project,
) -> None:
    """Look for nearer feet of the `doubtful` queries, in place.

    A foot no farther than the one found has a sample of its triangle beside it, within the size of
    a cell of that triangle, so a search starts in every triangle with a sample that near, from the
    nearest of its samples.
    """
    cells = tables.cell_sizes(control_points)
    cell = float(cells[tables.mesh.active].max())
    samples = np.asarray(tree.data)
    for part in np.array_split(doubtful, 1 + len(doubtful) // DOUBTFUL_AT_ONCE):
        here = points[part]
        reach = np.linalg.norm(found.position[part] - here, axis=1)
        lists = tree.query_ball_point(here, reach + cell, workers=threads)
        of = np.repeat(np.arange(len(part)), [len(some) for some in lists])
        if not len(of):
            continue
        start = np.concatenate([some for some in lists if some]).astype(np.int64)
        gap = np.linalg.norm(samples[start] - here[of], axis=1)
        triangle = tables.sample_triangle[start]
        near = np.flatnonzero(gap <= reach[of] + cells[triangle])
        order = near[np.lexsort((gap[near], triangle[near], of[near]))]
        of, start, triangle = of[order], start[order], triangle[order]
        first = np.ones(len(of), dtype=bool)
        first[1:] = (of[1:] != of[:-1]) | (triangle[1:] != triangle[:-1])
        of, start = of[first], start[first]
        again = project(tables, control_points, here[of], *_places(tables, start), threads)
        trial = np.linalg.norm(again.position - here[of], axis=1)
        order = np.lexsort((trial, of))
        best = order[np.unique(of, return_index=True)[1]]
        best = best[trial[best] < reach[of[best]]]
        for old, new in zip(found, again, strict=True):
            old[part[of[best]]] = new[best]


def _cell_sizes(mesh: ControlMesh, control_points: FloatArray) -> FloatArray:
    """(m,) how far the centre of a cell is from its corners, in every triangle [m]."""
    corners = control_points[mesh.triangles]
    edges = corners - np.roll(corners, 1, axis=1)
    longest: FloatArray = np.sqrt(np.max(np.sum(edges**2, axis=2), axis=1))
    return longest / (np.sqrt(3.0) * SAMPLE_DIVISIONS)


def _project_plain(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
    threads: int,
) -> Feet:
    return Feet(
        triangle,
        parameters,
        *closest_point_plain.project_points(
            tables.mesh, tables.patches.neighbour, control_points, points, triangle, parameters
        ),
    )


def _project_compiled(
    tables: ProjectionTables,
    control_points: FloatArray,
    points: FloatArray,
    triangle: IntArray,
    parameters: FloatArray,
    threads: int,
) -> Feet:
    position, normal = np.empty_like(points), np.empty_like(points)
    on_boundary, sure = np.zeros((2, len(points)), dtype=np.bool_)
    feet = Feet(triangle, parameters, position, normal, on_boundary, sure)
    if tables.has(control_points):
        polynomials = tables.rest_polynomials
    else:
        polynomials = _polynomials(tables.patches, control_points)

    def work(part: slice) -> None:
        some = Feet._make(array[part] for array in feet)
        project_points(points[part], some, control_points, polynomials, tables.patches)

    if threads == 1 or len(points) < FEW_POINTS:
        work(slice(0, len(points)))
    else:
        bounds = [i * len(points) // threads for i in range(threads + 1)]
        parts = [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, parts))
    return feet


def _polynomials(patches: Patches, control_points: FloatArray) -> FloatArray:
    """(m, 15, 3) monomial coefficients of every regular triangle; zero for the others."""
    result = np.zeros((len(patches.patch), 15, 3))
    for index in np.unique(patches.patch).tolist():
        start = patches.polynomial_offset[index]
        if start < 0:
            continue
        members = np.flatnonzero(patches.patch == index)
        size = int(patches.sizes[index])
        matrix = patches.matrices[start : start + 15 * size].reshape(15, size)
        nodes = patches.nodes[patches.node_offsets[members][:, None] + np.arange(size)]
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
