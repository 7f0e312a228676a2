# SPDX-License-Identifier: Apache-2.0
"""Types of command-line numbers that refuse impossible values (exit code 2)."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

DEFAULT_CONTACT_RADIUS_M = 0.001
"""As `shell_deform.objects` has it, without loading a surface."""


def _number(text: str) -> float:
    """Any number, a NaN among them."""
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r} is no number') from error


def above_zero(text: str) -> float:
    """A finite number above zero."""
    value = _number(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not above zero')
    return value


def not_negative(text: str) -> float:
    """A finite number of at least zero."""
    value = _number(text)
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a number of at least zero')
    return value


def finite(text: str) -> float:
    """A finite number."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text} is not finite')
    return value


def poisson(text: str) -> float:
    """A ratio of Poisson that an elastic body can have."""
    value = _number(text)
    if not -1.0 < value <= 0.5:
        raise argparse.ArgumentTypeError(f'{text} is not above -1 and up to 0.5')
    return value


def count(low: int, high: int) -> Callable[[str], int]:
    """A whole number between two."""

    def counted(text: str) -> int:
        try:
            value = int(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(f'{text!r} is no whole number') from error
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text} is not between {low} and {high}')
        return value

    return counted


def direction(text: str) -> tuple[float, float, float]:
    """The unit vector along X,Y,Z."""
    try:
        values = [float(part) for part in text.replace(',', ' ').split()]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r}: {error}') from error
    if len(values) != 3 or not all(map(math.isfinite, values)) or not any(values):
        raise argparse.ArgumentTypeError(f'{text!r} is no direction X,Y,Z')
    # The largest first: the length of very long and very short ones is no number.
    largest = max(map(abs, values))
    x, y, z = (value / largest for value in values)
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def contact(text: str) -> tuple[float, float, float, float]:
    """Place and radius of a pin, from X,Y,Z or X,Y,Z,RADIUS."""
    try:
        parts = [float(part) for part in text.split(',')]
    except ValueError:
        parts = []
    if len(parts) == 3:
        parts.append(DEFAULT_CONTACT_RADIUS_M)
    if len(parts) != 4 or not all(map(math.isfinite, parts)) or parts[3] <= 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not X,Y,Z,RADIUS with a radius above zero')
    return parts[0], parts[1], parts[2], parts[3]
