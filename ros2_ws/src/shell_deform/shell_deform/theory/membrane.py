# SPDX-License-Identifier: Apache-2.0
"""Green-Lagrange membrane strain: paper equations (9)-(11) with omega of (5), (6) in their places.

The paper prints omega_1 and omega_2 swapped relative to their use in (9)-(17). With
``omega_1 = t_1[beta] - (grad_t1 t_2 . t_1) alpha`` and ``omega_2`` accordingly, (9) and (10) are
exactly ``(a_i . a_i - 1) / 2`` and (11) is exactly ``a_1 . a_2``, whatever the frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def strains(q: Array) -> Array:
    """(p, 3) strains e_11, e_22, 2 e_12 [-] of derivative vectors q (p, 5, 3)."""
    a_1, a_2 = q[:, 0], q[:, 1]
    dot = np.einsum
    return np.stack(
        [
            0.5 * (dot('pi,pi->p', a_1, a_1) - 1.0),
            0.5 * (dot('pi,pi->p', a_2, a_2) - 1.0),
            dot('pi,pi->p', a_1, a_2),
        ],
        axis=1,
    )


def jacobian(q: Array) -> Array:
    """(p, 3, 5, 3) derivative of the strains with respect to q."""
    result = np.zeros((len(q), 3, 5, 3))
    result[:, 0, 0] = q[:, 0]
    result[:, 1, 1] = q[:, 1]
    result[:, 2, 0] = q[:, 1]
    result[:, 2, 1] = q[:, 0]
    return result


def add_hessian(hessian: Array, force: Array) -> None:
    """Add sum_k force_k d2(strain_k)/dq2 to hessian (p, 5, 3, 5, 3); force (p, 3)."""
    for i in range(3):
        hessian[:, 0, i, 0, i] += force[:, 0]
        hessian[:, 1, i, 1, i] += force[:, 1]
        hessian[:, 0, i, 1, i] += force[:, 2]
        hessian[:, 1, i, 0, i] += force[:, 2]
