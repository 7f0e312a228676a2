# SPDX-License-Identifier: Apache-2.0
"""Bordered systems and low-rank updates of a factorised matrix, with their inertia.

A bordered system [[K, C], [C^T, D]] serves displacement control, arc length and Lagrange
multipliers; an update K + V diag(c) V^T, a sealed gas or a penalty. Both are solved through the
factor of K alone. With the factor's strong part K+, weak modes Z and weak matrix R (see
`base.py`) the unknowns are x = K+ (f - C m) + Z a, and the border's m and a follow from

    [[D - C^T K+ C, C^T Z], [Z^T C, R]] [m, a] = [g - C^T K+ f, Z^T f],

which involves no inverse of R: a singular or nearly singular K (rigid modes, limit points) costs
no accuracy as long as the whole system is regular. An update is the border V with the corner
-diag(1/c). Inertias add (E. Haynsworth 1968, doi:10.1016/0024-3795(68)90050-5).

Borders that repeat each other, as those of two fingers in one place do, share what they carry, and
where they are given different values the mean counts: the least squares solution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shell_deform.factor.base import (
    REFINED,
    ZERO_EIGENVALUE,
    Factor,
    FactorError,
    Inertia,
    SingularMatrixError,
)

REFINEMENTS = 4

REPEATED = 1e-6
"""Part of an eigenvector of zero that borders which repeat each other have in anything else."""


class BorderedFactor:
    """Factor of [[K + V diag(c) V^T, C], [M^T, D]] from the factor of K, M = C unless given."""

    def __init__(
        self,
        factor: Factor,
        borders: ArrayLike | None = None,
        corner: ArrayLike | None = None,
        update_vectors: ArrayLike | None = None,
        update_coefficients: ArrayLike | None = None,
        measures: ArrayLike | None = None,
        loads: ArrayLike | None = None,
    ) -> None:
        """Borders C (N, k), symmetric corner D (k, k), default 0; update V (N, u), c (u,).

        `measures` M (N, k) are the lower borders where they differ: what is prescribed need not be
        what the multipliers work on. Such a matrix has no inertia.

        Rows of C and V at unknowns that the factor holds at zero are ignored.
        Raises FactorError for shapes that do not fit.
        """
        self.factor = factor
        size = factor.size
        own = _columns(borders, size, 'borders')
        updates = _columns(update_vectors, size, 'update_vectors')
        strengths = np.zeros(0) if update_coefficients is None else update_coefficients
        strengths = np.atleast_1d(np.asarray(strengths, dtype=np.float64))
        if strengths.shape != (updates.shape[1],):
            raise FactorError(
                f'{strengths.size} update coefficients for {updates.shape[1]} update vectors'
            )
        active = strengths != 0.0
        updates, strengths = updates[:, active], strengths[active]
        count = own.shape[1]
        inner = np.zeros((count, count)) if corner is None else np.asarray(corner, dtype=float)
        if inner.shape != (count, count) or not np.allclose(inner, inner.T, rtol=1e-12, atol=0.0):
            raise FactorError(f'corner: a symmetric ({count}, {count}) matrix is needed')
        self._count = count
        lower = own if measures is None else _columns(measures, size, 'measures')
        if lower.shape != own.shape:
            raise FactorError(f'{lower.shape[1]} measures for {count} borders')
        self._columns = np.where(factor.free[:, None], np.hstack([own, updates]), 0.0)
        self._rows = self._columns
        if measures is not None:
            self._rows = np.where(factor.free[:, None], np.hstack([lower, updates]), 0.0)
        total = self._columns.shape[1]
        self._corner = np.zeros((total, total))
        self._corner[:count, :count] = inner
        self._corner[range(count, total), range(count, total)] = -1.0 / strengths
        self._update_signs = Inertia(int(np.sum(strengths < 0.0)), int(np.sum(strengths > 0.0)), 0)
        known = _columns(loads, size, 'loads')
        strong, along = factor.partial_solve(
            np.hstack([self._columns, np.where(factor.free[:, None], known, 0.0)])
        )
        self._response, self._known = strong[:, :total], (strong[:, total:], along[:, total:])
        along = along[:, :total]
        small = np.block(
            [[self._corner - self._rows.T @ self._response, self._rows.T @ factor.weak_modes],
             [along, factor.weak_matrix]]
        )  # fmt: skip
        self._set_small(small)

    def _set_small(self, small: NDArray[np.float64]) -> None:
        """Eigenvalues of the small system after equilibration, singular values if unsymmetric."""
        symmetric = self._rows is self._columns
        if symmetric:
            small = 0.5 * (small + small.T)
        scale = np.ones(len(small))
        for _ in range(4):
            both = np.maximum(np.abs(small), np.abs(small.T)) * np.outer(scale, scale)
            largest = np.max(both, axis=1, initial=0.0)
            scale /= np.sqrt(np.where(largest > 0.0, largest, 1.0))
        self._scale = scale
        scaled = small * np.outer(scale, scale)
        if symmetric:
            self._values, self._vectors = np.linalg.eigh(scaled)
            self._left = self._vectors
        else:
            self._vectors, self._values, right = np.linalg.svd(scaled)
            self._left = right.T
        zero = np.abs(self._values) <= ZERO_EIGENVALUE
        self._repeated = 0
        if zero.any() and not np.abs(self._left[self._count :, zero]).max(initial=0.0) > REPEATED:
            # What has no part in any unknown or update: borders that say the same twice.
            self._repeated = int(zero.sum())
            self._values = np.where(zero, np.inf, self._values)

    @property
    def inertia(self) -> Inertia:
        """Inertia of the whole bordered (and updated) matrix over the free unknowns.

        A border that repeats others counts as a negative one, as each of these does. Raises
        FactorError for borders with other measures: that matrix is not symmetric.
        """
        if self._rows is not self._columns:
            raise FactorError('a bordered matrix with other measures is not symmetric')
        zero = np.abs(self._values) <= ZERO_EIGENVALUE
        positive = np.isfinite(self._values) & (self._values > 0.0) & ~zero
        return (
            self.factor.strong
            + Inertia(
                int(np.sum(positive)),
                int(np.sum((self._values < 0.0) & ~zero)) + self._repeated,
                int(np.sum(zero)),
            )
            - self._update_signs
        )

    def solve(
        self,
        rhs: ArrayLike,
        border_rhs: ArrayLike | None = None,
        refinements: int = REFINEMENTS,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x and multipliers m with (K + V c V^T) x + C m = f, C^T x + D m = g.

        f (N,) or (N, r); g (k,) or (k, r), default 0; x and m come in the same shapes.
        `refinements`: at most so many steps of iterative refinement, as long as they gain.
        Raises SingularMatrixError when the bordered system is singular.
        """
        load = np.asarray(rhs, dtype=np.float64)
        if load.shape[:1] != (self.factor.size,) or load.ndim > 2:
            raise FactorError(
                f'right-hand side of shape {load.shape}, needed are {self.factor.size} rows'
            )
        shape = (self._count, *load.shape[1:])
        f = np.where(self.factor.free[:, None], load.reshape(self.factor.size, -1), 0.0)
        g = np.zeros((len(self._corner), f.shape[1]))
        if border_rhs is not None:
            try:
                given = np.broadcast_to(border_rhs, shape)
                g[: self._count] = given.reshape(self._count, f.shape[1])
            except ValueError:
                raise FactorError(
                    f'border right-hand side of shape {np.shape(border_rhs)}, needed is {shape}'
                ) from None
        self._refuse_singular()
        x, m = self._solve_once(f, g)
        smallest = np.inf
        for _ in range(refinements):
            rest, border_rest, error = self._residual(f, g, x, m)
            if error <= REFINED or not error < 0.5 * smallest:
                break
            smallest = error
            dx, dm = self._solve_once(rest, border_rest)
            x, m = x + dx, m + dm
        return x.reshape(load.shape), m[: self._count].reshape(shape)

    def solve_loads(
        self, border_rhs: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`solve` without refinement for the `loads` of the constructor: x (N, l), m (k, l)."""
        strong, along = self._known
        g = np.zeros((len(self._corner), strong.shape[1]))
        g[: self._count] = border_rhs
        self._refuse_singular()
        x, m = self._close(strong, along, g)
        return x, m[: self._count]

    def _refuse_singular(self) -> None:
        zero = int(np.sum(np.abs(self._values) <= ZERO_EIGENVALUE))
        if zero:
            raise SingularMatrixError(
                f'the bordered matrix has {zero} zero eigenvalues: its borders do '
                'not hold every zero mode of the matrix; add a support or another border',
                self.factor.weak_unknowns,
            )

    def _solve_once(
        self, f: NDArray[np.float64], g: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Block elimination without refinement."""
        strong, along = np.zeros_like(f), np.zeros((self.factor.weak_modes.shape[1], f.shape[1]))
        loaded = np.any(f, axis=0)
        if loaded.any():
            strong[:, loaded], along[:, loaded] = self.factor.partial_solve(f[:, loaded])
        return self._close(strong, along, g)

    def _close(
        self, strong: NDArray[np.float64], along: NDArray[np.float64], g: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x and m from the strong and the weak part of the loads and the border's values g."""
        right = np.vstack([g - self._rows.T @ strong, along]) * self._scale[:, None]
        small = self._left @ ((self._vectors.T @ right) / self._values[:, None])
        small *= self._scale[:, None]
        m, weak = small[: len(g)], small[len(g) :]
        x = strong - self._response @ m + self.factor.weak_modes @ weak
        return x, m

    def _residual(
        self,
        f: NDArray[np.float64],
        g: NDArray[np.float64],
        x: NDArray[np.float64],
        m: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Residuals of both rows and the larger one relative to its terms."""
        elastic = self.factor.matrix @ x
        rest = np.where(self.factor.free[:, None], f - elastic - self._columns @ m, 0.0)
        border = g - self._rows.T @ x - self._corner @ m
        size = self.factor.norm * np.max(np.abs(x)) + np.max(np.abs(f)) + np.finfo(float).tiny
        reach = np.abs(self._rows).T @ np.abs(x) + np.abs(self._corner) @ np.abs(m) + np.abs(g)
        error = max(
            float(np.max(np.abs(rest)) / size),
            float(np.max(np.abs(border) / np.where(reach > 0.0, reach, 1.0), initial=0.0)),
        )
        return rest, border, error


def _columns(values: ArrayLike | None, size: int, name: str) -> NDArray[np.float64]:
    """Columns (size, k) from None, a vector or a matrix."""
    if values is None:
        return np.zeros((size, 0))
    columns = np.asarray(values, dtype=np.float64)
    columns = columns[:, None] if columns.ndim == 1 else columns
    if columns.ndim != 2 or len(columns) != size:
        raise FactorError(f'{name} of shape {columns.shape}, needed are {size} rows')
    return columns
