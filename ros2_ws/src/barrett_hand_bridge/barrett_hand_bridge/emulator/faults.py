"""Faults an emulated hand shows on demand, each with the moment at which it starts."""

from __future__ import annotations

import re
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
    'sleep': 'the motor controller of finger VALUE falls asleep (CAN)',
}


class FaultError(ValueError):
    """A fault that is not known or written wrongly."""


@dataclass(frozen=True)
class Fault:
    """One fault: what, from when (s after start), and its number."""

    kind: str
    at_s: float
    value: float


def parse_fault(text: str) -> Fault:
    """Read `KIND@SECONDS` or `KIND@SECONDS:VALUE`.

    Raises:
        FaultError: the kind is unknown or the form is another.
    """
    match = re.fullmatch(r'([a-z-]+)@(\d+(?:\.\d+)?)(?::(\d+(?:\.\d+)?))?', text)
    if match is None or match.group(1) not in FAULTS:
        raise FaultError(
            f'fault {text!r}: expected KIND@SECONDS or KIND@SECONDS:VALUE with KIND one of '
            + ', '.join(FAULTS)
        )
    return Fault(match.group(1), float(match.group(2)), float(match.group(3) or 0.0))
