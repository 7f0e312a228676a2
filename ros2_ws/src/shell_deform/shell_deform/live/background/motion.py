# SPDX-License-Identifier: Apache-2.0
"""Where the contacts will be when the equilibrium is ready.

A refresh takes a while, and its result serves for as long again. Solved where the fingers were, it
is always behind; solved a refresh ahead along their motion, the step that the tick adds is short.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.tracked_state import Target
from shell_deform.supports.grips import between

Array = NDArray[np.float64]

SLOWEST = 0.05
"""Steps between two load cases below this share of the wall thickness are not continued."""

SLOWEST_TURN = 1e-4
"""The same for grips, of a radian and of a metre."""

FARTHEST = 3.0
"""No step is continued by more wall thicknesses."""

LONGEST_GAP_S = 0.5
"""Load cases further apart tell no motion [s]."""

SLOWLY = 0.3
"""How fast the estimate of a refresh's duration follows [-]."""


class Motion:
    """Continues the last step of driven contacts and of grips by the duration of a refresh."""

    def __init__(self, wall: float) -> None:
        """`wall` [m]: thickness."""
        self._wall = wall
        self._last: tuple[int, float, Array] | None = None
        self._step = np.zeros(0)
        self._grips: tuple[float, Array] | None = None
        self._refresh = 0.0

    def took(self, seconds: float) -> None:
        """A refresh took so long."""
        if self._refresh == 0.0:
            self._refresh = seconds
        self._refresh += SLOWLY * (seconds - self._refresh)

    def ahead(self, target: Target, generation: int, now: float) -> Target:
        """`target`, of the contacts of `generation`, a refresh later; `now` steady [s]."""
        target = self._turned(target, now)
        last, before = self._last, self._step
        depths = np.where(target.driven, target.displacement, 0.0)
        self._last, self._step = (generation, now, depths), np.zeros(0)
        if last is None or last[0] != generation or not 0.0 < now - last[1] < LONGEST_GAP_S:
            return target
        step = depths - last[2]
        self._step = step
        size = float(np.abs(step).max(initial=0.0))
        turned = len(before) == len(step) and before @ step < 0.0
        if size < SLOWEST * self._wall or turned:
            return target
        share = min(1.0, self._refresh / (now - last[1]), FARTHEST * self._wall / size)
        return replace(target, displacement=target.displacement + share * step)

    def _turned(self, target: Target, now: float) -> Target:
        """`target` with its grips where they will be."""
        last, self._grips = self._grips, (now, target.grips)
        if last is None or not len(target.grips) or not 0.0 < now - last[0] < LONGEST_GAP_S:
            return target
        if np.abs(target.grips - last[1]).max() < SLOWEST_TURN:
            return target
        share = min(1.0, self._refresh / (now - last[0]))
        return replace(target, grips=between(last[1], target.grips, 1.0 + share))
