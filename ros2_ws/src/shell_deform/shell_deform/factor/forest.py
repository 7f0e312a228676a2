# SPDX-License-Identifier: Apache-2.0
"""Elimination forest of a vertex graph and its grouping into fronts.

Sources: J. W. H. Liu (1990), doi:10.1137/0611010 (elimination trees); C. Ashcraft and R. Grimes
(1989), doi:10.1145/76909.76910 (relaxed supernodes).
"""

from __future__ import annotations

from typing import Any

from numba import types

from shell_deform.compiled.kernel_arrays import floats, integers, longs
from shell_deform.compiled.kernel_types import Float, Ints, kernel


@kernel(Ints, Ints)
def _postorder(parent: Any) -> Any:
    """Nodes of a forest, children before parents and siblings in their order."""
    count = len(parent)
    first = integers(count, -1)
    following = integers(count, -1)
    roots = -1
    for v in range(count - 1, -1, -1):
        if parent[v] < 0:
            following[v] = roots
            roots = v
        else:
            following[v] = first[parent[v]]
            first[parent[v]] = v
    result = integers(count, 0)
    filled = 0
    stack = integers(count, 0)
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


@kernel(types.UniTuple(Ints, 3), Ints, Ints, Ints, called_from_python=True)
def elimination_forest(indptr: Any, indices: Any, order: Any) -> Any:
    """Postordered elimination forest: parent (n,), column heights (n,) and the new order (n,)."""
    count = len(order)
    position = integers(count, 0)
    for k in range(count):
        position[order[k]] = k
    parent = integers(count, -1)
    ancestor = integers(count, -1)
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
    place = integers(count, 0)
    for k in range(count):
        place[post[k]] = k
    new_order = integers(count, 0)
    new_parent = integers(count, -1)
    for k in range(count):
        new_order[k] = order[post[k]]
        if parent[post[k]] >= 0:
            new_parent[k] = place[parent[post[k]]]
    for k in range(count):
        position[new_order[k]] = k
    # Row k of the factor is the part of the forest between k's neighbours and k.
    heights = integers(count, 1)
    seen = integers(count, -1)
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


@kernel(types.UniTuple(Ints, 2), Ints, Ints, Float, called_from_python=True)
def merge_fronts(parent: Any, heights: Any, block: float) -> Any:
    """Front of each column (n,) and the parent of each front: equal columns first, then greedily.

    A child joins its parent when the zeros this stores cost less than another front would.
    """
    count = len(parent)
    front = integers(count, 0)
    fronts = 0
    for k in range(count):
        if k > 0 and parent[k - 1] == k and heights[k - 1] == heights[k] + 1:
            front[k] = fronts - 1
        else:
            front[k] = fronts
            fronts += 1
    width = floats(fronts, 0.0)
    height = floats(fronts, 0.0)
    above = integers(fronts, -1)
    for k in range(count):
        f = front[k]
        if width[f] == 0:
            height[f] = heights[k]
        width[f] += 1
        above[f] = front[parent[k]] if parent[k] >= 0 else -1
    zeros = floats(fronts, 0.0)
    merged_into = longs(fronts, 0)
    for f in range(fronts):
        merged_into[f] = f
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
    members = integers(count, 0)
    for k in range(count):
        members[k] = merged_into[front[k]]
    tree = integers(fronts, -2)
    for f in range(fronts):
        if merged_into[f] == f:
            tree[f] = merged_into[above[f]] if above[f] >= 0 else -1
    return members, tree


@kernel(types.UniTuple(Ints, 3), Ints, Ints, Ints, called_from_python=True)
def renumber(members: Any, tree: Any, order: Any) -> Any:
    """Order with the columns of each front together; first columns (f + 1,) and parents (f,)."""
    name = integers(len(tree), -1)
    kept = 0
    for f in range(len(tree)):
        if tree[f] != -2:
            name[f] = kept
            kept += 1
    small = integers(kept, 0)
    for f in range(len(tree)):
        if tree[f] != -2:
            small[name[f]] = -1 if tree[f] < 0 else name[tree[f]]
    post = _postorder(small)
    place = integers(kept, 0)
    for k in range(kept):
        place[post[k]] = k
    parent = integers(kept, 0)
    for k in range(kept):
        parent[k] = -1 if small[post[k]] < 0 else place[small[post[k]]]
    owned = integers(kept + 1, 0)
    for k in range(len(order)):
        owned[place[name[members[k]]] + 1] += 1
    for f in range(kept):
        owned[f + 1] += owned[f]
    fill = owned.copy()
    result = integers(len(order), 0)
    for k in range(len(order)):
        f = place[name[members[k]]]
        result[fill[f]] = order[k]
        fill[f] += 1
    return result, owned, parent
