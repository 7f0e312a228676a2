# SPDX-License-Identifier: Apache-2.0
"""Second-order-cone programmes of a few unknowns, in plain numpy: the twin of `cone_kernel`.

    minimise c x  subject to  A x = b,  x = (x_1, ..., x_k, u),  |x_i[1:]| <= x_i[0],  u >= 0

with k cones of four unknowns and l plain ones. Primal-dual interior point with the scaling of
Nesterov and Todd (Math. Oper. Res. 22, 1997) and the predictor and corrector of Mehrotra (SIAM J.
Optim. 2, 1992), started infeasible. The optimum is exact: no friction cone becomes a pyramid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONE = 4
"""Unknowns of one cone: push, two tangential forces, spin."""

MOST_ITERATIONS = 60
REGULAR = 1e-14
"""Share of the largest pivot below which a row counts as dependent on the others."""

BACK_OFF = 0.99
"""Share of the way to the edge of the cones that a step goes."""

NEAR = 1e5
"""A result whose errors are within so many tolerances still counts, where nothing moves on."""

STALE = 4
"""Iterations without a better result after which round-off rules."""


def solve_plain(
    cost: Array, matrix: Array, right: Array, cones: int, tolerance: float
) -> tuple[Array, Array, bool]:
    """Solution x (n,), multipliers y (m,) of the rows, and whether they are to `tolerance`.

    cost (n,), matrix (m, n), right (m,), the first 4 `cones` unknowns in cones.
    """
    # At the edge of the cones round-off ends it; the best until then is the answer.
    with np.errstate(all='ignore'):
        return _solve(cost, matrix, right, cones, tolerance)


def _solve(
    cost: Array, matrix: Array, right: Array, cones: int, tolerance: float
) -> tuple[Array, Array, bool]:
    n, m = len(cost), len(right)
    split = CONE * cones
    degree = 2.0 * cones + (n - split)
    unit = np.ones(n)
    unit[:split].reshape(cones, CONE)[:, 1:] = 0.0
    x, s, y = unit.copy(), unit.copy(), np.zeros(m)
    sizes = 1.0 + np.abs(right).max(initial=0.0), 1.0 + np.abs(cost).max(initial=0.0)
    best, stale = (x, y, np.inf), 0
    for _ in range(MOST_ITERATIONS):
        lacking = right - matrix @ x
        slack = cost - matrix.T @ y - s
        gap = float(x @ s) / degree
        value = abs(float(cost @ x))
        error = max(
            np.abs(lacking).max() / sizes[0], np.abs(slack).max() / sizes[1], gap / (1.0 + value)
        )
        if not (np.isfinite(error) and gap > 0.0):
            break
        if error < best[2]:
            best, stale = (x, y, error), 0
        stale += 1
        if error < tolerance or stale > STALE:
            break
        scaled, middle = _scaling(x, s, cones)
        weighted = _apply(scaled, matrix.T, cones, twice=True)
        factor = _factor(matrix @ weighted)
        dx, ds, dy = _direction(matrix, weighted, factor, lacking, slack, scaled, -middle, cones)
        reach = min(_reach(x, dx, cones), _reach(s, ds, cones), 1.0)
        left = float((x + reach * dx) @ (s + reach * ds)) / degree
        centre = (max(left, 0.0) / gap) ** 3
        bend = _product(_apply(scaled, dx, cones, inverse=True), _apply(scaled, ds, cones), cones)
        goal = centre * gap * unit - bend
        towards = _divide(middle, goal, cones) - middle
        share = 1.0 - centre
        dx, ds, dy = _direction(
            matrix, weighted, factor, share * lacking, share * slack, scaled, towards, cones
        )
        along, back = _reach(x, dx, cones), _reach(s, ds, cones)
        reach = min(BACK_OFF * min(along, back), 1.0)
        if not reach > 1e-10:
            break
        x, s, y = x + reach * dx, s + reach * ds, y + reach * dy
    return best[0], best[1], best[2] < NEAR * tolerance


def _direction(
    matrix: Array,
    weighted: Array,
    factor: Array,
    lacking: Array,
    slack: Array,
    scaled: Array,
    towards: Array,
    cones: int,
) -> tuple[Array, Array, Array]:
    """Newton step: A dx = lacking, A'dy + ds = slack, W^-1 dx + W ds = towards."""
    own = _apply(scaled, towards, cones)
    right = lacking - matrix @ own + weighted.T @ slack
    dy = np.linalg.solve(factor.T, np.linalg.solve(factor, right))
    ds = slack - matrix.T @ dy
    dx = own - _apply(scaled, ds, cones, twice=True)
    return dx, ds, dy


def _factor(normal: Array) -> Array:
    """Cholesky factor of the normal matrix; dependent rows get a pivot that leaves them alone."""
    size = len(normal)
    lower = np.zeros_like(normal)
    floor = REGULAR * float(np.diag(normal).max())
    for j in range(size):
        pivot = normal[j, j] - lower[j, :j] @ lower[j, :j]
        lower[j, j] = np.sqrt(pivot) if pivot > floor else 1e30
        for i in range(j + 1, size):
            lower[i, j] = (normal[i, j] - lower[i, :j] @ lower[j, :j]) / lower[j, j]
    return lower


def _scaling(x: Array, s: Array, cones: int) -> tuple[Array, Array]:
    """Scaling W (per cone: beta, w0, w1..w3; per plain unknown: w) and W s = W^-1 x."""
    scaled = np.zeros(5 * cones + len(x) - CONE * cones)
    for i in range(cones):
        a, b = x[CONE * i : CONE * i + CONE], s[CONE * i : CONE * i + CONE]
        length_a, length_b = _length(a), _length(b)
        a, b = a / length_a, b / length_b
        half = np.sqrt(0.5 * (1.0 + a @ b))
        mean = a.copy()
        mean[0] += b[0]
        mean[1:] -= b[1:]
        scaled[5 * i] = np.sqrt(length_a / length_b)
        scaled[5 * i + 1 : 5 * i + 5] = mean / (2.0 * half)
    scaled[5 * cones :] = np.sqrt(x[CONE * cones :] / s[CONE * cones :])
    return scaled, _apply(scaled, s, cones)


def _length(vector: Array) -> np.float64:
    """How far from the edge of its cone; numpy divides by 0 as the kernel does, not Python."""
    rest = np.linalg.norm(vector[1:])
    return np.float64(np.sqrt((vector[0] - rest) * (vector[0] + rest)))


def _apply(
    scaled: Array, vectors: Array, cones: int, inverse: bool = False, twice: bool = False
) -> Array:
    """W v, W^-1 v or W^2 v for vectors (n,) or (n, m)."""
    result = np.empty_like(vectors)
    for i in range(cones):
        part = slice(CONE * i, CONE * i + CONE)
        beta, w = scaled[5 * i], scaled[5 * i + 1 : 5 * i + 5].copy()
        v = vectors[part]
        if twice:
            turned = v.copy()
            turned[0] *= -1.0
            result[part] = beta**2 * (2.0 * np.multiply.outer(w, w @ v) + turned)
            continue
        if inverse:
            w[1:] *= -1.0
            beta = 1.0 / beta
        along = w[1:] @ v[1:]
        result[CONE * i] = beta * (w[0] * v[0] + along)
        result[CONE * i + 1 : CONE * i + CONE] = beta * (
            v[1:] + np.multiply.outer(w[1:], v[0] + along / (1.0 + w[0]))
        )
    tail = scaled[5 * cones :]
    tail = 1.0 / tail if inverse else tail
    tail = tail * tail if twice else tail
    plain = vectors[CONE * cones :]
    result[CONE * cones :] = tail * plain if vectors.ndim == 1 else tail[:, None] * plain
    return result


def _product(a: Array, b: Array, cones: int) -> Array:
    """Jordan product of a and b."""
    result = a * b
    for i in range(cones):
        part = slice(CONE * i, CONE * i + CONE)
        u, v = a[part], b[part]
        result[CONE * i] = u @ v
        result[CONE * i + 1 : CONE * i + CONE] = u[0] * v[1:] + v[0] * u[1:]
    return result


def _divide(a: Array, b: Array, cones: int) -> Array:
    """The v whose Jordan product with a is b."""
    result = np.empty_like(b)
    for i in range(cones):
        part = slice(CONE * i, CONE * i + CONE)
        u, v = a[part], b[part]
        size = _length(u) ** 2
        along = u[1:] @ v[1:]
        result[CONE * i] = (u[0] * v[0] - along) / size
        result[CONE * i + 1 : CONE * i + CONE] = (
            (along / u[0] - v[0]) * u[1:] + size / u[0] * v[1:]
        ) / size
    result[CONE * cones :] = b[CONE * cones :] / a[CONE * cones :]
    return result


def _reach(x: Array, step: Array, cones: int) -> float:
    """How much of `step` leads from x to the edge of the cones; infinite where none does."""
    reach = np.inf
    for i in range(cones):
        a = x[CONE * i : CONE * i + CONE]
        d = step[CONE * i : CONE * i + CONE]
        square = d[0] ** 2 - d[1:] @ d[1:]
        cross = a[0] * d[0] - a[1:] @ d[1:]
        room = _length(a) ** 2
        root = cross * cross - square * room
        if square < 0.0 or (cross < 0.0 and root >= 0.0):
            reach = min(reach, room / (np.sqrt(max(root, 0.0)) - cross))
    plain, change = x[CONE * cones :], step[CONE * cones :]
    shrinking = change < 0.0
    if np.any(shrinking):
        reach = min(reach, float((-plain[shrinking] / change[shrinking]).min()))
    return float(reach)
