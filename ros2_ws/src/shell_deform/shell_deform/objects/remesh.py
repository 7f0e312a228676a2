# SPDX-License-Identifier: Apache-2.0
"""Even triangles of a wanted number on a scanned surface.

Decimation (quadric error, package fast-simplification) brings the scan down to the wanted number
of triangles. What it leaves are slivers, so the small mesh is then evened out by splitting long
edges, collapsing short ones, flipping towards six neighbours and moving vertices within the
surface (M. Botsch and L. Kobbelt, A remeshing approach to multiresolution modeling, SGP 2004).
No package with a permissive licence and small wheels does this second step.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from .scan_clean import CleanScan, clean_scan, filled
from .shell_object import ObjectError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

ROUNDS = 8
NEIGHBOURS = 16


def decimated(
    vertices: FloatArray, triangles: IntArray, count: int
) -> tuple[FloatArray, IntArray]:
    """The same surface with about `count` vertices, if it has more.

    Raises:
        ObjectError: fast-simplification is not installed.
    """
    if len(triangles) <= 2 * count:
        return vertices, triangles
    try:
        import fast_simplification
    except ImportError:
        raise ObjectError(
            'decimating a scan needs the package fast-simplification; install it with pip'
        ) from None
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    points, faces = fast_simplification.simplify(
        ((vertices - low) / size).astype(np.float32),
        triangles.astype(np.int32),
        target_count=2 * count,
    )
    return low + size * points.astype(np.float64), faces.astype(np.int64)


def smoothed(vertices: FloatArray, triangles: IntArray, times: int) -> FloatArray:
    """Vertices moved to the mean of their neighbours that many times, the rim staying put.

    A dense scan is rougher than its triangles are long; decimation would fold it.
    """
    n = len(vertices)
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    graph = csr_matrix((np.ones(len(start), dtype=np.float32), (start, end)), (n, n))
    # Around an inner vertex of an oriented mesh every neighbour is the end of one half-edge.
    inward = np.bincount(end, minlength=n)
    degree = np.bincount(start, minlength=n)
    rim = np.zeros(n, dtype=bool)
    difference = graph - graph.T
    difference.eliminate_zeros()
    rim[difference.indices] = True
    free = ~rim & (inward == degree)
    result = vertices.copy()
    for _ in range(times):
        mean = (graph @ result) / degree[:, None]
        result[free] = 0.5 * (result[free] + mean[free])
    return result


def even_mesh(scan: CleanScan, vertices: int, longest_rim: float) -> EvenMesh:
    """About `vertices` vertices in even triangles on a scan, small holes closed.

    Args:
        longest_rim: longest rim of a hole that is closed [m].

    Raises:
        ObjectError: fast-simplification is needed and not installed.
    """
    points, faces = decimated(scan.vertices, scan.triangles, 3 * vertices)
    start = clean_scan(points, faces)
    points, faces, closed = filled(start.vertices, start.triangles, longest_rim)
    ground = _Ground(scan)
    sides = points[np.roll(faces, -1, axis=1)] - points[faces]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
    # Splitting and collapsing leave edges a little longer than asked.
    edge = 0.975 * float(np.sqrt(area / vertices / (np.sqrt(3.0) / 2.0)))
    for _ in range(ROUNDS):
        points, faces = split_long(points, faces, lambda middle: 4.0 / 3.0 * edge)
        points, faces = _collapse_short(points, faces, 0.8 * edge)
        for _ in range(3):
            faces = flipped(points, faces)
        points = _relaxed(points, faces, ground, edge)
    return EvenMesh(points, faces, closed)


@dataclass(frozen=True)
class EvenMesh:
    """An even triangulation of a scan.

    Attributes:
        vertices: (n, 3) [m], near the scan.
        triangles: (m, 3).
        holes_closed: number of holes closed.
    """

    vertices: FloatArray
    triangles: IntArray
    holes_closed: int


class _Ground:
    """The scanned surface, smoothed over some points, and its rim."""

    def __init__(self, scan: CleanScan) -> None:
        vertices, triangles = scan.vertices, scan.triangles
        self._tree = cKDTree(vertices)
        self._vertices = vertices
        corners = vertices[triangles]
        turn = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        flat = triangles.reshape(-1)
        self._normals = np.stack(
            [np.bincount(flat, np.repeat(turn[:, k], 3), len(vertices)) for k in range(3)], axis=1
        )
        rim = _boundary_edges(triangles)
        self._rim = cKDTree(vertices[np.unique(rim)]) if len(rim) else None
        self._rim_points = vertices[np.unique(rim)] if len(rim) else None

    def drop(self, points: FloatArray, reach: float) -> FloatArray:
        """Points moved onto the mean plane of their neighbourhood, if the scan has one there."""
        count = min(NEIGHBOURS, len(self._vertices))
        distance, near = self._tree.query(points, k=count)
        centre = self._vertices[near].mean(axis=1)
        normal = self._normals[near].sum(axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        away = np.einsum('ij,ij->i', points - centre, normal)
        covered = distance[:, 0] < reach
        return points - np.where(covered, away, 0.0)[:, None] * normal

    def drop_rim(self, points: FloatArray) -> FloatArray:
        """Points moved to the rim, to the mean of the nearest rim points."""
        if self._rim is None or self._rim_points is None or len(points) == 0:
            return points
        count = min(3, len(self._rim_points))
        _, near = self._rim.query(points, k=count)
        return self._rim_points[near.reshape(len(points), -1)].mean(axis=1)


def edge_table(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Edges (e, 2), their two triangles (e, 2; -1 on the boundary) and opposite corners."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    apex = np.roll(faces, -2, axis=1).reshape(-1)
    n = int(faces.max()) + 1
    key = np.minimum(start, end) * n + np.maximum(start, end)
    order = np.argsort(key, kind='stable')
    keys, first, counts = np.unique(key[order], return_index=True, return_counts=True)
    one = order[first]
    other = np.where(counts == 2, order[np.minimum(first + 1, len(order) - 1)], -1)
    triangles = np.column_stack([one // 3, np.where(other >= 0, other // 3, -1)])
    apexes = np.column_stack([apex[one], np.where(other >= 0, apex[other], -1)])
    return np.column_stack([keys // n, keys % n]), triangles, apexes


def _boundary_edges(faces: IntArray) -> IntArray:
    edges, triangles, _ = edge_table(faces)
    return edges[triangles[:, 1] < 0]


def _lengths(points: FloatArray, edges: IntArray) -> FloatArray:
    return np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)


def split_long(
    points: FloatArray,
    faces: IntArray,
    longest: Callable[[FloatArray], FloatArray | float],
    fixed: int = 0,
    rims: bool = False,
) -> tuple[FloatArray, IntArray]:
    """Halve edges that are too long, the longest first, at most one per triangle at a time.

    `longest` tells how long an edge with its middle at (e, 3) may be. New vertices come last;
    edges between two of the first `fixed` vertices stay, but those of the boundary if `rims`.
    """
    for _ in range(8):
        edges, triangles, _ = edge_table(faces)
        middles = points[edges].mean(axis=1)
        length = _lengths(points, edges) / longest(middles)
        free = (edges.max(axis=1) >= fixed) | (rims & (triangles[:, 1] < 0))
        wanted = np.flatnonzero((length > 1.0) & free)
        if len(wanted) == 0:
            break
        order = wanted[np.argsort(-length[wanted], kind='stable')]
        taken = [False] * len(faces)
        chosen = []
        for e, (a, b) in zip(order.tolist(), triangles[order].tolist(), strict=True):
            if taken[a] or (b >= 0 and taken[b]):
                continue
            taken[a] = True
            if b >= 0:
                taken[b] = True
            chosen.append(e)
        middle = len(points) + np.arange(len(chosen))
        new = [faces[~np.array(taken)]]
        for side in (0, 1):
            owner = triangles[chosen, side]
            there = owner >= 0
            face, fresh = faces[owner[there]], middle[there, None]
            for end in (0, 1):
                new.append(np.where(face == edges[chosen][there, end, None], fresh, face))
        points = np.concatenate([points, 0.5 * points[edges[chosen]].sum(axis=1)])
        faces = np.concatenate(new)
    return points, faces


def _collapse_short(
    points: FloatArray, faces: IntArray, shortest: float
) -> tuple[FloatArray, IntArray]:
    """Merge the ends of edges that are too short, where the surface stays manifold."""
    points = points.copy()
    for _ in range(4):
        edges, triangles, _ = edge_table(faces)
        length = _lengths(points, edges)
        wanted = np.flatnonzero(length < shortest)
        if len(wanted) == 0:
            break
        around: dict[int, set[int]] = defaultdict(set)
        for i, j in edges.tolist():
            around[i].add(j)
            around[j].add(i)
        rim = set(np.unique(edges[triangles[:, 1] < 0]).tolist())
        locked: set[int] = set()
        target = np.arange(len(points))
        for e in wanted[np.argsort(length[wanted], kind='stable')].tolist():
            i, j = edges[e].tolist()
            on_rim = (i in rim) + (j in rim)
            inside = triangles[e, 1] >= 0
            if (on_rim == 2 and inside) or i in locked or j in locked:
                continue
            common = around[i] & around[j]
            if len(common) != (2 if inside else 1) or (not inside and len(rim) < 8):
                continue
            if len(around[i] | around[j]) > 11 or min(len(around[k]) for k in common) <= 3:
                continue
            keep, gone = (j, i) if j in rim and i not in rim else (i, j)
            place = points[keep] if on_rim == 1 else 0.5 * (points[i] + points[j])
            reach = (around[i] | around[j]) - {i, j}
            if np.linalg.norm(points[list(reach)] - place, axis=1).max() > 5.0 / 3.0 * shortest:
                continue
            points[keep] = place
            target[gone] = keep
            locked |= reach | {i, j}
        if not locked:
            break
        faces = target[faces]
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (c != a)]
    used, faces = np.unique(faces, return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def flipped(points: FloatArray, faces: IntArray, fixed: int = 0) -> IntArray:
    """Flip edges where that brings valences nearer to six (four on the rim).

    Edges between two of the first `fixed` vertices stay.
    """
    edges, triangles, apexes = edge_table(faces)
    n = len(points)
    valence = np.bincount(edges.ravel(), minlength=n)
    rim = np.unique(edges[triangles[:, 1] < 0])
    goal = np.full(n, 6)
    goal[rim] = 4
    inner = np.flatnonzero((triangles[:, 1] >= 0) & (edges.max(axis=1) >= fixed))
    i, j = edges[inner].T
    k, m = apexes[inner].T
    excess = valence - goal
    before = excess[i] ** 2 + excess[j] ** 2 + excess[k] ** 2 + excess[m] ** 2
    after = (
        (excess[i] - 1) ** 2 + (excess[j] - 1) ** 2 + (excess[k] + 1) ** 2 + (excess[m] + 1) ** 2
    )
    gain = before - after
    order = np.argsort(-gain, kind='stable')
    order = order[gain[order] > 0]
    first, second = np.minimum(k, m) * n + np.maximum(k, m), edges[:, 0] * n + edges[:, 1]
    order = order[~np.isin(first[order], second)]
    order = order[(np.minimum(valence[i], valence[j])[order] > 3)]
    order = order[_stays_flat(points, i[order], j[order], k[order], m[order])]
    corners = np.column_stack([i, j, k, m])[order].tolist()
    owners = triangles[inner[order]].tolist()
    taken = [False] * n
    faces = faces.copy()
    made: set[tuple[int, int]] = set()
    for (a, b, c, d), (one, other) in zip(corners, owners, strict=True):
        if taken[a] or taken[b] or taken[c] or taken[d] or (c, d) in made:
            continue
        made |= {(c, d), (d, c)}
        # Triangle `one` runs a, b, c or b, a, c.
        face = faces[one].tolist()
        if face[(face.index(a) + 1) % 3] != b:
            a, b = b, a
        faces[one] = (a, d, c)
        faces[other] = (d, b, c)
        taken[a] = taken[b] = taken[c] = taken[d] = True
    return faces


def _stays_flat(
    points: FloatArray, a: IntArray, b: IntArray, c: IntArray, d: IntArray
) -> BoolArray:
    """(p,) True where the triangles of a flipped edge c-d look the way the old ones do."""
    pa, pb, pc, pd = points[a], points[b], points[c], points[d]
    old = np.cross(pb - pa, pc - pa) + np.cross(pd - pa, pb - pa)
    first, second = np.cross(pd - pa, pc - pa), np.cross(pb - pd, pc - pd)
    dot = [np.einsum('ij,ij->i', new, old) for new in (first, second)]
    return (dot[0] > 0.0) & (dot[1] > 0.0)


def _relaxed(points: FloatArray, faces: IntArray, ground: _Ground, edge: float) -> FloatArray:
    """Move vertices towards the mean of their neighbours, within the surface."""
    n = len(points)
    edges, triangles, _ = edge_table(faces)
    rim_edges = edges[triangles[:, 1] < 0]
    rim = np.unique(rim_edges)
    inner = np.ones(n, dtype=bool)
    inner[rim] = False
    both = np.concatenate([edges[inner[edges].any(axis=1)], rim_edges])
    pairs = np.concatenate([both, both[:, ::-1]])
    # Rim vertices follow the rim alone.
    pairs = pairs[inner[pairs[:, 0]] | ~inner[pairs[:, 1]]]
    graph = csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (n, n))
    mean = (graph @ points) / np.maximum(graph.sum(axis=1).A1, 1.0)[:, None]
    moved = points + 0.7 * (mean - points)
    moved[inner] = ground.drop(moved[inner], edge)
    moved[rim] = ground.drop_rim(moved[rim])
    return moved
