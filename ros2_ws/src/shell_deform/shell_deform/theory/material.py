# SPDX-License-Identifier: Apache-2.0
"""Plane-stress law of an isotropic, linearly elastic shell wall (paper equation (21))."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


class MaterialError(ValueError):
    """A material constant outside what an isotropic solid can have."""


@dataclass(frozen=True)
class Material:
    """Isotropic wall: Young's modulus [Pa] and Poisson's ratio [-]."""

    young_modulus: float
    poisson_ratio: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.young_modulus) and self.young_modulus > 0):
            raise MaterialError(
                f"Young's modulus is {self.young_modulus} Pa; give a positive finite value in Pa"
            )
        if not -1.0 < self.poisson_ratio <= 0.5:
            raise MaterialError(
                f"Poisson's ratio is {self.poisson_ratio}; an isotropic solid has -1 < nu <= 0.5"
            )

    @property
    def plane_stress(self) -> NDArray[np.float64]:
        """Stiffness (3, 3) [Pa] from (e_11, e_22, 2 e_12) to stress (s_11, s_22, s_12)."""
        nu = self.poisson_ratio
        return (
            self.young_modulus
            / (1.0 - nu**2)
            * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]])
        )

    def bending_stiffness(self, thickness: float) -> float:
        """Plate stiffness E h^3 / (12 (1 - nu^2)) [N m] for a wall of `thickness` [m]."""
        return self.young_modulus * thickness**3 / (12.0 * (1.0 - self.poisson_ratio**2))
