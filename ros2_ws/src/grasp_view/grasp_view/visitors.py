# SPDX-License-Identifier: Apache-2.0
"""Who looks at the page: each browser's window, its camera, and whether it wants it dark."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import viser

from .own_server import OwnServer
from .palette import DARK, LIGHT, Palette
from .poses import Floats

MAIN_PANEL = 352
# Below the first width the diagrams start folded away; up to the second, the library's own, the
# panels are a sheet from below, and the scene is what it leaves free.
NARROW, PHONE = 1000, 576
SHEET_SHARE = 0.46
# The height of the strip of diagrams below the scene, with its margin.
STRIP = 212
# What `page.js` says when the browser, or the visitor, wants it dark.
DARK_COOKIE = 'grasp_theme=dark'
# By what name the tab of a browser asks for its overlays, which it also says.
TAB_COOKIE = re.compile(r'grasp_tab=(\w+)')
# The size of its picture in pixels.
WINDOW_COOKIE = re.compile(r'grasp_window=(\d{2,5})x(\d{2,5})(?!\d)')


@dataclass(frozen=True)
class Window:
    """A browser's window in pixels, as it was before any panel took a side of it."""

    width: int
    height: int

    @property
    def narrow(self) -> bool:
        """Whether there is no room for the diagrams below the scene."""
        return self.width < NARROW

    @property
    def phone(self) -> bool:
        """Whether the panels are a sheet from below."""
        return self.width <= PHONE

    @property
    def scene(self) -> tuple[int, int]:
        """Width and height of what the panels leave to the scene."""
        if self.phone:
            return self.width, round(self.height * (1.0 - SHEET_SHARE))
        strip = 0 if self.narrow else STRIP
        return max(self.width - MAIN_PANEL, 100), max(self.height - strip, 100)

    @property
    def covered(self) -> float:
        """The share of the picture's height, from below, that panels lie over."""
        return 1.0 - self.scene[1] / max(self.height, 1)


@dataclass
class Visitor:
    """One browser."""

    client: viser.ClientHandle
    window: Window
    dark: bool = False
    tab: str = ''

    @property
    def palette(self) -> Palette:
        """Its colours."""
        return DARK if self.dark else LIGHT

    @property
    def axes(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors of its camera: to the right, up, and to where it looks."""
        camera = self.client.camera
        ahead = np.asarray(camera.look_at) - np.asarray(camera.position)
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        right = np.cross(ahead, np.asarray(camera.up_direction))
        right = right / max(float(np.linalg.norm(right)), 1e-9)
        return right, np.cross(right, ahead), ahead

    def pixels(self, points: Floats) -> Floats:
        """Columns and rows (n, 2) of points (n, 3) of the scene, in pixels of the page."""
        right, up, _ = self.axes
        camera = self.client.camera
        from_eye = np.atleast_2d(points) - np.asarray(camera.position)
        each = self.pixel_at(points)
        column = 0.5 * self.window.scene[0] + from_eye @ right / each
        return np.stack([column, 0.5 * self.window.height - from_eye @ up / each], axis=1)

    def pixel_at(self, points: Floats) -> Floats:
        """How wide a pixel of the page is (n,) at points (n, 3), in units of the scene."""
        camera = self.client.camera
        ahead = (np.atleast_2d(points) - np.asarray(camera.position)) @ self.axes[2]
        away = np.maximum(ahead, 1e-6)
        return np.asarray(2.0 * away * np.tan(camera.fov / 2.0) / self.window.height)

    @property
    def reach(self) -> float:
        """What the height of the picture is at the place looked at, in units of the scene."""
        camera = self.client.camera
        away = float(np.linalg.norm(np.asarray(camera.look_at) - np.asarray(camera.position)))
        return 2.0 * away * float(np.tan(camera.fov / 2.0))

    def dress(self) -> None:
        """Theme and background as it wants them."""
        self.client.gui.configure_theme(
            control_layout='floating',
            control_width='medium',
            dark_mode=self.dark,
            show_logo=False,
            show_share_button=False,
            brand_color=(0, 90, 156),
        )
        self.client.scene.set_background_image(self.palette.background(), format='png')


class Visitors:
    """All browsers now there, by number."""

    def __init__(self, server: OwnServer) -> None:
        self.all: dict[int, Visitor] = {}

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            camera = client.camera
            cookies = server.cookies(client)
            tab, size = TAB_COOKIE.search(cookies), WINDOW_COOKIE.search(cookies)
            # The library tells those of the display, of which a phone has two or three a pixel.
            window = Window(
                *(map(int, size.groups()) if size else (camera.image_width, camera.image_height))
            )
            visitor = Visitor(client, window, DARK_COOKIE in cookies, tab[1] if tab else '')
            client.gui.main_panel.dock_right()
            client.gui.main_panel.set_width(MAIN_PANEL)
            visitor.dress()
            self.all[client.client_id] = visitor

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self.all.pop(client.client_id, None)

    def of_tab(self, tab: str) -> Visitor | None:
        """The browser's tab of that name; None for an unknown one, or where two have it."""
        found = [visitor for visitor in self if visitor.tab == tab != '']
        return found[0] if len(found) == 1 else None

    def __iter__(self) -> Iterator[Visitor]:
        """Every browser, whoever comes or goes meanwhile."""
        return iter(tuple(self.all.values()))
