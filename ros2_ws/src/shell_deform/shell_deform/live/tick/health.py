# SPDX-License-Identifier: Apache-2.0
"""Figures of the running node: latencies, rates, losses, memory."""

from __future__ import annotations

import os
import time
from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np

WINDOW = 4096
JUMP_S = 1.0
"""Stamps that leave their publisher's clock by more have jumped; less is a loss of samples [s]."""
JUMP_PERIODS = 10.0
"""And by so many sample periods: a slow stream played fast does not jump. A step back by less than
so many periods, and than `JUMP_S`, is a sample that comes late."""
LATE_S = 0.05
"""A step back by less is a late sample, whatever the period [s]."""
GAPS = 9
"""The sample period is the median of so many gaps: a pause or a jump among them is none."""


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


class Arrival(Enum):
    """What a stamp says about its sample."""

    NEXT = 'goes on from the last one'
    REPEATED = 'is the last one again'
    LATE = 'was overtaken by a newer one of the same stream'
    JUMPED = 'belongs to another time: what happened in between was not seen'


class StampWatch:
    """Counts what the stamps of a stream tell: samples, repeats, late ones, jumps of time.

    Time jumps when it goes back (a bag played again, a seek) and when it runs ahead of the clock
    by which its messages are sent (a seek forwards). A pause of the hand is neither: both clocks
    go on. Nor is a node that catches up: when it comes to a message says nothing of when it was
    sent.
    A step back of a few sample periods is no jump either: that sample was overtaken.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.repeated = 0
        self.late = 0
        self.jumps = 0
        self._last = 0
        self._sent = 0.0
        self._gaps: deque[float] = deque(maxlen=GAPS)

    def arrived(self, stamp_ns: int, sent: float) -> Arrival:
        """Take the stamp of a sample that was published at `sent` [s] by its publisher's clock."""
        if self.samples and stamp_ns == self._last:
            self.repeated += 1
            return Arrival.REPEATED
        gap = 1e-9 * (stamp_ns - self._last)
        period = self._period
        if self.samples and -min(max(JUMP_PERIODS * period, LATE_S), JUMP_S) < gap < 0.0:
            self.samples += 1
            self.late += 1
            return Arrival.LATE
        ahead = gap - (sent - self._sent)
        first = self.samples == 0
        self.samples += 1
        self._last, self._sent = stamp_ns, sent
        if first:
            return Arrival.NEXT
        if gap > 0.0:
            self._gaps.append(gap)
        if gap < 0.0 or (ahead > JUMP_S and 0.0 < JUMP_PERIODS * period < gap):
            self.jumps += 1
            return Arrival.JUMPED
        return Arrival.NEXT

    @property
    def _period(self) -> float:
        """Between two samples [s]; 0 before the second one."""
        return sorted(self._gaps)[(len(self._gaps) - 1) // 2] if self._gaps else 0.0


class LossCount:
    """Messages lost on the way, from the sequence numbers of the middleware.

    Every publisher counts its own, and a message does not say whose it is: with several of them,
    or where the middleware does not number, the loss is unknown (None), never guessed.
    """

    def __init__(self) -> None:
        self._lost = 0
        self._pending = 0
        self._last: int | None = None
        self._unknown = False

    def arrived(self, sequence: int | None) -> None:
        """A message came with its number."""
        if sequence is None:
            self._unknown = True
            return
        if self._last is not None and sequence > self._last + 1:
            self._pending += sequence - self._last - 1
        self._last = sequence

    def settle(self, publishers: int) -> None:
        """Once in a while: gaps so far are losses if they came from one publisher."""
        if publishers > 1:
            self._unknown, self._last = True, None
        elif not self._unknown:
            self._lost += self._pending
        self._pending = 0

    @property
    def lost(self) -> int | None:
        """How many, None if unknown."""
        return None if self._unknown else self._lost + self._pending


@dataclass
class Figures:
    """What the node counts and measures.

    Attributes:
        stamps, losses: of the contacts.
        ticks: from the call for a sample to its published surface.
        answers: from the publication of a sample, elsewhere, to that of its surface.
        refused: samples that could not be used. refreshes: load cases answered in the background.
        arrivals: messages of contacts that came, whatever they said.
        first_surface: from the start of the process to the first served surface [s].
    """

    stamps: StampWatch = field(default_factory=StampWatch)
    losses: LossCount = field(default_factory=LossCount)
    ticks: Latencies = field(default_factory=Latencies)
    answers: Latencies = field(default_factory=Latencies)
    refused: int = 0
    refreshes: int = 0
    first_surface: float = 0.0
    arrivals: int = 0
    _arrivals_counted: int = 0
    _arrivals_counted_at: float = 0.0
    _answered: int = 0
    _counted: int = 0
    _counted_at: float = 0.0

    def refreshed(self, answers: int) -> None:
        """A result for load case number `answers` came; a second one for it is no refresh."""
        self.refreshes += int(answers != self._answered)
        self._answered = answers

    def input_rate(self, now: float) -> float:
        """Messages of contacts per second [Hz] since the last call; `now` is steady [s]."""
        came, passed = self.arrivals - self._arrivals_counted, now - self._arrivals_counted_at
        self._arrivals_counted, self._arrivals_counted_at = self.arrivals, now
        return came / max(passed, 1e-9)

    def refresh_rate(self, now: float) -> float:
        """Refreshes per second [Hz] since the last call; `now` is steady [s]."""
        rate = (self.refreshes - self._counted) / max(now - self._counted_at, 1e-9)
        self._counted, self._counted_at = self.refreshes, now
        return rate


def resident(pid: int) -> float:
    """Resident memory of a process [byte], 0 if there is none of that number."""
    try:
        pages = Path(f'/proc/{pid}/statm').read_text().split()[1]
    except OSError:
        return 0.0
    return float(pages) * os.sysconf('SC_PAGE_SIZE')


def process_age() -> float:
    """How long this process runs [s]."""
    # proc(5): field 22 is the start in clock ticks after boot; the name before may hold spaces.
    started = Path('/proc/self/stat').read_text().rsplit(')', 1)[1].split()[19]
    ticks = float(started) / os.sysconf('SC_CLK_TCK')
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks
