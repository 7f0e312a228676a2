# SPDX-License-Identifier: Apache-2.0
"""Where the browsers look from: at the object, from as far as their window is narrow."""

from __future__ import annotations

import numpy as np
import viser

from .poses import Floats
from .windows import Windows

# From here the object and the arrows fill a window of this aspect; from further away a narrower.
SQUARE = 0.85
FROM = np.array([1.16, -1.42, 0.82])


class Aim:
    """Turns each browser to the object when it comes, and all when the object jumps away."""

    def __init__(self, server: viser.ViserServer, windows: Windows) -> None:
        self._server = server
        self._windows = windows
        self._middle: Floats | None = None
        self._turned: set[int] = set()

    def look(self, vertices: Floats) -> None:
        """Look at `vertices` (n, 3), in scene units."""
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        reach = float(np.ptp(vertices, axis=0).max())
        if self._middle is None or np.linalg.norm(middle - self._middle) > reach:
            self._middle = middle
            self._turned.clear()
        clients = self._server.get_clients()
        for number in clients.keys() - self._turned:
            camera = clients[number].camera
            narrow = max(1.0, SQUARE / self._windows.of(clients[number]).aspect)
            camera.position = tuple(self._middle + reach * narrow * FROM)
            camera.look_at = tuple(self._middle)
        self._turned = set(clients)
