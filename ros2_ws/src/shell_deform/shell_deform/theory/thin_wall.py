# SPDX-License-Identifier: Apache-2.0
"""How thin a wall must be: what Kirchhoff-Love theory costs against a solid.

A thin-shell wall does not shear and does not give under the pin, so a solid of the same rubber is
softer. `shell_verify --solid` measures by how much on spheres of R/h from 6 to 100.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.theory.reference import sharpest_curvature

Array = NDArray[np.float64]

EXCESS = 1.5
"""Excess stiffness per thickness over R + h, from `shell_verify --solid`."""

THICK_ERROR, THICK_ERROR_AT = 0.025, 12.5
"""Relative error of the force of a thick wall at this R/h, against solids."""

THICKEST = 1.0 / 6.0
"""Thickness over radius of the thickest wall that was compared with solids."""

WORTH_A_WARNING = 0.05

WORTH_A_THICK_WALL = 0.02
"""Theory `auto` takes `thick` where `koiter` would be off by more."""


def excess_stiffness(thickness_over_radius: float) -> float:
    """Share by which a thin shell is stiffer than a solid, under a pin at small loads.

    1.5 h / (R + h) for a middle radius R: 11 % at R/h 12.5, 5 % at 29, 1.5 % at 100. It is the
    largest share: from R/h 12 on a quarter to a half of it is gone in a dent as deep as the wall
    is thick. Measured on nearly incompressible spheres under pins of 0.23 sqrt(R h).
    """
    return EXCESS * thickness_over_radius / (1.0 + thickness_over_radius)


def thick_wall_error(thickness_over_radius: float) -> float:
    """Largest relative error of the force of a thick wall, either way, from 0.5 mm of travel on.

    2.5 % at R/h 12.5, 0.9 % at 25, 8 % at 6: `shell_verify --group thick` against solids under
    rigid pins, which it is fitted to.
    """
    return THICK_ERROR * (THICK_ERROR_AT * thickness_over_radius) ** 1.5


def thickness_over_radius(mean: Array, gauss: Array, thickness: Array) -> float:
    """Thickness over the smaller radius of curvature; 95 % of the p places are below it.

    `mean`, `gauss` (p,): curvatures [1/m], [1/m^2]. `thickness` (p,) [m].
    """
    return float(np.quantile(thickness * sharpest_curvature(mean, gauss), 0.95))


def thick_wall_warning(ratio: float) -> str | None:
    """A sentence with the expected error when the wall is too thick for the theory, else None."""
    excess = excess_stiffness(ratio)
    if excess <= WORTH_A_WARNING:
        return None
    enough = EXCESS / WORTH_A_WARNING - 1.0
    return (
        f'the wall is {ratio:.2g} of the radius of curvature: thin-shell theory is about '
        f'{100.0 * excess:.0f} % too stiff against a solid at small loads (5 % at R/h '
        f'{enough:.0f}), less in deep dents; a modulus identified with this model absorbs it'
    )
