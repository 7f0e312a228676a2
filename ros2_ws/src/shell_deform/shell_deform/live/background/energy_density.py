# SPDX-License-Identifier: Apache-2.0
"""Where the strain energy sits: a density per control vertex, to colour the nonlinear answer."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.model import ShellModel
from shell_deform.theory import KOITER, THICK

Array = NDArray[np.float64]


class EnergyDensity:
    """Strain energy per undeformed area of a shell's middle surface [J/m^2], vertex by vertex.

    The value of a vertex is the mean over its basis function, so that the values weighted with the
    areas of the basis functions add up to the strain energy.
    """

    def __init__(self, model: ShellModel) -> None:
        shell = model.shell
        self._model = model
        values = shell.value_matrix()
        shares = sp.diags(shell.weights) @ values
        self.areas: Array = np.asarray(shares.sum(axis=0)).ravel()
        """(n,) area [m^2] of each basis function; 0 where a vertex carries no surface."""
        scale = np.divide(1.0, self.areas, out=np.zeros(len(self.areas)), where=self.areas > 0.0)
        self._means = (sp.diags(scale) @ values.T).tocsr()

    def at(self, positions: Array) -> Array:
        """(n,) density [J/m^2] at control positions (n, 3) [m].

        That of a thick wall is taken as if it were thin: it only colours the surface.
        """
        theory = KOITER if self._model.theory == THICK else self._model.theory
        return np.asarray(self._means @ self._model.shell.point_energies(theory, positions))
