# SPDX-License-Identifier: Apache-2.0
"""Rates and delays over a sliding window, for diagnostics."""

from __future__ import annotations

from collections import deque

import numpy as np


class Rate:
    """Events per second over the last window."""

    def __init__(self, window_s: float = 1.0) -> None:
        """Nothing counted yet."""
        self._window_s = window_s
        self._times: deque[float] = deque()

    def count(self, time_s: float) -> None:
        """An event happened."""
        self._times.append(time_s)
        while self._times and time_s - self._times[0] > self._window_s:
            self._times.popleft()

    def per_second(self, time_s: float) -> float:
        """Rate at a time; 0 when nothing happened in the window before it."""
        recent = sum(1 for moment in self._times if time_s - moment <= self._window_s)
        return recent / self._window_s


class Delays:
    """Percentiles of recent delays."""

    def __init__(self, size: int = 1000) -> None:
        """Nothing measured yet."""
        self._delays: deque[float] = deque(maxlen=size)

    def add(self, seconds: float) -> None:
        """Take one delay."""
        self._delays.append(seconds)

    def percentile(self, percent: float) -> float:
        """Percentile in s; NaN before the first."""
        return float(np.percentile(self._delays, percent)) if self._delays else float('nan')
