"""Types of command-line numbers that refuse impossible values (exit code 2)."""

from __future__ import annotations

import argparse
import math


def above_zero(text: str) -> float:
    """A finite number above zero."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not above zero')
    return value


def not_negative(text: str) -> float:
    """A finite number of at least zero."""
    value = float(text)
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is negative')
    return value
