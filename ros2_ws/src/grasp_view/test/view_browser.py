# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: what it shows, read as a visitor reads it, and its controls."""

from __future__ import annotations

import io
import re

import numpy as np
from PIL import Image
from tests.running import wait_until

from grasp_view.colour_map import TABLE
from grasp_view.shading import DARKEST_UNREAD, lit_colours

MIDDLE = (330, 60, 780, 560)


def picture(tab) -> np.ndarray:
    """The pixels in the middle of the scene, where the object is, (h, w, 3)."""
    # Software rendering and the test share the processor: let the page work in between.
    tab.wait_for_timeout(150)
    shot = tab.screenshot()
    scene = Image.open(io.BytesIO(shot)).convert('RGB').crop(MIDDLE)
    return np.asarray(scene).astype(np.int16)


def share_of(image: np.ndarray, colour: np.ndarray, off: int = 2) -> float:
    """Which share of the picture's pixels is `colour` in some light, up to `off` of 255."""
    lights = np.linspace(DARKEST_UNREAD, 1.0, 26)
    shades = lit_colours(np.repeat(colour[None], len(lights), axis=0), lights).astype(np.int16)
    hit = [np.abs(image - shade).max(axis=2) <= off for shade in shades]
    return float(np.any(hit, axis=0).mean())


def deep(tab) -> bool:
    """Whether the picture shows the navy of the upper end of the scale."""
    return share_of(picture(tab), TABLE[240], 12) > 1e-4


def legend(tab) -> list[float]:
    return [float(text) for text in tab.locator('.grasp-legend-numbers span').all_inner_texts()]


def numbers(tab) -> str:
    """The one number and the table of the others, in one line."""
    parts = [tab.locator(name).inner_text() for name in ('.grasp-largest', '.grasp-numbers')]
    return ' '.join(' '.join(parts).split())


def choose(tab, label: str, option: str) -> None:
    tab.get_by_label(label, exact=True).click()
    tab.get_by_role('option', name=option, exact=True).click()


def buttons(tab) -> set[str]:
    """The labels of all buttons that a visitor sees."""
    return {text for text in tab.locator('button:visible').all_inner_texts() if text}


def displacement_mm(tab) -> float:
    """The largest displacement (mm); NaN while it is not known."""
    found = re.match(r'([\d.]+) (?:± [\d.]+ )?mm', numbers(tab))
    return float(found.group(1)) if found else float('nan')


def row_of(tab, label: str, what: str):
    """A part of the slider called `label`: its `[@role="slider"]` or its `[@type="text"]`."""
    beside = f'//*[normalize-space(text())="{label}"]'
    return tab.locator(f'xpath={beside}/following::*{what}').first


def as_at_first(tab) -> None:
    """Choose what the page's controls have chosen when it starts."""
    for label, first in (('Colour', 'displacement'), ('Answer', 'served')):
        if tab.get_by_label(label, exact=True).input_value() != first:
            choose(tab, label, first)
    enter(tab, 'Exaggerate', 1.0)


def slider(tab, label: str):
    """The thumb of a slider."""
    return row_of(tab, label, '[@role="slider"]')


def enter(tab, label: str, value: float) -> None:
    """Type a number beside a slider."""
    box = row_of(tab, label, '[@type="text"]')
    box.fill(f'{value:g}')
    box.press('Enter')


def drag(tab, label: str, share: float) -> float:
    """Drag a slider with the mouse to `share` of its way; returns the value it then has."""
    thumb = slider(tab, label)
    thumb.scroll_into_view_if_needed()
    here, way = thumb.bounding_box(), thumb.locator('xpath=..').bounding_box()
    y = here['y'] + here['height'] / 2
    tab.mouse.move(here['x'] + here['width'] / 2, y)
    tab.mouse.down()
    tab.mouse.move(way['x'] + share * way['width'], y, steps=10)

    def value(name: str = 'now') -> float:
        return float(thumb.get_attribute(f'aria-value{name}'))

    least, most = value('min'), value('max')
    # A busy browser follows the mouse late; released before that, the thumb stays on its way.
    wait_until(lambda: abs(value() - least - share * (most - least)) < 0.05 * (most - least))
    tab.mouse.up()
    return value()
