# SPDX-License-Identifier: Apache-2.0
"""The equations of the contact pressures under the pins of a thick wall, cell by cell.

A cell is the part of an element that a pin covers; its pressure p, one number, closes the gap
m(u, p) between the outer face and the pin in the mean. No row of the stiffness belongs to it: the
tangent eliminates it with m = 0 linearised, dp = (m + B^T du) / S. Iterations on a tangent that
is kept must use its own B and S for that: a pressure is stiff, and multiplies what differs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class PressureEquations:
    """The equations of c cells at one state, linearised.

    Attributes:
        missing: (c,) gap over the cell [m^3]. soft: (c,) minus its derivative by the pressure
            [m^3/Pa]. reach: (c, w) its derivative by the unknowns `unknowns` (c, w) of the element
            [m^2]. dofs: (c,) the pressures among all unknowns, `unit` [Pa/m] each. share: of the
            modulus with which the wall answers.
    """

    missing: Array
    soft: Array
    reach: Array
    unknowns: Index
    dofs: Index
    unit: float
    share: float = 1.0

    def pull(self, missing: Array, size: int) -> Array:
        """(size,) gradient [N] of closing the gaps `missing` (c,) by pressure."""
        force = (self.share * missing / self.soft)[:, None] * self.reach
        result = np.zeros(size)
        np.add.at(result, self.unknowns, force)
        return result

    def followed(self, step: Array, missing: Array) -> Array:
        """`step` (N,) of the unknowns with the pressures' own, from the gaps `missing` (c,)."""
        result = step.copy()
        gap = missing + (self.reach * step[self.unknowns]).sum(axis=1)
        result[self.dofs] += gap / self.soft / self.unit
        return result
