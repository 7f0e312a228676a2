# SPDX-License-Identifier: Apache-2.0
"""Status sums of an emulated BH8-262, and the checks that lead to them."""

from __future__ import annotations

import re

from barrett_hand_bridge.emulator.serial_parameters import Limits

NOT_INITIALISED = 4
POSITION_NOT_REACHED = 16
UNKNOWN_COMMAND = 32
UNKNOWN_PARAMETER = 64
INVALID_VALUE = 128
READ_ONLY = 256
TOO_MANY_ARGUMENTS = 1024
PREFIX_NOT_ALLOWED = 4096
OVER_TEMPERATURE = 8192
INTERRUPTED = 16384


class RefusedError(Exception):
    """A command the hand refuses, with its status sum."""

    def __init__(self, status: int) -> None:
        """Keep the status sum."""
        super().__init__(status)
        self.status = status


def name_value_pairs(words: list[str]) -> list[tuple[str, int]]:
    """Names and whole numbers in turn.

    Raises:
        RefusedError: an odd number of words, or a value that is no whole number.
    """
    if len(words) % 2:
        raise RefusedError(INVALID_VALUE)
    pairs = []
    for name, text in zip(words[::2], words[1::2], strict=True):
        if not re.fullmatch(r'-?\d{1,10}', text):
            raise RefusedError(INVALID_VALUE)
        pairs.append((name, int(text)))
    return pairs


def check_value(limits: Limits | None, value: int) -> None:
    """Whether a parameter exists, may be written and allows a value.

    Raises:
        RefusedError: one of these is not so.
    """
    if limits is None:
        raise RefusedError(UNKNOWN_PARAMETER)
    if limits.read_only:
        raise RefusedError(READ_ONLY)
    if not limits.lowest <= value <= limits.highest:
        raise RefusedError(INVALID_VALUE)
