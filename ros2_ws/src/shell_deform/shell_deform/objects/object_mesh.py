# SPDX-License-Identifier: Apache-2.0
"""From an object to a control mesh whose limit surface is the object's middle surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surface.control_mesh import ControlMesh, control_mesh
from ..surface.fit import (
    MOST_THIN,
    STEADY,
    FitReport,
    Target,
    fit_limit_surface,
    fit_report,
    interpolating,
    raised,
    thin_share,
)
from ..surface.outer_ring import with_outer_ring
from .drawn import with_small_triangles
from .file_mesh import LimitTarget, control_file, read_triangles
from .grid_mesh import HalfCylinderTarget, HeightFieldTarget, grid, read_heights
from .local_radius import local_radius
from .prepare import Refinement, prepare
from .profile import Piece, RevolvedTarget, middle_profile
from .revolved_mesh import revolved_mesh
from .round_mesh import graded_sphere, turned_to
from .shell_object import (
    Cone,
    Contact,
    Cylinder,
    Ellipsoid,
    HalfCylinder,
    HeightField,
    MeshFile,
    ObjectError,
    Revolution,
    ShellObject,
    Sphere,
)
from .targets import EllipsoidTarget, SphereTarget

FloatArray = npt.NDArray[np.float64]

EDGES_PER_RADIUS = 1.0
"""Wanted edge length at a contact as a share of its radius.

Smaller triangles under the pin take vertices from the dent's ridge, which needs them more: of 640
vertices on the mission ball this share leaves the smallest error in the force at 12 mm.
"""

FIT_STEPS = 3

BENDING_SHARE = 0.25
"""Wanted edge length under a pad as a share of the bending length sqrt(R h) there.

A pad presses along a ring that begins at its centre and is as narrow as that length allows."""


def object_mesh(
    shell: ShellObject,
    control_vertices: int | None = None,
    refine_at: npt.ArrayLike | None = None,
    refine_radius: float | None = None,
) -> ControlMesh:
    """Control mesh whose limit surface is the middle surface of `shell`.

    Triangles are small at the contacts and grow smoothly away from them. Beyond every edge of an
    open surface lies a ring of control points that carries no surface (`surface/outer_ring.py`);
    its numbers come after those of the vertices on the surface.

    Args:
        control_vertices: about how many vertices on the surface (default: the object's own
            number); contacts much smaller than its triangles get more on top.
        refine_at: (k, 3) points of the surface to refine at [m] (default: the object's
            contacts; an empty list refines nowhere).
        refine_radius: radius of these contacts [m] (default: the smallest of the object's
            contacts).

    Raises:
        ObjectError: the object cannot be meshed like that.
    """
    count = shell.control_vertices if control_vertices is None else int(control_vertices)
    if count < 12:
        raise ObjectError(f'{shell.name}: {count} control vertices; at least 12 are needed')
    surface = shell.surface
    places = _places(shell, refine_at)
    if isinstance(surface, MeshFile):
        found = _from_file(shell, surface, count, places, refine_radius)
        return found if found.is_closed else _ringed(found, LimitTarget(found))
    target = middle_surface(shell)
    radius = _smallest_contact(shell, target, refine_radius)
    even, left = _graded(shell, target, count, places, radius)
    edge = EDGES_PER_RADIUS * radius
    around = _pressed_by_bodies(shell)
    mesh = with_small_triangles(even, target, left, edge, around=around)
    fitted = _ringed(interpolating(mesh), target)
    if thin_share(fitted) <= MOST_THIN:
        return fitted
    # Large triangles beside small ones have slid into slivers: once more along the normals alone.
    mesh = with_small_triangles(even, target, left, edge, rims=True, around=around)
    ringed = with_outer_ring(raised(mesh, target))
    steady = fit_limit_surface(ringed, target, 2 * FIT_STEPS, STEADY)
    return min(fitted, steady, key=thin_share)


def _ringed(mesh: ControlMesh, target: Target) -> ControlMesh:
    """Control points of `mesh`, and of a ring beyond its edges, fitted to `target`."""
    return fit_limit_surface(with_outer_ring(mesh), target, FIT_STEPS)


def middle_surface(shell: ShellObject) -> Target:
    """The middle surface, half the thickness inside the outer face.

    Exact for primitives; of a mesh file it is the limit surface of its control mesh.
    """
    surface, depth = shell.surface, 0.5 * shell.thickness_m
    if isinstance(surface, Sphere):
        return SphereTarget(0.5 * surface.outer_diameter_m - depth)
    if isinstance(surface, Ellipsoid):
        return EllipsoidTarget(0.5 * np.array(surface.outer_diameters_m), depth)
    if isinstance(surface, HalfCylinder):
        return HalfCylinderTarget(0.5 * surface.outer_diameter_m - depth, surface.length_m)
    if isinstance(surface, HeightField):
        return HeightFieldTarget(read_heights(surface.file), surface.spacing_m, depth)
    if isinstance(surface, MeshFile):
        mesh = _from_file(shell, surface, shell.control_vertices, _places(shell, None), None)
        return LimitTarget(mesh)
    return RevolvedTarget(meridian(shell))


def meridian(shell: ShellObject) -> list[Piece]:
    """Smooth pieces of the middle surface's meridian, from below."""
    surface = shell.surface
    if isinstance(surface, Revolution):
        outer = np.array(surface.outer_profile_m)
    else:
        assert isinstance(surface, Cylinder | Cone)
        if isinstance(surface, Cylinder):
            lower = upper = 0.5 * surface.outer_diameter_m
        else:
            lower, upper = (0.5 * diameter for diameter in surface.outer_diameters_m)
        end = 0.5 * surface.length_m
        outer = np.array([[lower, -end], [upper, end]])
        if isinstance(surface, Cylinder) and surface.ends == 'closed':
            outer = np.vstack([[0.0, -end], outer, [0.0, end]])
    try:
        return middle_profile(outer, 0.5 * shell.thickness_m)
    except ObjectError as error:
        raise ObjectError(f'{shell.name}: {error}') from error


def object_fit_report(shell: ShellObject, mesh: ControlMesh) -> FitReport:
    """How well the limit surface of `mesh` lies on the middle surface of `shell`."""
    return fit_report(mesh, middle_surface(shell))


def _places(shell: ShellObject, refine_at: npt.ArrayLike | None) -> FloatArray:
    """(k, 3) where triangles are to be small [m]."""
    patches = [grip.at_m for grip in shell.grips if grip.radius_m is not None]
    touched = [c.at_m for c in shell.contacts if c.kind != 'plate']
    own = np.array([*touched, *patches], dtype=np.float64)
    places = own if refine_at is None else np.asarray(refine_at, dtype=np.float64)
    places = places.reshape(-1, 3)
    if not np.isfinite(places).all():
        raise ObjectError(f'{shell.name}: refine_at holds a place that is not finite')
    return places


def _pressed_by_bodies(shell: ShellObject) -> bool:
    """Whether rigid bodies press on places of the object."""
    return any(contact.kind in ('pad', 'fingertip') for contact in shell.contacts)


def _smallest_contact(shell: ShellObject, target: Target, refine_radius: float | None) -> float:
    """Size [m] that triangles must resolve: as asked, or that of the object's contacts."""
    radius = refine_radius
    if radius is None:
        touched = [contact for contact in shell.contacts if contact.kind != 'plate']
        lengths = [_contact_length(shell, contact, target) for contact in touched]
        lengths += [grip.radius_m for grip in shell.grips if grip.radius_m is not None]
        radius = min(lengths, default=np.inf)
    if not radius > 0.0:
        raise ObjectError(f'{shell.name}: refine_radius is {radius}; it must be above 0')
    return float(radius)


def _contact_length(shell: ShellObject, contact: Contact, target: Target) -> float:
    """Size [m] that triangles under a contact must resolve, by the roundness of the place."""
    if contact.kind == 'pin':
        return contact.radius_m
    length = contact.radius_m
    for _ in range(3):
        # What counts is how round the wall is within its bending length.
        radius = local_radius(target, np.array(contact.at_m), length)
        length = min(contact.radius_m, float(np.sqrt(radius * shell.thickness_m)))
    return min(contact.radius_m, BENDING_SHARE * length)


def _from_file(
    shell: ShellObject,
    surface: MeshFile,
    count: int,
    places: FloatArray,
    refine_radius: float | None,
) -> ControlMesh:
    """The control mesh in a file, or one fitted to the face that the file shows."""
    if surface.face != 'control':
        vertices, triangles = read_triangles(surface.file, surface.unit)
        try:
            return prepare(
                vertices,
                triangles,
                shell.thickness_m,
                face=surface.face,
                control_vertices=count,
                refinement=Refinement(
                    places,
                    lambda target: (
                        EDGES_PER_RADIUS * _smallest_contact(shell, target, refine_radius)
                    ),
                    _pressed_by_bodies(shell),
                ),
            ).fit.mesh
        except ObjectError as error:
            raise ObjectError(f'{shell.name}: {surface.file}: {error}') from error
    mesh = control_file(shell.name, surface)
    walls = shell.vertex_thickness_m
    if walls is not None and len(walls) != mesh.vertex_count:
        raise ObjectError(
            f'{shell.name}: thickness_m lists {len(walls)} values; {surface.file} has '
            f'{mesh.vertex_count} vertices'
        )
    return mesh


def _graded(
    shell: ShellObject, target: Target, count: int, places: FloatArray, radius: float
) -> tuple[ControlMesh, FloatArray]:
    """A mesh as even as the surface lets it be, fine at poles that are touched; places left."""
    surface = shell.surface
    if isinstance(surface, Sphere | Ellipsoid):
        return _round(surface, 0.5 * shell.thickness_m, count, places, radius)
    if isinstance(target, HalfCylinderTarget):
        flat, triangles = grid(np.pi * target.radius, target.length, count)
    elif isinstance(target, HeightFieldTarget):
        flat, triangles = grid(target.width, target.height, count)
    else:
        return _revolved(meridian(shell), count, places, radius)
    return control_mesh(target.place(flat), triangles), places


def _round(
    surface: Sphere | Ellipsoid, depth: float, count: int, places: FloatArray, radius: float
) -> tuple[ControlMesh, FloatArray]:
    """A sphere or ellipsoid, graded to its poles if exactly they are touched; places left."""
    if isinstance(surface, Sphere):
        outer = np.full(3, 0.5 * surface.outer_diameter_m)
    else:
        outer = 0.5 * np.array(surface.outer_diameters_m)
    half_axes = outer - depth
    directions = places / outer
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-30)
    axis, edge = np.array([0.0, 0.0, 1.0]), None
    if len(places):
        axis = directions[0]
        if (np.abs(directions @ axis) > np.cos(0.02)).all():
            edge = EDGES_PER_RADIUS * radius / half_axes.max()
            places = places[:0]
    points, triangles = graded_sphere(count, edge)
    return control_mesh(turned_to(points, axis) * half_axes, triangles), places


def _revolved(
    pieces: list[Piece], count: int, places: FloatArray, radius: float
) -> tuple[ControlMesh, FloatArray]:
    """A surface of revolution, graded to poles that are touched; the other places."""
    off_axis = np.hypot(places[:, 0], places[:, 1]) > radius
    middle = 0.5 * (pieces[0].curve(0.0)[1] + pieces[-1].curve(pieces[-1].length)[1])
    edges: list[float | None] = [None, None]
    for end, pole in enumerate((pieces[0].starts_on_axis(), pieces[-1].ends_on_axis())):
        touched = ~off_axis & ((places[:, 2] > middle) == bool(end))
        if pole and touched.any():
            edges[end] = EDGES_PER_RADIUS * radius
    return revolved_mesh(pieces, count, edges[0], edges[1]), places[off_axis]
