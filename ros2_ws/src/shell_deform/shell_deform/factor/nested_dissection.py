# SPDX-License-Identifier: Apache-2.0
"""Nested dissection: an elimination order that keeps the factor of a mesh matrix thin.

A set of vertices is cut in two by planes through its median in several directions; the smallest
separator among them, each as small as the cut's edges allow, is eliminated last. Without
coordinates, distances in the graph from a few far-apart landmarks serve as coordinates.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components, dijkstra

from shell_deform.compiled.kernel_arrays import (
    floats,
    integer_rows,
    integers,
    longs,
    small_integers,
)
from shell_deform.compiled.kernel_types import (
    Bytes,
    FixedFloatRows,
    Float,
    FloatRows,
    Floats,
    Int,
    Ints,
    Void,
    kernel,
)

LANDMARKS = 4
LEAF_VERTICES = 24
# Irrational tilts break the ties of regular lattices and of integer graph distances.
TILT = 1e-3


def nested_dissection(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    coordinates: NDArray[np.float64] | None = None,
    leaf_vertices: int = LEAF_VERTICES,
) -> NDArray[np.int32]:
    """Elimination order (n,): position k is vertex order[k].

    `indptr` (n + 1,) and `indices` describe a symmetric graph (self loops allowed), `coordinates`
    (n, d) place its vertices [m].
    Source: A. George (1973), doi:10.1137/0710032; Koenig's theorem for the vertex cover.
    """
    count = len(indptr) - 1
    order = np.arange(count, dtype=np.int32)
    if count <= leaf_vertices:
        return order
    if coordinates is None:
        coordinates = _graph_coordinates(indptr, indices, LANDMARKS)
    points = np.ascontiguousarray(coordinates, dtype=np.float64).reshape(count, -1)
    _dissect(indptr, indices, points, _directions(points.shape[1]), order, leaf_vertices)
    return order


def _directions(dimension: int) -> NDArray[np.float64]:
    """Candidate normals (c, dimension): axes and, in the plane and space, their diagonals."""
    axes = np.eye(dimension)
    if dimension <= 3:
        grid = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * dimension)).reshape(dimension, -1).T
        axes = grid[len(grid) // 2 + 1 :]
        axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    tilt = TILT * np.sqrt(np.arange(2.0, 2.0 + dimension))
    return np.ascontiguousarray(axes + tilt)


def _graph_coordinates(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], landmarks: int
) -> NDArray[np.float64]:
    """Graph distances (n, landmarks + 1) from far-apart landmarks; components lie far apart."""
    count = len(indptr) - 1
    graph = sp.csr_matrix((np.ones(len(indices)), indices, indptr), shape=(count, count))
    component = connected_components(graph, directed=False)[1]
    seeds = np.unique(component, return_index=True)[1]

    def distance(sources: NDArray[np.intp]) -> NDArray[np.float64]:
        """Edges to the source in the same component."""
        return np.asarray(dijkstra(graph, indices=sources, unweighted=True, min_only=True))

    def farthest(distances: NDArray[np.float64]) -> NDArray[np.intp]:
        """The vertex of each component with the largest distance."""
        order = np.lexsort((distances, component))
        return order[np.append(np.flatnonzero(np.diff(component[order])), count - 1)]

    result = np.empty((count, landmarks + 1))
    nearest = np.full(count, np.inf)
    sources = farthest(distance(seeds))
    for landmark in range(landmarks):
        result[:, landmark] = distance(sources)
        nearest = np.minimum(nearest, result[:, landmark])
        sources = farthest(nearest)
    result[:, landmarks] = 2.0 * count * component
    return result


@kernel(Int, Ints, Ints, Bytes, Ints, Int, Int, Ints, Ints, Ints, Ints)
def _minimum_cover(
    indptr: Any,
    indices: Any,
    side: Any,
    order: Any,
    low: int,
    high: int,
    partner: Any,
    seen: Any,
    stack: Any,
    cursor: Any,
) -> int:
    """Mark with side 2 the fewest vertices of order[low:high] that touch every cut edge.

    Matching by augmenting paths from side 0, then Koenig's cover: vertices of side 0 not reached,
    and of side 1 reached, by alternating paths from the unmatched vertices of side 0.
    """
    for k in range(low, high):
        partner[order[k]] = -1
        seen[order[k]] = -1
    for k in range(low, high):
        v = order[k]
        if side[v] == 0:
            for q in range(indptr[v], indptr[v + 1]):
                w = indices[q]
                if side[w] == 1 and partner[w] < 0:
                    partner[w] = v
                    partner[v] = w
                    break
    for k in range(low, high + 1):
        # The last round marks what all unmatched vertices reach together.
        if k == high:
            depth = 0
            for j in range(low, high):
                seen[order[j]] = -1
        root_low, root_high = (k, k + 1) if k < high else (low, high)
        for j in range(root_low, root_high):
            root = order[j]
            if side[root] != 0 or partner[root] >= 0:
                continue
            stack[0] = root
            cursor[0] = indptr[root]
            seen[root] = k
            depth = 1
            while depth > 0:
                v = stack[depth - 1]
                descended = False
                q = cursor[depth - 1]
                while q < indptr[v + 1]:
                    w = indices[q]
                    q += 1
                    if side[w] != 1 or seen[w] == k:
                        continue
                    seen[w] = k
                    if partner[w] < 0:
                        # Augment along the stack: each vertex takes the one it last looked at.
                        cursor[depth - 1] = q
                        for level in range(depth):
                            u = stack[level]
                            w = indices[cursor[level] - 1]
                            partner[w] = u
                            partner[u] = w
                        depth = 0
                        descended = True
                        break
                    cursor[depth - 1] = q
                    stack[depth] = partner[w]
                    seen[partner[w]] = k
                    cursor[depth] = indptr[partner[w]]
                    depth += 1
                    descended = True
                    break
                if not descended:
                    depth -= 1
    cover = 0
    for k in range(low, high):
        v = order[k]
        if (
            side[v] == 0
            and partner[v] >= 0
            and seen[v] != high
            or side[v] == 1
            and seen[v] == high
        ):
            stack[cover] = v
            cover += 1
    for k in range(cover):
        side[stack[k]] = 2
    return cover


@kernel(Float, Floats, Int, Floats)
def _median(values: Any, count: int, scratch: Any) -> float:
    """The (count // 2)-th smallest of values[:count] (Hoare's selection)."""
    for k in range(count):
        scratch[k] = values[k]
    low, high, wanted = 0, count - 1, count // 2
    while low < high:
        pivot = scratch[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while scratch[i] < pivot:
                i += 1
            while scratch[j] > pivot:
                j -= 1
            if i <= j:
                scratch[i], scratch[j] = scratch[j], scratch[i]
                i += 1
                j -= 1
        if wanted <= j:
            high = j
        elif wanted >= i:
            low = i
        else:
            break
    return float(scratch[wanted])


@kernel(Void, Ints, Ints, FixedFloatRows, FloatRows, Ints, Int, called_from_python=True)
def _dissect(
    indptr: Any, indices: Any, points: Any, directions: Any, order: Any, leaf: int
) -> None:
    """Reorder `order` in place: halves first, their separator last, recursively."""
    count = len(order)
    dimension = points.shape[1]
    candidates = len(directions)
    side = small_integers(count, -1)
    partner = integers(count, 0)
    seen = integers(count, 0)
    stack = integers(count + 1, 0)
    cursor = integers(count + 1, 0)
    values = floats(count, 0.0)
    best = small_integers(count, 0)
    scratch = floats(count, 0.0)
    sizes = longs(3, 0)
    # Ranges of `order` still to be cut; each cut halves one, so few wait at a time.
    ranges = integer_rows(count + 2, 2)
    ranges[0, 0], ranges[0, 1] = 0, count
    waiting = 1
    while waiting > 0:
        waiting -= 1
        low, high = ranges[waiting, 0], ranges[waiting, 1]
        size = high - low
        if size <= leaf:
            continue
        smallest = size + 1
        for c in range(candidates):
            for k in range(size):
                value = 0.0
                for i in range(dimension):
                    value += directions[c, i] * points[order[low + k], i]
                values[k] = value
            level = _median(values, size, scratch)
            for k in range(size):
                side[order[low + k]] = 0 if values[k] < level else 1
            cover = _minimum_cover(
                indptr, indices, side, order, low, high, partner, seen, stack, cursor
            )
            if cover < smallest:
                smallest = cover
                for k in range(size):
                    best[k] = side[order[low + k]]
        for k in range(size):
            side[order[low + k]] = best[k]
        filled = 0
        sizes[:] = 0
        for part in range(3):
            for k in range(low, high):
                if side[order[k]] == part:
                    stack[filled] = order[k]
                    filled += 1
                    sizes[part] += 1
        for k in range(size):
            order[low + k] = stack[k]
            side[stack[k]] = -1
        if sizes[0] == size or sizes[1] == size:
            continue
        middle = low + sizes[0]
        ranges[waiting, 0], ranges[waiting, 1] = low, middle
        ranges[waiting + 1, 0], ranges[waiting + 1, 1] = middle, middle + sizes[1]
        waiting += 2
