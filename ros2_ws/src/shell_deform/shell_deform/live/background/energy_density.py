# SPDX-License-Identifier: Apache-2.0
"""Where the strain energy sits: a density per control vertex, to colour the nonlinear answer."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.model import ShellModel
from shell_deform.theory import KOITER, THEORIES, THICK

Array = NDArray[np.float64]


class EnergyDensity:
    """Strain energy per undeformed area of a shell's middle surface [J/m^2], vertex by vertex.

    The value of a vertex is the mean over its basis function, so that the values weighted with the
    areas of the basis functions add up to the strain energy.
    """

    def __init__(self, model: ShellModel) -> None:
        shell = model.shell
        points, vertices = len(shell.weights), len(model.rest)
        self._model = model
        self._derivatives = sp.vstack(
            [
                sp.csr_matrix((column, shell.row_nodes, shell.row_offsets), (points, vertices))
                for column in shell.rows.T
            ],
            format='csr',
        )
        shares = sp.diags(shell.weights) @ shell.value_matrix()
        self.areas: Array = np.asarray(shares.sum(axis=0)).ravel()
        """(n,) area [m^2] of each basis function; 0 where a vertex carries no surface."""
        scale = np.divide(1.0, self.areas, out=np.zeros(vertices), where=self.areas > 0.0)
        self._means = (sp.diags(scale) @ shares.T).tocsr()

    def at(self, positions: Array) -> Array:
        """(n,) density [J/m^2] at control positions (n, 3) [m].

        That of a thick wall is taken as if it were thin: it only colours the surface.
        """
        shell = self._model.shell
        q = (self._derivatives @ positions).reshape(5, -1, 3).transpose(1, 0, 2)
        theory = KOITER if self._model.theory == THICK else self._model.theory
        strain = THEORIES[theory].strains(q, shell.reference)
        membrane, change = strain[:, :3, None], strain[:, 3:, None]
        energy = 0.5 * ((shell.membrane @ membrane) * membrane).sum(axis=(1, 2))
        energy += 0.5 * ((shell.bending @ change) * change).sum(axis=(1, 2))
        return np.asarray(self._means @ energy)
