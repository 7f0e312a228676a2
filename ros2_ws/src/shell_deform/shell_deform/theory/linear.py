# SPDX-License-Identifier: Apache-2.0
"""The paper's small-deformation strains: equations (18)-(20) without products of displacements.

They are the first-order part of the paper's nonlinear strains at the undeformed surface, so one
set of derivatives serves both. A rigid rotation strains this theory: that is its limit, not a bug.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.theory import paper
from shell_deform.theory.reference import ReferencePoints

Array = NDArray[np.float64]


def jacobian(q: Array, reference: ReferencePoints) -> Array:
    """(p, 6, 5, 3) derivative of the strains with respect to q: that of the rest state."""
    return paper.jacobian(reference.derivatives, reference)


def strains(q: Array, reference: ReferencePoints) -> Array:
    """(p, 6) strains, linear in the displacement q - reference.derivatives."""
    return np.einsum(
        'pkai,pai->pk', jacobian(q, reference), q - reference.derivatives, optimize=True
    )


def hessian(q: Array, reference: ReferencePoints, stress: Array) -> Array:
    """(p, 5, 3, 5, 3) zeros: linear strains have no second derivative."""
    return np.zeros((len(q), 5, 3, 5, 3))
