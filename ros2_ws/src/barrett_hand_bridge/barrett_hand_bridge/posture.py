# SPDX-License-Identifier: Apache-2.0
"""What the encoders say for a finger being free: the hand stands still, has opened, is open.

A gauge alone cannot tell a load from a zero that stepped. A finger that has not moved since its
reading was right, that has gone back, or that is fully open can hardly have met something.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from barrett_hand_bridge.hand import FINGERS, EncoderScale, HandSample

STILL_COUNTS = 2
# 3.6 mm at the end of a pin of the default hand: more than a dent of 1 N is deep.
WITHDRAWN_RAD = 0.03
# Beside its end stop a finger of an open hand stands outside of anything it could have grasped.
OPEN_RAD = 0.1


class HandPosture:
    """Since when the whole hand stands, and how far each finger has gone back."""

    def __init__(self, encoder: EncoderScale) -> None:
        """Nothing seen yet."""
        self._encoder = encoder
        self.still_since_s = math.inf
        # When each finger last closed.
        self.closed_at_s = dict.fromkeys(FINGERS, -math.inf)
        self._stood: tuple[int, ...] | None = None
        self._most_closed: dict[int, int] = {}
        self._most_open: dict[int, int] = {}

    def forget(self) -> None:
        """The hand was away: it may have moved."""
        self.still_since_s = math.inf
        self.closed_at_s = dict.fromkeys(FINGERS, -math.inf)
        self._stood = None
        self._most_closed.clear()
        self._most_open.clear()

    def see(self, sample: HandSample) -> None:
        """Take the motor positions of one sample."""
        positions = (*sample.finger_counts, sample.spread_counts)
        stood = self._stood
        if stood is None or any(
            abs(now - before) > STILL_COUNTS for now, before in zip(positions, stood, strict=True)
        ):
            self._stood = positions
            self.still_since_s = sample.stamp_ns * 1e-9
        for finger, counts in zip(FINGERS, sample.finger_counts, strict=True):
            lowest = self._most_open.setdefault(finger, counts)
            self._most_closed.setdefault(finger, counts)
            if counts > lowest + STILL_COUNTS:
                # It closes (again): from here on it may meet something.
                self._most_closed[finger] = self._most_open[finger] = counts
                self.closed_at_s[finger] = sample.stamp_ns * 1e-9
            self._most_open[finger] = min(self._most_open[finger], counts)

    def withdrawn(self, finger: int) -> bool:
        """Whether the finger's last way was one of opening, and long enough to leave a dent."""
        if finger not in self._most_open:
            return False
        way = self._most_closed[finger] - self._most_open[finger]
        return way * self._encoder.finger_rad_per_count >= WITHDRAWN_RAD


def is_open(inner_rad: Mapping[int, float], finger: int) -> bool:
    """Whether a finger stands at its open end, by the angles of the inner joints in rad."""
    return inner_rad[finger] <= OPEN_RAD
