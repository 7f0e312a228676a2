# SPDX-License-Identifier: Apache-2.0
"""What the suite knows about one thin shell: shape, wall, material, gas, supports, contacts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from ..theory import THICK
from ..theory.relaxation import Relaxation

STANDARD_ATMOSPHERE_PA = 101_325.0
DEFAULT_CONTROL_VERTICES = 640
DEFAULT_CONTACT_RADIUS_M = 0.001


class ObjectError(ValueError):
    """An object file or object that cannot be used; the message says where and what is allowed."""


@dataclass(frozen=True)
class Sphere:
    """A sphere about the origin."""

    outer_diameter_m: float
    kind: ClassVar[str] = 'sphere'


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid about the origin with its axes along x, y, z."""

    outer_diameters_m: tuple[float, float, float]
    kind: ClassVar[str] = 'ellipsoid'


@dataclass(frozen=True)
class Cylinder:
    """A circular cylinder about z, from -length / 2 to length / 2; closed ends are flat."""

    outer_diameter_m: float
    length_m: float
    ends: Literal['open', 'closed']
    kind: ClassVar[str] = 'cylinder'


@dataclass(frozen=True)
class HalfCylinder:
    """The half y >= 0 of an open cylinder about z; its crown is the line x = 0, y = radius."""

    outer_diameter_m: float
    length_m: float
    kind: ClassVar[str] = 'half_cylinder'


@dataclass(frozen=True)
class Cone:
    """A truncated cone about z: the first diameter at z = -length / 2, the second at the top."""

    outer_diameters_m: tuple[float, float]
    length_m: float
    kind: ClassVar[str] = 'cone'


@dataclass(frozen=True)
class Revolution:
    """A surface of revolution about z; its profile lists (radius, height), outside to the right.

    A profile that starts or ends at radius zero closes there; elsewhere the surface is open.
    """

    outer_profile_m: tuple[tuple[float, float], ...]
    kind: ClassVar[str] = 'revolution'


@dataclass(frozen=True)
class HeightField:
    """Heights z over a rectangular grid about the origin of the x-y plane; outside is above."""

    file: Path
    spacing_m: float
    kind: ClassVar[str] = 'height_field'


@dataclass(frozen=True)
class MeshFile:
    """A triangle mesh from a file: the outer face, the middle surface, or the control mesh."""

    file: Path
    unit: Literal['m', 'cm', 'mm', 'in', 'inch']
    face: Literal['outer', 'middle', 'control']
    kind: ClassVar[str] = 'mesh'


Surface = Sphere | Ellipsoid | Cylinder | HalfCylinder | Cone | Revolution | HeightField | MeshFile


@dataclass(frozen=True)
class Gas:
    """What fills a closed shell; V0 is the volume inside the undeformed middle surface."""

    kind: Literal['none', 'open', 'sealed', 'liquid'] = 'none'
    gauge_pressure_pa: float = 0.0
    ambient_pa: float = STANDARD_ATMOSPHERE_PA


@dataclass(frozen=True)
class Support:
    """A part of the surface that is held.

    Attributes:
        kind: what is held.
        where: 'boundary', the name of an edge (see `edge_names`), or a plane such as 'x=0'.
    """

    kind: Literal['clamped', 'hinged', 'symmetry', 'diaphragm', 'held']
    where: str


@dataclass(frozen=True)
class Finger:
    """Which fingertip touches, and how it lies.

    Attributes:
        body: the file of its shape. unit: of a mesh file's numbers, None for a parameter file.
        along: direction of the finger, to its tip; None for any. towards: where the pad faces;
            None for the inward normal.
        cells_n: what its touch cells measured [N], by which its push then lies on the object
            instead of by contact; None for a rigid body.
    """

    body: Path
    unit: str | None = None
    along: tuple[float, float, float] | None = None
    towards: tuple[float, float, float] | None = None
    cells_n: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Contact:
    """A place where the object is touched, on its outer face.

    A pin presses evenly over its radius. A pad is a rigid body with a rim of that radius and a
    flat face, or one of `curvature_radius_m`; a fingertip is one of any shape; a plate is a pad as
    wide as it is said to be, flat, that moves `towards` a direction from wherever it touches
    first, the edge of an open object included. Rigid bodies have a coefficient of friction.
    """

    at_m: tuple[float, float, float]
    radius_m: float
    kind: Literal['pin', 'pad', 'fingertip', 'plate']
    curvature_radius_m: float | None = None
    friction: float = 0.0
    finger: Finger | None = None
    towards: tuple[float, float, float] | None = None

    @property
    def is_rigid(self) -> bool:
        """Whether a rigid body presses, not a given traction."""
        measured = self.finger is not None and self.finger.cells_n is not None
        return self.kind != 'pin' and not measured


@dataclass(frozen=True)
class GripPlace:
    """A part of the surface that a rigid body holds, in a pose that may change.

    Attributes:
        where: an edge or a plane as in `Support`, or None for a patch.
        at_m: the middle of a patch on the outer face; of an edge the point about which it turns,
            None for the middle of what is held.
        radius_m: of a patch. hold: 'hinged' keeps the places of an edge, 'clamped' also what lies
            across it, shear included: stiffer by up to a row of triangles.
        free: world axes along which it may shift.
    """

    where: str | None = None
    at_m: tuple[float, float, float] | None = None
    radius_m: float | None = None
    hold: Literal['hinged', 'clamped'] = 'hinged'
    free: tuple[Literal['x', 'y', 'z'], ...] = ()

    @property
    def name(self) -> str:
        """What messages and results call it."""
        if self.where is not None:
            return self.where
        return 'at ' + ' '.join(f'{value:g}' for value in self.at_m or ())


@dataclass(frozen=True)
class ShellObject:
    """One thin shell.

    Attributes:
        thickness_m: wall thickness, or its mean where `vertex_thickness_m` is given.
        young_modulus_pa: with which thin-shell theory answers. solid_young_modulus_pa: that of the
            material, with which a thick wall answers; None: the same.
        vertex_thickness_m: (n,) thickness at each vertex of a control mesh, else None.
        relaxation: how the modulus falls with time, or None for an elastic wall.
        pressure_pa: constant pressure inside over that outside, on the wall.
        source: where the numbers come from.
    """

    name: str
    surface: Surface
    thickness_m: float
    young_modulus_pa: float
    poisson_ratio: float
    yield_stress_pa: float | None = None
    gas: Gas = field(default_factory=Gas)
    supports: tuple[Support, ...] = ()
    contacts: tuple[Contact, ...] = ()
    grips: tuple[GripPlace, ...] = ()
    pressure_pa: float = 0.0
    control_vertices: int = DEFAULT_CONTROL_VERTICES
    vertex_thickness_m: npt.NDArray[np.float64] | None = None
    relaxation: Relaxation | None = None
    source: str = ''
    solid_young_modulus_pa: float | None = None

    def modulus(self, theory: str) -> float:
        """Young's modulus [Pa] for a theory.

        Thin-shell theory is too stiff for a thick wall: the modulus that it finds in a measured
        squeeze is lower than that of the material.
        """
        solid = self.solid_young_modulus_pa
        return solid if theory == THICK and solid is not None else self.young_modulus_pa

    def for_theory(self, theory: str) -> ShellObject:
        """The same object with one modulus, that of `theory`."""
        return replace(self, young_modulus_pa=self.modulus(theory), solid_young_modulus_pa=None)


_EDGES: dict[str, tuple[str, ...]] = {
    'cylinder': ('lower', 'upper'),
    'cone': ('lower', 'upper'),
    'revolution': ('lower', 'upper'),
    'half_cylinder': ('straight', 'ends'),
    'height_field': ('left', 'right', 'front', 'back'),
}


def edge_names(surface: Surface) -> tuple[str, ...]:
    """Names of the edges that a support may hold, besides 'boundary' and planes."""
    if isinstance(surface, Cylinder) and surface.ends == 'closed':
        return ()
    return _EDGES.get(surface.kind, ())


def is_closed(surface: Surface) -> bool | None:
    """True for a closed surface, False for an open one, None where only the file knows."""
    if isinstance(surface, Sphere | Ellipsoid):
        return True
    if isinstance(surface, Cylinder):
        return surface.ends == 'closed'
    if isinstance(surface, Revolution):
        return surface.outer_profile_m[0][0] == 0.0 and surface.outer_profile_m[-1][0] == 0.0
    if isinstance(surface, MeshFile):
        return None
    return False


def smallest_radius(surface: Surface) -> float:
    """Smallest outer radius of a primitive [m]; inf where it has none of its own."""
    if isinstance(surface, Sphere | Cylinder | HalfCylinder):
        return 0.5 * surface.outer_diameter_m
    if isinstance(surface, Ellipsoid | Cone):
        return 0.5 * min(surface.outer_diameters_m)
    return float(np.inf)
