# SPDX-License-Identifier: Apache-2.0
"""Where the browsers look from: so that the object and its hardest pressed dent are seen."""

from __future__ import annotations

import numpy as np

from .layer import SCALE
from .poses import Floats
from .scene_model import Snapshot
from .section import deepest
from .view_options import ViewOptions
from .visitors import Visitor, Visitors

# From here the object and the arrows fill a scene of this aspect; from further away a narrower.
SQUARE = 1.25
DISTANCE = 1.5
FROM = np.array([0.58, -0.71, 0.41])
VIEWS = ('All', 'F1', 'F2', 'F3', 'Top')
# The dent is seen obliquely: across its axis its depth shows, along it its outline.
BESIDE, ABOVE = 0.8, 0.42


class Aim:
    """Turns each browser to the object when it comes, and all when the object jumps away."""

    def __init__(self, visitors: Visitors) -> None:
        self._visitors = visitors
        self._middle: Floats | None = None
        self._turned: set[tuple[int, bool]] = set()
        self._view = VIEWS[0]
        self._pressed = False

    def turn(self, view: str) -> None:
        """Look by one of `VIEWS` from the next call on."""
        self._view = view
        self._turned.clear()

    def look(self, snapshot: Snapshot, options: ViewOptions) -> None:
        """Look at the object of `snapshot`."""
        surface = snapshot.surface(options.shape)
        if snapshot.mesh is None:
            return
        vertices = snapshot.mesh.rest if surface is None else surface.position
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, reach = (low + high) / 2, float((high - low).max())
        if self._middle is None or np.linalg.norm(middle - self._middle) > reach:
            self._middle = middle
            self._turned.clear()
        # Anew when a phone is turned: the panels then leave another part of the picture.
        now = {(seen.client.client_id, seen.window.phone): seen for seen in self._visitors}
        for who in now.keys() - self._turned:
            self._point(now[who], reach, self._direction(snapshot))
        self._turned = set(now)

    def _direction(self, snapshot: Snapshot) -> Floats:
        """The unit vector from the object to the eye."""
        if self._view == 'Top':
            return np.array([0.0, -0.01, 1.0])
        contacts = snapshot.contacts
        outward = None
        if self._view.startswith('F') and contacts is not None:
            of = np.flatnonzero(contacts.finger == int(self._view[1:]))
            if len(of):
                normals = snapshot.in_scene(contacts.frame).vectors(contacts.normals[of[:1]])
                outward = -normals[0]
        elif contacts is not None:
            touch = deepest(snapshot)
            if touch is not None:
                outward = -touch.force / touch.newtons
        if outward is None or not np.isfinite(outward).all() or np.linalg.norm(outward) < 0.5:
            return FROM / np.linalg.norm(FROM)
        beside = np.cross(outward, [0.0, 0.0, 1.0])
        if np.linalg.norm(beside) < 0.3:
            beside = np.array([0.0, -1.0, 0.0])
        # The side nearer to the usual one, so that a view turns as little as it can.
        beside = beside / np.linalg.norm(beside) * (1.0 if beside @ FROM >= 0.0 else -1.0)
        towards = outward + BESIDE * beside + ABOVE * np.array([0.0, 0.0, 1.0])
        return np.asarray(towards / np.linalg.norm(towards))

    def _point(self, visitor: Visitor, reach: float, towards: Floats) -> None:
        assert self._middle is not None
        camera, (width, height) = visitor.client.camera, visitor.window.scene
        narrow = max(1.0, SQUARE * height / width)
        away = DISTANCE * reach * narrow * SCALE
        # Panels cover the lower part of the picture: what is looked at moves up, and is as large
        # in the rest as it would be in a picture of that size.
        covered = visitor.window.covered
        away /= 1.0 - covered
        target = self._middle * SCALE
        target = target - np.array([0.0, 0.0, away * np.tan(camera.fov / 2.0) * covered])
        camera.position = tuple(target + away * towards)
        camera.look_at = tuple(target)
