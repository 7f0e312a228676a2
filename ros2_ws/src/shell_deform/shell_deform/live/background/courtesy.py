# SPDX-License-Identifier: Apache-2.0
"""How the background process keeps out of the way of the fast loop, without starving.

A scheduler takes a processor on which only the idle class runs for free, and one on which a nice
process runs for taken: beside a merely nice solver the node, the hand and their listeners queue
on what is left. The idle class in turn gets nothing where all processors are wanted, and a nice
thread next to nothing where they are wanted several times over. So the solver begins as any other
thread, becomes a nice one where that leaves room, and moves to the idle class while it gets on
there; where an equilibrium takes too long it comes back: an answer far behind the hand is worth
less than a later tick.

A thread without privileges can leave neither the idle class nor its niceness: there are three, and
each piece of work goes to one of them.
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
"""Share of a processor that says: there is room for the next more courteous class."""

TELLING_S = 2e-3
"""Work that needs less of a processor does not tell how much of it there is [s]."""

TOO_LONG_S = 0.2
"""Without a sufficient share work that takes longer moves to the next less courteous class [s]."""

PATIENCE_S = 2.0
"""So long a thread works before the next more courteous class is tried [s]."""

CAUTION = 5.0
"""How many times longer after each starvation: the piece of work then begun may take seconds."""

LONGEST_S = 120.0
"""The next more courteous class is tried again after this at the latest [s]."""

PLAIN, NICE, IDLE = range(3)


def busy_for(work: Callable[[], None]) -> float:
    """Do the work; returns how long this thread had a processor for it [s]."""
    before = time.thread_time()
    work()
    return time.thread_time() - before


class Courtesy:
    """Runs work as a plain thread, a nice one or in the idle class.

    To be made before its process becomes nice: the plain thread stems from then, the others later.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        measure: Callable[[Callable[[], None]], float] = busy_for,
    ) -> None:
        """`clock` [s] and `measure` as in `busy_for`."""
        self._clock = clock
        self._measure = measure
        self._pools = (
            ThreadPoolExecutor(1, 'plain'),
            ThreadPoolExecutor(1, 'nice'),
            ThreadPoolExecutor(1, 'idle', initializer=_enter_idle_class),
        )
        # A pool starts its thread at the first piece of work.
        self._pools[PLAIN].submit(int).result()
        self.courtesy = PLAIN
        self._since = clock()
        self._patience = PATIENCE_S

    def run(self, work: Callable[[], None]) -> None:
        """Do the work and wait for it; what it raises is raised here."""
        began = self._clock()
        busy = self._pools[self.courtesy].submit(self._measure, work).result()
        now = self._clock()
        passed = now - began
        if busy < TELLING_S and passed < TOO_LONG_S:
            return
        share = busy / max(passed, busy)
        starved = share < ENOUGH and (self.courtesy == IDLE or passed > TOO_LONG_S)
        if share <= ROOM:
            # Room is what lasts.
            self._since = now
        if starved and self.courtesy > PLAIN:
            self._patience = min(CAUTION * self._patience, LONGEST_S)
            self.courtesy -= 1
        elif self.courtesy < IDLE and now - self._since > self._patience:
            self.courtesy, self._since = self.courtesy + 1, now


def _enter_idle_class() -> None:
    # Where that is forbidden the thread stays as nice as the one that started it.
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
