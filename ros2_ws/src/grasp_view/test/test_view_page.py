# SPDX-License-Identifier: Apache-2.0
"""The page in a real browser: its buttons, its visitors, nodes that come and go."""

from __future__ import annotations

from contextlib import closing

import pytest
from PIL import Image
from view_browser import buttons, deep, displacement_mm, picture, share_of
from view_grasp import Grasp

from grasp_view.colour_map import TABLE

BUTTONS = {
    'Tare gauges', 'Compare scan', 'Screenshot', 'CSV', 'PNG',
    'All', 'F1', 'F2', 'F3', 'Top', 'Dark',
}  # fmt: skip


@pytest.mark.chromium
def test_every_button_calls_its_service_and_shows_the_answer(page, squeezed, wait_until) -> None:
    wait_until(lambda: buttons(page) == BUTTONS, 60)
    for label, service, answer in (
        ('Tare gauges', 'hand/tare', 'tare: refused, the hand is loaded'),
        ('Compare scan', 'scan/compare', 'compare: done'),
    ):
        page.get_by_role('button', name=label).click()
        wait_until(lambda name=service: name in squeezed.called, 60)
        wait_until(lambda text=answer: text in page.locator('.grasp-answer').inner_text(), 60)
    with page.expect_download() as download:
        page.get_by_role('button', name='Screenshot').click()
    with Image.open(download.value.path()) as saved:
        assert saved.format == 'PNG' and saved.size == (1200, 900)


@pytest.mark.chromium
def test_a_tablet_held_upright_keeps_room_for_the_object(
    address: str, squeezed, open_tab, wait_until
) -> None:
    squeezed.depth = 4.8e-3
    tablet = open_tab(820, 1180, has_touch=True)
    tablet.goto(address)
    wait_until(lambda: displacement_mm(tablet) == 4.8, 60)
    wait_until(lambda: not tablet.locator('.u-over').first.is_visible(), 60)
    tablet.get_by_role('button', name='Screenshot').tap()


@pytest.mark.chromium
def test_nodes_may_come_late_go_and_come_back_with_another_mesh(
    view, tab, port: int, wait_until
) -> None:
    running = view()
    tab.goto(f'http://127.0.0.1:{port}')
    tab.get_by_role('button', name='Tare gauges').click()
    wait_until(lambda: 'nobody offers' in tab.locator('.grasp-answer').inner_text(), 60)
    with closing(Grasp(2)):
        wait_until(lambda: share_of(picture(tab), TABLE[0]) > 0.02, 60)
    with closing(Grasp(3)) as second:
        second.depth = 4.8e-3
        wait_until(lambda: displacement_mm(tab) == 4.8, 60)
        wait_until(lambda: deep(tab), 60)
    assert running.process.poll() is None and 'Traceback' not in running.text
