# SPDX-License-Identifier: Apache-2.0
"""How the page looks in a browser: contrast, names of controls, themes, sizes, no complaints."""

from __future__ import annotations

import re

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


@pytest.fixture
def shown(view, grasp, open_tab, port: int, wait_until):
    """A browser with the page of a dent of 4.8 mm, by size and theme."""
    grasp().depth = 4.8e-3
    view()

    def look(width: int, height: int, **options):
        tab = open_tab(width, height, **options)
        tab.asked = []
        tab.on('request', lambda request: tab.asked.append(request.url))
        tab.goto(f'http://127.0.0.1:{port}')
        wait_until(lambda: displacement_mm(tab) == 4.8, 60)
        wait_until(lambda: tab.locator('.grasp-legend-numbers').is_visible(), 60)
        return tab

    return look


@pytest.mark.chromium
@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_the_page_passes_contrast_names_and_console_in_both_themes(
    shown, port: int, scheme
) -> None:
    tab = shown(1440, 900, color_scheme=scheme)
    palette = DARK if scheme == 'dark' else LIGHT
    low = [one for one in worst_contrast(tab.evaluate(TEXTS), rgb(palette.panel)) if one[0] < 4.5]
    assert low == []
    small = [one for one in tab.evaluate(TEXTS) if one['size'] < 11]
    assert [(one['text'], one['size']) for one in small] == []
    tab.wait_for_timeout(1500)
    assert tab.evaluate(NAMELESS) == []
    assert tab.evaluate('document.documentElement.lang') == 'en'
    assert tab.complaints == []
    foreign = [url for url in tab.asked if not url.startswith(f'http://127.0.0.1:{port}/')]
    assert [url for url in foreign if not url.startswith(('data:', 'blob:'))] == []


@pytest.mark.chromium
def test_two_browsers_have_two_themes_and_a_switch(shown, wait_until) -> None:
    bright, dim = shown(1000, 640), shown(1000, 640, color_scheme='dark')
    assert luminance(picture(bright)[GROUND]) > 0.5 and luminance(picture(dim)[GROUND]) < 0.1
    dim.get_by_role('button', name='Light').click()
    wait_until(lambda: displacement_mm(dim) == 4.8, 60)
    wait_until(lambda: luminance(picture(dim)[GROUND]) > 0.5, 60)


@pytest.mark.chromium
@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1024, 768), (1440, 900)])
def test_the_object_is_whole_and_nothing_runs_off_the_side(shown, width, height, tmp_path) -> None:
    # Two pixels of the display in one of the page, as phones have.
    phone = {'has_touch': True, 'is_mobile': True, 'device_scale_factor': 2}
    phone = phone if width < 600 else {}
    tab = shown(width, height, **phone)
    tab.add_style_tag(content='.mantine-Notifications-root { display: none }')
    tab.wait_for_timeout(1500)
    assert tab.evaluate('document.documentElement.scrollWidth') <= width
    wide = """() => [...document.querySelectorAll('[class^="grasp-"], #grasp-overlay > *')]
      .filter(e => e.getBoundingClientRect().width)
      .filter(e => e.getBoundingClientRect().right > innerWidth + 1)
      .map(e => e.className || e.id)"""
    assert tab.evaluate(wide) == []
    tab.screenshot(path=tmp_path / 'page.png', scale='css')
    with Image.open(tmp_path / 'page.png') as image:
        seen = np.asarray(image.convert('RGB')).astype(int)
    # The body's yellow: whole between header, sides and what lies below.
    body = (seen[..., 0] - seen[..., 2] > 90) & (seen[..., 0] > 120)
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    free = 0.54 * height if width < 600 else height
    assert rows[0] > 46 and rows[-1] < free and columns[0] > 2 and columns[-1] < width - 2
    assert np.ptp(columns) > 0.18 * width
    # The length of the bar is round, and it is as long as a thumb.
    bar = tab.locator('#grasp-scale i').bounding_box()
    assert re.fullmatch(r'[125]0* mm', tab.locator('#grasp-scale').inner_text().strip())
    assert 40 <= bar['width'] <= 121 and bar['x'] + bar['width'] < width


@pytest.mark.chromium
def test_the_title_names_the_object_and_a_tap_reads_the_surface(shown, wait_until) -> None:
    tab = shown(1000, 640)
    assert tab.title() == 'grasp'
    assert not tab.locator('#grasp-probe').is_visible()

    def read() -> bool:
        tab.mouse.click(340, 270)
        tab.wait_for_timeout(800)
        return tab.locator('#grasp-probe').is_visible()

    wait_until(read, 60)
    told = tab.locator('#grasp-probe').inner_text()
    assert 'mm' in told and 'displacement at x' in told


@pytest.mark.chromium
@pytest.mark.parametrize(('kind', 'begin'), [('CSV', b'time_s,force_1_n'), ('PNG', b'\x89PNG')])
def test_the_plots_are_exported(shown, kind: str, begin: bytes) -> None:
    tab = shown(1000, 640)
    with tab.expect_download() as download:
        tab.get_by_role('button', name=kind, exact=True).click()
    with open(download.value.path(), 'rb') as saved:
        content = saved.read()
    assert content.startswith(begin)
    assert kind == 'PNG' or len(content.splitlines()) > 2
