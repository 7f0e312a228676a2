"""Elimination forest of a vertex graph and its grouping into fronts.

Sources: J. W. H. Liu (1990), doi:10.1137/0611010 (elimination trees); C. Ashcraft and R. Grimes
(1989), doi:10.1145/76909.76910 (relaxed supernodes).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled import compiled


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
def elimination_forest(indptr: Any, indices: Any, order: Any) -> Any:
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
def merge_fronts(parent: Any, heights: Any, block: float) -> Any:
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
    merged_into = np.arange(fronts)
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
def renumber(members: Any, tree: Any, order: Any) -> Any:
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
