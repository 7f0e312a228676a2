# SPDX-License-Identifier: Apache-2.0
"""A hand by its URDF: where every link is at given joint angles, and which mesh it shows.

The description comes by `robot_description`; until then it is that of the BarrettHand, whose file
is data of the package `barrett_hand_bridge` where that is installed. Only a picture: nothing here
enters a number.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from .poses import Floats, Pose

BRIDGE, MACRO = 'barrett_hand_bridge', 'barrett_hand.urdf.xacro'
TURNING, SLIDING = ('revolute', 'continuous'), ('prismatic',)
# Motion of an outer joint over that of the inner one before a finger's breakaway, by its gears.
OUTER_PER_INNER = 1.0 / 3.0


MOST_PARTS = 1000
"""Joints, and visuals, of a robot that is drawn."""


class DescriptionError(ValueError):
    """A robot description that cannot be read; the text says why."""


@dataclass(frozen=True)
class Joint:
    """One joint: its frame in the parent link, axis (3,), and whom it mimics how."""

    name: str
    kind: str
    parent: str
    child: str
    place: Pose
    axis: Floats
    mimic: tuple[str, float, float] | None

    def pose(self, positions: Mapping[str, float]) -> Pose | None:
        """The child in the parent; None while the joint's position is not known."""
        if self.kind == 'fixed':
            return self.place
        source, factor, offset = self.mimic or (self.name, 1.0, 0.0)
        if source not in positions:
            return None
        value = factor * positions[source] + offset
        if self.kind in SLIDING:
            return self.place.after(Pose(np.eye(3), value * self.axis))
        return self.place.after(Pose(turn(self.axis, value), np.zeros(3)))


@dataclass(frozen=True)
class Visual:
    """The mesh of a link: its address, its frame in the link, its scale (3,)."""

    link: str
    address: str
    place: Pose
    scale: Floats


@dataclass(frozen=True)
class Description:
    """Links that show something, and the joints, each parent before its children."""

    visuals: tuple[Visual, ...]
    joints: tuple[Joint, ...]

    def places(self, base: str, positions: Mapping[str, float]) -> dict[str, Pose]:
        """Every link whose joints are known, in the frame of the link `base`."""
        children = {joint.child for joint in self.joints}
        roots = {joint.parent for joint in self.joints} - children
        placed = {root: Pose() for root in sorted(roots)} or {base: Pose()}
        for joint in self.joints:
            step = joint.pose(positions)
            if step is not None and joint.parent in placed:
                placed[joint.child] = placed[joint.parent].after(step)
        if base not in placed:
            return {}
        away = placed[base].inverse
        return {link: away.after(pose) for link, pose in placed.items()}


def turn(axis: Floats, angle: float) -> Floats:
    """Rotation matrix (3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def read_description(text: str) -> Description:
    """Read a URDF; raises DescriptionError."""
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise DescriptionError(f'robot_description is no XML: {error}') from error
    joints = [_joint(element) for element in root.findall('joint')]
    visuals = [visual for link in root.findall('link') for visual in _visuals(link)]
    if max(len(joints), len(visuals)) > MOST_PARTS:
        raise DescriptionError(
            f'robot_description has {len(joints)} joints and {len(visuals)} visuals; '
            f'{MOST_PARTS} of each are drawn at most'
        )
    return Description(tuple(visuals), tuple(_in_order(joints)))


def _in_order(joints: Sequence[Joint]) -> Iterator[Joint]:
    """Parents first; raises DescriptionError where the joints go in a circle."""
    left, children = list(joints), {joint.child for joint in joints}
    known = {joint.parent for joint in joints} - children
    while left:
        ready = [joint for joint in left if joint.parent in known]
        if not ready:
            raise DescriptionError(
                f'robot_description: the joint {left[0].name!r} hangs on a circle of joints'
            )
        known |= {joint.child for joint in ready}
        yield from ready
        left = [joint for joint in left if joint.parent not in known or joint not in ready]


def _numbers(text: str | None, fallback: Sequence[float], what: str) -> Floats:
    try:
        found = np.array(text.split() if text else fallback, dtype=np.float64)
    except ValueError as error:
        raise DescriptionError(f'robot_description: {what} {text!r} is not numbers') from error
    if found.shape != (len(fallback),) or not np.isfinite(found).all():
        raise DescriptionError(
            f'robot_description: {what} {text!r} is not {len(fallback)} finite numbers'
        )
    return found


def _origin(element: ElementTree.Element) -> Pose:
    origin = element.find('origin')
    given = {} if origin is None else origin.attrib
    place = _numbers(given.get('xyz'), (0.0, 0.0, 0.0), 'xyz')
    roll, pitch, yaw = _numbers(given.get('rpy'), (0.0, 0.0, 0.0), 'rpy')
    x, y, z = np.eye(3)
    return Pose(turn(z, yaw) @ turn(y, pitch) @ turn(x, roll), place)


def _joint(element: ElementTree.Element) -> Joint:
    name = element.get('name', '')
    parent, child = element.find('parent'), element.find('child')
    if parent is None or child is None:
        raise DescriptionError(f'robot_description: joint {name!r} lacks its parent or child')
    kind = element.get('type', 'fixed')
    axis = element.find('axis')
    direction = _numbers(None if axis is None else axis.get('xyz'), (1.0, 0.0, 0.0), 'axis')
    length = float(np.linalg.norm(direction))
    if kind in (*TURNING, *SLIDING) and length < 1e-9:
        raise DescriptionError(f'robot_description: joint {name!r} turns about no axis')
    follows = element.find('mimic')
    mimic = None
    if follows is not None:
        factor, offset = (
            float(_numbers(follows.get(key), (value,), key)[0])
            for key, value in (('multiplier', 1.0), ('offset', 0.0))
        )
        mimic = follows.get('joint', ''), factor, offset
    return Joint(
        name, kind, parent.get('link', ''), child.get('link', ''), _origin(element),
        direction / max(length, 1e-9), mimic,
    )  # fmt: skip


def _visuals(link: ElementTree.Element) -> Iterator[Visual]:
    for element in link.findall('visual'):
        mesh = element.find('geometry/mesh')
        if mesh is not None:
            scale = _numbers(mesh.get('scale'), (1.0, 1.0, 1.0), 'scale')
            yield Visual(link.get('name', ''), mesh.get('filename', ''), _origin(element), scale)


def joint_positions(names: Sequence[str], positions: Floats) -> dict[str, float]:
    """Positions by name, finite ones only; a missing `_outer` joint follows its `_inner` one."""
    found = {
        name: float(position)
        for name, position in zip(names, positions, strict=False)
        if np.isfinite(position)
    }
    for name in [name for name in found if name.endswith('_inner')]:
        outer = f'{name.removesuffix("_inner")}_outer'
        found.setdefault(outer, found[name] * OUTER_PER_INNER)
    return found


def package_file(address: str) -> Path | None:
    """The file of a `package://name/path` address on this machine; None where there is none."""
    scheme, _, rest = address.partition('://')
    package, _, path = rest.partition('/')
    outside = '..' in Path(path).parts or Path(path).is_absolute()
    if scheme != 'package' or not package or outside:
        return None
    folders = [
        Path(prefix) / 'share' / package
        for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
        if prefix
    ]
    # Where the package is installed by pip alone, its data lie beside its modules.
    with_modules = importlib.util.find_spec(package) if package.isidentifier() else None
    for place in (with_modules.submodule_search_locations or ()) if with_modules else ():
        folders += [Path(place), Path(place) / 'description']
    return next((f / path for f in folders if (f / path).is_file()), None)


def barrett_hand() -> Description | None:
    """The BarrettHand as its bridge describes it; None where the bridge is not installed."""
    found = package_file(f'package://{BRIDGE}/urdf/{MACRO}') or package_file(
        f'package://{BRIDGE}/{MACRO}'
    )
    if found is None:
        return None
    root = ElementTree.fromstring(found.read_text(encoding='utf-8').replace('${prefix}', ''))
    macro = next((element for element in root if element.tag.endswith('macro')), root)
    kept = ElementTree.Element('robot')
    kept.extend(e for e in macro if e.get('name') != 'hand_mount')
    return read_description(ElementTree.tostring(kept, encoding='unicode'))
