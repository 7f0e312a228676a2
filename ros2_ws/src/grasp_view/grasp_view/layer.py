# SPDX-License-Identifier: Apache-2.0
"""What one part of the 3-D picture is: it draws itself from a snapshot, and only what changed.

To add a part, write a class with this `draw` and put it into `SceneView.layers`.
"""

from __future__ import annotations

from typing import Protocol

import viser

from .scene_model import Snapshot
from .view_options import ViewOptions
from .visitors import Visitors

SCALE = 20.0
"""Times m on the way out: browsers clip and round a 65 mm ball drawn in metres."""


class Layer(Protocol):
    """One part of the picture."""

    def draw(self, snapshot: Snapshot, options: ViewOptions, visitors: Visitors) -> None:
        """Bring the browsers up to date."""


class Memory:
    """Tells whether what a part is made of is other than at the last call."""

    def __init__(self) -> None:
        self._before: tuple[object, ...] | None = None

    def changed(self, *what: object) -> bool:
        """Whether any of `what` is another object; numbers and words count by their value."""
        before, self._before = self._before, what
        return (
            before is None
            or len(before) != len(what)
            or not all(
                a is b or (isinstance(a, float | bool | str | int) and a == b)
                for a, b in zip(before, what, strict=True)
            )
        )

    def forget(self) -> None:
        """The next call finds everything changed."""
        self._before = None


def hide(*handles: viser.SceneNodeHandle | None) -> None:
    """Take bodies out of sight."""
    for handle in handles:
        if handle is not None and handle.visible:
            handle.visible = False
