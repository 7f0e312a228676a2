# SPDX-License-Identifier: Apache-2.0
"""The quartic box spline of a regular triangle patch: twelve points, one triangle.

The twelve points stand on the triangular lattice in the order in which a patch lists them:
the three corners (0, 0), (1, 0), (0, 1), then the rings of corner 0, 1 and 2 counter-clockwise.
Basis polynomials: J. Stam, Evaluation of Loop subdivision surfaces, SIGGRAPH 1998 course notes,
here rebuilt from their three symmetry types.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

LATTICE = (
    ((0, 0), (1, 0), (0, 1))
    + ((-1, 1), (-1, 0), (0, -1), (1, -1))
    + ((2, -1), (2, 0), (1, 1))
    + ((0, 2), (-1, 2))
)
"""Lattice position of each of the twelve points."""

EXPONENTS = tuple((i, j) for total in range(5) for i in range(total, -1, -1) for j in (total - i,))
"""Exponents (i, j) of the fifteen monomials u^i v^j."""

_BARYCENTRIC = ({(0, 0): 1.0, (1, 0): -1.0, (0, 1): -1.0}, {(1, 0): 1.0}, {(0, 1): 1.0})

# Each type lists (coefficient, power of a, power of b, power of c), twelve times the basis.
_CORNER = (
    [(6, 4, 0, 0), (24, 3, 1, 0), (24, 3, 0, 1), (24, 2, 2, 0), (24, 2, 0, 2), (60, 2, 1, 1)]
    + [(8, 1, 3, 0), (8, 1, 0, 3), (36, 1, 2, 1), (36, 1, 1, 2), (1, 0, 4, 0), (1, 0, 0, 4)]
    + [(6, 0, 3, 1), (6, 0, 1, 3), (12, 0, 2, 2)]
)
_ACROSS = [(1, 0, 4, 0), (1, 0, 0, 4), (6, 0, 3, 1), (6, 0, 1, 3), (12, 0, 2, 2)] + [
    (2, 1, 3, 0),
    (2, 1, 0, 3),
    (6, 1, 2, 1),
    (6, 1, 1, 2),
]
_OUTER = [(1, 4, 0, 0), (2, 3, 1, 0)]

# Type and the roles (a, b, c) played by the barycentric coordinates of corners 0, 1, 2.
_POINTS = (
    ((_CORNER, (0, 1, 2)), (_CORNER, (1, 2, 0)), (_CORNER, (2, 0, 1)))
    + ((_ACROSS, (1, 0, 2)), (_OUTER, (0, 2, 1)), (_OUTER, (0, 1, 2)), (_ACROSS, (2, 0, 1)))
    + ((_OUTER, (1, 0, 2)), (_OUTER, (1, 2, 0)), (_ACROSS, (0, 1, 2)))
    + ((_OUTER, (2, 1, 0)), (_OUTER, (2, 0, 1)))
)


def _product(
    first: dict[tuple[int, int], float], second: dict[tuple[int, int], float]
) -> dict[tuple[int, int], float]:
    result: dict[tuple[int, int], float] = {}
    for (i, j), a in first.items():
        for (k, m), b in second.items():
            result[i + k, j + m] = result.get((i + k, j + m), 0.0) + a * b
    return result


def _coefficients() -> FloatArray:
    rows = np.zeros((12, len(EXPONENTS)))
    for row, (terms, roles) in zip(rows, _POINTS, strict=True):
        for coefficient, *powers in terms:
            polynomial = {(0, 0): coefficient / 12.0}
            for role, power in zip(roles, powers, strict=True):
                for _ in range(power):
                    polynomial = _product(polynomial, _BARYCENTRIC[role])
            for exponent, value in polynomial.items():
                row[EXPONENTS.index(exponent)] += value
    rows.setflags(write=False)
    return rows


COEFFICIENTS = _coefficients()
"""(12, 15) monomial coefficients of the twelve basis polynomials."""


def _derivative_tables() -> FloatArray:
    """(6, 12, 15) coefficients of value, d/du, d/dv, d2/du2, d2/dudv, d2/dv2."""
    tables = np.zeros((6, 12, len(EXPONENTS)))
    for order, (du, dv) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
        for column, (i, j) in enumerate(EXPONENTS):
            if i < du or j < dv:
                continue
            factor = np.prod(np.arange(i - du + 1, i + 1)) * np.prod(np.arange(j - dv + 1, j + 1))
            tables[order, :, EXPONENTS.index((i - du, j - dv))] += factor * COEFFICIENTS[:, column]
    tables.setflags(write=False)
    return tables


DERIVATIVES = _derivative_tables()
"""(6, 12, 15) monomial coefficients of value, u, v, uu, uv and vv derivative."""


def box_spline(parameters: FloatArray) -> FloatArray:
    """Values and derivatives of the twelve basis functions.

    Args:
        parameters: (p, 2) barycentric parameters (u, v) of the triangle.

    Returns:
        (p, 12, 6): value, d/du, d/dv, d2/du2, d2/dudv, d2/dv2 of each basis function.
    """
    u, v = parameters[:, 0], parameters[:, 1]
    monomials = np.stack([u**i * v**j for i, j in EXPONENTS], axis=1)
    table = DERIVATIVES.transpose(2, 1, 0).reshape(len(EXPONENTS), -1)
    return (monomials @ table).reshape(-1, 12, 6)
