# SPDX-License-Identifier: Apache-2.0
"""Faults an emulated hand shows on demand: at a moment, or when it is told to."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

FAULTS: dict[str, str] = {
    'drop': 'the next VALUE bytes (or frames) from the hand are lost',
    'garble': 'the next VALUE bytes (or frames) from the hand are changed',
    'delay': 'answers come VALUE seconds late from now on',
    'mute': 'the hand says nothing for VALUE seconds',
    'brown-out': 'the hand restarts and prints its banner (serial) or sleeps (CAN)',
    'unplug': 'the line is cut for VALUE seconds (0: for ever)',
    'loop-error': 'the next RealTime block is answered by ERR VALUE (serial)',
    'no-gauge': 'the gauge of finger VALUE reads as not fitted',
    'hot': 'the hand reports 70 degrees Celsius',
    'press': 'the cells of --press are pressed only now (CAN)',
    'no-touch': 'the touch cells of finger VALUE do not start (CAN)',
    'sleep': 'the motor controller of finger VALUE falls asleep (CAN)',
}
NEEDS_FINGER = ('no-gauge', 'no-touch', 'sleep')
ON_SIGNAL = 'signal'


class FaultError(ValueError):
    """A fault that is not known or written wrongly."""


@dataclass(frozen=True)
class Fault:
    """One fault: what, from when (s after start, infinite: when told to), and its number."""

    kind: str
    at_s: float
    value: float


def parse_fault(text: str) -> Fault:
    """Read `KIND@SECONDS` or `KIND@signal`, with `:VALUE` behind it where it needs one.

    Raises:
        FaultError: the kind is unknown or the form is another.
    """
    match = re.fullmatch(r'([a-z-]+)@(signal|\d+(?:\.\d+)?)(?::(\d+(?:\.\d+)?))?', text)
    if match is None or match.group(1) not in FAULTS:
        raise FaultError(
            f'fault {text!r}: expected KIND@SECONDS[:VALUE] or KIND@signal[:VALUE] with KIND one '
            'of ' + ', '.join(FAULTS)
        )
    if match.group(1) in NEEDS_FINGER and match.group(3) not in ('1', '2', '3'):
        raise FaultError(f'fault {text!r}: needs a finger, 1, 2 or 3, behind a colon')
    moment = math.inf if match.group(2) == ON_SIGNAL else float(match.group(2))
    return Fault(match.group(1), moment, float(match.group(3) or 0.0))


class FaultPlan:
    """The faults still to come, in order. `strike` may come from another thread."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        """The clock of the plan starts now."""
        self._begin_s = time.monotonic()
        self._timed = sorted((f for f in faults if f.at_s < math.inf), key=lambda f: f.at_s)
        self._waiting = [f for f in faults if f.at_s == math.inf]
        self._struck: list[Fault] = []
        self._lock = threading.Lock()

    def strike(self) -> None:
        """Let the next fault that waits for it happen now."""
        with self._lock:
            if self._waiting:
                self._struck.append(self._waiting.pop(0))

    def due(self, now_s: float) -> list[Fault]:
        """Faults whose moment (monotonic time in s) has come, once each."""
        with self._lock:
            due, self._struck = self._struck, []
        while self._timed and now_s - self._begin_s >= self._timed[0].at_s:
            due.append(self._timed.pop(0))
        return due
