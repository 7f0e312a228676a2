# SPDX-License-Identifier: Apache-2.0
"""What the page knows of the grasp at one instant, and what it draws of it.

All lengths in m, forces in N. The scene's frame is that of the served surface: the contacts' by
default, the object's if the `deformation` node is told so. Surfaces are the shell's middle
surface, as published.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from .grasp_measures import GraspMeasures
from .hand_description import Description
from .poses import Floats, Pose

Ints = npt.NDArray[np.integer]
Shape = Literal['served', 'linear', 'nonlinear']
SHAPES: tuple[Shape, ...] = ('served', 'nonlinear', 'linear')

CONTACT, SATURATED, STALE, NOT_TARED, FAULT, NO_GAUGE = 1, 2, 4, 8, 16, 32
FLAG_NAMES = {
    SATURATED: 'saturated',
    STALE: 'stale',
    NOT_TARED: 'not tared',
    FAULT: 'fault',
    NO_GAUGE: 'no gauge',
}


@dataclass(frozen=True)
class Mesh:
    """Topology and rest positions at the time it was sent: triangles (t, 3), rest (n, 3)."""

    triangles: Ints
    rest: Floats


@dataclass(frozen=True)
class Surface:
    """One answer: positions, displacement vectors (n, 3), m; sigma (n,), m.

    energy (n,): strain energy per area, J/m^2, where it is published (the nonlinear answer).
    The rest shape is taken from here, not from the mesh: it follows an object that moves.
    """

    stamp: float
    frame: str
    position: Floats
    moved: Floats
    sigma: Floats
    energy: Floats | None = None


@dataclass(frozen=True)
class Contacts:
    """Contacts in `frame`: points, inward normals, forces (k, 3); sigma_n, radius (k,)."""

    stamp: float
    frame: str
    points: Floats
    normals: Floats
    forces: Floats
    sigma: Floats
    radius: Floats
    finger: Ints
    flags: Ints


@dataclass(frozen=True)
class Cloud:
    """A scan: points (p, 3) in `frame`; signed distance (p,) to the model where compared."""

    stamp: float
    frame: str
    points: Floats
    distance: Floats | None = None


@dataclass(frozen=True)
class Snapshot:
    """Everything received last; None where nothing came yet. `time` is the newest stamp in s.

    joints: positions by name, rad or m. answer: which theory answered, `taking up` while none
    could; trouble: what the deformation node complains of; closure: whether the grasp closes, and
    why not, in its words. object_name, theory and recording say where the numbers come from; a
    recording is `name: label`.
    """

    time: float = 0.0
    mesh: Mesh | None = None
    served: Surface | None = None
    linear: Surface | None = None
    nonlinear: Surface | None = None
    contacts: Contacts | None = None
    grasp: GraspMeasures | None = None
    scan: Cloud | None = None
    scan_error: Cloud | None = None
    joints: Mapping[str, float] = field(default_factory=dict)
    hand: Description | None = None
    state: str = ''
    answer: str = ''
    trouble: str = ''
    closure: str = ''
    object_name: str = ''
    theory: str = ''
    recording: str = ''
    numbers: Mapping[str, float] = field(default_factory=dict)
    object_pose: Pose = field(default_factory=Pose)
    hand_frame: str = 'hand_base'

    @property
    def frame(self) -> str:
        """The frame that the scene is drawn in; empty before the first answer."""
        return '' if self.served is None else self.served.frame

    def in_scene(self, frame: str) -> Pose:
        """Where `frame` lies in the scene; every frame but the hand's counts as the object's."""
        scene = self.served.frame if self.served is not None else 'object'
        if (frame == self.hand_frame) == (scene == self.hand_frame):
            return Pose()
        return self.object_pose.inverse if frame == self.hand_frame else self.object_pose

    def surface(self, shape: Shape) -> Surface | None:
        """The named answer, if it fits the mesh."""
        found = {'served': self.served, 'linear': self.linear, 'nonlinear': self.nonlinear}[shape]
        if self.mesh is None or found is None or len(found.moved) != len(self.mesh.rest):
            return None
        return found


@dataclass(frozen=True)
class Quantity:
    """A quantity the surface can be coloured by; `factor` turns SI into `unit`.

    smallest: the least upper end of its scale; grey: what a vertex without a value lacks;
    signed: the scale goes as far below zero as above.
    """

    name: str
    unit: str
    factor: float
    smallest: float
    grey: str
    signed: bool = False

    def low(self, top: float) -> float:
        """The lower end of the scale that ends at `top`."""
        return -top if self.signed else 0.0


DISPLACEMENT = Quantity('displacement', 'mm', 1e3, 0.1, 'no answer')
DIFFERENCE = Quantity('linear - nonlinear', 'mm', 1e3, 0.05, 'both theories have not answered')
SCAN_ERROR = Quantity('scan error', 'mm', 1e3, 0.2, 'not seen by a compared scan', signed=True)
SIGMA = Quantity('uncertainty', 'mm', 1e3, 0.02, 'no uncertainty published')
ENERGY = Quantity('strain energy density', 'J/m²', 1.0, 0.1, 'no energy density published')
QUANTITIES = {q.name: q for q in (DISPLACEMENT, DIFFERENCE, SCAN_ERROR, SIGMA, ENERGY)}


def values_of(snapshot: Snapshot, quantity: Quantity, shape: Shape) -> Floats | None:
    """The quantity per vertex (n,) in its unit; NaN where unknown; None if nothing is known."""
    surface = snapshot.surface(shape)
    if surface is None:
        return None
    if quantity is DISPLACEMENT:
        return np.linalg.norm(surface.moved, axis=1) * quantity.factor
    if quantity is SIGMA:
        return surface.sigma * quantity.factor
    if quantity is ENERGY:
        # Only the nonlinear answer carries it; the served one is built on that.
        known = (surface, snapshot.surface('nonlinear'))
        found = next((s.energy for s in known if s is not None and s.energy is not None), None)
        return None if found is None else found * quantity.factor
    if quantity is DIFFERENCE:
        linear, nonlinear = snapshot.surface('linear'), snapshot.surface('nonlinear')
        if linear is None or nonlinear is None:
            return None
        return np.linalg.norm(linear.moved - nonlinear.moved, axis=1) * quantity.factor
    error = snapshot.scan_error
    if error is None or error.distance is None or not len(error.points):
        return None
    points = snapshot.in_scene(error.frame).points(error.points)
    return vertex_scan_error(deformed(surface), points, error.distance) * quantity.factor


def deformed(surface: Surface, exaggeration: float = 1.0) -> Floats:
    """Vertex positions (n, 3) of an answer, its displacement multiplied by `exaggeration`."""
    return surface.position + (exaggeration - 1.0) * surface.moved


def vertex_scan_error(vertices: Floats, points: Floats, distance: Floats) -> Floats:
    """Mean signed scan error (n,) in m of the points nearest to each vertex; NaN = not seen.

    Positive where the scan lies outside of the model.

    A point speaks for a vertex that is no further away than its own error plus 2 mm.
    """
    # Imported with the first scan: SciPy takes half of the page's start.
    from scipy.spatial import cKDTree

    count = min(8, len(points))
    size = np.abs(distance)
    gap, index = cKDTree(points).query(vertices, k=count)
    gap, index = gap.reshape(-1, count), index.reshape(-1, count)
    weight = (gap <= size[index] + 2e-3).astype(float)
    total = weight.sum(axis=1)
    mean = (weight * distance[index]).sum(axis=1) / np.maximum(total, 1.0)
    return np.where(total > 0, mean, np.nan)


@dataclass(frozen=True)
class Touch:
    """A contact's force: point (3,) m, force (3,) N, finger, sigma in N, flags in words."""

    point: Floats
    force: Floats
    finger: int
    sigma: float
    flags: tuple[str, ...]
    touching: bool

    @property
    def newtons(self) -> float:
        """Size of the force."""
        return float(np.linalg.norm(self.force))

    @property
    def label(self) -> str:
        """What stands beside the finger's arrow."""
        sigma = f' ± {self.sigma:.1f}' if np.isfinite(self.sigma) else ''
        words = f' {", ".join(self.flags)}' if self.flags else ''
        return f'F{self.finger}  {self.newtons:.1f}{sigma} N{words}'


def touches(snapshot: Snapshot) -> list[Touch]:
    """One per contact with finite numbers, in the scene's frame."""
    contacts = snapshot.contacts
    if contacts is None:
        return []
    points = snapshot.in_scene(contacts.frame).points(contacts.points)
    forces = snapshot.in_scene(contacts.frame).vectors(contacts.forces)
    made = []
    for k in range(len(points)):
        if not (np.isfinite(points[k]).all() and np.isfinite(forces[k]).all()):
            continue
        flags = int(contacts.flags[k])
        made.append(
            Touch(
                points[k],
                forces[k],
                int(contacts.finger[k]),
                float(contacts.sigma[k]),
                tuple(word for bit, word in FLAG_NAMES.items() if flags & bit),
                bool(flags & CONTACT),
            )
        )
    return made


def friction_cones(snapshot: Snapshot, coefficient: float, length: float) -> Floats:
    """Line segments (s, 2, 3) m: the friction cone of each touching contact, about its normal.

    Outside, where the finger is that pushes from within it. On the deformed shape with the
    friction that its grasp was given, once that is known.
    """
    contacts, grasp = snapshot.contacts, snapshot.grasp
    if grasp is not None and grasp.deformed:
        points = snapshot.in_scene(grasp.frame).points(grasp.points)
        normals = snapshot.in_scene(grasp.frame).vectors(grasp.normals)
        touching, coefficient = np.arange(len(points)), grasp.friction
    elif contacts is not None:
        points = snapshot.in_scene(contacts.frame).points(contacts.points)
        normals = snapshot.in_scene(contacts.frame).vectors(contacts.normals)
        touching = np.flatnonzero(contacts.flags & CONTACT)
    else:
        return np.zeros((0, 2, 3))
    angles = np.linspace(0.0, 2 * np.pi, 17)[:-1]
    sizes = np.linalg.norm(normals, axis=1)
    segments = []
    for k in touching:
        if not (np.isfinite(points[k]).all() and 0.5 < sizes[k] < 2.0):
            continue
        axis = normals[k]
        helper = np.eye(3)[int(np.abs(axis).argmin())]
        first = np.cross(axis, helper)
        first /= np.linalg.norm(first)
        ring = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), np.cross(axis, first))
        rim = points[k] - length * (axis + coefficient * ring)
        segments.append(np.stack([np.broadcast_to(points[k], rim.shape), rim], axis=1))
        segments.append(np.stack([rim, np.roll(rim, -1, axis=0)], axis=1))
    return np.concatenate(segments) if segments else np.zeros((0, 2, 3))


def largest(values: Floats | None) -> float:
    """The largest known size of a value, 0 where none is known."""
    if values is None:
        return 0.0
    known = values[np.isfinite(values)]
    return float(np.abs(known).max()) if len(known) else 0.0
