# SPDX-License-Identifier: Apache-2.0
"""The squeeze window: the least squeeze that lifts the object, and the most that it bears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNLIMITED = 1e9
"""Push that nothing known forbids [N]."""

UNKNOWN = 1e3
"""Relative sigma of a stress that is not resolved: nothing is known of it."""

FIRMEST = 1e-3
"""A snap margin nearer to one than this says nothing of a snap."""


@dataclass(frozen=True)
class SqueezeWindow:
    """Mean push of the fingers [N].

    Attributes:
        least: that lifts the stated mass; `UNLIMITED` where no squeeze does.
        most: before the first limit. limit: which one: 'snap', 'yield', 'strain' or ''.
        liftable: mass that the present squeeze can lift [kg]. share: of the weight [-], 1 for all.
        open: whether the present push is inside.
    """

    least: float
    most: float
    limit: str
    liftable: float
    share: float
    open: bool


@dataclass(frozen=True)
class Limits:
    """How near the wall is to what it does not bear, at the present squeeze.

    Attributes:
        snap_margin: stiffness against the fingers over that at rest [-]; 1 unless known.
        stress: largest von Mises stress over the yield stress [-], 0 if unknown.
        strain: largest strain over its limit [-], 0 if unknown.
    """

    snap_margin: float = 1.0
    stress: float = 0.0
    strain: float = 0.0


def squeeze_window(push: float, liftable: float, mass: float, limits: Limits) -> SqueezeWindow:
    """Window about the present mean push [N] that can lift `liftable` [kg] now.

    From one state: capacity grows with the push, stress and strain in proportion to it, and the
    stiffness falls by as much again for every such push. A curve of states says it without that
    (`window_of_curve`). A mass below zero is no mass: nothing can be said.
    """
    if not (np.isfinite(mass) and mass >= 0.0):
        limit = 'mass below zero' if mass < 0.0 else 'mass is not a number'
        return SqueezeWindow(UNLIMITED, 0.0, limit, max(liftable, 0.0), 0.0, False)
    push = max(push, 0.0)
    least = push * mass / liftable if liftable > 0.0 else (0.0 if mass == 0.0 else UNLIMITED)
    most, limit = UNLIMITED, ''
    softening = 1.0 - limits.snap_margin
    for name, share in (('snap', softening), ('yield', limits.stress), ('strain', limits.strain)):
        if share > FIRMEST and push / share < most:
            most, limit = push / share, name
    if limits.snap_margin <= 0.0:
        most, limit = min(most, push), 'snap'
    lifted = min(liftable / mass, 1.0) if mass > 0.0 else 1.0
    inside = bool(least <= push <= most) and push > 0.0
    return SqueezeWindow(min(least, UNLIMITED), most, limit, liftable, lifted, inside)


def window_of_curve(
    push: Array, liftable: Array, mass: float, limits: list[Limits]
) -> tuple[float, float, str]:
    """Least and most push [N] and the limit, from states (s,) of a squeeze, pushes rising.

    Between two states by straight lines; the most is the last push where no limit was met, or
    `UNLIMITED` with no limit.
    """
    least = UNLIMITED
    for i, (here, lifted) in enumerate(zip(push, liftable, strict=True)):
        if lifted >= mass:
            before = (push[i - 1], liftable[i - 1]) if i else (0.0, 0.0)
            rise = lifted - before[1]
            share = (mass - before[1]) / rise if rise > 0.0 else 1.0
            least = float(before[0] + np.clip(share, 0.0, 1.0) * (here - before[0]))
            break
    most, limit = UNLIMITED, ''
    for name, used in (
        ('snap', [1.0 - one.snap_margin for one in limits]),
        ('yield', [one.stress for one in limits]),
        ('strain', [one.strain for one in limits]),
    ):
        crossed = crossing(push, np.array(used), 1.0)
        if crossed < most:
            most, limit = crossed, name
    return least, most, limit


def crossing(push: Array, used: Array, level: float) -> float:
    """First push [N] at which `used` (s,) reaches `level`; `UNLIMITED` if it does not."""
    above = np.flatnonzero(used >= level)
    if not len(above):
        return UNLIMITED
    i = int(above[0])
    before = (float(push[i - 1]), float(used[i - 1])) if i else (0.0, 0.0)
    rise = float(used[i]) - before[1]
    return before[0] + (level - before[1]) / rise * (float(push[i]) - before[0])
