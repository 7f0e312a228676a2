# SPDX-License-Identifier: Apache-2.0
"""Types of command-line numbers that refuse impossible values (exit code 2)."""

from __future__ import annotations

import argparse
import math

DEFAULT_CONTACT_RADIUS_M = 0.001
"""As `shell_deform.objects` has it, without loading a surface."""

UNITS = ('cm', 'in', 'inch', 'm', 'mm')
"""Units of files that are read, as `shell_deform.objects.file_mesh` knows them."""


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
