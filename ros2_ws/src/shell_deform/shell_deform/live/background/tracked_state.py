# SPDX-License-Identifier: Apache-2.0
"""What a live equilibrium is asked for, and what it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from shell_deform.supports.grips import between

Array = NDArray[np.float64]


def _no_grips() -> Array:
    return np.zeros((0, 6))


@dataclass(frozen=True)
class Target:
    """What is prescribed at the k contacts, the r free rigid motions and the g grips.

    Attributes:
        force: (k,) push [N], read where the contact is not driven.
        displacement: (k,) centre displacement [m], read where it is driven.
        driven: (k,) whether the displacement is prescribed.
        rigid: (r,) amplitudes of the free rigid motions.
        held: (3 k,) lateral motions and spin at which the patches are held.
        grips: (g, 6) motions of the grips: shift [m], turn [rad].
    """

    force: Array
    displacement: Array
    driven: NDArray[np.bool_]
    rigid: Array
    held: Array
    grips: Array = field(default_factory=_no_grips)

    def towards(self, end: Target, share: float) -> Target:
        """What is prescribed at this share of the way to `end`."""
        held = end.held
        if len(self.held) == len(held):
            held = self.held + share * (held - self.held)
        return Target(
            self.force + share * (end.force - self.force),
            self.displacement + share * (end.displacement - self.displacement),
            end.driven,
            self.rigid + share * (end.rigid - self.rigid),
            held,
            between(self.grips, end.grips, share) if len(end.grips) else end.grips,
        )


@dataclass(frozen=True)
class State:
    """An equilibrium of the shell.

    Attributes:
        moved: (N,) displacement of the control points. force: (k,) pushes [N].
        multipliers: (3 k + r,) of the constraints. energy: [J]. gradient: (N,) its derivative [N],
            at these pressures under the pins of a thick wall. missing: (c,) gaps [m^3] under them.
        residual: unbalanced force relative to the loads. grips: (g, 6) motions of the grips.
    """

    moved: Array
    force: Array
    multipliers: Array
    energy: float
    gradient: Array
    missing: Array
    residual: float
    grips: Array = field(default_factory=_no_grips)


@dataclass(frozen=True)
class Loose:
    """What keeps a state but is no longer there.

    A contact that left has taken its push and its grip with it, and one that comes onto a dent
    finds gaps under it: all of it is let go in steps.

    Attributes:
        force: (N,) nodal forces [N]. gaps: (c,) under the pins of a thick wall [m^3].
    """

    force: Array
    gaps: Array

    def part(self, share: float) -> Loose:
        """So much of it."""
        return Loose(share * self.force, share * self.gaps)
