"""Contacts and other loads as consistent nodal forces on the undeformed surface.

A contact has a radius: under a mathematical point force Koiter's energy has no convergent
solution. Its force is a uniform dead traction along a fixed direction over the middle-surface arc
within the radius; its displacement is that of its centre, along its axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import basis_rows

Array = NDArray[np.float64]

RADIAL_POINTS, ANGULAR_POINTS = 8, 24


class LoadError(ValueError):
    """A contact or load that cannot be applied to this surface."""


@dataclass(frozen=True)
class ContactPatch:
    """One contact on the undeformed middle surface of n control vertices.

    Attributes:
        point: (3,) centre on the middle surface [m]. axis: (3,) unit direction of the push,
            into the object. radius: arc radius of the patch [m].
        centre: (n,) basis values at the centre. spread: (n,) their mean over the patch.
        moments: (n, 3) mean over the patch of basis value times offset from the centre [m].
        inertia: mean squared offset across the axis [m^2].
    """

    point: Array
    axis: Array
    radius: float
    centre: Array
    spread: Array
    moments: Array
    inertia: float

    @property
    def lateral(self) -> tuple[Array, Array]:
        """Two unit vectors across the axis."""
        helper = np.eye(3)[int(np.argmin(np.abs(self.axis)))]
        first = np.cross(self.axis, helper)
        first /= np.linalg.norm(first)
        return first, np.cross(self.axis, first)

    def force_pattern(self, direction: Array) -> Array:
        """Nodal forces (n, 3) of a unit force [N] along `direction` (3,)."""
        return self.spread[:, None] * direction

    def displacement_row(self) -> Array:
        """Row (n, 3): displacement of the centre along the axis."""
        return self.centre[:, None] * self.axis

    def spin_row(self) -> Array:
        """Row (n, 3): mean rotation of the patch about its axis [rad] times its radius [m]."""
        scale = self.radius / self.inertia
        return scale * np.cross(self.axis, self.moments)

    def torque_pattern(self) -> Array:
        """Nodal forces (n, 3) of a unit torque [N m] about the axis over the patch."""
        return np.cross(self.axis, self.moments) / self.inertia

    def held_rows(self) -> Array:
        """Rows (3, n, 3) that a held contact keeps at zero: mean lateral motion, mean spin."""
        first, second = self.lateral
        return np.stack([self.force_pattern(first), self.force_pattern(second), self.spin_row()])


def contact_patch(
    surface: LimitSurface, at: Array, radius: float, axis: Array | None = None
) -> ContactPatch:
    """Contact of `radius` [m] centred where the middle surface is nearest to `at` (3,) [m].

    `axis` is the direction of the push (default: the inward normal there). Raises LoadError for a
    radius that is not positive or a point that is not finite.
    """
    at = np.asarray(at, dtype=float)
    if not np.all(np.isfinite(at)):
        raise LoadError(f'contact point {at.tolist()} is not finite')
    if not (np.isfinite(radius) and radius > 0):
        raise LoadError(f'contact radius is {radius} m; it must be positive')
    mesh = surface.mesh
    centre = surface.closest_point(mesh.vertices, at[None])
    normal = centre.normal[0]
    point = centre.position[0]
    push = -normal if axis is None else np.asarray(axis, float) / np.linalg.norm(axis)
    triangle, parameters, weight, offset = _disc_points(surface, point, normal, radius)
    rows = basis_rows(mesh, triangle, parameters)
    row_of = np.repeat(np.arange(len(weight)), np.diff(rows.node_offsets))
    weighted = weight[row_of] * rows.values
    spread = np.zeros(len(mesh.vertices))
    np.add.at(spread, rows.nodes, weighted)
    moments = np.zeros((len(mesh.vertices), 3))
    np.add.at(moments, rows.nodes, weighted[:, None] * offset[row_of])
    middle = basis_rows(mesh, centre.triangle, centre.parameters)
    values = np.zeros(len(mesh.vertices))
    np.add.at(values, middle.nodes, middle.values)
    across = offset - np.outer(offset @ push, push)
    return ContactPatch(
        point=point,
        axis=push,
        radius=float(radius),
        centre=values,
        spread=spread,
        moments=moments,
        inertia=float(weight @ np.einsum('pi,pi->p', across, across)),
    )


def _disc_points(
    surface: LimitSurface, point: Array, normal: Array, radius: float
) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Quadrature of the patch: triangles, parameters, weights (sum 1), offsets from the centre.

    Gauss points in the squared radius and equal angles give equal areas on a plane; on a curved
    surface the distance along it is the chord stretched by the turn of the normal.
    """
    nodes, gauss = np.polynomial.legendre.leggauss(RADIAL_POINTS)
    arc = radius * np.sqrt(0.5 * (nodes + 1.0))
    angle = 2.0 * np.pi * (np.arange(ANGULAR_POINTS) + 0.5) / ANGULAR_POINTS
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    direction = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    target = np.repeat(arc, ANGULAR_POINTS)
    direction = np.tile(direction, (RADIAL_POINTS, 1))
    reach = target.copy()
    for _ in range(3):
        found = surface.closest_point(surface.mesh.vertices, point + reach[:, None] * direction)
        offset = found.position - point
        chord = np.linalg.norm(offset, axis=1)
        half_turn = 0.5 * np.arccos(np.clip(found.normal @ normal, -1.0, 1.0))
        length = chord / np.sinc(half_turn / np.pi)
        reach *= target / np.maximum(length, 1e-12 * radius)
    turn = np.arccos(np.clip(found.normal @ normal, -1.0, 1.0))
    weight = np.repeat(0.5 * gauss, ANGULAR_POINTS) * np.sinc(turn / np.pi)
    return found.triangle, found.parameters, weight / weight.sum(), offset
