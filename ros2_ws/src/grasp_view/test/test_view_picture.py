# SPDX-License-Identifier: Apache-2.0
"""What the page shows in a real browser is what the topics say."""

from __future__ import annotations

from itertools import count

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
)

from grasp_view.colour_map import SIGNED_TABLE, TABLE, colour_index


@pytest.fixture
def dented(page, squeezed, wait_until):
    """The page, once it shows a dent of 4.8 mm."""
    squeezed.depth = 4.8e-3
    wait_until(lambda: deep(page), 60)
    return page


@pytest.fixture
def undented(page, wait_until):
    """The page, once it shows a ball at rest."""
    wait_until(lambda: share_of(picture(page), TABLE[0]) > 0.02, 60)
    return page


@pytest.mark.chromium
def test_the_colours_of_the_surface_are_those_of_the_legend(page, squeezed, wait_until) -> None:
    squeezed.sigma = 0.6e-4
    choose(page, 'Colour', 'uncertainty')
    wait_until(lambda: 'uncertainty (mm)' in page.locator('.grasp-legend').inner_text(), 60)
    for sigma in (0.6e-4, 0.95e-4):
        squeezed.sigma = sigma
        top = 0.1
        index = colour_index(np.array([sigma * 1e3]), 0.0, top)
        wait_until(
            lambda wanted=TABLE[index][0]: (
                legend(page)[-1] == 0.1 and share_of(picture(page), wanted) > 0.02
            ),
            60,
        )


@pytest.mark.chromium
def test_the_picture_and_the_numbers_follow_the_squeeze(undented, squeezed, wait_until) -> None:
    squeezed.depth = 4.8e-3
    wait_until(lambda: legend(undented) == [0.0, 1.25, 2.5, 3.75, 5.0], 60)
    wait_until(lambda: displacement_mm(undented) == 4.8, 60)
    wait_until(lambda: deep(undented), 60)
    assert '14.4 %' in numbers(undented)
    squeezed.state('SATURATED')
    wait_until(lambda: undented.locator('.grasp-state').inner_text() == 'SATURATED', 60)


@pytest.mark.chromium
def test_strain_energy_is_grey_until_it_is_published_and_then_on_the_scale(
    page, squeezed, wait_until
) -> None:
    choose(page, 'Colour', 'strain energy density')
    told = 'grey: no energy density published'
    wait_until(lambda: told in page.locator('.grasp-legend').inner_text(), 60)
    wait_until(lambda: share_of(picture(page), TABLE[256]) > 0.02, 60)
    squeezed.energy = 1500.0
    wait_until(lambda: legend(page) == [0.0, 500.0, 1000.0, 1500.0, 2000.0], 60)
    wanted = TABLE[colour_index(np.array([1500.0]), 0.0, 2000.0)][0]
    wait_until(lambda: share_of(picture(page), wanted) > 0.02, 60)
    assert 'grey' not in page.locator('.grasp-legend').inner_text()


@pytest.mark.chromium
def test_the_scan_is_coloured_by_its_error(page, squeezed, wait_until) -> None:
    choose(page, 'Colour', 'scan error')
    wait_until(lambda: share_of(picture(page), TABLE[256]) > 0.02, 60)
    wanted = SIGNED_TABLE[colour_index(np.array([-0.3]), -0.5, 0.5)][0]

    def shown() -> bool:
        squeezed.scan(-0.3e-3)
        return share_of(picture(page), wanted) > 0.02

    wait_until(shown, 60)
    assert legend(page)[-1] == 0.5


@pytest.mark.chromium
def test_every_switch_of_the_page_takes_its_body_away_and_brings_it_back(
    dented, wait_until
) -> None:
    dented.get_by_text('Show', exact=True).click()
    for label in (
        'Rest shape', 'Lines of equal displacement', 'Mesh lines', 'Forces', 'Hand',
        'Friction cones',
    ):  # fmt: skip
        box = dented.get_by_label(label, exact=True)
        for _ in range(2):
            before, was = picture(dented), box.is_checked()
            box.set_checked(not was)
            wait_until(lambda old=before: np.abs(picture(dented) - old).max() > 20, 60)


@pytest.mark.chromium
def test_each_theory_alone_is_coloured_by_its_own_displacement(dented, wait_until) -> None:
    choose(dented, 'Answer', 'linear')  # half the depth
    wait_until(lambda: not deep(dented), 60)
    choose(dented, 'Answer', 'nonlinear')
    wait_until(lambda: deep(dented), 60)


@pytest.mark.chromium
def test_exaggeration_moves_the_surface_and_not_the_numbers(dented, wait_until) -> None:
    before, shown = picture(dented), legend(dented)
    enter(dented, 'Exaggerate', 4.0)
    wait_until(lambda: (np.abs(picture(dented) - before).max(axis=2) > 20).mean() > 0.01, 60)
    assert legend(dented) == shown and displacement_mm(dented) == 4.8


@pytest.mark.chromium
def test_the_slider_looks_back(undented, squeezed, wait_until) -> None:
    squeezed.depth = 4.8e-3
    wait_until(lambda: deep(undented), 60)
    undented.get_by_text('Look back', exact=True).click()
    undented.get_by_label('Live', exact=True).uncheck()
    seconds = count(start=-0.2, step=-0.2)

    def before_the_dent() -> bool:
        enter(undented, 'Seconds', next(seconds))
        return not deep(undented)

    wait_until(before_the_dent, 60)
    undented.get_by_label('Live', exact=True).check()
    wait_until(lambda: deep(undented), 60)


@pytest.mark.chromium
def test_a_browser_shows_the_hold_and_the_turn(page, squeezed, wait_until) -> None:
    squeezed.depth = 4e-3
    squeezed.turned = True
    for name in ('hold', 'turn'):
        part = page.locator(f'.grasp-{name}-curve svg')
        wait_until(lambda part=part: part.count() == 1 and part.is_visible(), 60)
    wait_until(lambda: 'about to slip' in page.locator('.grasp-turn-curve').inner_text(), 60)
    assert page.locator('.grasp-hold-curve .band').count() >= 2
