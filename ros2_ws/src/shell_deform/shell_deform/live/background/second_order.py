# SPDX-License-Identifier: Apache-2.0
"""Second and third order of the surface's motion along the way the contacts came.

A tangent alone serves short steps. A cubic through two states with both tangents (Hermite) has the
second order exactly at its end; what it has of third order is kept as the error of leaving it out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALLEST_STEP = 0.02
"""Steps below this share of the wall thickness say nothing about the second order."""

SHORTEST_REACH = 0.3
"""A second order measured over less still serves over this share of the wall thickness."""

THIRD_FLOOR = 0.8
"""Third order per wall thickness is at least this share of the second."""


@dataclass(frozen=True)
class Columns:
    """The tangent at one state of a shell of n vertices under k contacts; j inputs.

    Attributes:
        surface: (n, 3) limit positions [m]. columns: (n, 3, j) their motion per unit input.
        displacement_by: (k, j) motion of the contacts per unit input. displacement: (k,) there.
        inputs: (j,) their values there.
    """

    surface: Array
    columns: Array
    displacement_by: Array
    displacement: Array
    inputs: Array


class SecondOrder:
    """What is known of it about the present state.

    Attributes:
        field: (n, 3) [1/m] motion per squared step of the contacts along `direction` (k,), which
            is empty where no direction is known. third: (n,) [1/m^2] size of the third order.
        reach: step over which it was measured [m]. push: (k,) second order of the pushes [N/m^2].
    """

    def __init__(self, vertices: int, wall: float) -> None:
        self._vertices, self._wall = vertices, wall
        self.forget()

    def forget(self) -> None:
        """Nothing is known."""
        self.field = np.zeros((self._vertices, 3))
        self.third = np.zeros(self._vertices)
        self.direction = self.push = np.zeros(0)
        self.reach = 0.0

    def from_rest(self, field: Array, push: Array, direction: Array, near_rest: bool) -> None:
        """That of new contacts: exact for a shell at rest, elsewhere for the error."""
        self.field, self.push = field, push
        self.third = THIRD_FLOOR / self._wall * np.linalg.norm(field, axis=1)
        if near_rest:
            self.direction, self.reach = direction, SHORTEST_REACH * self._wall

    def along(self, old: Columns, new: Columns, driven: NDArray[np.bool_]) -> float:
        """Take that of the step from one state to the next: its length [m], 0 for a short one.

        `driven` (k,): contacts whose pushes the tick finds from their motion.
        """
        steps = new.displacement - old.displacement
        step = float(np.linalg.norm(steps))
        if step < SMALLEST_STEP * self._wall:
            return 0.0
        inputs = new.inputs - old.inputs
        before, after = (_found(there, steps, inputs, driven) for there in (old, new))
        self.push = ((2.0 * after + before - 3.0 * inputs) / step**2)[: len(steps)]
        change = new.surface - old.surface
        start, end = old.columns @ before, new.columns @ after
        self.field = (2.0 * end + start - 3.0 * change) / step**2
        third = np.linalg.norm((end + start - 2.0 * change) / step**3, axis=1)
        floor = THIRD_FLOOR / self._wall * np.linalg.norm(self.field, axis=1)
        self.third = np.maximum(third, floor)
        self.direction = steps / step
        self.reach = max(step, SHORTEST_REACH * self._wall)
        return step


def _found(there: Columns, steps: Array, inputs: Array, driven: NDArray[np.bool_]) -> Array:
    """`inputs` (j,) with the pushes of driven contacts as the tick finds them from `steps`."""
    which = np.flatnonzero(driven)
    if not len(which):
        return inputs
    left = steps - there.displacement_by @ inputs
    result = inputs.copy()
    square = there.displacement_by[np.ix_(which, which)]
    result[which] += np.linalg.lstsq(square, left[which], rcond=None)[0]
    return result
