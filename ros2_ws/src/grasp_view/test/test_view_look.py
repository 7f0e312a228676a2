# SPDX-License-Identifier: Apache-2.0
"""How the page looks in a browser: contrast, names of controls, themes, sizes, no complaints."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.legible import NAMELESS, TEXTS, contrast, luminance, worst_contrast
from view_browser import displacement_mm, picture

from grasp_view.palette import DARK, LIGHT, Palette, rgb

GROUND = 40, 5
"""A pixel of the picture's middle with nothing but ground in it."""


@pytest.mark.parametrize('palette', [LIGHT, DARK])
def test_text_and_marks_stand_out_from_their_ground(palette: Palette) -> None:
    for ink in (palette.ink, palette.second_ink):
        for ground in (palette.panel, palette.top, palette.bottom):
            assert contrast(rgb(ink), rgb(ground)) >= 4.5
    for mark in (*palette.fingers, palette.good, palette.warning, palette.bad):
        assert contrast(rgb(mark), rgb(palette.panel)) >= 4.5
        assert contrast(rgb(mark), rgb(palette.bottom)) >= 3.0


def opened(tab, address: str, wait_until):
    """The page in that tab, once it shows a dent of 4.8 mm."""
    tab.goto(address)
    wait_until(lambda: displacement_mm(tab) == 4.8, 60)
    # Over the picture, or in a phone's sheet.
    wait_until(lambda: tab.locator('.grasp-legend-numbers').is_visible(), 60)
    return tab


@pytest.fixture(autouse=True)
def dented(squeezed) -> None:
    """The ball is pressed by 4.8 mm."""
    squeezed.depth = 4.8e-3


def troubles(tab, ground: tuple[int, int, int], wait_until) -> None:
    """Assert that a visitor can read the page and use it, and that nothing is asked elsewhere."""
    low = [one for one in worst_contrast(tab.evaluate(TEXTS), ground) if one[0] < 4.5]
    assert low == []
    small = [one for one in tab.evaluate(TEXTS) if one['size'] < 11]
    assert [(one['text'], one['size']) for one in small] == []
    wait_until(lambda: tab.evaluate(NAMELESS) == [], 60, lambda: str(tab.evaluate(NAMELESS)))
    assert tab.evaluate('document.documentElement.lang') == 'en'
    assert tab.complaints == []
    own = tab.evaluate('location.origin')
    assert [url for url in tab.asked if not url.startswith((f'{own}/', 'data:', 'blob:'))] == []


@pytest.mark.chromium
def test_the_page_passes_contrast_names_and_console_in_the_light(page, wait_until) -> None:
    wait_until(lambda: displacement_mm(page) == 4.8, 60)
    troubles(page, rgb(LIGHT.panel), wait_until)


@pytest.mark.chromium
def test_a_dark_browser_gets_a_dark_page_beside_a_light_one_and_has_a_switch(
    page, address: str, open_tab, wait_until
) -> None:
    dim = opened(open_tab(1000, 640, color_scheme='dark'), address, wait_until)
    troubles(dim, rgb(DARK.panel), wait_until)
    assert luminance(picture(page)[GROUND]) > 0.5 and luminance(picture(dim)[GROUND]) < 0.1
    dim.get_by_role('button', name='Light').click()
    wait_until(lambda: displacement_mm(dim) == 4.8, 60)
    wait_until(lambda: luminance(picture(dim)[GROUND]) > 0.5, 60)


def around_body(tab, path: Path, end: float) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the body's yellow in the page above `end`."""
    tab.screenshot(path=path, scale='css')
    with Image.open(path) as image:
        seen = np.asarray(image.convert('RGB')).astype(int)[: round(end)]
    body = (seen[..., 0] - seen[..., 2] > 90) & (seen[..., 0] > 120)
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    if not len(rows):
        return 0, 0, 0, 0
    return int(columns[0]), int(columns[-1]), int(rows[0]), int(rows[-1])


@pytest.mark.chromium
@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1024, 768), (1440, 900)])
def test_the_object_is_whole_and_nothing_runs_off_the_side(
    address: str, open_tab, width: int, height: int, tmp_path: Path, wait_until
) -> None:
    # Two pixels of the display in one of the page, as phones have.
    phone = {'has_touch': True, 'is_mobile': True, 'device_scale_factor': 2}
    phone = phone if width < 600 else {}
    tab = opened(open_tab(width, height, **phone), address, wait_until)
    tab.add_style_tag(content='.mantine-Notifications-root { display: none }')
    free = 0.54 * height if width < 600 else height
    # What is yellow below is the legend in the sheet.
    scene = 44 + 0.54 * (height - 44) if width < 600 else height

    def whole() -> bool:
        """Whether it lies between header, sides and what is below, and is large."""
        left, right, top, bottom = around_body(tab, tmp_path / 'page.png', scene)
        inside = left > 2 and right < width - 2 and top > 46 and bottom < free
        return inside and right - left > 0.18 * width

    wait_until(whole, 60, lambda: str(around_body(tab, tmp_path / 'page.png', scene)))
    assert tab.evaluate('document.documentElement.scrollWidth') <= width
    wide = """() => [...document.querySelectorAll('[class^="grasp-"], #grasp-overlay > *')]
      .filter(e => e.getBoundingClientRect().width)
      .filter(e => e.getBoundingClientRect().right > innerWidth + 1)
      .map(e => e.className || e.id)"""
    assert tab.evaluate(wide) == []
    if width < 600:
        # The sheet leaves the picture its part, and has first what is looked at first.
        sheet = tab.locator('#root [style*="max-height: 60%"]').bounding_box()
        assert sheet['y'] >= free and sheet['width'] == width
        first = ('.grasp-state', '.grasp-largest b', '.grasp-legend-numbers', '.u-wrap')
        tops = [tab.locator(part).first.bounding_box()['y'] for part in first]
        assert tops == sorted(tops) and sheet['y'] < tops[0] and tops[-1] < height - 60
    # The length of the bar is round, and it is as long as a thumb.
    wait_until(lambda: tab.locator('#grasp-scale i').count() == 1, 60)
    bar = tab.locator('#grasp-scale i').bounding_box()
    assert re.fullmatch(r'[125]0* mm', tab.locator('#grasp-scale').inner_text().strip())
    assert 40 <= bar['width'] <= 121 and bar['x'] + bar['width'] < width


@pytest.mark.chromium
def test_the_diagrams_span_what_is_remembered_however_the_data_come(page, wait_until) -> None:
    ends = """Object.values(__viserTestpoints.uplots || {})
      .map(plot => [plot.chart.scales.x.min, plot.chart.scales.x.max])"""

    def whole() -> bool:
        found = page.evaluate(ends)
        return bool(found) and all(span == [-100, 0] for span in found)

    wait_until(whole, 60, lambda: str(page.evaluate(ends)))


@pytest.mark.chromium
def test_the_title_names_the_object_and_a_tap_reads_the_surface(page, wait_until) -> None:
    assert page.title() == 'grasp'
    assert not page.locator('#grasp-probe').is_visible()

    def read() -> bool:
        page.mouse.click(340, 270)
        page.wait_for_timeout(400)
        return page.locator('#grasp-probe').is_visible()

    wait_until(read, 60)
    told = page.locator('#grasp-probe').inner_text()
    assert 'mm' in told and 'displacement at x' in told


@pytest.mark.chromium
@pytest.mark.parametrize(('kind', 'begin'), [('CSV', b'time_s,force_1_n'), ('PNG', b'\x89PNG')])
def test_the_plots_are_exported(page, kind: str, begin: bytes) -> None:
    with page.expect_download() as download:
        page.get_by_role('button', name=kind, exact=True).click()
    with open(download.value.path(), 'rb') as saved:
        content = saved.read()
    assert content.startswith(begin)
    assert kind == 'PNG' or len(content.splitlines()) > 2
