# SPDX-License-Identifier: Apache-2.0
"""Loads on the way to a load case, and where the path through the last states leads next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.solve.equilibrium import LoadCase, PathState
from shell_deform.supports.grips import between

Array = NDArray[np.float64]

# A step longer than this many of the last one is not extrapolated.
LONGEST_PREDICTION = 2.0


@dataclass(frozen=True)
class StepLoads:
    """What one load step prescribes.

    Attributes:
        force: (k,) pushes [N], read where they are prescribed. moved: (k,) centre displacements
            [m], likewise. dead: (N,) other dead load [N]. motion: (k, 6) of rigid bodies beside
            their depth, grip_motion: (g, 6) of grips [m, rad]. target: where that moves the
            springs of what is held; None for nowhere, and until `StepSolver.aimed` knows.
    """

    force: Array
    moved: Array
    dead: Array
    motion: Array
    grip_motion: Array
    target: Array | None = None

    def towards(self, goal: StepLoads, fraction: float) -> StepLoads:
        """The loads at this fraction of the way to `goal`."""
        return StepLoads(
            self.force + fraction * (goal.force - self.force),
            self.moved + fraction * (goal.moved - self.moved),
            self.dead + fraction * (goal.dead - self.dead),
            between(self.motion, goal.motion, fraction),
            between(self.grip_motion, goal.grip_motion, fraction),
        )


def control_of(case: LoadCase, loads: StepLoads) -> Array:
    """What is prescribed, as one vector along which a path can be continued."""
    prescribed = np.where(case.driven, loads.moved, loads.force)
    others = [prescribed, loads.motion.ravel(), loads.grip_motion.ravel()]
    return np.concatenate([*others, [np.linalg.norm(loads.dead)]])


def predicted(path: Sequence[PathState], control: Array) -> Array | None:
    """All unknowns expected at `control` (k,), by the parabola through the last states of `path`.

    None where the path behind says nothing: too short, or a step back or aside.
    """
    if len(path) < 2 or not len(path[-2].control) == len(path[-1].control) == len(control):
        return None
    last = path[-1].control - path[-2].control
    length = float(last @ last)
    ahead = float((control - path[-1].control) @ last) / length if length > 0 else 0.0
    if not 0.0 < ahead <= LONGEST_PREDICTION:
        return None
    now, then = path[-1].positions, path[-2].positions
    if len(path) < 3 or len(path[-3].control) != len(control):
        return now + ahead * (now - then)
    gap = float((path[-2].control - path[-3].control) @ last) / length
    if gap <= 0.0:
        return now + ahead * (now - then)
    first = (ahead + 1.0) * (ahead + 1.0 + gap) / (1.0 + gap)
    second = -ahead * (ahead + 1.0 + gap) / gap
    third = ahead * (ahead + 1.0) / (gap * (1.0 + gap))
    return first * now + second * then + third * path[-3].positions
