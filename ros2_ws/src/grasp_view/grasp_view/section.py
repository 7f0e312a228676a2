# SPDX-License-Identifier: Apache-2.0
"""The section through a dent: the material line that a plane through the contact's axis cuts out.

The plane cuts the rest shape; each place of that line is then followed to where an answer has it,
so rest, served and linear curves are the same material, and depth is read between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .level_lines import Crossings, crossings
from .poses import Floats
from .scene_model import Snapshot, Surface, Touch, deformed, touches
from .smooth_faces import Ints, SmoothFaces

# How far the section reaches to either side, as a share of the body's extent.
REACH_SHARE = 0.36
# Scan points so far from the plane are drawn, as a share of the reach.
SLAB_SHARE = 0.06
MOST_POINTS = 240
# Where the surface has moved less, the rest shape lies on it and is not drawn.
SEEN_M = 3e-4


@dataclass(frozen=True)
class Axis:
    """A contact's axis: origin on the rest shape, outward and two lateral unit vectors (3,)."""

    origin: Floats
    outward: Floats
    lateral: tuple[Floats, Floats]
    reach: float


def axis_of(touch: Touch, surface: Surface) -> Axis:
    """The axis of a pressing contact: along its force, through the rest shape under it."""
    outward = -touch.force / max(touch.newtons, 1e-12)
    rest = deformed(surface, 0.0)
    near = int(np.linalg.norm(surface.position - touch.point, axis=1).argmin())
    origin = touch.point + outward * float((rest[near] - touch.point) @ outward)
    helper = np.array([0.0, 0.0, 1.0]) if abs(outward[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    level = np.cross(helper, outward)
    level = level / np.linalg.norm(level)
    extent = float(np.median(np.ptp(rest, axis=0)))
    return Axis(origin, outward, (level, np.cross(outward, level)), REACH_SHARE * extent)


@dataclass(frozen=True)
class Cut:
    """The material line of one plane: segments, sorted along the plane's lateral direction."""

    axis: Axis
    along: Floats
    places: Crossings

    def curve(self, values: Floats) -> Floats:
        """`values` (n, ...) at the segments' middles, in their order: (s, ...)."""
        return np.asarray(self.places.of(values).mean(axis=1))

    def plane(self, points: Floats) -> Floats:
        """Points (n, 3) m as (n, 2): along the plane's lateral direction, and outward."""
        away = points - self.axis.origin
        return np.stack([away @ self.along, away @ self.axis.outward], axis=1)


def cut(surface: Surface, triangles: Ints, axis: Axis, side: int = 0) -> Cut:
    """The near half of the rest shape's section, within reach of the axis."""
    rest = deformed(surface, 0.0)
    along = axis.lateral[side]
    across = axis.lateral[1 - side]
    places = crossings(triangles, (rest - axis.origin) @ across, 0.0)
    at = Cut(axis, along, places).plane(places.of(rest).mean(axis=1))
    # The far side of a closed body lies below anything within reach of a bowl of this reach.
    near = np.flatnonzero((np.abs(at[:, 0]) <= axis.reach) & (at[:, 1] > -axis.reach))
    order = near[np.argsort(at[near, 0])]
    return Cut(axis, along, Crossings(places.ends[order], places.weights[order]))


@dataclass(frozen=True)
class Section:
    """Curves in mm: lateral and outward, from the rest shape's place under the contact.

    band (s,): sigma of the served curve; depth: how far the served surface is pushed in on the
    axis; scan_age: s that the scan is older than the answer; registered: it was fitted to the
    undeformed part of the object, not only placed. linear and scan may be empty.
    """

    finger: int
    reach: float
    rest: Floats
    served: Floats
    band: Floats
    linear: Floats
    scan: Floats
    pin: Floats
    depth: float
    scan_age: float
    registered: bool


def deepest(snapshot: Snapshot) -> Touch | None:
    """The pressing contact where the served surface has moved most; None while none presses."""
    surface = snapshot.surface('served')
    pressing = [touch for touch in touches(snapshot) if touch.touching and touch.newtons > 1e-3]
    if surface is None:
        return None

    def moved(touch: Touch) -> float:
        near = int(np.linalg.norm(surface.position - touch.point, axis=1).argmin())
        return float(np.linalg.norm(surface.moved[near]))

    return max(pressing, key=moved, default=None)


def finer(surface: Surface, faces: SmoothFaces) -> Surface:
    """An answer at the finer faces' vertices, where the picture draws it."""
    position, rest = faces.positions(surface.position), faces.positions(deformed(surface, 0.0))
    sigma = faces.values(surface.sigma)
    return Surface(surface.stamp, surface.frame, position, position - rest, sigma)


def section_of(snapshot: Snapshot, faces: SmoothFaces) -> Section | None:
    """The section through the hardest pressed contact, of the served answer."""
    touch, served = deepest(snapshot), snapshot.surface('served')
    if touch is None or served is None:
        return None
    surface = finer(served, faces)
    axis = axis_of(touch, surface)
    found = cut(surface, faces.triangles, axis)
    if len(found.places.weights) < 3:
        return None

    def curve(points: Floats) -> Floats:
        return 1e3 * found.plane(found.curve(points))

    line = curve(surface.position)
    linear = snapshot.surface('linear')
    cloud = snapshot.scan_error or snapshot.scan
    rest = curve(deformed(surface, 0.0))
    middle = int(np.abs(rest[:, 0]).argmin())
    return Section(
        touch.finger,
        1e3 * axis.reach,
        rest,
        line,
        1e3 * found.curve(surface.sigma),
        np.zeros((0, 2)) if linear is None else curve(faces.positions(linear.position)),
        _scan(snapshot, found),
        1e3 * found.plane(touch.point[None])[0],
        float(rest[middle, 1] - line[middle, 1]),
        0.0 if cloud is None else served.stamp - cloud.stamp,
        snapshot.scan_error is not None,
    )


def _scan(snapshot: Snapshot, found: Cut) -> Floats:
    cloud = snapshot.scan_error or snapshot.scan
    if cloud is None or not len(cloud.points):
        return np.zeros((0, 2))
    axis = found.axis
    points = snapshot.in_scene(cloud.frame).points(cloud.points)
    at = found.plane(points)
    off = (points - axis.origin) @ np.cross(found.along, axis.outward)
    near = np.flatnonzero(
        (np.abs(off) < SLAB_SHARE * axis.reach)
        & (np.abs(at[:, 0]) < axis.reach)
        & (at[:, 1] > -axis.reach)
    )
    step = max(1, len(near) // MOST_POINTS)
    return np.asarray(1e3 * at[near[::step]])


def rest_arcs(surface: Surface, triangles: Ints, touch: Touch, dash: float) -> Floats:
    """Dashed arcs (s, 2, 3) m of the rest shape in two planes through a contact's axis."""
    axis = axis_of(touch, surface)
    rest, made = deformed(surface, 0.0), []
    for side in (0, 1):
        found = cut(surface, triangles, axis, side)
        ends = found.places.of(rest)
        if not len(ends):
            continue
        at = (ends - axis.origin) @ found.along
        turned = at[:, 0] > at[:, 1]
        ends[turned] = ends[turned][:, ::-1]
        gap = np.linalg.norm(found.curve(surface.moved), axis=1) > SEEN_M
        made.append(ends[gap & (np.floor(at.mean(axis=1) / dash).astype(int) % 2 == 0)])
    return np.concatenate(made) if made else np.zeros((0, 2, 3))
