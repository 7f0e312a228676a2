# SPDX-License-Identifier: Apache-2.0
"""Anderson acceleration of iterations that go on a fixed tangent.

A chord iteration corrects by the stiffness of another state. What that stiffness has wrong lies in
a few directions, those in which the dents grow, and a few iterations show how the steps change
along them: the combination of these that leaves the smallest step is the next start. D. G.
Anderson, Journal of the ACM 12 (1965), doi:10.1145/321296.321305; H. F. Walker, P. Ni, SIAM
Journal on Numerical Analysis 49 (2011), doi:10.1137/10078356X.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEPTH = 5
"""Iterations that are remembered."""

DEPENDENT = 1e-10
"""Steps that differ by less than this share of the largest difference tell nothing new."""


class AndersonMixing:
    """Remembers the last iterates of x -> x + f(x), and from where to go on.

    Linear conditions that all iterates fulfil are fulfilled by what comes next, too.
    """

    def __init__(self, measured: int) -> None:
        """`measured`: so many numbers of f, its first, tell how large a step is."""
        self._measured = measured
        self._last: tuple[Array, Array] | None = None
        self._moves: list[Array] = []
        self._changes: list[Array] = []

    def forget(self) -> None:
        """f is another function from now on."""
        self._last = None
        self._moves, self._changes = [], []

    def next(self, at: Array, step: Array) -> Array:
        """Where to go from the iterate `at` (n,), from which the iteration makes `step` (n,)."""
        if self._last is not None:
            self._moves = [*self._moves, at - self._last[0]][-DEPTH:]
            self._changes = [*self._changes, step - self._last[1]][-DEPTH:]
        self._last = at, step
        if not self._moves:
            return at + step
        changes = np.stack(self._changes, axis=1)
        share = np.linalg.lstsq(
            changes[: self._measured], step[: self._measured], rcond=DEPENDENT
        )[0]
        onward: Array = at + step - (np.stack(self._moves, axis=1) + changes) @ share
        return onward
