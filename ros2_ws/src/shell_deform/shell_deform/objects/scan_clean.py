# SPDX-License-Identifier: Apache-2.0
"""From the triangles of a scanner to one clean, oriented, manifold piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .shell_object import ObjectError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class CleanScan:
    """One oriented manifold piece of a scan.

    Attributes:
        vertices: (n, 3) [m].
        triangles: (m, 3), outward.
        report: what was found and done, by name.
    """

    vertices: FloatArray
    triangles: IntArray
    report: dict[str, int]


def clean_scan(vertices: FloatArray, triangles: IntArray, *, split_fans: bool = True) -> CleanScan:
    """Keep the largest piece of a scan and make it manifold and outward.

    Triangles that are degenerate, doubled or hang as a third one on an edge are dropped; vertices
    at which several fans meet are split; of several pieces the one with the largest area is kept.
    `split_fans` may be left out for a first pass over a large scan.
    The outside of a closed piece is where its volume is positive; an open piece keeps the side
    that most of its triangles show.

    Raises:
        ObjectError: nothing is left, a vertex is not finite, or the piece has one side only.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(triangles, dtype=np.int64)
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        raise ObjectError(f'vertex {bad} of the scan is not finite: {vertices[bad]}')
    report = {'triangles_read': len(triangles)}
    triangles = _sound(vertices, triangles)
    triangles, first, second = _paired(vertices, triangles)
    report['triangles_dropped'] = report['triangles_read'] - len(triangles)
    if len(triangles) == 0:
        raise ObjectError('the scan has no triangle with an area')
    pieces, label = _components(len(triangles), first // 3, second // 3)
    report['pieces'] = pieces
    if pieces > 1:
        kept = label == np.argmax(np.bincount(label, _areas(vertices, triangles)))
        triangles, first, second = _subset(triangles, first, second, kept)
    triangles, turned = _oriented(vertices, triangles, first, second)
    report['triangles_turned'] = turned
    if split_fans:
        vertices, triangles, report['vertices_split'] = _split_fans(vertices, triangles)
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    report['triangles_kept'] = len(triangles)
    return CleanScan(vertices[used], (np.cumsum(used) - 1)[triangles], report)


def boundary_loops(triangles: IntArray) -> list[IntArray]:
    """Boundary loops of an oriented manifold mesh, the surface on their left."""
    start, end, _ = _half_edges(triangles)
    n = int(triangles.max()) + 1
    alone = ~np.isin(start * n + end, end * n + start)
    following = dict(zip(start[alone].tolist(), end[alone].tolist(), strict=True))
    loops = []
    while following:
        first, vertex = following.popitem()
        loop = [first]
        while vertex != first:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def filled(
    vertices: FloatArray, triangles: IntArray, longest_rim: float
) -> tuple[FloatArray, IntArray, int]:
    """Close holes whose rim is not longer than `longest_rim` [m] by a fan around their middle.

    Returns:
        Vertices, triangles and the number of holes closed.
    """
    points, faces, closed = [vertices], [triangles], 0
    for loop in boundary_loops(triangles):
        rim = vertices[loop]
        if np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).sum() > longest_rim:
            continue
        middle = len(vertices) + closed
        points.append(rim.mean(axis=0, keepdims=True))
        faces.append(np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), middle)]))
        closed += 1
    return np.concatenate(points), np.concatenate(faces), closed


def _half_edges(triangles: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    start = triangles.reshape(-1)
    end = np.roll(triangles, -1, axis=1).reshape(-1)
    n = int(triangles.max()) + 1
    return start, end, np.minimum(start, end) * n + np.maximum(start, end)


def _areas(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _sound(vertices: FloatArray, triangles: IntArray) -> IntArray:
    """Triangles with three corners and an area, each once."""
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    if len(triangles) == 0:
        return triangles
    sides = vertices[np.roll(triangles, -1, axis=1)] - vertices[triangles]
    longest = (sides**2).sum(axis=2).max(axis=1)
    triangles = triangles[_areas(vertices, triangles) > 1e-9 * longest]
    low, middle, high = np.sort(triangles, axis=1).T
    order = np.lexsort((high, middle, low))
    again = np.zeros(len(triangles), dtype=bool)
    again[order[1:]] = (
        (low[order[1:]] == low[order[:-1]])
        & (middle[order[1:]] == middle[order[:-1]])
        & (high[order[1:]] == high[order[:-1]])
    )
    return triangles[~again]


def _paired(vertices: FloatArray, triangles: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Drop third triangles at an edge; and the half-edges that then pair up.

    The triangle that hangs with the most sides on nothing goes first, then the largest.
    """
    while len(triangles):
        key = _half_edges(triangles)[2]
        order = np.argsort(key)
        ordered = key[order]
        same = ordered[1:] == ordered[:-1]
        third = same[1:] & same[:-1]
        if not third.any():
            where = np.flatnonzero(same)
            return triangles, order[where], order[where + 1]
        partnered = np.zeros(len(key), dtype=bool)
        partnered[order[1:][same]] = partnered[order[:-1][same]] = True
        loose = 3 - partnered.reshape(-1, 3).sum(axis=1)
        owner = np.arange(len(key)) // 3
        order = np.lexsort((_areas(vertices, triangles)[owner], loose[owner], key))
        keep = np.ones(len(triangles), dtype=bool)
        keep[order[2:][third] // 3] = False
        triangles = triangles[keep]
    return triangles, triangles.reshape(-1), triangles.reshape(-1)


def _subset(
    triangles: IntArray, first: IntArray, second: IntArray, kept: npt.NDArray[np.bool_]
) -> tuple[IntArray, IntArray, IntArray]:
    """Some of the triangles, with the pairs of half-edges among them renumbered."""
    number = np.cumsum(kept) - 1
    both = kept[first // 3] & kept[second // 3]
    first, second = first[both], second[both]
    return (
        triangles[kept],
        3 * number[first // 3] + first % 3,
        3 * number[second // 3] + second % 3,
    )


def _components(count: int, first: IntArray, second: IntArray) -> tuple[int, IntArray]:
    graph = coo_matrix((np.ones(len(first), dtype=bool), (first, second)), (count, count))
    pieces, label = connected_components(graph, directed=False)
    return int(pieces), label


def _oriented(
    vertices: FloatArray, triangles: IntArray, first: IntArray, second: IntArray
) -> tuple[IntArray, int]:
    """Turn triangles so that all agree, outside out; and how many were turned."""
    m = len(triangles)
    start = _half_edges(triangles)[0]
    alike = start[first] != start[second]
    a, b = first // 3, second // 3
    # Node t stands for triangle t as it is, node t + m for it turned over.
    one = np.concatenate([a, a + m])
    other = np.concatenate([np.where(alike, b, b + m), np.where(alike, b + m, b)])
    _, label = _components(2 * m, one, other)
    if label[0] == label[m]:
        raise ObjectError('the scan has one side only, like a Moebius strip; it has no outside')
    turned = label[:m] != label[0]
    flipped = np.where(turned[:, None], triangles[:, ::-1], triangles)
    area = _areas(vertices, triangles)
    is_closed = 2 * len(first) == 3 * m
    if is_closed:
        corners = vertices[flipped]
        volume = np.einsum('ti,ti->', corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        over = volume < 0.0
    else:
        over = area[turned].sum() > 0.5 * area.sum()
    if over:
        flipped, turned = flipped[:, ::-1], ~turned
    return np.ascontiguousarray(flipped), int(turned.sum())


def _split_fans(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray, int]:
    """Give every fan of triangles its own vertex."""
    _, first, second = _paired(vertices, triangles)
    corner = np.arange(3 * len(triangles))
    following = corner - corner % 3 + (corner + 1) % 3
    # In an oriented mesh the start of one half-edge is the end of the other.
    one = np.concatenate([first, following[first]])
    other = np.concatenate([following[second], second])
    _, label = _components(len(corner), one, other)
    flat = triangles.reshape(-1)
    fans, where = np.unique(label, return_index=True)
    owner = flat[where]
    _, first_fan = np.unique(owner, return_index=True)
    number = np.empty(len(fans), dtype=np.int64)
    extra = np.setdiff1d(np.arange(len(fans)), first_fan)
    number[first_fan] = owner[first_fan]
    number[extra] = len(vertices) + np.arange(len(extra))
    grown = np.concatenate([vertices, vertices[owner[extra]]])
    return grown, number[label].reshape(-1, 3), len(extra)
