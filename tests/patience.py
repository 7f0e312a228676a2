# SPDX-License-Identifier: Apache-2.0
"""How long a test waits for a condition: seconds of a machine that has processors to spare.

A test that fails because others took the processor says nothing. The kernel counts the time in
which somebody waits for one (`/proc/pressure/cpu`); that time does not count here. So a wait is
as short as written on an idle machine, where a process that hangs is told soon, and as long as
it takes on a starved one. Without that count, patience is four times as long.
"""

from __future__ import annotations

import time
from pathlib import Path

PRESSURE = Path('/proc/pressure/cpu')
WITHOUT_PRESSURE = 4.0


def starved_s() -> float | None:
    """Seconds since the start of the machine in which somebody waited for a processor."""
    try:
        some = PRESSURE.read_text().splitlines()[0]
        return 1e-6 * float(some.rpartition('total=')[2])
    except (OSError, ValueError, IndexError):
        return None


class Patience:
    """So many seconds of waiting that a starved machine does not use up."""

    def __init__(self, seconds: float) -> None:
        self._began, self._starved = time.monotonic(), starved_s()
        self._seconds = seconds if self._starved is not None else WITHOUT_PRESSURE * seconds

    @property
    def over(self) -> bool:
        """Whether the time is up."""
        waited = time.monotonic() - self._began
        if waited <= self._seconds:
            return False
        starved = starved_s()
        return waited - (starved or 0.0) + (self._starved or 0.0) > self._seconds
