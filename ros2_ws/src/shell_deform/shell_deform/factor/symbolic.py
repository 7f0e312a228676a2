# SPDX-License-Identifier: Apache-2.0
"""Analysis of a vertex graph for the multifrontal factorisation: fronts, once per mesh.

A front owns the vertices that it eliminates; its rows are these and, behind them, the later
vertices they couple to. Vertices are renumbered so that each front owns a range and children come
before parents.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from shell_deform.compiled.kernel_arrays import integer_rows, integers, longs, small_integers
from shell_deform.compiled.kernel_types import Bytes, Int, IntRows, Ints, Longs, Void, kernel
from shell_deform.factor.forest import elimination_forest, merge_fronts, renumber
from shell_deform.factor.front_types import Tree

WORTH_TWO_THREADS = 2e6
"""Operations of a factorisation from which two threads gain more than they cost."""

Spans = tuple[tuple[int, int], ...]
"""First and last fronts, the last excluded."""


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
    the end of the parent's owned rows. `first_child`, `next_child` (f,) chain the children, -1
    ends them.
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
    first_child: NDArray[np.int32]
    next_child: NDArray[np.int32]

    @property
    def tree(self) -> Tree:
        """What the numeric kernels read."""
        return Tree(*(getattr(self, name) for name in Tree._fields))

    @property
    def count(self) -> int:
        """Number of fronts."""
        return len(self.parent)

    @cached_property
    def spans(self) -> Spans:
        """Fronts that are eliminated together, one after the other: two that need nothing of each
        other, then what is above both; or all in one.
        """
        work = self._work(3)
        if work.sum() < WORTH_TWO_THREADS:
            return ((0, self.count),)
        before = np.concatenate([[0.0], np.cumsum(work)])
        best = 0.9 * before[-1]
        result: Spans = ((0, self.count),)
        roots: list[tuple[int, int]] = []
        for f in range(self.count):
            # Subtrees that wait when front f was eliminated: those of its children are its own.
            first = f
            while roots and self.parent[roots[-1][1]] == f:
                first = roots.pop()[0]
            roots.append((first, f))
            starts = [start for start, _ in roots[1:]]
            for middle in starts:
                both = max(before[middle], before[f + 1] - before[middle])
                needed = both + before[-1] - before[f + 1]
                if needed < best:
                    best = needed
                    result = ((0, middle), (middle, f + 1), (f + 1, self.count))
        return result

    def stored_entries(self, block: int, span: tuple[int, int] | None = None) -> int:
        """Doubles in the factor when every vertex has `block` unknowns."""
        first, last = span or (0, self.count)
        width = block * np.diff(self.owned).astype(np.int64)
        height = block * np.diff(self.row_offsets)
        return int(np.sum((width * height)[first:last]))

    def stack_entries(self, block: int, span: tuple[int, int] | None = None) -> int:
        """Doubles that waiting Schur complements and the open front need at most."""
        heights = (block * np.diff(self.row_offsets)).astype(np.int64)
        borders = heights - block * np.diff(self.owned).astype(np.int64)
        return int(_peak(self.parent, heights, borders, *(span or (0, self.count))))

    def operations(self, block: int) -> float:
        """Floating-point operations of a definite factorisation (multiply and add count two)."""
        return float(self._work(block).sum())

    def _work(self, block: int) -> NDArray[np.float64]:
        """(f,) floating-point operations of each front."""
        width = block * np.diff(self.owned).astype(float)
        border = block * np.diff(self.row_offsets).astype(float) - width
        return np.asarray(width**3 / 3 + width**2 * border + width * border**2)


def find_fronts(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], order: NDArray[np.int32], block: int
) -> Fronts:
    """Fronts of the symmetric graph (`indptr`, `indices`) eliminated in `order` (n,).

    `block` unknowns per vertex weigh the merging of small fronts.
    """
    parent, heights, order = elimination_forest(indptr, indices, order)
    members, front_parent = merge_fronts(parent, heights, float(block))
    order, owned, tree = renumber(members, front_parent, order)
    row_offsets, rows = _front_rows(indptr, indices, order, owned, tree)
    targets, run_offsets, runs = _maps(indptr, indices, order, owned, tree, row_offsets, rows)
    parity, first_child, next_child = _family(tree)
    return Fronts(
        order,
        owned,
        row_offsets,
        rows,
        tree,
        parity,
        targets,
        run_offsets,
        runs,
        first_child,
        next_child,
    )


@kernel(Int, Ints, Longs, Longs, Int, Int, called_from_python=True)
def _peak(parent: Any, heights: Any, borders: Any, first: int, last: int) -> int:
    """Largest sum of waiting complements and one whole front, of fronts `first` up to `last`."""
    freed = longs(len(parent), 0)
    waiting, peak = 0, 0
    for f in range(first):
        if first <= parent[f] < last:
            waiting += borders[f] * borders[f]
            freed[parent[f]] += borders[f] * borders[f]
    for f in range(first, last):
        peak = max(peak, waiting + heights[f] * heights[f])
        waiting += borders[f] * borders[f] - freed[f]
        if parent[f] >= 0:
            freed[parent[f]] += borders[f] * borders[f]
    return peak


@kernel(types.Tuple((Bytes, Ints, Ints)), Ints, called_from_python=True)
def _family(parent: Any) -> Any:
    """Depth of each front modulo two, first child and next sibling (-1: none)."""
    parity = small_integers(len(parent), 0)
    first_child = integers(len(parent), -1)
    next_child = integers(len(parent), -1)
    for f in range(len(parent) - 1, -1, -1):
        if parent[f] >= 0:
            parity[f] = 1 - parity[parent[f]]
            next_child[f] = first_child[parent[f]]
            first_child[parent[f]] = f
    return parity, first_child, next_child


@kernel(Void, Ints, Int)
def _sort(values: Any, count: int) -> None:
    """Sort values[:count] in place (shell sort, gaps of M. Ciura 2001)."""
    for gap in (1750, 701, 301, 132, 57, 23, 10, 4, 1):
        for i in range(gap, count):
            value = values[i]
            j = i
            while j >= gap and values[j - gap] > value:
                values[j] = values[j - gap]
                j -= gap
            values[j] = value


@kernel(types.Tuple((Longs, Ints)), Ints, Ints, Ints, Ints, Ints, called_from_python=True)
def _front_rows(indptr: Any, indices: Any, order: Any, owned: Any, parent: Any) -> Any:
    """Rows of every front, ascending: offsets (f + 1,) and positions."""
    count, fronts = len(order), len(parent)
    position = integers(count, 0)
    for k in range(count):
        position[order[k]] = k
    first = integers(fronts, -1)
    following = integers(fronts, -1)
    offsets = longs(fronts + 1, 0)
    rows = integers(16 * count + 64, 0)
    seen = integers(count, -1)
    border = integers(count, 0)
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
            larger = integers(2 * needed, 0)
            for r in range(at):
                larger[r] = rows[r]
            rows = larger
        for k in range(low, high):
            rows[at + k - low] = k
        _sort(border, size)
        for r in range(size):
            rows[at + high - low + r] = border[r]
        offsets[f + 1] = needed
        p = parent[f]
        if p >= 0:
            following[f] = first[p]
            first[p] = f
    return offsets, rows[: offsets[fronts]].copy()


@kernel(
    types.Tuple((Ints, Longs, IntRows)), Ints, Ints, Ints, Ints, Ints, Longs, Ints,
    called_from_python=True,
)  # fmt: skip
def _maps(
    indptr: Any, indices: Any, order: Any, owned: Any, parent: Any, offsets: Any, rows: Any
) -> Any:
    """Where graph entries and borders of children land: targets, run offsets (f + 1,), runs."""
    count, fronts = len(order), len(parent)
    position = integers(count, 0)
    for k in range(count):
        position[order[k]] = k
    local = integers(count, -1)
    targets = integers(len(indices), -1)
    run_offsets = longs(fronts + 1, 0)
    for f in range(fronts):
        run_offsets[f + 1] = offsets[f + 1] - offsets[f] - (owned[f + 1] - owned[f])
    # Borders bound the number of runs; the runs themselves are packed at the end.
    room = longs(fronts + 1, 0)
    for f in range(fronts):
        room[f + 1] = room[f] + run_offsets[f + 1]
    spread = integer_rows(room[fronts], 3)
    used = longs(fronts, 0)
    first = integers(fronts, -1)
    following = integers(fronts, -1)
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
    runs = integer_rows(run_offsets[fronts], 3)
    for f in range(fronts):
        for r in range(used[f]):
            for c in range(3):
                runs[run_offsets[f] + r, c] = spread[room[f] + r, c]
    return targets, run_offsets, runs
