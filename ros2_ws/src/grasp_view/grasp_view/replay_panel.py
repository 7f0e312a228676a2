# SPDX-License-Identifier: Apache-2.0
"""Where a replay stands, and the means to steer it; hidden while there is none."""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable
from dataclasses import dataclass

import viser

# The slider is left to the hand that moves it for this long.
HELD_S = 1.0
STEPS = ('Pause', 'Resume', 'Step')


@dataclass(frozen=True)
class ReplayState:
    """What a replay tells of itself: seconds since the recording's start, its length, paused."""

    position: float
    duration: float
    paused: bool = False


class ReplayPanel:
    """A slider through the recorded time, and buttons; `command` gets pause, resume or step."""

    def __init__(self, server: viser.ViserServer, command: Callable[[str], None]) -> None:
        gui = server.gui
        self._wanted: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._touched = 0.0
        # By this mark `page.css` finds the folder behind it, to show it further up on a phone.
        self._mark = gui.add_html('<i class="grasp-transport"></i>', visible=False)
        self._folder = gui.add_folder('Replay', visible=False)
        with self._folder:
            self._slider = gui.add_slider(
                'Recording (s)', 0.0, 1.0, 0.01, 0.0, hint='Drag to go on from another time'
            )
            self._steps = gui.add_button_group(
                'running', STEPS, hint='Step: one message further in a paused recording'
            )
        self._slider.on_update(self._moved)
        self._steps.on_click(lambda _: command(self._steps.value.lower()))

    def _moved(self, event: viser.GuiEvent) -> None:
        # Our own updates of the slider come without a client.
        if event.client is not None:
            self._touched = time.monotonic()
            self._wanted.put(float(self._slider.value))

    def take_wanted(self) -> float | None:
        """The time (s) somebody dragged the slider to since the last call, else None."""
        wanted = None
        while not self._wanted.empty():
            wanted = self._wanted.get()
        return wanted

    def show(self, state: ReplayState | None) -> None:
        """Follow the replay; None, or one of unknown length, hides the folder."""
        if state is not None and not math.isfinite(state.duration):
            state = None
        if self._folder.visible != (state is not None):
            self._folder.visible = self._mark.visible = state is not None
        if state is None:
            return
        # Rounded down: the recording has nothing behind its end.
        longest = max(math.floor(100 * state.duration) / 100, 0.01)
        if self._slider.max != longest:
            self._slider.max = longest
        place = round(min(max(state.position, 0.0), longest), 2)
        if time.monotonic() - self._touched > HELD_S and self._slider.value != place:
            # The setter is there; mypy misses it behind viser's helper method.
            self._slider.value = place  # type: ignore[misc]
        told = 'paused' if state.paused else 'running'
        if self._steps.label != told:
            self._steps.label = told
