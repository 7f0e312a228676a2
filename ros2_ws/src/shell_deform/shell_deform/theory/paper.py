# SPDX-License-Identifier: Apache-2.0
"""The paper's nonlinear strains, equations (3)-(20), for an arbitrary parametric middle surface.

With the misprint of (5), (6) corrected, (12)-(14) say that the deformed fibre is
``m = a_1 x a_2`` (not normalised) and (15)-(17) are ``zeta_ij = a_i . D_j (m - n)``, symmetrised.
Since ``a_i . D_j m = -a_ij . m`` these need no derivative of the frame, and the printed form reads

    zeta_ij = -(a_ij . m) + sym(a_i . t_k B_kj).

The paper drops products of z with the principal curvatures. Restoring them
(`restore_curvature_terms`) replaces ``a_i . t_k B_kj`` by ``B_ij``: exact to first order in z and
invariant under rotation, which the printed form is not. The strains here are ``-zeta`` so that all
theories share the sign of the second fundamental form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.theory import membrane
from shell_deform.theory.koiter import cross_matrix
from shell_deform.theory.reference import ReferencePoints

Array = NDArray[np.float64]


def curvature_of_frame(reference: ReferencePoints) -> tuple[Array, Array]:
    """Vectors (p, 3) B_1k t_k and B_2k t_k: minus the derivatives of the undeformed normal."""
    b = reference.curvature
    t_1, t_2 = reference.tangents[:, 0], reference.tangents[:, 1]
    return b[:, 0, None] * t_1 + b[:, 1, None] * t_2, b[:, 1, None] * t_1 + b[:, 2, None] * t_2


def strains(q: Array, reference: ReferencePoints, restore_curvature_terms: bool = False) -> Array:
    """(p, 6) strains of derivative vectors q (p, 5, 3)."""
    m = np.cross(q[:, 0], q[:, 1])
    change = np.einsum('pci,pi->pc', q[:, 2:], m)
    if restore_curvature_terms:
        change = change - reference.curvature
    else:
        k_1, k_2 = curvature_of_frame(reference)
        dot = np.einsum
        change = change - np.stack(
            [
                dot('pi,pi->p', q[:, 0], k_1),
                0.5 * (dot('pi,pi->p', q[:, 0], k_2) + dot('pi,pi->p', q[:, 1], k_1)),
                dot('pi,pi->p', q[:, 1], k_2),
            ],
            axis=1,
        )
    bending = np.stack([change[:, 0], change[:, 2], 2.0 * change[:, 1]], axis=1)
    return np.concatenate([membrane.strains(q), bending], axis=1)


def jacobian(q: Array, reference: ReferencePoints, restore_curvature_terms: bool = False) -> Array:
    """(p, 6, 5, 3) derivative of the strains with respect to q."""
    result = np.zeros((len(q), 6, 5, 3))
    result[:, :3] = membrane.jacobian(q)
    m = np.cross(q[:, 0], q[:, 1])
    for row, vector, factor in ((3, 2, 1.0), (4, 4, 1.0), (5, 3, 2.0)):
        result[:, row, 0] = factor * np.cross(q[:, 1], q[:, vector])
        result[:, row, 1] = factor * np.cross(q[:, vector], q[:, 0])
        result[:, row, vector] = factor * m
    if not restore_curvature_terms:
        k_1, k_2 = curvature_of_frame(reference)
        result[:, 3, 0] -= k_1
        result[:, 4, 1] -= k_2
        result[:, 5, 0] -= k_2
        result[:, 5, 1] -= k_1
    return result


def hessian(q: Array, reference: ReferencePoints, stress: Array) -> Array:
    """(p, 5, 3, 5, 3) sum_k stress_k d2(strain_k)/dq2; the same with restored terms."""
    result = np.zeros((len(q), 5, 3, 5, 3))
    membrane.add_hessian(result, stress[:, :3])
    by_1, by_2 = -cross_matrix(q[:, 1]), cross_matrix(q[:, 0])
    c = np.zeros((len(q), 3))
    for row, vector, factor in ((3, 2, 1.0), (4, 4, 1.0), (5, 3, 2.0)):
        moment = factor * stress[:, row]
        c += moment[:, None] * q[:, vector]
        for column, gradient in ((0, by_1), (1, by_2)):
            result[:, vector, :, column] += moment[:, None, None] * gradient
            result[:, column, :, vector] += moment[:, None, None] * np.swapaxes(gradient, 1, 2)
    result[:, 0, :, 1] -= cross_matrix(c)
    result[:, 1, :, 0] += cross_matrix(c)
    return result
