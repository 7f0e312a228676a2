# SPDX-License-Identifier: Apache-2.0
"""The browsers' windows: how much of each the panels leave to the scene."""

from __future__ import annotations

from dataclasses import dataclass

import viser

MAIN_PANEL, PLOT_PANEL = 324, 304
# Below this width the diagrams start folded away.
NARROW = 1000


@dataclass(frozen=True)
class Window:
    """A browser's window in pixels."""

    width: int
    height: int

    @property
    def narrow(self) -> bool:
        """Whether there is no room for the diagrams beside scene and main panel."""
        return self.width < NARROW

    @property
    def aspect(self) -> float:
        """Width over height of what is left to the scene."""
        left = self.width - MAIN_PANEL - (0 if self.narrow else PLOT_PANEL)
        return max(left, 100) / max(self.height, 1)


class Windows:
    """The window of every browser, measured before its main panel takes a side of it."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._known: dict[int, Window] = {}

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            camera = client.camera
            self._known[client.client_id] = Window(camera.image_width, camera.image_height)
            client.gui.main_panel.dock_right()

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self._known.pop(client.client_id, None)

    def of(self, client: viser.ClientHandle) -> Window:
        """The window of one browser; a wide one until it has told."""
        return self._known.get(client.client_id, Window(1280, 860))
