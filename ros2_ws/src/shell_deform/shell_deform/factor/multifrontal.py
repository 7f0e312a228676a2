# SPDX-License-Identifier: Apache-2.0
"""The house's own factor: multifrontal L D L^T in compiled kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from shell_deform.factor.base import Factor, FactorError, Inertia, SymbolicFactor
from shell_deform.factor.front_assembly import equilibrate
from shell_deform.factor.front_types import Matrix
from shell_deform.factor.fronts import count_signs, factorise_fronts
from shell_deform.factor.substitution import backward, forward
from shell_deform.factor.symbolic import Fronts
from shell_deform.factor.threads import one_blas_thread

# Pivots below this, relative to the equilibrated matrix, are set aside as weak.
WEAK_PIVOT = 1e-10
# Smallest admissible pivot relative to its column in fronts that are not definite.
PIVOT_THRESHOLD = 0.01


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
        with one_blas_thread():
            self._lower, self._pivots, weak, self._stack = factorise_fronts(
                Matrix(data, indptr, indices, targets, order, scale, block, interleaved),
                fronts.tree,
                *_take_storage(symbolic),
                PIVOT_THRESHOLD,
                WEAK_PIVOT,
            )
        self._unknown = (order[:, None].astype(np.int64) * block + np.arange(block)).ravel()
        self._scale = scale[self._unknown]
        positive, negative = count_signs(self._lower, self._pivots)
        held = self.size - int(np.count_nonzero(free))
        self.strong = Inertia(positive - held, negative, 0)
        self.definite = bool(np.all(self._pivots.definite))
        self._weak_rows = weak.ids
        if len(self._weak_rows):
            self._find_weak_modes(weak.values, weak.sizes)

    def _find_weak_modes(self, values: NDArray[np.float64], sizes: NDArray[np.int64]) -> None:
        """Modes and matrix of the columns that stayed without a pivot; `values` root by root."""
        ends = np.cumsum(sizes**2)
        blocks = [
            values[end - size**2 : end].reshape(size, size)
            for end, size in zip(ends, sizes, strict=True)
        ]
        modes = np.zeros((self.size, len(self._weak_rows)))
        modes[self._weak_rows, np.arange(len(self._weak_rows))] = 1.0
        with one_blas_thread():
            backward(self._lower, modes)
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
        return {**self.__dict__, '_spare': [], '_stack': None}

    def __del__(self) -> None:
        if getattr(self, '_stack', None) is not None and len(self._spare) < 2:
            self._spare.append((self._lower.values, self._lower.ids, self._stack))

    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K+ f (N, k) and Z^T f (r, k) of f (N, k), unrefined."""
        if rhs.shape[1] == 0:
            # BLAS complains about matrices without columns.
            return np.zeros((self.size, 0)), np.zeros((len(self._weak_rows), 0))
        y = np.ascontiguousarray(rhs[self._unknown] * self._scale[:, None])
        along = np.zeros((0, y.shape[1]))
        with one_blas_thread():
            forward(self._lower, self._pivots, y)
            if len(self._weak_rows):
                along = y[self._weak_rows]
                y[self._weak_rows] = 0.0
            backward(self._lower, y)
        x = np.empty_like(y)
        x[self._unknown] = y * self._scale[:, None]
        return x, along


def _take_storage(symbolic: SymbolicFactor) -> Any:
    """Arrays for values, row numbers and the stack, recycled when a factor was dropped."""
    if symbolic.spare:
        return symbolic.spare.pop()
    fronts, block = symbolic.fronts, symbolic.block
    return (
        np.empty(fronts.stored_entries(block)),
        np.empty(len(fronts.rows) * block, np.int32),
        np.empty(fronts.stack_entries(block)),
    )
