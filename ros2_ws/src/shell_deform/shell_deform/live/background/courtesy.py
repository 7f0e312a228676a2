# SPDX-License-Identifier: Apache-2.0
"""How the background process keeps out of the way of the fast loop.

A scheduler takes a processor on which only the idle class runs for free, and one on which a nice
process runs for taken: beside a merely nice solver the node, the hand and their listeners queue
on what is left. The idle class in turn gets nothing where all processors are wanted. So the solver
runs in the idle class while it gets on there, and as a nice thread when it does not.

A thread without privileges cannot leave the idle class: there are two, and each piece of work goes
to one of them.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

ENOUGH = 0.3
"""Share of a processor with which a thread in the idle class gets on."""

ROOM = 0.7
"""Share of a processor of a nice thread that says: there is room for the idle class."""

PATIENCE_S = 2.0
"""So long a nice thread works before the idle class is tried [s]."""

CAUTION = 5.0
"""How many times longer after each starvation: the piece of work then begun may take seconds."""

LONGEST_S = 120.0
"""The idle class is tried again after this at the latest [s]."""


def share_of(work: Callable[[], None]) -> float:
    """Do the work; returns which share of the time this thread had a processor."""
    wall, busy = time.perf_counter(), time.thread_time()
    work()
    passed = time.perf_counter() - wall
    return 1.0 if passed <= 0 else (time.thread_time() - busy) / passed


class Courtesy:
    """Runs work in the idle class or beside it; `clock` [s] and `measure` as in `share_of`."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        measure: Callable[[Callable[[], None]], float] = share_of,
    ) -> None:
        self._clock = clock
        self._measure = measure
        self._nice = ThreadPoolExecutor(1, 'nice')
        self._idle = ThreadPoolExecutor(1, 'idle', initializer=_enter_idle_class)
        self.in_idle_class = False
        self._since = clock()
        self._patience = PATIENCE_S

    def run(self, work: Callable[[], None]) -> None:
        """Do the work and wait for it; what it raises is raised here."""
        pool = self._idle if self.in_idle_class else self._nice
        share = pool.submit(self._measure, work).result()
        now = self._clock()
        if self.in_idle_class:
            change = share < ENOUGH
            if change:
                self._patience = min(CAUTION * self._patience, LONGEST_S)
        else:
            change = share > ROOM and now - self._since > self._patience
        if change:
            self.in_idle_class = not self.in_idle_class
            self._since = now


def _enter_idle_class() -> None:
    # Where that is forbidden the thread stays as nice as its process.
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
