"""The gauge's zero: tared once, followed between grasps, less and less certain during one.

The maker acknowledges that the zero drifts (BH8-262 manual for firmware 4.4, page 56) and gives no
figure. The model is a random walk plus a slope that dies away (warm-up); a Kalman filter follows
both while the finger is free and lets their uncertainty grow while it is loaded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

BLOCK_S = 1.0
GATE = 4.0


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
        self._state = np.zeros(2)
        self._covariance = np.zeros((2, 2))
        self._time_s = 0.0
        self._block: list[float] = []
        self._block_start_s = 0.0

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
        """Standard deviation of the zero in counts."""
        return math.sqrt(max(float(self._covariance[0, 0]), 0.0))

    def tare(self, mean_counts: float, sigma_counts: float, time_s: float) -> None:
        """Take a zero measured now; the slope is unknown, not zero."""
        self.tared_at_s = self._time_s = time_s
        self._state = np.array([mean_counts, 0.0])
        floor = self.model.floor_counts
        self._covariance = np.diag(
            [sigma_counts**2 + floor**2, self.model.slope_counts_per_minute**2]
        )
        self._block.clear()

    def forget(self) -> None:
        """The hand was away: a new tare is needed."""
        self.tared_at_s = None
        self._block.clear()

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
        self._covariance[0, 0] += m.walk_counts_per_sqrt_minute**2 * minutes
        # What the walk of the slope adds keeps the filter ready for a warm-up that starts again.
        self._covariance[1, 1] += (0.05 * m.slope_counts_per_minute) ** 2 * minutes

    def free_reading(self, counts: float, noise_counts: float, time_s: float) -> None:
        """A reading of the free finger (weight taken off); averaged over a second, then used."""
        if not self.tared:
            return
        if not self._block:
            self._block_start_s = time_s
        self._block.append(counts)
        if time_s - self._block_start_s < BLOCK_S:
            return
        mean = float(np.mean(self._block))
        size = len(self._block)
        self._block.clear()
        self.advance(time_s)
        variance = (noise_counts**2 + 1.0 / 12.0) / size + self.model.floor_counts**2
        innovation = mean - self._state[0]
        spread = self._covariance[0, 0] + variance
        if innovation**2 > GATE**2 * spread + 1.0:
            return
        gain = self._covariance[:, 0] / spread
        self._state = self._state + gain * innovation
        self._covariance = self._covariance - np.outer(gain, self._covariance[0, :])

    def interrupt(self) -> None:
        """The finger is loaded: drop a block that has begun."""
        self._block.clear()
