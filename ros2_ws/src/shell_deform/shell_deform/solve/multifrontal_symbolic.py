"""Analysis of a vertex graph for the multifrontal factorisation: fronts, once per mesh.

A front owns the vertices that it eliminates; its rows are these and, behind them, the later
vertices they couple to. Vertices are renumbered so that each front owns a range and children come
before parents.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.compiled import compiled


@dataclass(frozen=True)
class Fronts:
    """The elimination forest of an n-vertex graph.

    `order` (n,): new position -> vertex. Front f owns positions owned[f]:owned[f + 1] and has the
    rows rows[row_offsets[f]:row_offsets[f + 1]] (positions, ascending, owned ones first); its
    parent is parent[f] (-1 at a root), `parity` its depth modulo two.
    `targets` (nonzeros,): for each graph entry (vertex, neighbour), in the order of the pattern,
    the neighbour's row in the front that owns the vertex, or -1 when the neighbour is eliminated
    earlier. `runs` (r, 3): (row in the child's border, row in the parent, length) of the maximal
    stretches that map a front's border into its parent, run_offsets (f + 1,). A run never crosses
    the end of the parent's owned rows.
    """

    order: NDArray[np.int32]
    owned: NDArray[np.int32]
    row_offsets: NDArray[np.int64]
    rows: NDArray[np.int32]
    parent: NDArray[np.int32]
    parity: NDArray[np.int8]
    targets: NDArray[np.int32]
    run_offsets: NDArray[np.int64]
    runs: NDArray[np.int32]

    @property
    def count(self) -> int:
        """Number of fronts."""
        return len(self.parent)

    def stored_entries(self, block: int) -> int:
        """Doubles in the factor when every vertex has `block` unknowns."""
        width = block * np.diff(self.owned).astype(np.int64)
        height = block * np.diff(self.row_offsets)
        return int(np.sum(width * height))

    def stack_entries(self, block: int) -> int:
        """Doubles that waiting Schur complements and the open front need at most."""
        heights = (block * np.diff(self.row_offsets)).astype(np.int64)
        borders = heights - block * np.diff(self.owned).astype(np.int64)
        return int(_peak(self.parent, heights, borders))

    def operations(self, block: int) -> float:
        """Floating-point operations of a definite factorisation (multiply and add count two)."""
        width = block * np.diff(self.owned).astype(float)
        height = block * np.diff(self.row_offsets).astype(float)
        border = height - width
        return float(np.sum(width**3 / 3 + width**2 * border + width * border**2))


def find_fronts(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], order: NDArray[np.int32], block: int
) -> Fronts:
    """Fronts of the symmetric graph (`indptr`, `indices`) eliminated in `order` (n,).

    `block` unknowns per vertex weigh the merging of small fronts.
    Source: J. W. H. Liu (1990), doi:10.1137/0611010 (elimination trees); C. Ashcraft and R. Grimes
    (1989), doi:10.1145/76909.76910 (relaxed supernodes).
    """
    parent, heights, order = _elimination_forest(indptr, indices, order)
    members, front_parent = _merge_fronts(parent, heights, float(block))
    order, owned, tree = _renumber(members, front_parent, order)
    row_offsets, rows = _front_rows(indptr, indices, order, owned, tree)
    targets, run_offsets, runs = _maps(indptr, indices, order, owned, tree, row_offsets, rows)
    parity = np.zeros(len(tree), np.int8)
    _fill_parity(tree, parity)
    return Fronts(order, owned, row_offsets, rows, tree, parity, targets, run_offsets, runs)


@compiled
def _peak(parent: Any, heights: Any, borders: Any) -> int:
    """Largest sum of waiting complements and one whole front."""
    freed = np.zeros(len(parent), np.int64)
    waiting, peak = 0, 0
    for f in range(len(parent)):
        peak = max(peak, waiting + heights[f] * heights[f])
        waiting += borders[f] * borders[f] - freed[f]
        if parent[f] >= 0:
            freed[parent[f]] += borders[f] * borders[f]
    return peak


@compiled
def _fill_parity(parent: Any, parity: Any) -> None:
    """Depth of each front modulo two."""
    for f in range(len(parent) - 1, -1, -1):
        parity[f] = 0 if parent[f] < 0 else 1 - parity[parent[f]]


@compiled
def _postorder(parent: Any) -> Any:
    """Nodes of a forest, children before parents and siblings in their order."""
    count = len(parent)
    first = np.full(count, -1, np.int32)
    following = np.full(count, -1, np.int32)
    roots = -1
    for v in range(count - 1, -1, -1):
        if parent[v] < 0:
            following[v] = roots
            roots = v
        else:
            following[v] = first[parent[v]]
            first[parent[v]] = v
    result = np.empty(count, np.int32)
    filled = 0
    stack = np.empty(count, np.int32)
    root = roots
    while root >= 0:
        stack[0] = root
        depth = 1
        while depth > 0:
            v = stack[depth - 1]
            if first[v] >= 0:
                stack[depth] = first[v]
                depth += 1
                first[v] = -1
            else:
                depth -= 1
                result[filled] = v
                filled += 1
                if depth > 0 and following[v] >= 0:
                    stack[depth] = following[v]
                    depth += 1
        root = following[root]
    return result


@compiled
def _elimination_forest(indptr: Any, indices: Any, order: Any) -> Any:
    """Postordered elimination forest: parent (n,), column heights (n,) and the new order (n,)."""
    count = len(order)
    position = np.empty(count, np.int32)
    for k in range(count):
        position[order[k]] = k
    parent = np.full(count, -1, np.int32)
    ancestor = np.full(count, -1, np.int32)
    for k in range(count):
        v = order[k]
        for q in range(indptr[v], indptr[v + 1]):
            i = position[indices[q]]
            while i >= 0 and i < k:
                above = ancestor[i]
                ancestor[i] = k
                if above < 0:
                    parent[i] = k
                    break
                i = above
    post = _postorder(parent)
    place = np.empty(count, np.int32)
    for k in range(count):
        place[post[k]] = k
    new_order = np.empty(count, np.int32)
    new_parent = np.full(count, -1, np.int32)
    for k in range(count):
        new_order[k] = order[post[k]]
        if parent[post[k]] >= 0:
            new_parent[k] = place[parent[post[k]]]
    for k in range(count):
        position[new_order[k]] = k
    # Row k of the factor is the part of the forest between k's neighbours and k.
    heights = np.ones(count, np.int32)
    seen = np.full(count, -1, np.int32)
    for k in range(count):
        seen[k] = k
        v = new_order[k]
        for q in range(indptr[v], indptr[v + 1]):
            i = position[indices[q]]
            while i < k and seen[i] != k:
                heights[i] += 1
                seen[i] = k
                i = new_parent[i]
    return new_parent, heights, new_order


@compiled
def _merge_fronts(parent: Any, heights: Any, block: float) -> Any:
    """Front of each column (n,) and the parent of each front: equal columns first, then greedily.

    A child joins its parent when the zeros this stores cost less than another front would.
    """
    count = len(parent)
    front = np.empty(count, np.int32)
    fronts = 0
    for k in range(count):
        if k > 0 and parent[k - 1] == k and heights[k - 1] == heights[k] + 1:
            front[k] = fronts - 1
        else:
            front[k] = fronts
            fronts += 1
    width = np.zeros(fronts)
    height = np.zeros(fronts)
    above = np.full(fronts, -1, np.int32)
    for k in range(count):
        f = front[k]
        if width[f] == 0:
            height[f] = heights[k]
        width[f] += 1
        above[f] = front[parent[k]] if parent[k] >= 0 else -1
    zeros = np.zeros(fronts)
    merged_into = np.arange(fronts).astype(np.int32)
    for f in range(fronts):
        p = above[f]
        if p < 0:
            continue
        joint = width[f] + width[p]
        tall = width[f] + height[p]
        added = zeros[f] + zeros[p] + width[f] * (tall - height[f])
        total = joint * tall - 0.5 * joint * joint
        columns = joint * block
        share = added / total
        if (
            added == 0
            or columns <= 24
            or (columns <= 48 and share < 0.4)
            or (columns <= 96 and share < 0.15)
            or share < 0.05
        ):
            merged_into[f] = p
            width[p] = joint
            height[p] = tall
            zeros[p] = added
    for f in range(fronts - 1, -1, -1):
        merged_into[f] = merged_into[merged_into[f]]
    members = np.empty(count, np.int32)
    for k in range(count):
        members[k] = merged_into[front[k]]
    tree = np.full(fronts, -2, np.int32)
    for f in range(fronts):
        if merged_into[f] == f:
            tree[f] = merged_into[above[f]] if above[f] >= 0 else -1
    return members, tree


@compiled
def _renumber(members: Any, tree: Any, order: Any) -> Any:
    """Order with the columns of each front together; first columns (f + 1,) and parents (f,)."""
    name = np.full(len(tree), -1, np.int32)
    kept = 0
    for f in range(len(tree)):
        if tree[f] != -2:
            name[f] = kept
            kept += 1
    small = np.empty(kept, np.int32)
    for f in range(len(tree)):
        if tree[f] != -2:
            small[name[f]] = -1 if tree[f] < 0 else name[tree[f]]
    post = _postorder(small)
    place = np.empty(kept, np.int32)
    for k in range(kept):
        place[post[k]] = k
    parent = np.empty(kept, np.int32)
    for k in range(kept):
        parent[k] = -1 if small[post[k]] < 0 else place[small[post[k]]]
    owned = np.zeros(kept + 1, np.int32)
    for k in range(len(order)):
        owned[place[name[members[k]]] + 1] += 1
    for f in range(kept):
        owned[f + 1] += owned[f]
    fill = owned.copy()
    result = np.empty_like(order)
    for k in range(len(order)):
        f = place[name[members[k]]]
        result[fill[f]] = order[k]
        fill[f] += 1
    return result, owned, parent


@compiled
def _front_rows(indptr: Any, indices: Any, order: Any, owned: Any, parent: Any) -> Any:
    """Rows of every front, ascending: offsets (f + 1,) and positions."""
    count, fronts = len(order), len(parent)
    position = np.empty(count, np.int32)
    for k in range(count):
        position[order[k]] = k
    first = np.full(fronts, -1, np.int32)
    following = np.full(fronts, -1, np.int32)
    offsets = np.zeros(fronts + 1, np.int64)
    rows = np.empty(16 * count + 64, np.int32)
    seen = np.full(count, -1, np.int32)
    border = np.empty(count, np.int32)
    for f in range(fronts):
        low, high = owned[f], owned[f + 1]
        size = 0
        for k in range(low, high):
            v = order[k]
            for q in range(indptr[v], indptr[v + 1]):
                i = position[indices[q]]
                if i >= high and seen[i] != f:
                    seen[i] = f
                    border[size] = i
                    size += 1
        child = first[f]
        while child >= 0:
            start = offsets[child] + owned[child + 1] - owned[child]
            for r in range(start, offsets[child + 1]):
                i = rows[r]
                if i >= high and seen[i] != f:
                    seen[i] = f
                    border[size] = i
                    size += 1
            child = following[child]
        at = offsets[f]
        needed = at + (high - low) + size
        if needed > len(rows):
            larger = np.empty(2 * needed, np.int32)
            larger[:at] = rows[:at]
            rows = larger
        for k in range(low, high):
            rows[at + k - low] = k
        rows[at + high - low : needed] = np.sort(border[:size])
        offsets[f + 1] = needed
        p = parent[f]
        if p >= 0:
            following[f] = first[p]
            first[p] = f
    return offsets, rows[: offsets[fronts]].copy()


@compiled
def _maps(
    indptr: Any, indices: Any, order: Any, owned: Any, parent: Any, offsets: Any, rows: Any
) -> Any:
    """Where graph entries and borders of children land: targets, run offsets (f + 1,), runs."""
    count, fronts = len(order), len(parent)
    position = np.empty(count, np.int32)
    for k in range(count):
        position[order[k]] = k
    local = np.full(count, -1, np.int32)
    targets = np.full(len(indices), -1, np.int32)
    run_offsets = np.zeros(fronts + 1, np.int64)
    for f in range(fronts):
        run_offsets[f + 1] = offsets[f + 1] - offsets[f] - (owned[f + 1] - owned[f])
    # Borders bound the number of runs; the runs themselves are packed at the end.
    room = np.zeros(fronts + 1, np.int64)
    for f in range(fronts):
        room[f + 1] = room[f] + run_offsets[f + 1]
    spread = np.empty((room[fronts], 3), np.int32)
    used = np.zeros(fronts, np.int64)
    first = np.full(fronts, -1, np.int32)
    following = np.full(fronts, -1, np.int32)
    for f in range(fronts):
        for r in range(offsets[f], offsets[f + 1]):
            local[rows[r]] = r - offsets[f]
        for k in range(owned[f], owned[f + 1]):
            v = order[k]
            for q in range(indptr[v], indptr[v + 1]):
                i = position[indices[q]]
                if i >= owned[f]:
                    targets[q] = local[i]
        own = owned[f + 1] - owned[f]
        child = first[f]
        while child >= 0:
            start = offsets[child] + owned[child + 1] - owned[child]
            at = room[child]
            previous = -2
            for r in range(start, offsets[child + 1]):
                here = local[rows[r]]
                if here == previous + 1 and here != own:
                    spread[at - 1, 2] += 1
                else:
                    spread[at, 0] = r - start
                    spread[at, 1] = here
                    spread[at, 2] = 1
                    at += 1
                previous = here
            used[child] = at - room[child]
            child = following[child]
        p = parent[f]
        if p >= 0:
            following[f] = first[p]
            first[p] = f
    for f in range(fronts):
        run_offsets[f + 1] = run_offsets[f] + used[f]
    runs = np.empty((run_offsets[fronts], 3), np.int32)
    for f in range(fronts):
        for r in range(used[f]):
            for c in range(3):
                runs[run_offsets[f] + r, c] = spread[room[f] + r, c]
    return targets, run_offsets, runs
