"""From an object to a control mesh whose limit surface is the object's middle surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surface.control_mesh import ControlMesh, control_mesh
from ..surface.fit import FitReport, Target, fit_limit_surface, fit_report, interpolating
from .round_mesh import graded_sphere, turned_to
from .shell_object import Ellipsoid, ObjectError, ShellObject, Sphere
from .targets import EllipsoidTarget, SphereTarget

FloatArray = npt.NDArray[np.float64]

EDGES_PER_RADIUS = 0.4
"""Wanted edge length at a contact as a share of its radius."""

FIT_STEPS = 3


def object_mesh(
    shell: ShellObject,
    control_vertices: int | None = None,
    refine_at: npt.ArrayLike | None = None,
    refine_radius: float | None = None,
) -> ControlMesh:
    """Control mesh whose limit surface is the middle surface of `shell`.

    Triangles are small at the contacts and grow smoothly away from them.

    Args:
        control_vertices: about how many vertices (default: the object's own number).
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
    places, radius = _refinement(shell, refine_at, refine_radius)
    target = middle_surface(shell)
    mesh = _round(shell, count, places, radius)
    return fit_limit_surface(interpolating(mesh), target, FIT_STEPS)


def middle_surface(shell: ShellObject) -> Target:
    """The exact middle surface: half the thickness inside the outer face."""
    surface, depth = shell.surface, 0.5 * shell.thickness_m
    if isinstance(surface, Sphere):
        return SphereTarget(0.5 * surface.outer_diameter_m - depth)
    if isinstance(surface, Ellipsoid):
        return EllipsoidTarget(0.5 * np.array(surface.outer_diameters_m), depth)
    raise ObjectError(f'{shell.name}: no exact middle surface of a {surface.kind}')


def object_fit_report(shell: ShellObject, mesh: ControlMesh) -> FitReport:
    """How well the limit surface of `mesh` lies on the middle surface of `shell`."""
    return fit_report(mesh, middle_surface(shell))


def _refinement(
    shell: ShellObject, refine_at: npt.ArrayLike | None, refine_radius: float | None
) -> tuple[FloatArray, float]:
    own = np.array([contact.at_m for contact in shell.contacts], dtype=np.float64)
    places = own if refine_at is None else np.asarray(refine_at, dtype=np.float64)
    places = places.reshape(-1, 3)
    if not np.isfinite(places).all():
        raise ObjectError(f'{shell.name}: refine_at holds a place that is not finite')
    radius = refine_radius
    if radius is None:
        radius = min((contact.radius_m for contact in shell.contacts), default=np.inf)
    if not radius > 0.0:
        raise ObjectError(f'{shell.name}: refine_radius is {radius}; it must be above 0')
    return places, float(radius)


def _round(shell: ShellObject, count: int, places: FloatArray, radius: float) -> ControlMesh:
    surface = shell.surface
    if isinstance(surface, Sphere):
        outer = np.full(3, 0.5 * surface.outer_diameter_m)
    else:
        assert isinstance(surface, Ellipsoid)
        outer = 0.5 * np.array(surface.outer_diameters_m)
    half_axes = outer - 0.5 * shell.thickness_m
    edge = EDGES_PER_RADIUS * radius / half_axes.max() if len(places) else None
    points, triangles = graded_sphere(count, edge)
    axis = places[0] / outer if len(places) else np.array([0.0, 0.0, 1.0])
    return control_mesh(turned_to(points, axis) * half_axes, triangles)
