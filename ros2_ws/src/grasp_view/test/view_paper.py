# SPDX-License-Identifier: Apache-2.0
"""A scene and a panel that keep what is drawn on them, as viser would show it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np

from grasp_view.visitors import Visitor, Window


class Handle(SimpleNamespace):
    """A thing on the paper with the properties that it was given; it opens like a folder."""

    def __enter__(self) -> Handle:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def on_update(self, told: Callable[[Any], None]) -> None:
        """Keep whom to tell."""
        self.told = told

    on_click = on_update


class Paper:
    """Every `add_...` keeps its handle by name; what is removed is gone."""

    def __init__(self) -> None:
        self.things: dict[str, Handle] = {}
        self.clicked: Callable[[Any], None] | None = None

    def __getattr__(self, kind: str) -> Callable[..., Handle]:
        if not kind.startswith('add_'):
            raise AttributeError(kind)

        def add(name: Any, *given: Any, **properties: Any) -> Handle:
            key = name if isinstance(name, str) else f'{kind}_{len(self.things)}'
            handle = Handle(visible=True, given=given, name=name, text=given[0] if given else '')
            handle.__dict__.update(properties)
            handle.remove = lambda: self.things.pop(key, None)
            self.things[key] = handle
            return handle

        return add

    def on_click(self) -> Callable[[Callable[[Any], None]], None]:
        """Keep who listens to taps."""
        return lambda listener: setattr(self, 'clicked', listener)

    @property
    def seen(self) -> set[str]:
        """Names of what is in sight."""
        return {name for name, handle in self.things.items() if handle.visible}


def visitor(window: Window | None = None, dark: bool = False) -> Visitor:
    """A browser on paper that looks along +y from 4 units away."""
    camera = SimpleNamespace(
        position=np.array([0.0, -4.0, 0.0]),
        look_at=np.zeros(3),
        up_direction=np.array([0.0, 0.0, 1.0]),
        fov=0.9,
    )
    client = SimpleNamespace(client_id=7, camera=camera, scene=Paper(), gui=Paper())
    return Visitor(client, window or Window(1400, 900), dark)  # type: ignore[arg-type]


def server() -> Any:
    """A server on paper."""
    return SimpleNamespace(scene=Paper(), gui=Paper(), atomic=nullcontext)
