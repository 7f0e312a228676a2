# SPDX-License-Identifier: Apache-2.0
"""The scale bar over the scene: a round length, as long as it is on the screen."""

from __future__ import annotations

import math

from .layer import SCALE

LONGEST_PX = 120.0
STEPS = (5.0, 2.0, 1.0)


def round_length(most: float) -> float:
    """The longest of 1, 2 and 5 times a power of ten that is not longer than `most` > 0."""
    power = 10.0 ** math.floor(math.log10(most))
    # 0.002 / 0.001 is a little less than 2.
    return next((step * power for step in STEPS if step * power <= most * (1 + 1e-9)), power)


def scale_html(pixel: float) -> str:
    """The bar where a pixel is `pixel` units of the scene wide; empty while that is unknown."""
    if not (math.isfinite(pixel) and pixel > 0.0):
        return ''
    millimetres = 1e3 * pixel / SCALE
    length = round_length(LONGEST_PX * millimetres)
    return (
        f'<i style="width:{length / millimetres:.0f}px" title="at the middle of the object"></i>'
        f'{length:g} mm'
    )
