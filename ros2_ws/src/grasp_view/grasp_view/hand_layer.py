# SPDX-License-Identifier: Apache-2.0
"""The hand in one calm material, from the meshes of its description, and the pins it presses with.

It casts the only shadow of the scene: that ties a finger to its dent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser

from .hand_description import Description, Visual, package_file
from .layer import SCALE, Memory, hide
from .palette import Palette, rgb
from .poses import Floats, Pose, quaternion_wxyz
from .scene_model import CONTACT, Snapshot
from .smooth_faces import Ints
from .view_options import ViewOptions
from .visitors import Visitors

MOST_BYTES = 50_000_000
# A contact so far from the fingertip's frame is pressed by a pin between them, m.
PIN_LENGTHS = (4e-3, 80e-3)
PIN_RADII = (0.5e-3, 4e-3)


class HandLayer:
    """Links and pins, in every browser."""

    def __init__(self) -> None:
        self._hands: dict[int, _Hand] = {}
        self._meshes: dict[str, tuple[Floats, Ints] | None] = {}

    def draw(self, snapshot: Snapshot, options: ViewOptions, visitors: Visitors) -> None:
        """Bring every browser up to date."""
        here = {visitor.client.client_id: visitor for visitor in visitors}
        self._hands = {
            number: self._hands.get(number) or _Hand(visitor.client.scene, visitor.palette)
            for number, visitor in here.items()
        }
        parts = (
            snapshot.joints, snapshot.contacts, snapshot.object_pose, snapshot.frame,
            snapshot.hand, options.hand,
        )  # fmt: skip
        stale = [hand for hand in self._hands.values() if hand.memory.changed(*parts)]
        if not stale:
            return
        places: dict[str, Pose] = {}
        if options.hand and snapshot.hand is not None and snapshot.joints:
            base = snapshot.in_scene(snapshot.hand_frame)
            found = snapshot.hand.places(snapshot.hand_frame, snapshot.joints)
            places = {link: base.after(pose) for link, pose in found.items()}
        pins = pins_of(snapshot, places)
        for hand in stale:
            hand.draw_links(snapshot.hand, places, self._mesh)
            hand.draw_pins(pins)

    def _mesh(self, visual: Visual) -> tuple[Floats, Ints] | None:
        """Vertices (n, 3) m and faces of a link; None where its file cannot be read."""
        if visual.address not in self._meshes:
            self._meshes[visual.address] = read_mesh(package_file(visual.address))
        return self._meshes[visual.address]


def read_mesh(path: Path | None) -> tuple[Floats, Ints] | None:
    """Vertices (n, 3) and faces (t, 3) of a mesh file; None where there is none to be read."""
    # Imported with the first hand, as late as the meshes it reads.
    import trimesh

    try:
        if path is None or path.stat().st_size > MOST_BYTES:
            return None
        mesh = trimesh.load_mesh(path)
        if not isinstance(mesh, trimesh.Trimesh):
            return None
        mesh.merge_vertices()
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except (ValueError, OSError, TypeError, KeyError, IndexError):
        # A link without its mesh is not drawn; the others are.
        return None


@dataclass(frozen=True)
class Pin:
    """A rod from a fingertip to its contact: ends (3,) and radius, m."""

    finger: int
    start: Floats
    end: Floats
    radius: float


def pins_of(snapshot: Snapshot, places: Mapping[str, Pose]) -> list[Pin]:
    """The pins of the contacts that a placed fingertip presses with one."""
    contacts, made = snapshot.contacts, []
    tips = {link: pose for link, pose in places.items() if link.endswith('_tip')}
    for k in range(0 if contacts is None or not tips else len(contacts.points)):
        assert contacts is not None
        finger = int(contacts.finger[k])
        tip = next((p for link, p in tips.items() if link.endswith(f'_{finger}_tip')), None)
        point = snapshot.in_scene(contacts.frame).points(contacts.points[k][None])[0]
        if tip is None or not contacts.flags[k] & CONTACT or not np.isfinite(point).all():
            continue
        length = float(np.linalg.norm(point - tip.translation))
        if PIN_LENGTHS[0] < length < PIN_LENGTHS[1]:
            radius = float(np.clip(np.nan_to_num(contacts.radius[k]), *PIN_RADII))
            made.append(Pin(finger, tip.translation, point, radius))
    return made


class _Hand:
    """What one browser shows of the hand."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        self.memory = Memory()
        self._scene = scene
        self._palette = palette
        self._links: dict[str, tuple[Visual, viser.MeshHandle]] = {}
        self._pins: dict[int, viser.CylinderHandle] = {}

    def draw_links(
        self,
        hand: Description | None,
        places: Mapping[str, Pose],
        mesh: Callable[[Visual], tuple[Floats, Ints] | None],
    ) -> None:
        """Put every link whose place is known there."""
        shown = set()
        for number, visual in enumerate(hand.visuals if hand is not None else ()):
            if visual.link not in places:
                continue
            name = f'/hand/{number}'
            known = self._links.get(name)
            if known is None or known[0] is not visual:
                made = mesh(visual)
                if made is None:
                    continue
                known = (
                    visual,
                    self._scene.add_mesh_simple(
                        name,
                        made[0] * visual.scale * SCALE,
                        made[1],
                        color=rgb(self._palette.hand),
                        flat_shading=False,
                        cast_shadow=True,
                        receive_shadow=False,
                    ),
                )
                self._links[name] = known
            pose = places[visual.link].after(visual.place)
            handle = known[1]
            handle.wxyz = tuple(quaternion_wxyz(pose.rotation))
            handle.position = tuple(pose.translation * SCALE)
            handle.visible = True
            shown.add(name)
        hide(*(handle for name, (_, handle) in self._links.items() if name not in shown))

    def draw_pins(self, pins: Sequence[Pin]) -> None:
        """Draw these pins and no other."""
        for pin in pins:
            along = pin.end - pin.start
            length = float(np.linalg.norm(along))
            z = along / length
            x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
            x = x / np.linalg.norm(x)
            handle = self._pins.get(pin.finger)
            if handle is None:
                self._pins[pin.finger] = handle = self._scene.add_cylinder(
                    f'/pin_{pin.finger}',
                    radius=pin.radius * SCALE,
                    height=length * SCALE,
                    color=rgb(self._palette.pin),
                    cast_shadow=True,
                )
            handle.radius, handle.height = pin.radius * SCALE, length * SCALE
            handle.wxyz = tuple(quaternion_wxyz(np.stack([x, np.cross(z, x), z], axis=1)))
            handle.position = tuple(0.5 * (pin.start + pin.end) * SCALE)
            handle.visible = True
        shown = {pin.finger for pin in pins}
        hide(*(handle for number, handle in self._pins.items() if number not in shown))
