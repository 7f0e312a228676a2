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

FARTHEST = 2.0
"""A step longer than this many of those behind it is not extrapolated."""

NEAREST = 0.25
"""States closer together than this share of the step say more of their errors than of the path."""

ASIDE = 0.5
"""A state further off the line of the step than this share of its distance is on another path."""


@dataclass(frozen=True)
class StepLoads:
    """What one load step prescribes.

    Attributes:
        force: (k,) pushes [N], read where they are prescribed. moved: (k,) centre displacements
            [m], likewise. dead: (N,) other dead load [N]. motion: (k, 6) of rigid bodies beside
            their depth, grip_motion: (g, 6) of grips [m, rad]. target: where that moves the
            springs of what is held; None for nowhere, and until `StepSolver.aimed` knows.
        filled: share of the model's own pressures, see `ShellModel.filled`.
    """

    force: Array
    moved: Array
    dead: Array
    motion: Array
    grip_motion: Array
    target: Array | None = None
    filled: float = 1.0

    def towards(self, goal: StepLoads, fraction: float) -> StepLoads:
        """The loads at this fraction of the way to `goal`."""
        return StepLoads(
            self.force + fraction * (goal.force - self.force),
            self.moved + fraction * (goal.moved - self.moved),
            self.dead + fraction * (goal.dead - self.dead),
            between(self.motion, goal.motion, fraction),
            between(self.grip_motion, goal.grip_motion, fraction),
            filled=self.filled + fraction * (goal.filled - self.filled),
        )


def control_of(case: LoadCase, loads: StepLoads) -> Array:
    """What is prescribed, as one vector along which a path can be continued."""
    prescribed = np.where(case.driven, loads.moved, loads.force)
    others = [prescribed, loads.motion.ravel(), loads.grip_motion.ravel()]
    return np.concatenate([*others, [np.linalg.norm(loads.dead), loads.filled]])


def predicted(path: Sequence[PathState], control: Array) -> Array | None:
    """All unknowns expected at `control` (k,), by the parabola through the last states of `path`.

    By a line where there are only two; None where the path behind says nothing: too short, or a
    step back or aside.
    """
    if not path or len(path[-1].control) != len(control):
        return None
    now = path[-1]
    step = control - now.control
    length = float(step @ step)
    behind: list[tuple[float, Array]] = []
    for state in reversed(path[:-1]):
        if length == 0.0 or len(state.control) != len(control) or len(behind) == 2:
            break
        back = state.control - now.control
        place = float(back @ step) / length
        last = behind[-1][0] if behind else 0.0
        if place > last or np.linalg.norm(back - place * step) > ASIDE * np.linalg.norm(back):
            break
        if last - place >= (NEAREST if behind else 1.0 / FARTHEST):
            behind.append((place, state.positions))
    if not behind:
        return None
    (s, then), *others = behind
    if not others:
        return now.positions + (then - now.positions) / s
    t, before = others[0]
    return (
        (1.0 - s) * (1.0 - t) / (s * t) * now.positions
        + (1.0 - t) / (s * (s - t)) * then
        + (1.0 - s) / (t * (t - s)) * before
    )
