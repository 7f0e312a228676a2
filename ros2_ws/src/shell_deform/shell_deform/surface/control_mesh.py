# SPDX-License-Identifier: Apache-2.0
"""Control mesh of a Loop subdivision surface: triangles, adjacency and sharp features.

A mesh is validated once, when it is built, and never changes afterwards: everything that is
derived from it (patches, bases, factorisations) may be cached without a second look.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

DEFAULT_CORNER_ANGLE = np.deg2rad(50.0)


class MeshError(ValueError):
    """A control mesh that cannot carry a surface; the message names the offending element."""


@dataclass(frozen=True, eq=False)
class ControlMesh:
    """A validated, immutable control mesh. Build it with :func:`control_mesh`.

    Attributes:
        vertices: (n, 3) control points [m].
        triangles: (m, 3) vertex indices, consistently oriented, outward by the right-hand rule.
        active: (m,) False for triangles that only support the basis of their neighbours and
            carry no surface themselves (a ring beyond an edge, say).
        crease_edges: (c, 2) interior edges across which the surface may bend sharply.
        corners: (k,) boundary or crease vertices that the surface interpolates.
    """

    vertices: FloatArray
    triangles: IndexArray
    active: BoolArray
    crease_edges: IndexArray
    corners: IndexArray

    @property
    def vertex_count(self) -> int:
        """Number of control vertices."""
        return len(self.vertices)

    @property
    def triangle_count(self) -> int:
        """Number of triangles, inactive ones included."""
        return len(self.triangles)

    @cached_property
    def twins(self) -> IntArray:
        """(3m,) half-edge 3 t + e runs from corner e to e + 1 of t; its opposite, or -1."""
        return _frozen(_twins(self.triangles))

    @cached_property
    def sharp(self) -> BoolArray:
        """(3m,) True for half-edges on the boundary or on a crease."""
        sharp = self.twins < 0
        if len(self.crease_edges):
            n = np.int64(self.vertex_count)
            wanted = np.sort(self.crease_edges, axis=1).astype(np.int64)
            keys = _edge_keys(self.triangles, n)
            sharp |= np.isin(keys, wanted[:, 0] * n + wanted[:, 1])
        return _frozen(sharp)

    @cached_property
    def boundary_edges(self) -> IndexArray:
        """(b, 2) directed boundary edges, the surface on their left."""
        half = np.flatnonzero(self.twins < 0)
        return _frozen(
            np.column_stack([_origins(self.triangles)[half], _ends(self.triangles)[half]])
        )

    @cached_property
    def boundary_vertices(self) -> IndexArray:
        """(b,) sorted indices of the vertices on the boundary."""
        return _frozen(np.unique(self.boundary_edges))

    @property
    def is_closed(self) -> bool:
        """True if the surface has no boundary."""
        return len(self.boundary_edges) == 0 and bool(self.active.all())

    @cached_property
    def edges(self) -> IndexArray:
        """(e, 2) undirected edges, each once, smaller index first."""
        pairs = np.column_stack([_origins(self.triangles), _ends(self.triangles)])
        return _frozen(np.unique(np.sort(pairs, axis=1), axis=0))

    @cached_property
    def valence(self) -> IntArray:
        """(n,) number of edges at each vertex."""
        return _frozen(np.bincount(self.edges.ravel(), minlength=self.vertex_count))

    @cached_property
    def triangle_valence(self) -> IntArray:
        """(n,) number of triangles at each vertex."""
        return _frozen(np.bincount(self.triangles.ravel(), minlength=self.vertex_count))

    @cached_property
    def sharp_valence(self) -> IntArray:
        """(n,) number of sharp edges (boundary or crease) at each vertex."""
        half = np.flatnonzero(self.sharp)
        pairs = np.column_stack([_origins(self.triangles)[half], _ends(self.triangles)[half]])
        pairs = np.unique(np.sort(pairs, axis=1), axis=0) if len(pairs) else pairs
        return _frozen(np.bincount(pairs.ravel(), minlength=self.vertex_count))

    @cached_property
    def is_corner(self) -> BoolArray:
        """(n,) True where the surface interpolates the control point."""
        corner = self.sharp_valence > 2
        corner[self.corners] = True
        return _frozen(corner)

    @cached_property
    def irregular_vertices(self) -> IntArray:
        """(k,) vertices around which the surface is no plain box spline."""
        regular = (self.sharp_valence == 0) & (self.valence == 6)
        boundary = np.zeros(self.vertex_count, dtype=bool)
        boundary[self.boundary_vertices] = True
        regular |= boundary & (self.sharp_valence == 2) & (self.triangle_valence == 3)
        regular |= ~boundary & (self.sharp_valence == 2) & (self.triangle_valence == 6)
        return _frozen(np.flatnonzero(~regular | self.is_corner))

    def neighbours(self, vertex: int) -> IntArray:
        """Indices of the vertices that share an edge with `vertex`, sorted."""
        touching = self.edges[(self.edges == vertex).any(axis=1)]
        return np.sort(touching[touching != vertex]).astype(np.int64)


def control_mesh(
    vertices: npt.ArrayLike,
    triangles: npt.ArrayLike,
    crease_edges: npt.ArrayLike | None = None,
    corners: Iterable[int] | None = None,
    *,
    active: npt.ArrayLike | None = None,
    corner_angle: float = DEFAULT_CORNER_ANGLE,
) -> ControlMesh:
    """Build and validate a control mesh.

    Args:
        vertices: (n, 3) control points [m], finite.
        triangles: (m, 3) vertex indices, consistently oriented.
        crease_edges: (c, 2) interior edges to keep sharp.
        corners: boundary or crease vertices to interpolate. None chooses them: boundary
            vertices in exactly one triangle, or where the boundary turns by more than
            `corner_angle`. An empty list chooses none.
        active: (m,) False for triangles without surface of their own (default: all True).
        corner_angle: turning angle of the boundary [rad] from which a corner is assumed.

    Raises:
        MeshError: not manifold, not oriented, degenerate, disconnected, or an index that does
            not exist; the message names the vertex, edge or triangle.
    """
    points = np.array(vertices, dtype=np.float64)
    faces = np.array(triangles)
    if points.ndim != 2 or points.shape[1:] != (3,):
        raise MeshError(f'vertices have shape {points.shape}; (n, 3) is needed')
    if faces.ndim != 2 or faces.shape[1:] != (3,) or len(faces) == 0:
        raise MeshError(f'triangles have shape {faces.shape}; (m, 3) with m > 0 is needed')
    if not np.issubdtype(faces.dtype, np.integer):
        raise MeshError(f'triangles hold {faces.dtype}; integers are needed')
    _check_vertices(points, faces)
    faces = faces.astype(np.int32)
    _check_manifold(faces, len(points))
    creases = _checked_creases(crease_edges, faces, len(points))
    mask = np.ones(len(faces), dtype=bool) if active is None else np.array(active, dtype=bool)
    if mask.shape != (len(faces),):
        raise MeshError(f'active has shape {mask.shape}; one flag per triangle is needed')
    plain = ControlMesh(
        _frozen(points), _frozen(faces), _frozen(mask), _frozen(creases), _frozen(_no_indices())
    )
    chosen = _default_corners(plain, corner_angle) if corners is None else _checked(corners, plain)
    return ControlMesh(
        plain.vertices, plain.triangles, plain.active, plain.crease_edges, _frozen(chosen)
    )


def moved(mesh: ControlMesh, vertices: npt.ArrayLike) -> ControlMesh:
    """Return the same topology, sharp features included, with other control points (n, 3) [m]."""
    points = np.array(vertices, dtype=np.float64)
    if points.shape != mesh.vertices.shape:
        raise MeshError(f'vertices have shape {points.shape}; {mesh.vertices.shape} is needed')
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise MeshError(f'vertex {bad} is not finite: {points[bad]}')
    return ControlMesh(
        _frozen(points), mesh.triangles, mesh.active, mesh.crease_edges, mesh.corners
    )


def _check_vertices(points: FloatArray, faces: IntArray) -> None:
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        bad = int(np.flatnonzero(~finite)[0])
        raise MeshError(f'vertex {bad} is not finite: {points[bad]}')
    outside = (faces < 0) | (faces >= len(points))
    if outside.any():
        bad = int(np.flatnonzero(outside.any(axis=1))[0])
        raise MeshError(
            f'triangle {bad} {faces[bad].tolist()} names a vertex outside 0..{len(points) - 1}'
        )
    repeated = (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    )
    if repeated.any():
        bad = int(np.flatnonzero(repeated)[0])
        raise MeshError(f'triangle {bad} {faces[bad].tolist()} names a vertex twice')
    used = np.zeros(len(points), dtype=bool)
    used[faces] = True
    if not used.all():
        raise MeshError(f'vertex {int(np.flatnonzero(~used)[0])} belongs to no triangle')
    sides = points[np.roll(faces, -1, axis=1)] - points[faces]
    longest = np.sqrt((sides**2).sum(axis=2).max(axis=1))
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    flat = area <= 1e-10 * longest**2
    if flat.any():
        bad = int(np.flatnonzero(flat)[0])
        raise MeshError(
            f'triangle {bad} {faces[bad].tolist()} is degenerate: area {area[bad]:.3g} m2 '
            f'with a side of {longest[bad]:.3g} m'
        )


def _check_manifold(faces: IndexArray, n: int) -> None:
    start, end = _origins(faces).astype(np.int64), _ends(faces).astype(np.int64)
    undirected = _edge_keys(faces, n)
    keys, counts = np.unique(undirected, return_counts=True)
    if (counts > 2).any():
        key = int(keys[np.flatnonzero(counts > 2)[0]])
        owners = (np.flatnonzero(undirected == key) // 3).tolist()
        raise MeshError(
            f'edge ({key // n}, {key % n}) belongs to {len(owners)} triangles {owners}; '
            'a manifold mesh has one or two'
        )
    directed, where, counts = np.unique(start * n + end, return_index=True, return_counts=True)
    if (counts > 1).any():
        key = int(directed[np.flatnonzero(counts > 1)[0]])
        owners = (np.flatnonzero(start * n + end == key) // 3).tolist()
        raise MeshError(
            f'triangles {owners[0]} and {owners[1]} both run from vertex {key // n} to '
            f'{key % n}: they are not oriented alike; reverse one of them'
        )
    pairs = coo_matrix((np.ones(len(start)), (start, end)), shape=(n, n))
    pieces, label = connected_components(pairs, directed=False)
    if pieces > 1:
        other = int(np.flatnonzero(label != label[0])[0])
        raise MeshError(
            f'the mesh has {pieces} separate pieces (vertex {other} is not connected to '
            'vertex 0); keep one'
        )
    _check_fans(faces, n)


def _check_fans(faces: IndexArray, n: int) -> None:
    """Refuse vertices where two fans of triangles meet in a point only."""
    twins = _twins(faces)
    half = np.arange(3 * len(faces))
    previous = half - half % 3 + (half + 2) % 3
    around = twins[previous]
    linked = around >= 0
    graph = coo_matrix(
        (np.ones(int(linked.sum())), (half[linked], around[linked])), shape=(len(half), len(half))
    )
    _, label = connected_components(graph, directed=False)
    pairs = np.unique(np.column_stack([_origins(faces), label]), axis=0)
    fans = np.bincount(pairs[:, 0], minlength=n)
    if (fans > 1).any():
        bad = int(np.flatnonzero(fans > 1)[0])
        owners = np.flatnonzero((faces == bad).any(axis=1)).tolist()
        raise MeshError(
            f'vertex {bad} joins {fans[bad]} fans of triangles (of {owners}) in a single point; '
            'split it into one vertex per fan'
        )


def _checked_creases(edges: npt.ArrayLike | None, faces: IndexArray, n: int) -> IndexArray:
    if edges is None:
        return np.empty((0, 2), dtype=np.int32)
    pairs = np.array(edges, dtype=np.int64).reshape(-1, 2)
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    missing = ~np.isin(low * n + high, _edge_keys(faces, n))
    if missing.any():
        bad = pairs[np.flatnonzero(missing)[0]]
        raise MeshError(f'crease edge ({bad[0]}, {bad[1]}) is no edge of the mesh')
    return np.unique(np.column_stack([low, high]), axis=0).astype(np.int32)


def _checked(corners: Iterable[int], mesh: ControlMesh) -> IndexArray:
    chosen = np.unique(np.array(list(corners), dtype=np.int64))
    for vertex in chosen.tolist():
        if not 0 <= vertex < mesh.vertex_count:
            raise MeshError(f'corner {vertex} is no vertex of 0..{mesh.vertex_count - 1}')
        if mesh.sharp_valence[vertex] < 2:
            raise MeshError(
                f'corner {vertex} lies neither on the boundary nor on a crease; '
                'only such vertices can be interpolated'
            )
    return chosen.astype(np.int32)


def _default_corners(mesh: ControlMesh, corner_angle: float) -> IndexArray:
    edges = mesh.boundary_edges
    if len(edges) == 0:
        return _no_indices()
    following = np.full(mesh.vertex_count, -1, dtype=np.int64)
    following[edges[:, 0]] = edges[:, 1]
    middle = edges[:, 1].astype(np.int64)
    incoming = mesh.vertices[middle] - mesh.vertices[edges[:, 0]]
    outgoing = mesh.vertices[following[middle]] - mesh.vertices[middle]
    cosine = np.einsum('ij,ij->i', incoming, outgoing)
    cosine /= np.linalg.norm(incoming, axis=1) * np.linalg.norm(outgoing, axis=1)
    turning = np.arccos(np.clip(cosine, -1.0, 1.0))
    single = mesh.triangle_valence[middle] == 1
    return np.unique(middle[single | (turning > corner_angle)]).astype(np.int32)


def _twins(faces: IndexArray) -> IntArray:
    n = np.int64(faces.max()) + 1
    keys = _edge_keys(faces, n)
    order = np.argsort(keys, kind='stable')
    same = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    twins = np.full(len(keys), -1, dtype=np.int64)
    twins[order[same]] = order[same + 1]
    twins[order[same + 1]] = order[same]
    return twins


def _edge_keys(faces: IndexArray, n: int | np.int64) -> IntArray:
    start, end = _origins(faces).astype(np.int64), _ends(faces).astype(np.int64)
    return np.minimum(start, end) * np.int64(n) + np.maximum(start, end)


def _origins(faces: IndexArray) -> IndexArray:
    return faces.reshape(-1)


def _ends(faces: IndexArray) -> IndexArray:
    return np.roll(faces, -1, axis=1).reshape(-1)


def _no_indices() -> IndexArray:
    return np.empty(0, dtype=np.int32)


def _frozen(array: npt.NDArray) -> npt.NDArray:
    array.setflags(write=False)
    return array
