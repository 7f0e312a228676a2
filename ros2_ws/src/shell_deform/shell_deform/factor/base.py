# SPDX-License-Identifier: Apache-2.0
"""What every factor of a sparse symmetric matrix offers: solves, refinement, inertia, zero modes.

Pivots that are tiny against the equilibrated matrix stay outside a factor. With the strong part's
generalised inverse K+, the weak modes Z (N, r) and the small weak matrix R (r, r), K x = f means
x = K+ f + Z a with R a = Z^T f: exactly, however small R is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

# Eigenvalues below this, relative to the equilibrated matrix, are rounding: zero.
ZERO_EIGENVALUE = 1e-13
# Refinement stops at this residual relative to |K| |x| + |f|.
REFINED = 32.0 * np.finfo(float).eps
# A load may have this part along zero modes before it counts as inconsistent.
CONSISTENT = 1e-9


class FactorError(RuntimeError):
    """A matrix that cannot be factorised or solved as asked."""


class SingularMatrixError(FactorError):
    """The matrix is singular and the right-hand side is not in its range.

    `unknowns`: the unknowns whose pivots vanish (one per zero mode).
    """

    def __init__(self, message: str, unknowns: NDArray[np.int64]) -> None:
        super().__init__(message)
        self.unknowns = unknowns


@dataclass(frozen=True)
class Inertia:
    """Numbers of positive, negative and zero eigenvalues."""

    positive: int
    negative: int
    zero: int

    def __add__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.positive + other.positive,
            self.negative + other.negative,
            self.zero + other.zero,
        )

    def __sub__(self, other: Inertia) -> Inertia:
        return Inertia(
            self.positive - other.positive,
            self.negative - other.negative,
            self.zero - other.zero,
        )


@dataclass(frozen=True)
class SymbolicFactor:
    """A pattern analysed once: vertex graph (`indptr`, `indices`) with `block` unknowns each.

    Unknown a of vertex v is number block * v + a. `order` (n,): elimination order of the vertices;
    `fronts`: the multifrontal structure, None without numba.
    """

    block: int
    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    order: NDArray[np.int32]
    fronts: Any
    checked: list[Any] = field(default_factory=list, repr=False, compare=False)
    spare: list[Any] = field(default_factory=list, repr=False, compare=False)

    @property
    def unknowns(self) -> int:
        """Rows of the matrices that fit."""
        return self.block * (len(self.indptr) - 1)

    @property
    def stored_entries(self) -> int:
        """Doubles in a multifrontal factor."""
        return 0 if self.fronts is None else int(self.fronts.stored_entries(self.block))


class Factor(ABC):
    """A factorised symmetric matrix K, some unknowns held at zero.

    Attributes: `size` N; `inertia` of K over the free unknowns; `strong` inertia of the part
    behind K+; `weak_matrix` R (r, r), `weak_modes` Z (N, r), `weak_unknowns` (r,), see the module;
    `definite`: no pivoting was needed and nothing is weak.
    """

    def __init__(self, matrix: Any, free: NDArray[np.bool_]) -> None:
        self.size = len(free)
        self.free = free
        self.matrix = copy(matrix)
        self.matrix.data = np.array(matrix.data, dtype=np.float64)
        self.definite = False
        self.strong = Inertia(0, 0, 0)
        self.weak_unknowns: NDArray[np.int64] = np.zeros(0, np.int64)
        self.weak_matrix: NDArray[np.float64] = np.zeros((0, 0))
        self.weak_modes: NDArray[np.float64] = np.zeros((self.size, 0))
        self._weak_values: NDArray[np.float64] = np.zeros(0)
        self._weak_vectors: NDArray[np.float64] = np.zeros((0, 0))
        self._norm: float | None = None

    @abstractmethod
    def partial_solve(
        self, rhs: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """K+ f (N, k) and Z^T f (r, k) of f (N, k), unrefined."""

    @property
    def norm(self) -> float:
        """Largest magnitude in K."""
        if self._norm is None:
            self._norm = float(np.max(np.abs(self.matrix.data), initial=0.0))
        return self._norm

    @property
    def inertia(self) -> Inertia:
        """Positive, negative and zero eigenvalues of K over the free unknowns."""
        values = self._weak_values
        return self.strong + Inertia(
            int(np.sum(values > ZERO_EIGENVALUE)),
            int(np.sum(values < -ZERO_EIGENVALUE)),
            int(np.sum(np.abs(values) <= ZERO_EIGENVALUE)),
        )

    def solve(self, rhs: ArrayLike, refinements: int | None = None) -> NDArray[np.float64]:
        """x with K x = f for f (N,) or (N, k), in the same shape; held unknowns are 0.

        `refinements`: steps of iterative refinement; left out, none for a definite factor and as
        many (at most 4) as still reduce the residual otherwise. A singular K answers consistent
        loads with one of the solutions.
        Raises SingularMatrixError for other loads, FactorError for a wrong shape.
        """
        load = np.asarray(rhs, dtype=np.float64)
        if load.shape[:1] != (self.size,) or load.ndim > 2:
            raise FactorError(
                f'right-hand side of shape {load.shape}, needed are {self.size} rows'
            )
        columns = load.reshape(self.size, -1)
        x = self._solve_once(columns, check=True)
        steps = (0 if self.definite else 4) if refinements is None else refinements
        if steps:
            x = self._refined(columns, x, steps, until_exact=refinements is None)
        return x.reshape(load.shape)

    def refine(self, rhs: ArrayLike, x: ArrayLike, steps: int = 1) -> NDArray[np.float64]:
        """`x` improved by `steps` of iterative refinement against f (N,) or (N, k)."""
        load = np.asarray(rhs, dtype=np.float64)
        start = np.array(x, dtype=np.float64).reshape(self.size, -1)
        columns = load.reshape(self.size, -1)
        return self._refined(columns, start, steps, until_exact=False).reshape(load.shape)

    def residual(self, rhs: ArrayLike, x: ArrayLike) -> float:
        """max |f - K x| / (|K| max |x| + max |f|) over the free unknowns, |K| in the max norm."""
        load = np.asarray(rhs, dtype=np.float64).reshape(self.size, -1)
        solution = np.asarray(x, dtype=np.float64).reshape(self.size, -1)
        rest = np.where(self.free[:, None], load - self.matrix @ solution, 0.0)
        return float(np.max(self._relative(rest, load, solution), initial=0.0))

    def zero_modes(self) -> NDArray[np.float64]:
        """Basis (N, inertia.zero) of the null space of K."""
        vectors = self._weak_vectors[:, np.abs(self._weak_values) <= ZERO_EIGENVALUE]
        return self.weak_modes @ vectors

    def _relative(
        self,
        rest: NDArray[np.float64],
        load: NDArray[np.float64],
        x: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Residual of each column relative to |K| |x| + |f|."""
        size = self.norm * np.max(np.abs(x), axis=0) + np.max(np.abs(load), axis=0)
        return np.max(np.abs(rest), axis=0) / np.where(size > 0.0, size, 1.0)

    def _refined(
        self,
        load: NDArray[np.float64],
        x: NDArray[np.float64],
        steps: int,
        until_exact: bool,
    ) -> NDArray[np.float64]:
        """Iterative refinement; with `until_exact` it stops when nothing is gained."""
        best, smallest = x, np.inf
        for step in range(steps + 1):
            rest = np.where(self.free[:, None], load - self.matrix @ x, 0.0)
            error = float(np.max(self._relative(rest, load, x), initial=0.0))
            if until_exact and not error < 0.5 * smallest:
                return x if error < smallest else best
            best, smallest = x, error
            if step == steps or (until_exact and error <= REFINED):
                return x
            x = x + self._solve_once(rest, check=False)
        return best

    def _solve_once(self, load: NDArray[np.float64], check: bool) -> NDArray[np.float64]:
        """One solve through the strong and the weak part."""
        x, along = self.partial_solve(load)
        if len(self._weak_values) == 0:
            return x
        zero = np.abs(self._weak_values) <= ZERO_EIGENVALUE
        components = self._weak_vectors.T @ along
        if check and np.any(zero):
            modes = self.weak_modes @ self._weak_vectors[:, zero]
            reach = np.abs(modes).T @ np.abs(load)
            if np.any(np.abs(components[zero]) > CONSISTENT * reach):
                raise SingularMatrixError(self._singular_message(), self.weak_unknowns)
        amounts = np.zeros_like(components)
        amounts[~zero] = components[~zero] / self._weak_values[~zero, None]
        solution: NDArray[np.float64] = x + self.weak_modes @ (self._weak_vectors @ amounts)
        return solution

    def _singular_message(self) -> str:
        """What is singular, where, and the way out."""
        named = ', '.join(str(i) for i in self.weak_unknowns[:12])
        return (
            f'the matrix has {self.inertia.zero} zero eigenvalues (pivots vanish at unknowns '
            f'{named}) and the load works on these modes: add supports, balance the load, or '
            'border the system'
        )

    def _set_weak(
        self,
        unknowns: NDArray[np.int64],
        matrix: NDArray[np.float64],
        modes: NDArray[np.float64],
        gram: NDArray[np.float64],
    ) -> None:
        """Keep the weak part and its Rayleigh-Ritz values, with `gram` = Z^T Z of scaled modes.

        Divided by the modes' length the weak values are eigenvalues of the equilibrated matrix (up
        to second order), which can be told from rounding; those of R alone cannot.
        """
        self.weak_unknowns, self.weak_matrix, self.weak_modes = unknowns, matrix, modes
        self._weak_values, self._weak_vectors = scipy.linalg.eigh(matrix, gram)
