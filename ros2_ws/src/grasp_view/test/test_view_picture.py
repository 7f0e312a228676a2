# SPDX-License-Identifier: Apache-2.0
"""What the page shows in a real browser is what the topics say."""

from __future__ import annotations

import time

import numpy as np
import pytest
from view_browser import (
    choose,
    deep,
    displacement_mm,
    enter,
    legend,
    numbers,
    picture,
    share_of,
    slider,
)

from grasp_view.colour_map import SIGNED_TABLE, TABLE, colour_index


@pytest.fixture
def dented(view, grasp, tab, port: int, wait_until) -> None:
    """The page, once it shows a dent of 4.8 mm."""
    grasp().depth = 4.8e-3
    view()
    tab.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: deep(tab), 60)


@pytest.mark.chromium
def test_the_colours_of_the_surface_are_those_of_the_legend(
    view, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    squeezed.sigma = 0.6e-4
    view()
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    choose(tab, 'Colour', 'uncertainty')
    wait_until(lambda: 'uncertainty (mm)' in tab.locator('.grasp-legend').inner_text(), 60)
    for sigma in (0.6e-4, 0.95e-4):
        squeezed.sigma = sigma
        top = 0.1
        index = colour_index(np.array([sigma * 1e3]), 0.0, top)
        wait_until(
            lambda wanted=TABLE[index][0]: (
                legend(tab)[-1] == 0.1 and share_of(picture(tab), wanted) > 0.02
            ),
            60,
        )


@pytest.mark.chromium
def test_the_picture_and_the_numbers_follow_the_squeeze(
    view, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    view()
    tab.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: share_of(picture(tab), TABLE[0]) > 0.02, 60)
    squeezed.depth = 4.8e-3
    wait_until(lambda: legend(tab) == [0.0, 1.25, 2.5, 3.75, 5.0], 60)
    wait_until(lambda: displacement_mm(tab) == 4.8, 60)
    wait_until(lambda: deep(tab), 60)
    assert '14.4 %' in numbers(tab)
    squeezed.state('SATURATED')
    wait_until(lambda: tab.locator('.grasp-state').inner_text() == 'SATURATED', 60)


@pytest.mark.chromium
def test_strain_energy_is_grey_until_it_is_published_and_then_on_the_scale(
    view, grasp, tab, port: int, wait_until
) -> None:
    squeezed = grasp()
    view()
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    choose(tab, 'Colour', 'strain energy density')
    told = 'grey: no energy density published'
    wait_until(lambda: told in tab.locator('.grasp-legend').inner_text(), 60)
    wait_until(lambda: share_of(picture(tab), TABLE[256]) > 0.02, 60)
    squeezed.energy = 1500.0
    wait_until(lambda: legend(tab) == [0.0, 500.0, 1000.0, 1500.0, 2000.0], 60)
    wanted = TABLE[colour_index(np.array([1500.0]), 0.0, 2000.0)][0]
    wait_until(lambda: share_of(picture(tab), wanted) > 0.02, 60)
    assert 'grey' not in tab.locator('.grasp-legend').inner_text()


@pytest.mark.chromium
def test_the_scan_is_coloured_by_its_error(view, grasp, tab, port: int, wait_until) -> None:
    squeezed = grasp()
    view()
    tab.goto(f'http://127.0.0.1:{port}')
    choose(tab, 'Colour', 'scan error')
    wait_until(lambda: share_of(picture(tab), TABLE[256]) > 0.02, 60)
    wanted = SIGNED_TABLE[colour_index(np.array([-0.3]), -0.5, 0.5)][0]

    def shown() -> bool:
        squeezed.scan(-0.3e-3)
        return share_of(picture(tab), wanted) > 0.02

    wait_until(shown, 60)
    assert legend(tab)[-1] == 0.5


@pytest.mark.chromium
def test_every_switch_of_the_page_takes_its_body_away_and_brings_it_back(
    dented, tab, wait_until
) -> None:
    tab.get_by_text('Show', exact=True).click()
    for label in (
        'Rest shape', 'Lines of equal displacement', 'Mesh lines', 'Forces', 'Hand',
        'Friction cones',
    ):  # fmt: skip
        box = tab.get_by_label(label, exact=True)
        for _ in range(2):
            before, was = picture(tab), box.is_checked()
            box.set_checked(not was)
            wait_until(lambda old=before: np.abs(picture(tab) - old).max() > 20, 60)


@pytest.mark.chromium
def test_each_theory_alone_is_coloured_by_its_own_displacement(dented, tab, wait_until) -> None:
    choose(tab, 'Answer', 'linear')  # half the depth
    wait_until(lambda: not deep(tab), 60)
    choose(tab, 'Answer', 'nonlinear')
    wait_until(lambda: deep(tab), 60)


@pytest.mark.chromium
def test_exaggeration_moves_the_surface_and_not_the_numbers(dented, tab, wait_until) -> None:
    before, shown = picture(tab), legend(tab)
    enter(tab, 'Exaggerate', 4.0)
    wait_until(lambda: (np.abs(picture(tab) - before).max(axis=2) > 20).mean() > 0.01, 60)
    assert legend(tab) == shown and displacement_mm(tab) == 4.8


@pytest.mark.chromium
def test_the_slider_looks_back(view, grasp, tab, port: int, wait_until) -> None:
    squeezed = grasp()
    view()
    tab.goto(f'http://127.0.0.1:{port}')
    wait_until(lambda: share_of(picture(tab), TABLE[0]) > 0.02, 60)
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 3.0)
    squeezed.depth = 4.8e-3
    wait_until(lambda: deep(tab), 60)
    tab.get_by_text('Look back', exact=True).click()
    tab.get_by_label('Live', exact=True).uncheck()
    back = slider(tab, 'Seconds')
    wait_until(lambda: float(back.get_attribute('aria-valuemin')) < -3.0, 60)
    back.focus()
    back.press('Home')
    wait_until(lambda: not deep(tab), 60)
    tab.get_by_label('Live', exact=True).check()
    wait_until(lambda: deep(tab), 60)
