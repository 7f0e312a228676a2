# SPDX-License-Identifier: Apache-2.0
"""The what-if half of the page: sliders for the object, and fingers one drags over it."""

from __future__ import annotations

import html
import queue
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from .poses import Floats
from .scene_view import SCALE
from .what_if import Finger

FINGERS = 3
LARGEST_FORCE_N = 25.0
COLOURS = ((0, 69, 124), (192, 90, 0), (90, 90, 90))
HANDLE_M = 3.5e-3
GIVEN_FRICTION = 0.5
"""What the solver starts with."""
THEORIES = ('koiter', 'auto', 'thick', 'paper')
"""The thin wall first: a dragged finger lays the pins of a thick one anew, half a second each."""


@dataclass(frozen=True)
class Drag:
    """A finger pulled to a ray from the eye: origin and direction (3,), m."""

    finger: int
    origin: Floats
    direction: Floats


@dataclass(frozen=True)
class Wish:
    """What the sliders ask of the object and of the grasp."""

    object_name: str
    theory: str
    young_modulus_pa: float
    gauge_pressure_pa: float
    friction: float
    mass_kg: float


class WhatIfPanel:
    """Sliders and handles; drags wait in `drags` for the node."""

    def __init__(
        self, server: viser.ViserServer, objects: Mapping[str, Mapping[str, Any]], chosen: str
    ) -> None:
        self._server = server
        self._objects = objects
        self.drags: queue.SimpleQueue[Drag] = queue.SimpleQueue()
        self._handles: dict[int, viser.IcosphereHandle] = {}
        self._shown: dict[int, Floats] = {}
        self._grabs: dict[tuple[int, int], Floats] = {}
        gui = server.gui
        with gui.add_folder('What if'):
            self._object = gui.add_dropdown('Object', tuple(objects), initial_value=chosen)
            self._theory = gui.add_dropdown('Theory', THEORIES)
            self._young = gui.add_slider('Modulus (x file)', 0.1, 10.0, 0.05, 1.0)
            self._pressure = gui.add_slider('Pressure (kPa)', 0.0, 200.0, 1.0, 0.0)
            self._friction = gui.add_slider(
                'Friction', 0.0, 1.5, 0.01, GIVEN_FRICTION, hint='Of the fingers: does it close?'
            )
            self._mass = gui.add_slider('Mass (g)', 0.0, 1000.0, 1.0, 0.0)
            self._opposite = gui.add_checkbox(
                'Opposed', True, hint='Finger 2 stays opposite finger 1, with the same force'
            )
            self._force = [
                gui.add_slider(f'Finger {k + 1} (N)', 0.0, LARGEST_FORCE_N, 0.05, start)
                for k, start in enumerate((5.0, 5.0, 0.0))
            ]
            self._said = gui.add_html('')
        for changed in (self._opposite, self._force[0]):
            changed.on_update(lambda _: self._follow())
        self._follow()

    def _follow(self) -> None:
        """An opposing finger 2 pushes as hard as finger 1, and its slider says so."""
        self._force[1].disabled = self._opposite.value
        if self.opposing:
            # The setter is there; mypy misses it behind viser's helper method.
            self._force[1].value = self._force[0].value  # type: ignore[misc]

    @property
    def opposing(self) -> bool:
        """Whether finger 2 mirrors finger 1."""
        return bool(self._opposite.value)

    def force(self, finger: int) -> float:
        """Force of finger 1..3 in N."""
        source = 0 if finger == 2 and self.opposing else finger - 1
        return float(self._force[source].value)

    @property
    def wish(self) -> Wish:
        """What the sliders ask of the object now."""
        described = self._objects[self._object.value]
        return Wish(
            self._object.value,
            self._theory.value,
            float(described['young_modulus_pa']) * float(self._young.value),
            float(self._pressure.value) * 1e3,
            float(self._friction.value),
            float(self._mass.value) * 1e-3,
        )

    def release(self, finger: int) -> None:
        """A finger 2 that is dragged stands where it is put, no longer opposite finger 1."""
        if finger == 2 and self.opposing:
            self._opposite.value = False  # type: ignore[misc]

    def say(self, text: str) -> None:
        """One line under the sliders."""
        style = 'padding:0.2em 1em;font-size:0.85em'
        self._said.content = f'<div style="{style}">{html.escape(text)}</div>'

    def show(self, fingers: Sequence[Finger]) -> None:
        """Put the handles where the fingers are."""
        self._shown = {finger.number: finger.touch.point for finger in fingers}
        for finger in fingers:
            place = (finger.touch.point + 1.4 * HANDLE_M * finger.touch.outward) * SCALE
            handle = self._handles.get(finger.number)
            if handle is None:
                handle = self._server.scene.add_icosphere(
                    f'/finger_{finger.number}',
                    radius=HANDLE_M * SCALE,
                    color=COLOURS[finger.number - 1],
                    position=place,
                    cast_shadow=False,
                )
                self._listen(finger.number, handle)
                self._handles[finger.number] = handle
            handle.position = tuple(place)
            handle.visible = True
        shown = {finger.number for finger in fingers}
        for number, handle in self._handles.items():
            if number not in shown and handle.visible:
                handle.visible = False

    def _listen(self, number: int, handle: viser.IcosphereHandle) -> None:
        async def dragged(event: viser.SceneNodeDragEvent[viser.IcosphereHandle]) -> None:
            eye = np.asarray(event.client.camera.position) / SCALE
            pointer = np.asarray(event.end_position) / SCALE
            # The ball stands off the surface: seen obliquely, far beside the place it touches.
            # That place follows the pointer from where it was when the ball was taken.
            key = number, event.client_id
            if event.phase == 'start':
                self._grabs[key] = self._shown.get(number, pointer) - pointer
            grab = self._grabs.get(key, np.zeros(3))
            if event.phase == 'end':
                self._grabs.pop(key, None)
            self.drags.put(Drag(number, eye, pointer + grab - eye))

        handle.on_drag(dragged)
