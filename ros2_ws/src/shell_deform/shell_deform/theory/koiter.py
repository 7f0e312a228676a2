# SPDX-License-Identifier: Apache-2.0
"""Koiter's measure, the default: Green-Lagrange strain and change of the second fundamental form.

Both are invariant under rigid motion (shell_theory: E_ab = (a_ab - A_ab) / 2, K_ab = b_ab - B_ab
with the unit normal of the deformed surface). Plain numpy; `theory.kernels` holds the compiled
twin. W. T. Koiter, "On the nonlinear theory of thin elastic shells", 1966.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.theory import membrane
from shell_deform.theory.reference import ReferencePoints

Array = NDArray[np.float64]


def cross_matrix(v: Array) -> Array:
    """(p, 3, 3) matrices with cross_matrix(v) @ w = v x w."""
    result = np.zeros((*v.shape, 3), dtype=v.dtype)
    result[..., 0, 1], result[..., 0, 2], result[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    result[..., 1, 0], result[..., 2, 0], result[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return result


def _normal(q: Array) -> tuple[Array, Array]:
    """Unit normal (p, 3) and area stretch |a_1 x a_2| (p,)."""
    m = np.cross(q[:, 0], q[:, 1])
    stretch = np.sqrt(np.einsum('pi,pi->p', m, m))
    return m / stretch[:, None], stretch


def _normal_gradient(q: Array, normal: Array, stretch: Array) -> tuple[Array, Array]:
    """Derivatives (p, 3, 3) of the unit normal with respect to a_1 and a_2."""
    projector = (np.eye(3) - normal[:, :, None] * normal[:, None, :]) / stretch[:, None, None]
    return -projector @ cross_matrix(q[:, 1]), projector @ cross_matrix(q[:, 0])


def strains(q: Array, reference: ReferencePoints) -> Array:
    """(p, 6) strains of derivative vectors q (p, 5, 3)."""
    normal, _ = _normal(q)
    change = np.einsum('pci,pi->pc', q[:, 2:], normal) - reference.curvature
    bending = np.stack([change[:, 0], change[:, 2], 2.0 * change[:, 1]], axis=1)
    return np.concatenate([membrane.strains(q), bending], axis=1)


def jacobian(q: Array, reference: ReferencePoints) -> Array:
    """(p, 6, 5, 3) derivative of the strains with respect to q."""
    normal, stretch = _normal(q)
    by_1, by_2 = _normal_gradient(q, normal, stretch)
    result = np.zeros((len(q), 6, 5, 3))
    result[:, :3] = membrane.jacobian(q)
    for row, vector, factor in ((3, 2, 1.0), (4, 4, 1.0), (5, 3, 2.0)):
        result[:, row, 0] = factor * np.einsum('pi,pij->pj', q[:, vector], by_1)
        result[:, row, 1] = factor * np.einsum('pi,pij->pj', q[:, vector], by_2)
        result[:, row, vector] = factor * normal
    return result


def hessian(q: Array, reference: ReferencePoints, stress: Array) -> Array:
    """(p, 5, 3, 5, 3) sum_k stress_k d2(strain_k)/dq2; stress (p, 6)."""
    normal, stretch = _normal(q)
    by_1, by_2 = _normal_gradient(q, normal, stretch)
    result = np.zeros((len(q), 5, 3, 5, 3))
    membrane.add_hessian(result, stress[:, :3])
    for row, vector, factor in ((3, 2, 1.0), (4, 4, 1.0), (5, 3, 2.0)):
        moment = (factor * stress[:, row])[:, None, None]
        for column, gradient in ((0, by_1), (1, by_2)):
            result[:, vector, :, column] += moment * gradient
            result[:, column, :, vector] += moment * np.swapaxes(gradient, 1, 2)
    # f = c . n with c fixed: f j = c . (a_1 x a_2), j the area stretch, differentiated twice.
    c = (
        stress[:, 3, None] * q[:, 2]
        + stress[:, 4, None] * q[:, 4]
        + 2.0 * stress[:, 5, None] * q[:, 3]
    )
    f = np.einsum('pi,pi->p', c, normal)
    f_by = (np.einsum('pi,pij->pj', c, by_1), np.einsum('pi,pij->pj', c, by_2))
    j_by = (np.cross(q[:, 1], normal), np.cross(normal, q[:, 0]))
    m_by = (-cross_matrix(q[:, 1]), cross_matrix(q[:, 0]))
    n_by = (by_1, by_2)
    for x in range(2):
        for y in range(2):
            j_xy = np.swapaxes(m_by[x], 1, 2) @ n_by[y]
            g_xy = np.zeros_like(j_xy)
            if x != y:
                sign = -1.0 if x == 0 else 1.0
                j_xy = j_xy + sign * cross_matrix(normal)
                g_xy = sign * cross_matrix(c)
            result[:, x, :, y] += (
                g_xy
                - f[:, None, None] * j_xy
                - j_by[x][:, :, None] * f_by[y][:, None, :]
                - f_by[x][:, :, None] * j_by[y][:, None, :]
            ) / stretch[:, None, None]
    return result
