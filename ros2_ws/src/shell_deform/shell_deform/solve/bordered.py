"""Sparse systems with a few dense borders, by block elimination.

    [ K    B ] [ x ]   [ r ]
    [ C^T  D ] [ y ] = [ s ]

K is the sparse stiffness, whose factorisation is at hand; the borders carry what is dense or would
change the pattern: contact forces, held contacts, free rigid motions, sealed gas (rank one), and
the springs that make a free body's stiffness regular, taken back here exactly.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Solver(Protocol):
    """Anything that solves with the factorised sparse part."""

    def solve(self, rhs: Array) -> Array:
        """Solve for one (N,) or several (N, k) right-hand sides."""


class BorderedSystem:
    """The factorised bordered system; borders (N, k), corner (k, k)."""

    def __init__(
        self,
        factor: Solver,
        matrix: sp.csr_matrix,
        columns: Array,
        rows: Array,
        corner: Array,
    ) -> None:
        self._factor = factor
        self._matrix = matrix
        self._columns = columns
        self._rows = rows
        self._corner = corner
        self._through = factor.solve(columns) if columns.shape[1] else columns
        self.schur = corner - rows.T @ self._through
        self._schur_factor = la.lu_factor(self.schur) if columns.shape[1] else None

    def solve(self, right: Array, below: Array, refinements: int = 1) -> tuple[Array, Array]:
        """Solution (x, y) for right-hand sides (N,) or (N, m) and (k,) or (k, m)."""
        x, y = self._solve_once(right, below)
        for _ in range(refinements):
            first = right - self._matrix @ x - self._columns @ y
            second = below - self._rows.T @ x - self._corner @ y
            dx, dy = self._solve_once(first, second)
            x, y = x + dx, y + dy
        return x, y

    def _solve_once(self, right: Array, below: Array) -> tuple[Array, Array]:
        base = self._factor.solve(np.ascontiguousarray(right))
        if self._schur_factor is None:
            return base, below
        y = la.lu_solve(self._schur_factor, below - self._rows.T @ base, check_finite=False)
        return base - self._through @ y, y
