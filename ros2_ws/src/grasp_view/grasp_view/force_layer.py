# SPDX-License-Identifier: Apache-2.0
"""Forces: an arrow beside each finger and its label, in every browser's own colours.

Arrow and label stand beside the finger, never over the dent: the arrow is lifted off the contact's
axis and ends before the rest shape, the label stands at the arrow's tail (`labels.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import viser

from .colour_map import renderer_colours
from .labels import Box, label_box, outline
from .layer import SCALE, Memory, hide
from .poses import Floats
from .scene_model import Snapshot, Surface, Touch, deformed, touches
from .section import axis_of, rest_arcs
from .smooth_faces import Ints
from .surface_layer import INK
from .unlit_mesh import Body, unlit_glb
from .view_options import ViewOptions
from .visitors import Visitor, Visitors

# Shares of the body's extent: how far above the axis, how far off the rest shape, per newton.
LIFT, GAP, PER_NEWTON, SHORTEST, LONGEST = 0.17, 0.12, 0.019, 0.12, 0.5
SHAFT, HEAD, HEAD_LENGTH = 0.014, 0.04, 0.11
DASH = 0.028
LIFTED_M = 3e-4
SIDES = 16
UP = np.array([0.0, 0.0, 1.0])


def arrow_body(tail: Floats, head: Floats, extent: float) -> tuple[Floats, Ints]:
    """Vertices (n, 3) and triangles of an arrow; its radii are shares of `extent`."""
    along = head - tail
    length = float(np.linalg.norm(along))
    along = along / max(length, 1e-12)
    helper = np.eye(3)[int(np.abs(along).argmin())]
    first = np.cross(along, helper)
    first = first / np.linalg.norm(first)
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(along, first))
    neck = head - min(HEAD_LENGTH * extent, 0.6 * length) * along
    profile = [
        (tail, 0.0),
        (tail, SHAFT),
        (neck, SHAFT),
        (neck, HEAD),
        (head, 0.0),
    ]
    vertices = np.concatenate([centre + radius * extent * ring for centre, radius in profile])
    faces = []
    for row in range(len(profile) - 1):
        for k in range(SIDES):
            a, b = row * SIDES + k, row * SIDES + (k + 1) % SIDES
            faces += [(a, b, b + SIDES), (a, b + SIDES, a + SIDES)]
    return vertices, np.array(faces)


def extent_of(surface: Surface) -> float:
    """The middle one of a body's three sizes; 0 for one that is no more than a line."""
    return float(np.median(np.ptp(deformed(surface, 0.0), axis=0)))


def arrow_ends(touch: Touch, surface: Surface) -> tuple[Floats, Floats, float]:
    """Tail and head (3,) m beside a finger, and the body's extent."""
    axis = axis_of(touch, surface)
    extent = extent_of(surface)
    lateral = UP - float(UP @ axis.outward) * axis.outward
    if np.linalg.norm(lateral) < 0.3:
        lateral = axis.lateral[0]
    lateral = lateral / np.linalg.norm(lateral)
    head = axis.origin + extent * (LIFT * lateral + GAP * axis.outward)
    length = extent * float(np.clip(PER_NEWTON * touch.newtons, SHORTEST, LONGEST))
    return head + length * axis.outward, head, extent


def label_places(
    visitor: Visitor, touching: Sequence[Touch], surface: Surface
) -> dict[int, tuple[Floats, str]]:
    """By finger: where its label stands in a visitor's picture (scene's units), its anchor."""
    body = outline(visitor.pixels(surface.position * SCALE))
    right, up, _ = visitor.axes
    found: dict[int, tuple[Floats, str]] = {}
    boxes: dict[int, Box] = {}
    for touch in touching:
        tail = arrow_ends(touch, surface)[0] * SCALE
        at = visitor.pixels(tail)[0]
        others = [box for finger, box in boxes.items() if finger != touch.finger]
        box = label_box(touch.label, at, body, visitor.window.scene[0], others)
        boxes[touch.finger] = box
        off = (box.tail - at[0]) * right - (box.row - at[1]) * up
        anchor = 'center-left' if box.to_right else 'center-right'
        found[touch.finger] = tail + visitor.pixel_at(tail) * off, anchor
    return found


@dataclass
class _Drawn:
    """What one browser shows of the forces."""

    arrows: dict[int, viser.GlbHandle] = field(default_factory=dict)
    labels: dict[int, viser.LabelHandle] = field(default_factory=dict)
    arcs: list[viser.LineSegmentsHandle] = field(default_factory=list)
    memory: Memory = field(default_factory=Memory)
    places: dict[int, tuple[float, ...]] = field(default_factory=dict)


class ForceLayer:
    """Arrows, labels and the dashed rest shape at the contacts."""

    def __init__(self) -> None:
        self._drawn: dict[int, _Drawn] = {}

    def draw(self, snapshot: Snapshot, options: ViewOptions, visitors: Visitors) -> None:
        """Bring every browser up to date."""
        surface = snapshot.surface('served')
        shown: list[Touch] = []
        if surface is not None and extent_of(surface) > 0.0:
            shown = [t for t in touches(snapshot) if t.touching and t.newtons > 1e-6]
        self._drawn = {
            visitor.client.client_id: self._drawn.get(visitor.client.client_id, _Drawn())
            for visitor in visitors
        }
        for visitor in visitors:
            drawn = self._drawn.get(visitor.client.client_id)
            if drawn is None:
                continue
            changed = drawn.memory.changed(
                snapshot.contacts, surface, visitor.dark, options.contacts, options.rest,
                snapshot.object_pose,
            )  # fmt: skip
            if surface is not None:
                self._label(drawn, visitor, shown if options.contacts else [], surface)
            if changed:
                self._arrows(drawn, visitor, shown if options.contacts else [], surface)
                self._arcs(drawn, visitor, shown if options.rest else [], snapshot, surface)

    @staticmethod
    def _arrows(
        drawn: _Drawn, visitor: Visitor, shown: list[Touch], surface: Surface | None
    ) -> None:
        hide(*(h for n, h in drawn.arrows.items() if n not in {t.finger for t in shown}))
        for touch in shown:
            assert surface is not None
            tail, head, extent = arrow_ends(touch, surface)
            vertices, triangles = arrow_body(tail, head, extent)
            colour = np.array([visitor.palette.finger(touch.finger)], dtype=np.uint8)
            glb = unlit_glb([Body(vertices * SCALE, triangles, renderer_colours(colour)[0])])
            handle = drawn.arrows.get(touch.finger)
            if handle is None:
                drawn.arrows[touch.finger] = visitor.client.scene.add_glb(
                    f'/force_{touch.finger}', glb, cast_shadow=False, receive_shadow=False
                )
                continue
            handle.glb_data = glb
            handle.visible = True

    @staticmethod
    def _label(drawn: _Drawn, visitor: Visitor, shown: list[Touch], surface: Surface) -> None:
        for number, label in drawn.labels.items():
            if number not in {touch.finger for touch in shown}:
                hide(label)
        places = label_places(visitor, shown, surface)
        for touch in shown:
            place, anchor = places[touch.finger]
            handle = drawn.labels.get(touch.finger)
            if handle is None:
                drawn.labels[touch.finger] = handle = visitor.client.scene.add_label(
                    f'/force_label_{touch.finger}', touch.label, anchor='center-left'
                )
            if handle.text != touch.label:
                handle.text = touch.label
            if handle.anchor != anchor:
                handle.anchor = anchor  # type: ignore[assignment]
            now = tuple(np.round(place, 3).tolist())
            if drawn.places.get(touch.finger) != now:
                drawn.places[touch.finger] = now
                handle.position = tuple(place)
            if not handle.visible:
                handle.visible = True

    @staticmethod
    def _arcs(
        drawn: _Drawn,
        visitor: Visitor,
        shown: list[Touch],
        snapshot: Snapshot,
        surface: Surface | None,
    ) -> None:
        for handle in drawn.arcs:
            handle.remove()
        drawn.arcs = []
        if surface is None or snapshot.mesh is None or not shown:
            return
        dash = DASH * float(np.median(np.ptp(deformed(surface, 0.0), axis=0)))
        arcs = [rest_arcs(surface, snapshot.mesh.triangles, touch, dash) for touch in shown]
        points = np.concatenate(arcs)
        if not len(points):
            return
        # A little towards the finger, so that a line does not lie in the surface it is drawn on.
        lifted = np.concatenate(
            [
                np.broadcast_to(-LIFTED_M * t.force / t.newtons, arc.shape)
                for t, arc in zip(shown, arcs, strict=True)
            ]
        )
        # A pale edge, so that the dashes are seen over the dark dent too.
        for name, lift, colour, width in (
            ('halo', 1.0, (255, 255, 255), 4.5),
            ('ink', 1.6, INK, 1.8),
        ):
            drawn.arcs.append(
                visitor.client.scene.add_line_segments(
                    f'/rest_{name}',
                    ((points + lift * lifted) * SCALE).astype(np.float32),
                    colors=colour,
                    thickness=width,
                    thickness_units='screen',
                )
            )
