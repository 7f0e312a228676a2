# SPDX-License-Identifier: Apache-2.0
"""Where labels stand in a picture, in pixels: beside the body and the arrow they belong to.

Rows count downwards. A label stands at its arrow's tail, on the side of the body where the tail
is; where the picture is too narrow for that, at its edge and above the arrow, clear of the body
and of the labels placed before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .poses import Floats

PER_SIGN, AROUND, TALL = 6.8, 6.0, 18.0
"""A letter's width on the average, what a label has besides its letters, and its height."""
MARGIN, GAP = 6.0, 8.0
ABOVE_ARROW = 12.0
LEAST_TOP = 34.0
"""Above it stands what is written over the picture of a phone."""


@dataclass(frozen=True)
class Outline:
    """The ellipse around a body: its middle and half axes."""

    column: float
    row: float
    half_width: float
    half_height: float

    def top_between(self, left: float, right: float) -> float:
        """Its least row between two columns; infinite beside it."""
        off = max(left - self.column, self.column - right, 0.0) / max(self.half_width, 1e-9)
        if off >= 1.0:
            return float('inf')
        return self.row - self.half_height * float(np.sqrt(1.0 - off * off))


@dataclass(frozen=True)
class Box:
    """A label's place; `tail` is the column of its edge nearer to the arrow."""

    left: float
    right: float
    row: float
    to_right: bool

    @property
    def tail(self) -> float:
        """Where the label is held: whatever its true width, it grows away from the body."""
        return self.left if self.to_right else self.right

    def meets(self, other: Box) -> bool:
        """Whether the two cover each other."""
        apart = self.left >= other.right or other.left >= self.right
        return not apart and abs(self.row - other.row) < TALL


def outline(places: Floats) -> Outline:
    """The ellipse of what lies at `places` (n, 2)."""
    low, high = places.min(axis=0), places.max(axis=0)
    (column, row), (half_width, half_height) = 0.5 * (low + high), 0.5 * (high - low)
    return Outline(float(column), float(row), float(half_width), float(half_height))


def label_box(
    text: str, tail: Floats, body: Outline, width: float, others: Sequence[Box] = ()
) -> Box:
    """The place of a label whose arrow ends at `tail` (2,), in a picture so many pixels wide."""
    wide = PER_SIGN * len(text) + AROUND
    to_right = bool(tail[0] > body.column)
    # Beside the body too, where the arrow ends behind or before it.
    if to_right:
        start = max(tail[0], body.column + body.half_width) + GAP
    else:
        start = min(tail[0], body.column - body.half_width) - GAP - wide
    left = float(np.clip(start, MARGIN, max(width - wide - MARGIN, MARGIN)))
    row = float(tail[1])
    if abs(left - start) >= 1.0:
        clear = body.top_between(left - GAP, left + wide + GAP) - 0.5 * TALL - GAP
        row = min(row - ABOVE_ARROW - 0.5 * TALL, clear)
    box = Box(left, left + wide, max(row, LEAST_TOP), to_right)
    for other in sorted(others, key=lambda other: -other.row):
        if box.meets(other):
            box = Box(box.left, box.right, other.row - TALL - 2.0, to_right)
    return box
