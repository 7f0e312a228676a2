# SPDX-License-Identifier: Apache-2.0
"""Strain measures of thin shells, each as a function of the surface derivatives at a point.

A theory maps the five derivative vectors of the deformed middle surface, taken in the orthonormal
reference frame of the point, ``q = (a_1, a_2, a_11, a_12, a_22)``, to six strains
``(e_11, e_22, 2 e_12, k_11, k_22, 2 k_12)``: membrane strain [-] and curvature change [1/m].
All measures here are tensors of the reference surface, so the frame may be any orthonormal tangent
frame: the principal frame of the paper gives the same energy where it exists, and umbilic points,
as everywhere on a sphere, need no special case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shell_deform.theory import koiter, linear, paper

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Theory:
    """A strain measure: its kernel code and its plain numpy functions."""

    code: int
    strains: Callable[..., Array]
    jacobian: Callable[..., Array]
    hessian: Callable[..., Array]
    is_linear: bool = False


THEORIES = {
    'linear': Theory(0, linear.strains, linear.jacobian, linear.hessian, is_linear=True),
    'paper': Theory(1, paper.strains, paper.jacobian, paper.hessian),
    'paper_restored': Theory(
        2,
        partial(paper.strains, restore_curvature_terms=True),
        partial(paper.jacobian, restore_curvature_terms=True),
        paper.hessian,
    ),
    'koiter': Theory(3, koiter.strains, koiter.jacobian, koiter.hessian),
}

KOITER = 'koiter'
"""The thin wall: Green-Lagrange strain and change of curvature."""

THICK = 'thick'
"""Transverse shear, changing thickness and a neo-Hookean wall: `thick_law_kernels`."""

AUTO = 'auto'
"""`thick` where a thin wall would be off by more than `thin_wall.WORTH_A_THICK_WALL`."""

DEFAULT_THEORY = AUTO
"""What nodes, commands and `load` solve by where nobody chooses."""

THEORY_NAMES = (*sorted(THEORIES), THICK)
"""Every theory a model can have."""


def is_linear(theory: str) -> bool:
    """Whether a theory is linear in the displacement."""
    return theory in THEORIES and THEORIES[theory].is_linear
