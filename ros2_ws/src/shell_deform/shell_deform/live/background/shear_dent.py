# SPDX-License-Identifier: Apache-2.0
"""What a thin wall has not: the shear dent that a pin makes before it bends anything.

A part of a pin's travel shears the wall around it. A plate that shears under a load F over a
circle of radius r gives way there by F / (2 pi 5/6 G h) (ln(a / r) + 1/2) against a circle of
radius a (Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells, section 20); a dent of a
shell ends at about a = sqrt(R h). Kirchhoff-Love theory spends that part on bending: its surface
is where it would have been without, moved on as further travel moves it. Nothing here is fitted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.model import ShellModel
from shell_deform.readout import wall_ratio

Array = NDArray[np.float64]

SHEAR_CORRECTION = 5.0 / 6.0


class ShearDent:
    """Of one thin shell, under any pins."""

    def __init__(self, model: ShellModel) -> None:
        wall = float(model.shell.thickness.mean())
        # On a flat wall a dent reaches as far as the wall.
        size = float(np.ptp(model.rest, axis=0).max())
        self._reach = wall / max(np.sqrt(wall_ratio(model)), wall / size)
        self._stiffness = SHEAR_CORRECTION * float(model.shell.membrane[:, 2, 2].mean())

    def travel(self, force: Array, radius: Array) -> Array:
        """Part (k,) [m] of the travel of pins (k,) [m] that bends nothing under (k,) [N]."""
        spread = np.log(np.maximum(self._reach / radius, 1.0)) + 0.5
        return np.asarray(np.abs(force) * spread / (2.0 * np.pi * self._stiffness))

    def sigma(
        self, force: Array, radius: Array, columns: Array, displacement_by: Array, normals: Array
    ) -> Array:
        """Sigma (n,) [m] of a thin wall's shape along its normals (n, 3).

        `columns` (n, 3, k): motion of the surface per unit push, `displacement_by` (k, k) that of
        the pins. What moves along the surface leaves its shape, as in all other parts of sigma.
        """
        push = np.linalg.lstsq(displacement_by, self.travel(force, radius), rcond=None)[0]
        return np.asarray(np.abs(np.einsum('ni,nij,j->n', normals, columns, push)))
