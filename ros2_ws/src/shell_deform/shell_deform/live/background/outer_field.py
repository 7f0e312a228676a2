# SPDX-License-Identifier: Apache-2.0
"""The outer face of a thick wall as the background process hands it to the tick.

A thin wall's outer face is half a wall along the normal: whoever needs it computes it. A thick
wall shears and gets thinner under a pin; its outer face is a field of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch
from shell_deform.live.background.tracked_state import State
from shell_deform.live.background.tracking import EquilibriumTracker

Array = NDArray[np.float64]

UNMODELLED = 0.055
"""Largest error of a thick wall within a wall of a deep pin's edge, over the wall: the stress
field of the edge of a stamp, which no shell has. Against the kept solids, R/h 12.5 and 8."""

DEEP = 0.6
"""Half of it is there in a dent of so many walls."""


class OuterField:
    """Where the outer face is over the surface, and how that changes along the contacts' way."""

    def __init__(self, tracker: EquilibriumTracker) -> None:
        self._tracker = tracker
        self._known: tuple[State, Array] | None = None
        self._refined: Array | None = None
        self.slope = np.zeros_like(tracker.model.rest)
        """(n, 3) change per step along the direction of the second-order field [-]."""

    def forget(self) -> None:
        """Other contacts: nothing is known of their way."""
        self._refined = None
        self.slope = np.zeros_like(self.slope)

    def offset(self) -> Array:
        """(n, 3) outer face over the surface at the tracker's state [m]."""
        tracker = self._tracker
        if self._known is None or self._known[0] is not tracker.state:
            face = tracker.model.shell.outer_face(tracker.unknowns)
            place = tracker.model.surface.limit_positions(tracker.positions)
            self._known = (tracker.state, face - place)
        return self._known[1]

    def refined(self, step: float) -> None:
        """New columns were taken; `step` [m]: of the contacts since the last, 0 where it is short.

        A short step leaves the slope as it is.
        """
        offset = self.offset()
        if self._refined is not None and step:
            self.slope = (offset - self._refined) / step
        if self._refined is None or step:
            self._refined = offset


def unmodelled(
    places: Array, wall: float, patches: tuple[ContactPatch, ...], displacement: Array
) -> Array:
    """Sigma (n,) [m] at `places` (n, 3) of what no shell has beside a rigid pin.

    `wall` [m]; `displacement` (k,) of the pins on `patches` [m].
    """
    result = np.zeros(len(places))
    for patch, depth in zip(patches, displacement.tolist(), strict=True):
        walls = max(depth, 0.0) / wall
        beside = np.linalg.norm(places - patch.point, axis=1) - patch.radius
        fading = np.clip(2.0 - beside / wall, 0.0, 1.0)
        np.maximum(result, UNMODELLED * wall * walls / (walls + DEEP) * fading, out=result)
    return result
