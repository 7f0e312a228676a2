# SPDX-License-Identifier: Apache-2.0
"""What only a phone's sheet of panels has: the legend, which over its picture would cover it."""

from __future__ import annotations

import viser

from .visitors import Visitors


class PhoneSheets:
    """The legend in the sheet of every phone, brought up to date when it changes."""

    def __init__(self, visitors: Visitors) -> None:
        self._visitors = visitors
        self._legends: dict[int, viser.GuiHtmlHandle] = {}

    def show(self, legend: str) -> None:
        """Show that legend (HTML)."""
        visitors = self._visitors.all
        for number in self._legends.keys() - visitors.keys():
            del self._legends[number]
        for number, visitor in tuple(visitors.items()):
            if not visitor.window.phone:
                continue
            handle = self._legends.get(number)
            if handle is None:
                self._legends[number] = visitor.client.gui.add_html(legend)
            elif handle.content != legend:
                handle.content = legend
