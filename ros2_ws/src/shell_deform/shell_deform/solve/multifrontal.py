"""Multifrontal LDL^T: the numeric factorisation and its triangular solves, compiled.

Written here because no permissively licensed wheel factorises indefinite matrices, reports the
inertia, reuses the pattern and releases the interpreter lock at once.

Fronts are visited children first. A front that is safely positive definite goes through Cholesky;
any other through `multifrontal_front.eliminate`, which may hand columns to the parent. Columns that
are still without a pivot larger than `weak` at a root stay outside the factor: they are the *weak*
part, a small dense matrix that the caller treats (rigid modes, limit points).

All matrices here are the scaled ones, S A S with S = diag(scale); scale 0 pins an unknown.
Source: I. S. Duff and J. K. Reid (1983), doi:10.1145/356044.356047; J. W. H. Liu (1992),
doi:10.1137/1034004.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled import compiled
from shell_deform.solve.multifrontal_blas import (
    NO,
    TRANSPOSE,
    cholesky,
    gemm,
    gemv,
    new_call,
    solve_lower_right,
    solve_lower_vector,
    subtract_gram,
)
from shell_deform.solve.multifrontal_front import eliminate

# Largest admissible sum of squares of a row of L below a Cholesky block, for a matrix of norm one:
# the backward error of the factorisation is this times the rounding unit.
GROWTH = 1e3
# Smaller pivots at a root may be rounding of zero: there pivots are chosen, largest first.
SAFE_ROOT_PIVOT = 1e-5


@compiled
def equilibrate(
    data: Any, indptr: Any, neighbours: Any, interleaved: bool, block: int, free: Any, scale: Any
) -> int:
    """Powers of two (n,) that bring every row's largest magnitude near one; 0 where not `free`.

    Matrix values lie as in `_add_entries`. Returns -1, or the first row with a value that is not
    finite. Source: D. Ruiz (2001), report RAL-TR-2001-034.
    """
    count = len(scale)
    for i in range(count):
        scale[i] = 1.0 if free[i] else 0.0
    largest = np.empty(count)
    for _ in range(6):
        balanced = True
        for v in range(len(indptr) - 1):
            begin, end = indptr[v], indptr[v + 1]
            row_step, block_step = _steps(block, end - begin, interleaved)
            for a in range(block):
                at = np.int64(begin) * block * block + a * row_step
                most = 0.0
                for q in range(begin, end):
                    w = neighbours[q] * block
                    values = data[at : at + block]
                    for e in range(block):
                        size = abs(values[e]) * scale[w + e]
                        if not size <= 1e300:
                            return v * block + a
                        most = max(most, size)
                    at += block_step
                largest[v * block + a] = most * scale[v * block + a]
        for i in range(count):
            if largest[i] > 0.0 and not 0.25 <= largest[i] <= 4.0:
                balanced = False
                # Within [0.25, 4] already: a further halving would only cost another sweep.
                exponent = np.int64(np.round(-0.5 * np.log2(largest[i])))
                scale[i] *= 2.0**exponent
        if balanced:
            break
    return -1


@compiled
def _steps(block: int, degree: int, interleaved: bool) -> Any:
    """Distance in `data` between a vertex's rows, and between the blocks of one row."""
    if interleaved:
        return block * degree, block
    return block, block * block


@compiled
def _add(target: Any, target_at: int, source: Any, source_at: int, count: int) -> None:
    """target[target_at:+count] += source[source_at:+count]."""
    into = target[target_at : target_at + count]
    out = source[source_at : source_at + count]
    for i in range(count):
        into[i] += out[i]


@compiled
def _add_entries(
    data: Any,
    indptr: Any,
    neighbours: Any,
    targets: Any,
    order: Any,
    scale: Any,
    block: int,
    interleaved: bool,
    low: int,
    high: int,
    shift: int,
    panel: Any,
    panel_at: int,
    m: int,
) -> None:
    """Add the matrix entries of the vertices at positions low:high to the columns of their front.

    `interleaved`: rows of scalars (CSR of unknowns); otherwise contiguous blocks (BSR). Rows behind
    the owned ones lie `shift` lower.
    """
    own = high - low
    for c in range(own):
        v = order[low + c]
        begin, end = indptr[v], indptr[v + 1]
        row_step, block_step = _steps(block, end - begin, interleaved)
        for a in range(block):
            column = panel_at + (c * block + a) * m
            scale_column = scale[v * block + a]
            at = np.int64(begin) * block * block + a * row_step
            for q in range(begin, end):
                t = targets[q]
                if t >= 0:
                    here = column + t * block + (shift if t >= own else 0)
                    w = neighbours[q] * block
                    for e in range(block):
                        panel[here + e] += scale_column * scale[w + e] * data[at + e]
                at += block_step
            if scale_column == 0.0:
                panel[column + c * block + a] = 1.0


@compiled
def _add_child(
    stack: Any,
    child_at: int,
    size: int,
    runs: Any,
    block: int,
    own: int,
    shift: int,
    panel: Any,
    panel_at: int,
    m: int,
    k: int,
    rest: Any,
    rest_at: int,
    rest_ld: int,
) -> None:
    """Add a child's Schur complement (size, size) without delayed columns, run by run."""
    for q in range(len(runs)):
        start, row, length = runs[q, 0] * block, runs[q, 1] * block, runs[q, 2] * block
        if runs[q, 1] >= own:
            row += shift
        for j in range(length):
            c = row + j
            source = child_at + (start + j) * size + start + j
            if c < k:
                base = panel_at + c * m
                _add(panel, base + c, stack, source, length - j)
            else:
                base = rest_at + (c - k) * rest_ld - k
                _add(rest, base + c, stack, source, length - j)
            source = child_at + (start + j) * size
            for r in range(q + 1, len(runs)):
                below = runs[r, 1] * block
                if runs[r, 1] >= own:
                    below += shift
                if c < k:
                    _add(
                        panel, base + below, stack, source + runs[r, 0] * block, runs[r, 2] * block
                    )
                else:
                    _add(
                        rest, base + below, stack, source + runs[r, 0] * block, runs[r, 2] * block
                    )


@compiled
def _add_child_with_delays(
    stack: Any,
    child_at: int,
    size: int,
    rows: Any,
    panel: Any,
    panel_at: int,
    m: int,
    k: int,
    rest: Any,
    rest_at: int,
    rest_ld: int,
) -> None:
    """Add a child's Schur complement whose row i lands in row rows[i] of the parent."""
    for j in range(size):
        for i in range(j, size):
            r, c = max(rows[i], rows[j]), min(rows[i], rows[j])
            value = stack[child_at + j * size + i]
            if c < k:
                panel[panel_at + c * m + r] += value
            else:
                rest[rest_at + (c - k) * rest_ld - k + r] += value


@compiled
def _assemble(
    f: int,
    block: int,
    data: Any,
    indptr: Any,
    neighbours: Any,
    targets: Any,
    order: Any,
    scale: Any,
    interleaved: bool,
    owned: Any,
    run_offsets: Any,
    runs: Any,
    first_child: Any,
    next_child: Any,
    stack: Any,
    rest_sizes: Any,
    rest_places: Any,
    delays: Any,
    shift: int,
    panel: Any,
    panel_at: int,
    m: int,
    k: int,
    rest: Any,
    rest_at: int,
    rest_ld: int,
) -> None:
    """Fill a front: its columns (m, k) in `panel`, the triangle behind them in `rest`."""
    panel[panel_at : panel_at + m * k] = 0.0
    for c in range(m - k):
        rest[rest_at + c * rest_ld + c : rest_at + c * rest_ld + m - k] = 0.0
    own = owned[f + 1] - owned[f]
    _add_entries(
        data,
        indptr,
        neighbours,
        targets,
        order,
        scale,
        block,
        interleaved,
        owned[f],
        owned[f + 1],
        shift,
        panel,
        panel_at,
        m,
    )
    delayed = own * block
    child = first_child[f]
    while child >= 0:
        size = rest_sizes[child]
        mine = runs[run_offsets[child] : run_offsets[child + 1]]
        if delays[child] == 0:
            _add_child(
                stack,
                rest_places[child],
                size,
                mine,
                block,
                own,
                shift,
                panel,
                panel_at,
                m,
                k,
                rest,
                rest_at,
                rest_ld,
            )
        else:
            rows = np.empty(size, np.int64)
            for i in range(delays[child]):
                rows[i] = delayed + i
            for q in range(len(mine)):
                row = mine[q, 1] * block
                if mine[q, 1] >= own:
                    row += shift
                for i in range(mine[q, 2] * block):
                    rows[delays[child] + mine[q, 0] * block + i] = row + i
            delayed += delays[child]
            _add_child_with_delays(
                stack,
                rest_places[child],
                size,
                rows,
                panel,
                panel_at,
                m,
                k,
                rest,
                rest_at,
                rest_ld,
            )
        child = next_child[child]


@compiled
def _definite_front(
    call: Any, panel: Any, at: int, m: int, k: int, rest: Any, rest_at: int, weak: float
) -> bool:
    """Cholesky of a front in place; False when a pivot is not above `weak` or L grows."""
    if cholesky(call, k, panel, at, m) != 0:
        return False
    for j in range(k):
        pivot = panel[at + j * m + j]
        if not pivot * pivot > (weak if m > k else max(weak, SAFE_ROOT_PIVOT)):
            return False
    border = m - k
    if border > 0:
        solve_lower_right(call, TRANSPOSE, border, k, panel, at, m, panel, at + k, m)
        before = np.empty(border)
        for i in range(border):
            before[i] = rest[rest_at + i * border + i]
        subtract_gram(call, border, k, panel, at + k, m, rest, rest_at, border)
        for i in range(border):
            if not before[i] - rest[rest_at + i * border + i] <= GROWTH:
                return False
    return True


@compiled
def _room(array: Any, used: int, needed: int) -> Any:
    """`array`, or a larger copy of its first `used` entries when `needed` do not fit."""
    if needed <= len(array):
        return array
    larger = np.empty(needed + needed // 4, array.dtype)
    larger[:used] = array[:used]
    return larger


@compiled
def factorise_fronts(
    data: Any,
    indptr: Any,
    neighbours: Any,
    interleaved: bool,
    scale: Any,
    block: int,
    order: Any,
    owned: Any,
    row_offsets: Any,
    rows: Any,
    parent: Any,
    parity: Any,
    targets: Any,
    run_offsets: Any,
    runs: Any,
    values: Any,
    ids: Any,
    stack: Any,
    threshold: float,
    weak: float,
) -> Any:
    """Factorise; `values`, `ids`, `stack` are room to use, larger arrays are made when needed.

    Returns the values of L (front by front, (m, pivots) column by column), their offsets, the
    unknowns of each front's rows in elimination numbering, their offsets, pivots per front,
    whether a front is a Cholesky factor, D and its off-diagonal per pivot, the weak unknowns, the weak
    matrices one after the other with their sizes, and the stack for reuse.
    """
    fronts = len(parent)
    call = new_call()
    first_child = np.full(fronts, -1, np.int32)
    next_child = np.full(fronts, -1, np.int32)
    for f in range(fronts - 1, -1, -1):
        if parent[f] >= 0:
            next_child[f] = first_child[parent[f]]
            first_child[parent[f]] = f
    value_offsets = np.zeros(fronts + 1, np.int64)
    id_offsets = np.zeros(fronts + 1, np.int64)
    pivots = np.zeros(fronts, np.int64)
    definite = np.zeros(fronts, np.bool_)
    delays = np.zeros(fronts, np.int64)
    rest_sizes = np.zeros(fronts, np.int64)
    rest_places = np.zeros(fronts, np.int64)
    unknowns = len(order) * block
    diagonal, beside = np.ones(unknowns), np.zeros(unknowns)
    weak_ids = np.empty(0, np.int32)
    weak_values = np.empty(0)
    weak_sizes = np.empty(fronts, np.int64)
    weak_blocks, weak_count, weak_entries = 0, 0, 0
    square = np.empty(0)
    # Two stacks grow towards each other: fronts of even depth from below, of odd depth from above.
    bottom, top = 0, len(stack)
    done = 0
    for f in range(fronts):
        own = (owned[f + 1] - owned[f]) * block
        shift, freed = 0, 0
        child = first_child[f]
        while child >= 0:
            shift += delays[child]
            freed += rest_sizes[child] * rest_sizes[child]
            child = next_child[child]
        m = (row_offsets[f + 1] - row_offsets[f]) * block + shift
        k = own + shift
        at = value_offsets[f]
        values = _room(values, at, at + m * k)
        first_id = id_offsets[f]
        ids = _room(ids, first_id, first_id + m)
        id_offsets[f + 1] = first_id + m
        filled = first_id
        for r in range(own):
            ids[filled] = owned[f] * block + r
            filled += 1
        child = first_child[f]
        while child >= 0:
            start = id_offsets[child] + pivots[child]
            for r in range(delays[child]):
                ids[filled] = ids[start + r]
                filled += 1
            child = next_child[child]
        for r in range(row_offsets[f] + owned[f + 1] - owned[f], row_offsets[f + 1]):
            for a in range(block):
                ids[filled] = rows[r] * block + a
                filled += 1
        # A front that delays columns leaves a larger complement: room for the worst case.
        if top - bottom < m * m:
            missing = m * m - (top - bottom)
            larger = np.empty(len(stack) + missing + len(stack) // 4)
            larger[:bottom] = stack[:bottom]
            moved = len(larger) - len(stack)
            larger[top + moved :] = stack[top:]
            for c in range(f):
                if rest_places[c] >= top:
                    rest_places[c] += moved
            top += moved
            stack = larger
        border = m - k
        rest_at = bottom if parity[f] == 0 else top - border * border
        taken = 0
        if shift == 0:
            _assemble(
                f,
                block,
                data,
                indptr,
                neighbours,
                targets,
                order,
                scale,
                interleaved,
                owned,
                run_offsets,
                runs,
                first_child,
                next_child,
                stack,
                rest_sizes,
                rest_places,
                delays,
                shift,
                values,
                at,
                m,
                k,
                stack,
                rest_at,
                border,
            )
            if _definite_front(call, values, at, m, k, stack, rest_at, weak):
                taken = k
                definite[f] = True
        if not definite[f]:
            square = _room(square, 0, m * m)
            _assemble(
                f,
                block,
                data,
                indptr,
                neighbours,
                targets,
                order,
                scale,
                interleaved,
                owned,
                run_offsets,
                runs,
                first_child,
                next_child,
                stack,
                rest_sizes,
                rest_places,
                delays,
                shift,
                square,
                0,
                m,
                k,
                square,
                k * m + k,
                m,
            )
            taken = eliminate(
                call,
                square,
                m,
                k,
                ids[first_id : first_id + m],
                diagonal[done : done + k],
                beside[done : done + k],
                threshold,
                weak,
            )
            values[at : at + m * taken] = square[: m * taken]
            border = m - taken
            rest_at = bottom if parity[f] == 0 else top - border * border
            for c in range(border):
                source = (taken + c) * m + taken
                here = rest_at + c * border
                stack[here + c : here + border] = square[source + c : source + border]
        pivots[f] = taken
        delays[f] = k - taken
        value_offsets[f + 1] = at + m * taken
        done += taken
        # The children's complements are the newest of the other parity.
        if parity[f] == 0:
            top += freed
            bottom += border * border
        else:
            bottom -= freed
            top -= border * border
        rest_sizes[f] = border
        rest_places[f] = rest_at
        if parent[f] < 0:
            if parity[f] == 0:
                bottom -= border * border
            if border > 0:
                weak_ids = _room(weak_ids, weak_count, weak_count + border)
                weak_values = _room(weak_values, weak_entries, weak_entries + border * border)
                for c in range(border):
                    weak_ids[weak_count + c] = ids[first_id + taken + c]
                    for i in range(border):
                        weak_values[weak_entries + c * border + i] = stack[
                            rest_at + min(i, c) * border + max(i, c)
                        ]
                weak_sizes[weak_blocks] = border
                weak_blocks += 1
                weak_count += border
                weak_entries += border * border
    return (
        values,
        value_offsets,
        ids,
        id_offsets,
        pivots,
        definite,
        diagonal,
        beside,
        weak_ids[:weak_count],
        weak_values[:weak_entries],
        weak_sizes[:weak_blocks],
        stack,
    )


@compiled
def count_signs(pivots: Any, definite: Any, diagonal: Any, beside: Any) -> Any:
    """Positive and negative eigenvalues of D."""
    positive, negative, at = 0, 0, 0
    for f in range(len(pivots)):
        if definite[f]:
            positive += pivots[f]
        else:
            j = at
            while j < at + pivots[f]:
                if beside[j] != 0.0:
                    determinant = diagonal[j] * diagonal[j + 1] - beside[j] * beside[j]
                    if determinant < 0.0:
                        positive += 1
                        negative += 1
                    elif diagonal[j] > 0.0:
                        positive += 2
                    else:
                        negative += 2
                    j += 2
                else:
                    if diagonal[j] > 0.0:
                        positive += 1
                    else:
                        negative += 1
                    j += 1
        at += pivots[f]
    return positive, negative


@compiled
def forward(
    values: Any,
    value_offsets: Any,
    ids: Any,
    id_offsets: Any,
    pivots: Any,
    definite: Any,
    diagonal: Any,
    beside: Any,
    x: Any,
) -> None:
    """x (n, r) = D^-1 L^-1 x in elimination numbering; weak rows hold L^-1 x."""
    call = new_call()
    columns = x.shape[1]
    largest = 0
    for f in range(len(pivots)):
        largest = max(largest, id_offsets[f + 1] - id_offsets[f])
    y = np.empty(largest * columns)
    done = 0
    for f in range(len(pivots)):
        mine = ids[id_offsets[f] : id_offsets[f + 1]]
        m, k, at = len(mine), pivots[f], value_offsets[f]
        if k == 0:
            continue
        border = m - k
        for i in range(k):
            for c in range(columns):
                y[i * columns + c] = x[mine[i], c]
        below = k * columns
        if columns == 1:
            solve_lower_vector(call, NO, k, values, at, m, y, 0)
            if border > 0:
                gemv(call, NO, border, k, 1.0, values, at + k, m, y, 0, 1, 0.0, y, k)
        else:
            solve_lower_right(call, TRANSPOSE, columns, k, values, at, m, y, 0, columns)
            if border > 0:
                gemm(
                    call,
                    NO,
                    TRANSPOSE,
                    columns,
                    border,
                    k,
                    1.0,
                    y,
                    0,
                    columns,
                    values,
                    at + k,
                    m,
                    0.0,
                    y,
                    below,
                    columns,
                )
        for i in range(border):
            for c in range(columns):
                x[mine[k + i], c] -= y[below + i * columns + c]
        if definite[f]:
            for i in range(k):
                for c in range(columns):
                    x[mine[i], c] = y[i * columns + c]
        else:
            i = 0
            while i < k:
                a, b = diagonal[done + i], beside[done + i]
                if b != 0.0:
                    d = diagonal[done + i + 1]
                    determinant = a * d - b * b
                    for c in range(columns):
                        p, q = y[i * columns + c], y[(i + 1) * columns + c]
                        x[mine[i], c] = (d * p - b * q) / determinant
                        x[mine[i + 1], c] = (a * q - b * p) / determinant
                    i += 2
                else:
                    for c in range(columns):
                        x[mine[i], c] = y[i * columns + c] / a
                    i += 1
        done += k


@compiled
def backward(
    values: Any, value_offsets: Any, ids: Any, id_offsets: Any, pivots: Any, x: Any
) -> None:
    """x (n, r) = L^-T x in elimination numbering; weak rows are kept."""
    call = new_call()
    columns = x.shape[1]
    largest = 0
    for f in range(len(pivots)):
        largest = max(largest, id_offsets[f + 1] - id_offsets[f])
    y = np.empty(largest * columns)
    for f in range(len(pivots) - 1, -1, -1):
        mine = ids[id_offsets[f] : id_offsets[f + 1]]
        m, k, at = len(mine), pivots[f], value_offsets[f]
        if k == 0:
            continue
        border = m - k
        for i in range(m):
            for c in range(columns):
                y[i * columns + c] = x[mine[i], c]
        below = k * columns
        if columns == 1:
            if border > 0:
                gemv(call, TRANSPOSE, border, k, -1.0, values, at + k, m, y, k, 1, 1.0, y, 0)
            solve_lower_vector(call, TRANSPOSE, k, values, at, m, y, 0)
        else:
            if border > 0:
                gemm(
                    call,
                    NO,
                    NO,
                    columns,
                    k,
                    border,
                    -1.0,
                    y,
                    below,
                    columns,
                    values,
                    at + k,
                    m,
                    1.0,
                    y,
                    0,
                    columns,
                )
            solve_lower_right(call, NO, columns, k, values, at, m, y, 0, columns)
        for i in range(k):
            for c in range(columns):
                x[mine[i], c] = y[i * columns + c]
