# SPDX-License-Identifier: Apache-2.0
"""The house's own factor: multifrontal L D L^T in compiled kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from shell_deform.compiled.halves import both
from shell_deform.factor.base import Factor, FactorError, Inertia, SymbolicFactor
from shell_deform.factor.front_assembly import equilibrate
from shell_deform.factor.front_types import Complements, Matrix, Span
from shell_deform.factor.fronts import count_signs, factorise_fronts
from shell_deform.factor.substitution import backward, forward
from shell_deform.factor.symbolic import Fronts
from shell_deform.factor.threads import one_blas_thread

# Pivots below this, relative to the equilibrated matrix, are set aside as weak.
WEAK_PIVOT = 1e-10
# Smallest admissible pivot relative to its column in fronts that are not definite.
PIVOT_THRESHOLD = 0.01


# From so many doubles in the factor on, two threads substitute faster than one.
WORTH_TWO_THREADS = 1_000_000


class MultifrontalFactor(Factor):
    """The house's own factor; its storage returns to the symbolic factor when it is dropped."""

    def __init__(
        self,
        symbolic: SymbolicFactor,
        matrix: Any,
        free: NDArray[np.bool_],
        interleaved: bool,
    ) -> None:
        """Factorise a matrix of the analysed pattern; `interleaved`: rows of scalars, not blocks.

        Raises FactorError for values that are not finite.
        """
        super().__init__(matrix, free)
        self._spare = symbolic.spare
        fronts: Fronts = symbolic.fronts
        block, indptr, indices = symbolic.block, symbolic.indptr, symbolic.indices
        data = self.matrix.data.reshape(-1)
        scale = np.empty(self.size)
        bad = equilibrate(data, indptr, indices, interleaved, block, free, scale)
        if bad >= 0:
            raise FactorError(f'row {bad} of the matrix holds a value that is not finite')
        order, targets = fronts.order, fronts.targets
        self._parts, weak, self._storage = _factorised(
            symbolic, Matrix(data, indptr, indices, targets, order, scale, block, interleaved)
        )
        self._ends = block * np.array([fronts.owned[last] for _, last in fronts.spans])
        self._unknown = (order[:, None].astype(np.int64) * block + np.arange(block)).ravel()
        self._scale = scale[self._unknown]
        signs = np.sum([count_signs(*part) for part in self._parts], axis=0)
        held = self.size - int(np.count_nonzero(free))
        self.strong = Inertia(int(signs[0]) - held, int(signs[1]), 0)
        self.definite = all(bool(np.all(pivots.definite)) for _, pivots in self._parts)
        self._weak_rows = np.concatenate([part.ids for part in weak])
        if len(self._weak_rows):
            self._find_weak_modes(
                np.concatenate([part.values for part in weak]),
                np.concatenate([part.sizes for part in weak]),
            )

    def _find_weak_modes(self, values: NDArray[np.float64], sizes: NDArray[np.int64]) -> None:
        """Modes and matrix of the columns that stayed without a pivot; `values` root by root."""
        ends = np.cumsum(sizes**2)
        blocks = [
            values[end - size**2 : end].reshape(size, size)
            for end, size in zip(ends, sizes, strict=True)
        ]
        modes = np.zeros((self.size, len(self._weak_rows)))
        modes[self._weak_rows, np.arange(len(self._weak_rows))] = 1.0
        self._backward(modes)
        natural = np.empty_like(modes)
        natural[self._unknown] = modes * self._scale[:, None]
        self._set_weak(
            self._unknown[self._weak_rows],
            scipy.linalg.block_diag(*blocks),
            natural,
            modes.T @ modes,
        )

    def __getstate__(self) -> dict[str, Any]:
        """Recycled storage does not travel with a factor."""
        return {**self.__dict__, '_spare': [], '_storage': None}

    def __del__(self) -> None:
        if getattr(self, '_storage', None) is not None and len(self._spare) < 2:
            self._spare.append(self._storage)

    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K+ f (N, k) and Z^T f (r, k) of f (N, k), unrefined."""
        if rhs.shape[1] == 0:
            # BLAS complains about matrices without columns.
            return np.zeros((self.size, 0)), np.zeros((len(self._weak_rows), 0))
        y = np.ascontiguousarray(rhs[self._unknown] * self._scale[:, None])
        along = np.zeros((0, y.shape[1]))
        self._forward(y)
        if len(self._weak_rows):
            along = y[self._weak_rows]
            y[self._weak_rows] = 0.0
        self._backward(y)
        x = np.empty_like(y)
        x[self._unknown] = y * self._scale[:, None]
        return x, along

    @property
    def _together(self) -> bool:
        """Whether two threads substitute faster than one."""
        entries = sum(int(lower.value_offsets[-1]) for lower, _ in self._parts)
        return len(self._parts) > 1 and entries >= WORTH_TWO_THREADS

    def _forward(self, y: NDArray[np.float64]) -> None:
        """y (N, k) = D^-1 L^-1 y in elimination numbering."""
        with one_blas_thread():
            if not self._together:
                for part in self._parts:
                    forward(*part, y)
                return
            one, two, last = self._parts
            middle, above = self._ends[:2]
            # Both subtract from the rows above them: the second on a copy of its own.
            other = np.zeros_like(y)
            other[middle:above] = y[middle:above]
            both(lambda: forward(*one, y), lambda: forward(*two, other))
            y[middle:above] = other[middle:above]
            y[above:] += other[above:]
            forward(*last, y)

    def _backward(self, y: NDArray[np.float64]) -> None:
        """y (N, k) = L^-T y in elimination numbering."""
        lowers = [lower for lower, _ in self._parts]
        with one_blas_thread():
            if not self._together:
                for lower in reversed(lowers):
                    backward(lower, y)
                return
            one, two, last = lowers
            backward(last, y)
            both(lambda: backward(one, y), lambda: backward(two, y))


def _factorised(symbolic: SymbolicFactor, matrix: Matrix) -> Any:
    """L and D of each span of fronts, weak parts of each, and the storage to recycle.

    Two subtrees are eliminated at the same time, and then what is above both: by the same
    operations in the same order as one after the other.
    """
    fronts: Fronts = symbolic.fronts
    tree, count = fronts.tree, fronts.count
    complements = Complements(*(np.zeros(count, np.int64) for _ in Complements._fields))
    spare = symbolic.spare.pop() if symbolic.spare else _storage(symbolic)

    def eliminate(number: int, bottom: int = 0, top: int = -1, ids: int = 0) -> Any:
        room = spare[number]
        span = Span(*fronts.spans[number], bottom, top if top >= 0 else len(room[2]), ids)
        return factorise_fronts(
            matrix, tree, span, complements, *room, PIVOT_THRESHOLD, WEAK_PIVOT
        )

    with one_blas_thread():
        if len(spare) == 1:
            results = [eliminate(0)]
        else:
            two = both(lambda: eliminate(0), lambda: eliminate(1))
            spare[2], *filled = _handed_up(fronts, complements, two, spare[2])
            results = [*two, eliminate(2, *filled)]
    parts = [(lower, pivots) for lower, pivots, _, _ in results]
    storage = [(lower.values, lower.ids, stack) for lower, _, _, stack in results]
    return parts, [weak for _, _, weak, _ in results], storage


def _handed_up(fronts: Fronts, complements: Complements, two: Any, room: Any) -> Any:
    """Storage of the last span with the complements that come from the `two` before it, how far
    the stack is filled from below and from above, and the count of their unknowns.
    """
    values, ids, stack = room
    middle, above = fronts.spans[1]
    waiting = [f for f in range(above) if fronts.parent[f] >= above]
    needed = sum(int(complements.sizes[f]) ** 2 for f in waiting)
    if needed > len(stack):
        stack = np.empty(2 * needed)
    names = sum(int(complements.sizes[f]) for f in waiting)
    if names > len(ids):
        ids = np.empty(2 * names, np.int32)
    bottom, top, filled = 0, len(stack), 0
    for f in waiting:
        lower, _, _, source = two[int(f >= middle)]
        size, place = int(complements.sizes[f]), int(complements.places[f])
        first = int(complements.rows[f])
        if fronts.parity[f]:
            top -= size * size
        at = top if fronts.parity[f] else bottom
        if not fronts.parity[f]:
            bottom += size * size
        stack[at : at + size * size] = source[place : place + size * size]
        ids[filled : filled + size] = lower.ids[first : first + size]
        complements.places[f], complements.rows[f] = at, filled
        filled += size
    return (values, ids, stack), bottom, top, filled


def _storage(symbolic: SymbolicFactor) -> Any:
    """Arrays for values, row numbers and the stack of each span of fronts."""
    fronts, block = symbolic.fronts, symbolic.block
    return [
        (
            np.empty(fronts.stored_entries(block, (first, last))),
            np.empty(block * int(fronts.row_offsets[last] - fronts.row_offsets[first]), np.int32),
            np.empty(fronts.stack_entries(block, (first, last))),
        )
        for first, last in fronts.spans
    ]
