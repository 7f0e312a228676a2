# SPDX-License-Identifier: Apache-2.0
"""The page's colours on a light and on a dark ground; `page.css` holds the same ones.

Fingers differ by colour and by the pattern of their lines; text on its ground has a contrast of
at least 4.5 to 1, marks 3 to 1 (a test reads them).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .colour_map import Bytes

Colour = tuple[int, int, int]


def rgb(text: str) -> Colour:
    """The three bytes of `#rrggbb`."""
    red, green, blue = bytes.fromhex(text.removeprefix('#'))
    return red, green, blue


@dataclass(frozen=True)
class Palette:
    """Colours as `#rrggbb`: panel, ends of the background, two inks, one per finger."""

    panel: str
    top: str
    bottom: str
    ink: str
    second_ink: str
    fingers: tuple[str, str, str]
    good: str
    warning: str
    bad: str
    hand: str
    pin: str

    def finger(self, number: int) -> Colour:
        """The colour of finger 1, 2 or 3; of others in turn."""
        return rgb(self.fingers[(number - 1) % len(self.fingers)])

    def background(self) -> Bytes:
        """A soft gradient (64, 2, 3), upper end first."""
        share = np.linspace(0.0, 1.0, 64)[:, None]
        rows = (1.0 - share) * np.array(rgb(self.top)) + share * np.array(rgb(self.bottom))
        return np.repeat(np.round(rows).astype(np.uint8)[:, None], 2, axis=1)


LIGHT = Palette(
    panel='#ffffff',
    top='#eef2f5',
    bottom='#cdd6de',
    ink='#17202b',
    second_ink='#4d5966',
    fingers=('#005a9c', '#a84300', '#6b4e8f'),
    good='#1b6e3c',
    warning='#8a5300',
    bad='#b3261e',
    hand='#9ea8b2',
    pin='#606a76',
)
DARK = Palette(
    panel='#151b22',
    top='#1d242d',
    bottom='#0b0f14',
    ink='#e7ecf1',
    second_ink='#a5b1bd',
    fingers=('#6cb4f2', '#ffa35c', '#c3a6ea'),
    good='#58c27f',
    warning='#f0b23e',
    bad='#ff8a80',
    hand='#505a65',
    pin='#7d8894',
)
