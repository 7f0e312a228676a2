"""Figures of the running node: latencies, rates, losses."""

from __future__ import annotations

import numpy as np

WINDOW = 4096


class Latencies:
    """The last few thousand durations [s]."""

    def __init__(self) -> None:
        self._values = np.zeros(WINDOW)
        self._count = 0

    def add(self, seconds: float) -> None:
        """Remember one."""
        self._values[self._count % WINDOW] = seconds
        self._count += 1

    def percentile(self, share: float) -> float:
        """Percentile `share` (0..100) [s], 0 without any."""
        known = self._values[: min(self._count, WINDOW)]
        return float(np.percentile(known, share)) if len(known) else 0.0


class StampWatch:
    """Counts what the stamps of a stream tell: samples, losses, repeats and steps back."""

    def __init__(self) -> None:
        self.samples = 0
        self.lost = 0
        self.repeated = 0
        self.backwards = 0
        self._last = 0
        self._period = 0.0

    def arrived(self, stamp_ns: int) -> bool:
        """Take a stamp; False if it repeats the last one and should not be answered again.

        After a step back (a bag played again, a seek) `backwards` has risen.
        """
        if self.samples and stamp_ns == self._last:
            self.repeated += 1
            return False
        gap = 1e-9 * (stamp_ns - self._last)
        if self.samples:
            if gap < 0:
                self.backwards += 1
                self._period = 0.0
            elif self._period == 0.0:
                self._period = gap
            else:
                missing = round(gap / self._period) - 1
                # A pause is no loss: beyond a second the stream stopped.
                if missing > 0 and gap < 1.0:
                    self.lost += missing
                elif missing == 0:
                    self._period += 0.1 * (gap - self._period)
                elif gap < self._period:
                    self._period = gap
        self.samples += 1
        self._last = stamp_ns
        return True
