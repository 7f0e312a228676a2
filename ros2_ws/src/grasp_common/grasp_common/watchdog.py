# SPDX-License-Identifier: Apache-2.0
"""Whether another process gets on, and what is wrong with it when it does not.

It counts up a number wherever it goes round a loop. When that number stands still, the kernel
tells a process that was stopped or waits for ever from one that loops, and from one that merely
finds no processor: the last is left alone.
"""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

NOTICED_S = 0.4
"""A number that stands still for longer is a process that does not get on [s]."""

WAITS_S = 1.0
"""One whose threads all sleep meanwhile waits for something that does not come [s]."""

LOOPS_S = 2.0
"""One that has used so much processor time meanwhile runs in a circle [s]."""

STARVED_S = 30.0
"""One that found no processor for so long is given up [s]."""


# Of Linux: on other systems a process is not told of its parent's end.
_PRCTL = getattr(ctypes.CDLL(None), 'prctl', None)
PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""

STOPPED = frozenset('Tt')
"""Letters of a thread that a signal or a debugger holds, proc(5)."""


@dataclass(frozen=True)
class Threads:
    """What the kernel says of a process: letters of its threads' states, processor time [s]."""

    states: frozenset[str]
    processor: float


def threads_of(pid: int) -> Threads:
    """See `Threads`; no states for a process that is gone."""
    states, ticks = set(), 0
    try:
        for task in Path(f'/proc/{pid}/task').iterdir():
            # proc(5): the name may hold spaces; behind it the state, and user and system time.
            fields = (task / 'stat').read_text().rsplit(')', 1)[1].split()
            states.add(fields[0])
            ticks += int(fields[11]) + int(fields[12])
    except OSError:
        return Threads(frozenset(), 0.0)
    return Threads(frozenset(states), ticks / os.sysconf('SC_CLK_TCK'))


def wake_with_parent() -> None:
    """Ask the kernel to let this process go on when the one that started it ends.

    It then sees the end of its pipe and follows, where somebody had stopped it (SIGSTOP): a
    stopped process sees nothing and would be left over. To one that runs it does nothing. Made to
    be a `preexec_fn`, before there is anything to stop: one system call that takes no lock.
    """
    _at_parents_end(signal.SIGCONT)


def end_with_parent() -> None:
    """Ask the kernel to kill this process when the one that started it ends; a `preexec_fn`, too.

    Not to terminate it: a process that somebody has stopped would not hear that.
    """
    _at_parents_end(signal.SIGKILL)


def _at_parents_end(sent: signal.Signals) -> None:
    if _PRCTL is not None:
        _PRCTL(PR_SET_PDEATHSIG, int(sent))


def is_stopped(pid: int) -> bool:
    """Whether a signal or a debugger holds every thread of the process."""
    states = threads_of(pid).states
    return bool(states) and states <= STOPPED


class Watchdog:
    """Follows one process; `look` says what is wrong, `hopeless` whether it must be replaced."""

    def __init__(self, pid: int, threads: Callable[[int], Threads] = threads_of) -> None:
        self._pid = pid
        self._threads = threads
        self._beats = -1
        self._since = 0.0
        self._processor = 0.0
        self._looked = 0.0
        self.trouble = ''
        self.hopeless = False

    def look(self, beats: int, now: float) -> str:
        """What is wrong, or ''; `beats` as counted by the process, `now` steady [s]."""
        if beats != self._beats or now - self._looked > NOTICED_S:
            # The second: this process itself has not looked for long, so that nothing is known.
            self._beats, self._since = beats, now
            self.trouble, self.hopeless = '', False
            self._processor = -1.0
        self._looked = now
        silent = now - self._since
        if silent > 0.5 * NOTICED_S and self._processor < 0.0:
            self._processor = self._threads(self._pid).processor
        if silent > NOTICED_S:
            self._judge(silent)
        return self.trouble

    def _judge(self, silent: float) -> None:
        found = self._threads(self._pid)
        used = found.processor - self._processor
        if found.states <= STOPPED:
            self.trouble, self.hopeless = 'is stopped', True
        elif used > LOOPS_S:
            self.trouble, self.hopeless = 'runs in a circle', True
        elif found.states & {'R', 'D'}:
            self.trouble, self.hopeless = 'finds no processor', silent > STARVED_S
        else:
            self.trouble, self.hopeless = 'hangs', silent > WAITS_S
