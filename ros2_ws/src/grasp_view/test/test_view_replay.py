# SPDX-License-Identifier: Apache-2.0
"""The page beside the real replay of the recorded ball and the real solver."""

from __future__ import annotations

import math
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from std_msgs.msg import Float64
from view_browser import buttons, displacement_mm, drag, picture, slider

from grasp_view.replay_panel import STEPS

ROOT = Path(__file__).resolve().parents[4]
BAG = ROOT / 'bags' / 'tennis_ball_two_finger'
THIN_BALL = ('--ros-args', '-p', 'object:=tennis_ball', '-p', 'theory:=koiter')
# The deepest hold of the recording, and a time before the first touch (its README).
DEEPEST_S, LENGTH_S = 20.3, 26.59


@pytest.mark.chromium
def test_the_recorded_ball_is_dragged_to_its_deepest_dent_and_back(
    start, view, tab, heard, port: int, wait_until
) -> None:
    page = view()
    start('deformation', *THIN_BALL).wait_for('serving', 90)
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    assert not tab.get_by_role('button', name='Pause').is_visible()
    replay = start('replay', BAG, '--start-paused', '--loop', '--rate', '0.5')

    def position() -> float:
        told = heard(Float64, 'replay/position')
        return math.nan if told is None else told.data

    def paused() -> bool:
        return tab.get_by_text('paused', exact=True).is_visible()

    def answer() -> str:
        return tab.locator('.grasp-answer').inner_text()

    def answered(text: str) -> bool:
        return text in answer()

    def gone_to() -> float:
        told = re.search(r'go to ([\d.]+) s: done', answer())
        return float(told.group(1)) if told else math.nan

    thumb = slider(tab, 'Recording (s)')
    wait_until(paused, 60, lambda: replay.text)
    assert set(STEPS) <= buttons(tab)
    assert thumb.get_attribute('aria-valuemax') == '26.59'
    wait_until(lambda: position() < 0.1, 30)

    drag(tab, 'Recording (s)', DEEPEST_S / LENGTH_S)
    # Places that the thumb passes are asked for as well; the last one counts.
    wait_until(lambda: abs(gone_to() - DEEPEST_S) < 0.5, 60, answer)
    wait_until(lambda: abs(position() - gone_to()) < 0.05, 60, lambda: f'{position()}, {answer()}')

    tab.get_by_role('button', name='Step').click()
    wait_until(lambda: answered('step: done, one message follows'), 60, answer)

    before = picture(tab)
    tab.get_by_role('button', name='Resume').click()
    wait_until(lambda: answered('resume: done, running'), 60, answer)
    # The recording's README: 9.96 mm on the middle surface.
    wait_until(lambda: displacement_mm(tab) > 8.0, 60, lambda: replay.text)
    wait_until(lambda: np.abs(picture(tab) - before).max() > 20, 60)
    wait_until(lambda: tab.locator('.grasp-state').inner_text() in ('CONTACT', 'SATURATED'), 60)

    tab.get_by_role('button', name='Pause').click()
    wait_until(lambda: answered('pause: done, paused') and paused(), 60, answer)
    drag(tab, 'Recording (s)', 0.05)
    wait_until(lambda: position() < 3.0, 60)
    wait_until(lambda: float(thumb.get_attribute('aria-valuenow')) < 3.0, 60)
    tab.get_by_role('button', name='Resume').click()
    wait_until(lambda: displacement_mm(tab) < 0.3, 60)
    wait_until(lambda: tab.locator('.grasp-state').inner_text() == 'FREE', 60)

    replay.stop(signal.SIGINT)
    wait_until(lambda: not tab.get_by_role('button', name='Pause').is_visible(), 60)
    assert page.process.poll() is None and 'Traceback' not in page.text
