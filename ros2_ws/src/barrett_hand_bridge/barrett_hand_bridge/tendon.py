# SPDX-License-Identifier: Apache-2.0
"""Play in the tendons: what no encoder sees, taken from the loops of squeezes and releases.

A tendon stretches with its torque; where it also has play, or rubs, the outer link lags behind it:
on the way in it is bent less than the stretch says, on the way out more. At the same force the
pins then have gone further by their encoders on the way out. Where the tendon has slipped both
ways the loop is as wide as twice the play, whatever the object's stiffness; an object that itself
loses force on the way out (rubber, friction) widens it.

In a squeeze of stretch R that a finger begins pulled back, a play p shows as a loop of 2 p, or of
R - 2 p where R is less than 4 p: less of the tendon slips both ways. So a loop L is a play between
L / 2 and (R - L) / 2. Where the two lie far apart the squeeze was too gentle to tell; a harder one
will. No loop at all in a hard squeeze is no play.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from statistics import median

import numpy as np

KEPT_LOOPS = 5
"""The play is the median of so many loops, the latest of hard squeezes."""

HARD = 0.6
"""A squeeze of this share of the largest stretch or more is hard: it tells more of a loop."""

FEWEST_SAMPLES = 5
"""A way in or out with fewer readings tells nothing."""

RELEASED = 0.95
"""Below this share of the largest force the hand opens."""

WIDEST = 0.9
"""The width of a loop is this quantile of all its widths: it opens once the tendon has slipped."""

SHUT = 0.07
"""Below this share of the stretch a loop is none: no play, or so much that nothing slipped."""

IMPLAUSIBLE = 3.0
SHUT_IMPLAUSIBLE = 2.0
"""The larger of two plays is out of the question from so many times the expected one; so is one
under which nothing slipped."""

CLOSE = 3.0
"""Two plays that differ by no more than this factor bound the truth."""


def lagging(bend_rad: float, stretch_rad: float, half_width_rad: float) -> float:
    """The bend of a link that follows its tendon's stretch with play (Prandtl's play operator)."""
    return min(max(bend_rad, stretch_rad - half_width_rad), stretch_rad + half_width_rad)


@dataclass(frozen=True)
class Squeezing:
    """One moment of a squeeze: mean push [N], way of all pins together [m], arms together [m].

    The way is that of rigid play-free tendons: encoders, less the stretch (mean, rad) of now.
    """

    push_n: float
    way_m: float
    arms_m: float
    stretch_rad: float


@dataclass
class TendonPlay:
    """How wide the loops are that the fingers' tendons run through; one figure for a hand.

    `expected_rad`: half a loop, as it may be before any release was seen; `relative_sigma`: of the
    stretch. `half_width_rad` and
    `spread_rad`: half a loop as the releases say, and half the range of what it may be.
    """

    expected_rad: float
    relative_sigma: float
    half_width_rad: float = 0.0
    spread_rad: float = 0.0
    _loops: list[tuple[float, float, float]] = field(default_factory=list)
    _fingers: tuple[int, ...] = ()
    _in: list[Squeezing] = field(default_factory=list)
    _out: list[Squeezing] = field(default_factory=list)

    @property
    def releases(self) -> int:
        """How many loops the play is taken from."""
        return len(self._loops)

    def told(self) -> str:
        """The play and how it is known, for people."""
        if not self._loops:
            return f'{self.expected_rad:.4f} expected: no release of a hard squeeze has shown it'
        return (
            f'{self.half_width_rad:.4f} +- {self.spread_rad:.4f}, of {self.releases} release'
            f'{"" if self.releases == 1 else "s"}'
        )

    def lag_sigma(self, stretch_rad: float) -> float:
        """Standard deviation [rad] of a bend under a stretch: never more than all of that.

        A lag lies within its loop, and the fingers of a squeeze lag alike: their sum within twice
        the loop, which is 1.4 sigma of the sum when each counts the whole loop as one.
        """
        if not self._loops:
            return min(2.0 * self.expected_rad, abs(stretch_rad))
        lag = min(2.0 * self.half_width_rad, abs(stretch_rad))
        return math.hypot(lag, 2.0 / math.sqrt(3.0) * self.spread_rad)

    def see(self, fingers: tuple[int, ...], now: Squeezing) -> None:
        """Take the fingers that touch and what they do; a loop ends where their set changes."""
        if fingers != self._fingers:
            self._close()
            self._fingers = fingers
        if not fingers:
            return
        if not self._in or now.push_n > self._in[-1].push_n:
            # Squeezed further than before: what went out between was no release.
            self._in.append(now)
            self._out.clear()
            return
        if now.push_n < RELEASED * self._in[-1].push_n:
            self._out.append(now)

    def _close(self) -> None:
        """Read the loop that has ended, if it says anything."""
        way_in, way_out = self._in, self._out
        self._in, self._out = [], []
        if len(way_out) < FEWEST_SAMPLES or len(way_in) < FEWEST_SAMPLES:
            return
        push = [one.push_n for one in way_in]
        way = [one.way_m for one in way_in]
        width = np.array(
            [(one.way_m - np.interp(one.push_n, push, way)) / one.arms_m for one in way_out]
        )
        loop = max(0.0, float(np.quantile(width, WIDEST)))
        stretch = way_in[-1].stretch_rad
        least, most = 0.5 * loop, 0.5 * (stretch * (1.0 + self.relative_sigma) - loop)
        larger = 0.5 * (stretch - loop) / max(self.expected_rad, 1e-9)
        if (
            larger >= (SHUT_IMPLAUSIBLE if loop <= SHUT * stretch else IMPLAUSIBLE)
            or most <= least
        ):
            most = least
        elif most > CLOSE * least:
            return
        hardest = max([stretch, *(kept[2] for kept in self._loops)])
        loops = [
            kept for kept in (*self._loops, (least, most, stretch)) if kept[2] >= HARD * hardest
        ]
        self._loops = loops[-KEPT_LOOPS:]
        self.half_width_rad = median(0.5 * (low + high) for low, high, _ in self._loops)
        self.spread_rad = max(0.5 * (high - low) for low, high, _ in self._loops)
