# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: what it shows, read as a visitor reads it, and its controls."""

from __future__ import annotations

import io
import re

import numpy as np
from PIL import Image


def picture(tab) -> np.ndarray:
    """The pixels between the two panels, below the notice of software rendering, (h, w, 3)."""
    # Software rendering and the test share the processor: let the page work in between.
    tab.wait_for_timeout(150)
    shot = tab.screenshot()
    scene = Image.open(io.BytesIO(shot)).convert('RGB').crop((310, 200, 670, 640))
    return np.asarray(scene).astype(int)


def share_of(image: np.ndarray, colour: np.ndarray, off: int = 2) -> float:
    """Which share of the picture's pixels is `colour`, up to `off` of 255."""
    return float((np.abs(image - colour.astype(int)).max(axis=2) <= off).mean())


def legend(tab) -> list[float]:
    return [float(text) for text in tab.locator('.grasp-legend-numbers span').all_inner_texts()]


def numbers(tab) -> str:
    return ' '.join(tab.locator('.grasp-numbers').inner_text().split())


def choose(tab, label: str, option: str) -> None:
    tab.get_by_label(label, exact=True).click()
    tab.get_by_role('option', name=option, exact=True).click()


def buttons(tab) -> set[str]:
    """The labels of all buttons that a visitor sees."""
    return {text for text in tab.locator('button:visible').all_inner_texts() if text}


def displacement_mm(tab) -> float:
    """The displacement in the banner (mm); NaN while it is not known."""
    found = re.search(r'displacement ([\d.]+) mm', numbers(tab))
    return float(found.group(1)) if found else float('nan')


def row_of(tab, label: str, what: str):
    """A part of the slider called `label`: its `[@role="slider"]` or its `[@type="text"]`."""
    beside = f'//*[normalize-space(text())="{label}"]'
    return tab.locator(f'xpath={beside}/following::*{what}').first


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
    tab.mouse.up()
    return float(thumb.get_attribute('aria-valuenow'))
