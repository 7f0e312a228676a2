# SPDX-License-Identifier: Apache-2.0
"""SciPy's SuperLU as a factor: slower, without reuse of the pattern, always present."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from shell_deform.factor.base import (
    ZERO_EIGENVALUE,
    Factor,
    FactorError,
    Inertia,
    SingularMatrixError,
    SymbolicFactor,
)

# Up to this size the inertia may be taken from dense eigenvalues.
DENSE_INERTIA_LIMIT = 1000


class SuperLUFactor(Factor):
    """SciPy's SuperLU behind the same interface.

    Pivots are taken on the diagonal while that is accurate: then the signs of U's diagonal are the
    inertia. Otherwise rows are exchanged and the inertia is known for small matrices only.
    """

    def __init__(self, symbolic: SymbolicFactor, matrix: Any, free: NDArray[np.bool_]) -> None:
        super().__init__(matrix, free)
        values = scipy.sparse.csc_array(self.matrix)
        if not np.all(np.isfinite(values.data)):
            raise FactorError('the matrix holds a value that is not finite')
        block = symbolic.block
        unknown = (symbolic.order[:, None].astype(np.int64) * block + np.arange(block)).ravel()
        self._unknown = unknown[free[unknown]]
        reduced = scipy.sparse.csc_array(values[self._unknown][:, self._unknown])
        largest = np.maximum(abs(reduced).max(axis=0).toarray().ravel(), np.finfo(float).tiny)
        self._scale = 1.0 / np.sqrt(largest)
        diagonal = scipy.sparse.dia_array(
            (self._scale[None], [0]), shape=(len(self._scale), len(self._scale))
        )
        scaled = scipy.sparse.csc_array(diagonal @ reduced @ diagonal)
        specification = 'MMD_AT_PLUS_A' if symbolic.fronts is None else 'NATURAL'
        self._factor: Any = None
        self._known: Inertia | None = None
        for threshold in (0.0, 0.1):
            try:
                self._factor = scipy.sparse.linalg.splu(
                    scaled,
                    permc_spec=specification,
                    diag_pivot_thresh=threshold,
                    options={'SymmetricMode': True},
                )
            except RuntimeError as error:
                if threshold > 0.0:
                    raise SingularMatrixError(
                        f'SuperLU: {error}; use the multifrontal factor or add supports',
                        np.zeros(0, np.int64),
                    ) from error
                continue
            if self._set_inertia(scaled):
                break

    def _set_inertia(self, scaled: Any) -> bool:
        """Read the inertia off the pivots; False when they are not trustworthy."""
        probe = np.cos(np.arange(1.0, scaled.shape[0] + 1.0))
        error = np.max(np.abs(scaled @ self._factor.solve(probe) - probe))
        on_diagonal = np.array_equal(self._factor.perm_r, self._factor.perm_c)
        pivots = self._factor.U.diagonal()
        if not on_diagonal or not error < 1e-6:
            if scaled.shape[0] <= DENSE_INERTIA_LIMIT:
                pivots = np.linalg.eigvalsh(scaled.toarray())
            else:
                return False
        self._known = Inertia(
            int(np.sum(pivots > ZERO_EIGENVALUE)),
            int(np.sum(pivots < -ZERO_EIGENVALUE)),
            int(np.sum(np.abs(pivots) <= ZERO_EIGENVALUE)),
        )
        self.strong = self._known
        self.definite = self._known.negative == 0 and self._known.zero == 0
        return bool(on_diagonal and error < 1e-6)

    @property
    def inertia(self) -> Inertia:
        """Positive, negative and zero eigenvalues; FactorError when rows had to be exchanged."""
        if self._known is None:
            raise FactorError(
                'SuperLU exchanged rows of this matrix and so does not know its inertia; '
                "use method='multifrontal'"
            )
        return self._known

    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K^-1 f (N, k), and no weak components."""
        x = np.zeros_like(rhs)
        scale = self._scale[:, None]
        x[self._unknown] = scale * self._factor.solve(scale * rhs[self._unknown])
        return x, np.zeros((0, rhs.shape[1]))
