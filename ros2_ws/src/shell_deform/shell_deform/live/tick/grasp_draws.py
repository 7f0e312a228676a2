# SPDX-License-Identifier: Apache-2.0
"""How sure the closure of more than two fingers is, told a draw at a time.

All draws of `grasp.probability` take as long as a hundred samples may: one is made every few
samples, and each tells how far it is from the grasp without errors, which moves on meanwhile.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from shell_deform.grasp.closure import Closure
from shell_deform.grasp.contacts import GraspContacts
from shell_deform.grasp.probability import (
    DRAWS,
    LEAST_SIGMA,
    Sigmas,
    closure_probability,
    closure_sigma,
    drawn_needed,
    pressing_part,
    share_closed,
)

EVERY = 3
"""Samples of one draw."""


class ClosureDraws:
    """The probability of closure of one sample after the other."""

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._found: Closure | None = None
        self._away = np.zeros(DRAWS)
        self._known = self._due = self._next = self._samples = 0
        self._told: float | None = None

    def probability(
        self, grasp: GraspContacts, found: Closure, sigmas: Sigmas, task: object
    ) -> float:
        """That of `grasp` for `task`; `found` is its closure, another one where it has moved.

        To first order until there are draws of such fingers and such a task.
        """
        if not len(found.squeeze):
            return 0.0
        key = (task, grasp.pressing.tobytes())
        if key != self._key:
            self._key, self._known, self._due, self._told = key, 0, DRAWS, None
        if found is not self._found:
            self._found, self._due, self._told = found, DRAWS, None
        if grasp.pressing.sum() == 2:
            if self._told is None:
                self._told = closure_probability(grasp, found, sigmas)
            return self._told
        self._samples += 1
        if self._due and self._samples % EVERY == 0:
            own, sure = pressing_part(grasp, sigmas)
            needed = drawn_needed(own, sure, self._next, found.needed)
            self._away[self._next] = needed - found.needed
            self._next = (self._next + 1) % DRAWS
            self._due, self._known = self._due - 1, min(self._known + 1, DRAWS)
            self._told = None if self._known == DRAWS else self._told
        if self._told is None:
            if self._known < DRAWS:
                sigma = max(closure_sigma(grasp, found, sigmas), LEAST_SIGMA)
                self._told = float(ndtr((1.0 - found.needed) / sigma))
            else:
                self._told = share_closed(found.needed + self._away, sigmas.friction)
        return self._told
