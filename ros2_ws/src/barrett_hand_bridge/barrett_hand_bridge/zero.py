# SPDX-License-Identifier: Apache-2.0
"""The gauge's zero: tared once, followed between grasps, less and less certain during one.

The maker acknowledges that the zero drifts (BH8-262 manual for firmware 4.4, page 56) and gives no
figure. The model is a random walk plus a slope that dies away (warm-up); a Kalman filter follows
both while the finger is free and lets their uncertainty grow while it is loaded. The figures of
the model are assumptions, so the filter watches its own innovations: where they are larger than
it expects, its memory fades and its process noise grows in proportion (fading-memory filter with
innovation-based covariance matching; R. K. Mehra, IEEE Trans. Automatic Control 17 (1972) 693).

An innovation beyond the gate is no drift. Where the posture speaks for a free finger and the
innovation persists, it is a step of the zero (knock, hysteresis) and adopted; the step itself
stays in the sigma as a doubt, because a load that came by itself would look the same, until the
finger has moved and the reading has stayed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.kinematics import Array, length

BLOCK_S = 1.0
GATE = 4.0
# Two blocks that agree: a knock that rings or a block that holds the step's edge is none of them.
PERSISTENT_BLOCKS = 2
# Share of the newest innovation in the filter's judgement of its own model: ten blocks.
NEWEST_SHARE = 0.1
# A pin that has moved so far (m) without a change of its reading touches nothing.
MOVED_M = 0.005


@dataclass(frozen=True)
class DriftModel:
    """How a zero moves, in gauge counts and minutes."""

    walk_counts_per_sqrt_minute: float
    slope_counts_per_minute: float
    slope_decay_minutes: float = 15.0
    floor_counts: float = 0.05


DRIFT_8_BIT = DriftModel(0.1, 0.25)
DRIFT_12_BIT = DriftModel(1.0, 2.0)


class ZeroTracker:
    """The zero of one gauge in counts, its slope, and the uncertainty of both."""

    def __init__(self, model: DriftModel) -> None:
        """Not tared."""
        self.model = model
        self.tared_at_s: float | None = None
        # Since when the readings of the last block that agreed with the zero were taken.
        self.agreed_from_s = -math.inf
        self._state = np.zeros(2)
        self._covariance = np.zeros((2, 2))
        self._time_s = 0.0
        self._block: list[float] = []
        self._block_start_s = 0.0
        self._misfit = 1.0
        self._persistent: list[float] = []
        self._tare_doubt = 0.0
        self._stepped = 0.0
        self._doubt_place: Array | None = None

    @property
    def tared(self) -> bool:
        """Whether a zero has been taken since the hand was connected."""
        return self.tared_at_s is not None

    @property
    def counts(self) -> float:
        """The zero in counts as of the last time given."""
        return float(self._state[0])

    @property
    def sigma_counts(self) -> float:
        """Standard deviation of the zero in counts, its doubt included."""
        return math.hypot(self.drift_sigma_counts, self.doubt_counts)

    @property
    def drift_sigma_counts(self) -> float:
        """Standard deviation of the zero in counts if nothing of it is a load."""
        return math.sqrt(max(float(self._covariance[0, 0]), 0.0))

    @property
    def doubt_counts(self) -> float:
        """What could be a load as well as the zero: adopted steps and the doubt of the tare."""
        return math.hypot(self._tare_doubt, self._stepped)

    def tare(
        self, mean_counts: float, sigma_counts: float, time_s: float, doubt_counts: float = 0.0
    ) -> None:
        """Take a zero measured now; the slope is unknown, not zero."""
        self.tared_at_s = self._time_s = self.agreed_from_s = time_s
        self._state = np.array([mean_counts, 0.0])
        floor = self.model.floor_counts
        self._covariance = np.diag(
            [sigma_counts**2 + floor**2, self.model.slope_counts_per_minute**2]
        )
        self._misfit = 1.0
        self._tare_doubt, self._stepped = doubt_counts, 0.0
        self._doubt_place = None
        self.interrupt()

    def forget(self) -> None:
        """The hand was away: a new tare is needed."""
        self.tared_at_s = None
        self.agreed_from_s = -math.inf
        self._tare_doubt = self._stepped = 0.0
        self.interrupt()

    def advance(self, time_s: float) -> None:
        """Predict zero and uncertainty at a later time in s."""
        minutes = (time_s - self._time_s) / 60.0
        if minutes <= 0.0 or not self.tared:
            return
        self._time_s = time_s
        m = self.model
        fade = math.exp(-minutes / m.slope_decay_minutes)
        carried = m.slope_decay_minutes * (1.0 - fade)
        transition = np.array([[1.0, carried], [0.0, fade]])
        self._state = transition @ self._state
        self._covariance = transition @ self._covariance @ transition.T
        growth = self._misfit * minutes
        self._covariance[0, 0] += m.walk_counts_per_sqrt_minute**2 * growth
        # What the walk of the slope adds keeps the filter ready for a warm-up that starts again.
        self._covariance[1, 1] += (0.05 * m.slope_counts_per_minute) ** 2 * growth

    def free_reading(
        self,
        counts: float,
        noise_counts: float,
        time_s: float,
        *,
        steps_counts: tuple[float, float] = (0.0, 0.0),
        place: Array | None = None,
    ) -> bool:
        """A reading of the free finger (weight taken off); averaged over a second, then used.

        `steps_counts`: the steps down and up (negative, positive) that the posture allows to be
        taken for one of the zero. `place`: where the pin is (3,), to end a doubt. True when a
        step has just been adopted.
        """
        if not self.tared:
            return False
        if not self._block:
            self._block_start_s = time_s
        self._block.append(counts)
        if time_s - self._block_start_s < BLOCK_S:
            return False
        mean = float(np.mean(self._block))
        size = len(self._block)
        self._block.clear()
        self.advance(time_s)
        variance = (noise_counts**2 + 1.0 / 12.0) / size + self.model.floor_counts**2
        innovation = mean - self.counts
        spread = float(self._covariance[0, 0]) + variance
        if innovation**2 > GATE**2 * spread:
            return self._step(innovation, variance, steps_counts, place)
        self._persistent.clear()
        self._follow(innovation, spread, variance)
        self.agreed_from_s = self._block_start_s
        self._end_doubt(place)
        return False

    def _follow(self, innovation: float, spread: float, variance: float) -> None:
        self._misfit += NEWEST_SHARE * (innovation**2 / spread - self._misfit)
        self._misfit = max(self._misfit, 1.0)
        self._covariance = self._misfit * self._covariance
        spread = float(self._covariance[0, 0]) + variance
        gain = self._covariance[:, 0] / spread
        self._state = self._state + gain * innovation
        self._covariance = self._covariance - np.outer(gain, self._covariance[0, :])

    def _step(
        self,
        innovation: float,
        variance: float,
        steps_counts: tuple[float, float],
        place: Array | None,
    ) -> bool:
        """Adopt an innovation beyond the gate once it persists where the posture allows it."""
        low, high = steps_counts
        if not low <= innovation <= high:
            self._persistent.clear()
            return False
        if self._persistent and abs(innovation - self._persistent[-1]) > GATE * math.sqrt(
            2.0 * variance
        ):
            self._persistent.clear()
        self._persistent.append(innovation)
        if len(self._persistent) < PERSISTENT_BLOCKS:
            return False
        self._persistent.clear()
        self._state[0] += innovation
        self._covariance[0, 0] = variance
        self._covariance[0, 1] = self._covariance[1, 0] = 0.0
        # Nothing pulls a finger closed: a step down is no load, at most the end of one.
        self._stepped = max(self._stepped + innovation, 0.0)
        self._doubt_place = place
        return True

    def _end_doubt(self, place: Array | None) -> None:
        if self.doubt_counts == 0.0 or place is None:
            return
        if self._doubt_place is None:
            self._doubt_place = place
        elif length(place - self._doubt_place) >= MOVED_M:
            self._tare_doubt = self._stepped = 0.0
            self._doubt_place = None

    def interrupt(self) -> None:
        """The finger is loaded: drop a block that has begun, and what seemed to persist."""
        self._block.clear()
        self._persistent.clear()
