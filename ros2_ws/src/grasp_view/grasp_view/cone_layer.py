# SPDX-License-Identifier: Apache-2.0
"""The friction cones of the touching contacts, on the deformed normals where those are known."""

from __future__ import annotations

import viser

from .grasp_measures import colour_of
from .layer import SCALE, Memory, hide
from .scene_model import Snapshot, friction_cones
from .view_options import ViewOptions
from .visitors import Visitors

LENGTH_M = 0.02
UNKNOWN = (60, 60, 60)


class ConeLayer:
    """Green where the grasp is closed, red where it is not, between them by probability.

    Grey, and of the coefficient that was chosen, while no grasp is published.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self._cones: viser.LineSegmentsHandle | None = None
        self._memory = Memory()

    def draw(self, snapshot: Snapshot, options: ViewOptions, visitors: Visitors) -> None:
        """Bring the browsers up to date."""
        if not options.cones:
            hide(self._cones)
            self._memory.forget()
            return
        grasp = snapshot.grasp
        if not self._memory.changed(
            snapshot.contacts, grasp, snapshot.frame, snapshot.object_pose, options.friction
        ):
            return
        segments = friction_cones(snapshot, options.friction, LENGTH_M) * SCALE
        if self._cones is not None:
            self._cones.remove()
            self._cones = None
        if len(segments):
            self._cones = self._scene.add_line_segments(
                '/cones',
                segments,
                colors=UNKNOWN if grasp is None else colour_of(grasp.probability),
                thickness=1.6,
                thickness_units='screen',
            )
