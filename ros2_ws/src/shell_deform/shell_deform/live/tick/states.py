# SPDX-License-Identifier: Apache-2.0
"""What the estimator can say right now, from its own steady clock."""

from __future__ import annotations

from enum import Enum

import numpy as np

from shell_deform.live.tick.sample import (
    FLAG_FAULT,
    FLAG_SATURATED,
    FLAG_STALE,
    ContactSample,
)

LONGEST_GAP = 10.0
"""A gap counts for the mean period by at most so many periods."""


class LiveState(str, Enum):
    """Names of `deformation/state`."""

    NO_HAND = 'NO_HAND'
    FREE = 'FREE'
    CONTACT = 'CONTACT'
    SATURATED = 'SATURATED'
    STALE = 'STALE'
    FAULT = 'FAULT'

    @property
    def is_served(self) -> bool:
        """Whether a surface may be published."""
        return self in (LiveState.FREE, LiveState.CONTACT, LiveState.SATURATED)


class Watch:
    """Follows samples and silence.

    Silence of more than `periods` sample periods, as measured here, but at least `floor` [s], is
    STALE. Silence of `no_hand` [s] while nobody publishes is NO_HAND.
    """

    def __init__(self, periods: float = 3.0, floor: float = 0.02, no_hand: float = 1.0) -> None:
        self.periods = periods
        self.floor = floor
        self.no_hand = no_hand
        self.state = LiveState.NO_HAND
        self.period = 0.0
        self._last = -np.inf

    def sample(self, sample: ContactSample, now: float) -> LiveState:
        """A sample arrived at steady time `now` [s]."""
        self._arrived(now)
        flags = int(np.bitwise_or.reduce(sample.flags)) if len(sample.flags) else 0
        touching = sample.touching
        if flags & FLAG_FAULT:
            self.state = LiveState.FAULT
        elif flags & FLAG_STALE:
            self.state = LiveState.STALE
        elif not touching.any():
            self.state = LiveState.FREE
        elif np.any(sample.flags[touching] & FLAG_SATURATED):
            self.state = LiveState.SATURATED
        else:
            self.state = LiveState.CONTACT
        return self.state

    def refused(self, now: float) -> LiveState:
        """A sample arrived that cannot be used."""
        self._arrived(now)
        self.state = LiveState.FAULT
        return self.state

    def _arrived(self, now: float) -> None:
        gap = now - self._last
        self._last = now
        # A hand that pauses is no slow hand; one whose samples come in bursts is.
        if not np.isfinite(gap) or gap >= self.no_hand or self.state is LiveState.NO_HAND:
            return
        if self.period > 0.0:
            gap = min(gap, LONGEST_GAP * self.period)
        self.period = gap if self.period == 0.0 else self.period + 0.1 * (gap - self.period)

    @property
    def deadline(self) -> float:
        """Longest silence [s] that is not STALE."""
        if self.period == 0.0:
            return self.no_hand
        return max(self.periods * self.period, self.floor)

    def remaining(self, now: float) -> float:
        """How long silence may last yet at steady time `now` [s]; a whole deadline when over."""
        left = self._last + self.deadline - now
        return left if left > 0 else self.deadline

    def look(self, now: float, somebody_publishes: bool) -> LiveState:
        """Time passed; `now` is steady [s]."""
        silence = now - self._last
        if self.state is LiveState.NO_HAND:
            return self.state
        if silence > self.no_hand and not somebody_publishes:
            self.state = LiveState.NO_HAND
            self.period = 0.0
        elif silence > self.deadline:
            self.state = LiveState.STALE
        return self.state
