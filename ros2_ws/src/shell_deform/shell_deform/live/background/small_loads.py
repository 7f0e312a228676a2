# SPDX-License-Identifier: Apache-2.0
"""First and second order of a shell's response in its loads, about rest.

Linear theory is the first; the gauge of its error, `linearity.py` of the tick, needs the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    # The tick reads the products of pairs and needs none of the solver: its process stays small.
    from shell_deform.live.background.condensed import CondensedSystem, ContactRows
    from shell_deform.model import ShellModel

Array = NDArray[np.float64]

ROUND_OFF = 1e-9
"""A compliance below this share of the largest is none [-]."""


@dataclass(frozen=True)
class SmallLoads:
    """First and second order of the displacements in the pushes, about rest.

    Attributes:
        compliance: (k, k) of the contact centres [m/N]. second_order: (k, k (k + 1) / 2) of the
            same [m/N^2], pairs i <= j.
        fields: (N, k) control point motion per unit push [m/N]. second_fields: (N, k (k + 1) / 2)
            [m/N^2].
    """

    compliance: Array
    second_order: Array
    fields: Array
    second_fields: Array

    def bend(self, direction: Array, driven: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Second order per squared step of the contacts along `direction` (k,).

        Returns the motion (N,) [1/m] and the change of the pushes (k,) [N/m^2]: those of `driven`
        contacts adapt, so that their centres keep to the step.
        """
        force = np.asarray(np.linalg.lstsq(self.compliance, direction, rcond=None)[0], float)
        products = pair_products(force)
        bend: Array = self.second_fields @ products
        push = np.zeros(len(force))
        if driven.any():
            beyond = (self.second_order @ products)[driven]
            less = np.linalg.lstsq(self.compliance[np.ix_(driven, driven)], beyond, rcond=None)[0]
            bend = bend - self.fields[:, driven] @ less
            push[driven] = -less
        return bend, push


def pair_products(force: Array) -> Array:
    """(k (k + 1) / 2,) products F_i F_j of pairs i <= j."""
    first, second = _pairs(len(force))
    return force[first] * force[second]


@lru_cache
def _pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the pairs i <= j."""
    return np.triu_indices(count)


def small_loads(
    model: ShellModel, rest: Array, system: CondensedSystem, rows: ContactRows
) -> SmallLoads:
    """Expansion about the unloaded unknowns `rest`, factorised in `system`.

    The third derivative of the energy along a direction is the second difference of its gradient.
    """
    fields = system.push_fields
    count = rows.contacts
    size = float(np.abs(fields).max(initial=0.0))
    step = 0.02 * float(model.shell.thickness.max()) / size if size > 0 else 0.0
    settled = model.shell.settled
    base = model.gradient(rest)[1]

    def bending(direction: Array) -> Array:
        offset = step * direction.reshape(-1, 3)
        forward = model.gradient(settled(rest + offset))[1]
        backward = model.gradient(settled(rest - offset))[1]
        return (forward + backward - 2.0 * base) / step**2

    first, second = _pairs(count)
    own = [bending(fields[:, i]) for i in range(count)]
    loads = np.zeros((fields.shape[0], len(first)))
    for p, (i, j) in enumerate(zip(first, second, strict=True)):
        if i == j:
            loads[:, p] = -0.5 * own[i]
        else:
            loads[:, p] = -0.5 * (bending(fields[:, i] + fields[:, j]) - own[i] - own[j])
    moved, _ = system.solve(loads, np.zeros((rows.constraints.shape[1], len(first))))
    return SmallLoads(system.compliance, rows.measure.T @ moved, fields, moved)


def snap_margin(small: SmallLoads | None, compliance: Array) -> float:
    """Smallest contact stiffness over that of the unloaded shell; 0 where it snaps.

    `compliance` (k, k) of the contacts now [m/N]; 1 where there are none, or rest is not known.
    """
    if small is None or not len(compliance):
        return 1.0
    return _smallest_stiffness(compliance) / _smallest_stiffness(small.compliance)


def _smallest_stiffness(compliance: Array) -> float:
    """Stiffness [N/m] along the softest combination of contacts; negative beyond a limit point."""
    values = np.linalg.eigvalsh(0.5 * (compliance + compliance.T))
    # Contacts in one place: that one pushes for the other moves nothing, but for round-off.
    if values[0] < -ROUND_OFF * abs(values[-1]):
        return 1.0 / float(values[0])
    return 1.0 / float(values[-1])
