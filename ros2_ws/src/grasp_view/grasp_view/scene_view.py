# SPDX-License-Identifier: Apache-2.0
"""The 3-D half of the page: a snapshot in, bodies in the browsers out, one layer after another."""

from __future__ import annotations

import viser

from .aim import Aim
from .cone_layer import ConeLayer
from .force_layer import ForceLayer
from .hand_layer import HandLayer
from .layer import SCALE, Layer
from .scan_layer import ScanLayer
from .scene_model import SCAN_ERROR, Snapshot
from .surface_layer import Legend, SurfaceLayer
from .view_options import ViewOptions
from .visitors import Visitors


class SceneView:
    """Bodies of one page; `draw` is called with every new snapshot, `drawn` counts surfaces."""

    def __init__(self, server: viser.ViserServer, visitors: Visitors) -> None:
        server.scene.set_up_direction('+z')
        server.scene.configure_default_lights(enabled=True, cast_shadow=True)
        self.surface = SurfaceLayer(server)
        self.layers: list[Layer] = [
            self.surface,
            ForceLayer(),
            ConeLayer(server),
            ScanLayer(server, self.surface.scales[SCAN_ERROR.name]),
            HandLayer(),
        ]
        self._visitors = visitors
        self._aim = Aim(visitors)

    @property
    def drawn(self) -> int:
        """Surfaces sent so far."""
        return self.surface.drawn

    def look(self, view: str) -> None:
        """Turn every browser: to all of it, to a finger's dent, or from above."""
        self._aim.turn(view)

    def draw(self, snapshot: Snapshot, options: ViewOptions) -> Legend:
        """Bring the browsers up to date; returns the scale now on the surface."""
        for layer in self.layers:
            layer.draw(snapshot, options, self._visitors)
        self._aim.look(snapshot, options)
        scale = self.surface.scales[options.quantity.name]
        return self.surface.legend or Legend(options.quantity, scale.top, 0.0)


__all__ = ['SCALE', 'SceneView']
