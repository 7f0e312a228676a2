# SPDX-License-Identifier: Apache-2.0
"""Contacts and other loads as consistent nodal forces on the undeformed surface.

A contact has a radius: under a mathematical point force Koiter's energy has no convergent
solution. Its force is a uniform dead traction along a fixed direction over the middle-surface arc
within the radius; its displacement is that of its centre, along its axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.contact.bodies import Body
from shell_deform.surface.closest_point import ClosestPoints
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.frames import lateral_vectors
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import basis_rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RADIAL_POINTS, ANGULAR_POINTS = 8, 24
LINE_POINTS = 4

# Pressure over its mean at the squared relative radius s of a patch.
PROFILES: dict[str, Callable[[Array], Array]] = {
    'uniform': np.ones_like,
    'hertz': lambda s: 1.5 * np.sqrt(1.0 - s),
    'cone': lambda s: 3.0 * (1.0 - np.sqrt(s)),
}


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
        body: the rigid body that touches here, or None where the traction is given (a pin).
        slides: whether nothing is held across the way of a body that does not rub.
    """

    point: Array
    axis: Array
    radius: float
    centre: Array
    spread: Array
    moments: Array
    inertia: float
    body: Body | None = None
    slides: bool = False

    @property
    def lateral(self) -> tuple[Array, Array]:
        """Two unit vectors across the axis."""
        return lateral_vectors(self.axis)

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
    surface: LimitSurface,
    at: Array,
    radius: float,
    axis: Array | None = None,
    profile: str = 'uniform',
    place: tuple[NDArray[np.int64], Array] | None = None,
) -> ContactPatch:
    """Contact of `radius` [m] centred where the middle surface is nearest to `at` (3,) [m].

    `place`: triangle (1,) and parameters (1, 2) of that point where they are known.
    `axis` is the direction of the push (default: the inward normal there). `profile`: how the
    pressure falls towards the rim: 'uniform' (a pin), 'hertz' (a pad: smooth bodies) or 'cone'.
    Raises LoadError for a radius that is not positive, a point that is not finite, or an unknown
    profile.
    """
    if profile not in PROFILES:
        raise LoadError(f'pressure profile is {profile!r}; choose one of {sorted(PROFILES)}')
    at = np.asarray(at, dtype=float)
    if not np.all(np.isfinite(at)):
        raise LoadError(f'contact point {at.tolist()} is not finite')
    if not (np.isfinite(radius) and radius > 0):
        raise LoadError(f'contact radius is {radius} m; it must be positive')
    mesh = surface.mesh
    centre = surface.closest_point(mesh.vertices, at[None], seeds=place)
    normal = centre.normal[0]
    point = centre.position[0]
    push = -normal if axis is None else np.asarray(axis, float) / np.linalg.norm(axis)
    triangle, parameters, weight, offset = _disc_points(surface, centre, radius, PROFILES[profile])
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
    surface: LimitSurface,
    centre: ClosestPoints,
    radius: float,
    pressure: Callable[[Array], Array],
) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Quadrature of the patch: triangles, parameters, weights (sum 1), offsets from the centre.

    Gauss points in the squared radius and equal angles give equal areas on a plane; on a curved
    surface the distance along it is the chord stretched by the turn of the normal.
    """
    point, normal = centre.position[0], centre.normal[0]
    nodes, gauss = np.polynomial.legendre.leggauss(RADIAL_POINTS)
    arc = radius * np.sqrt(0.5 * (nodes + 1.0))
    angle = 2.0 * np.pi * (np.arange(ANGULAR_POINTS) + 0.5) / ANGULAR_POINTS
    first, second = lateral_vectors(normal)
    direction = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    target = np.repeat(arc, ANGULAR_POINTS)
    direction = np.tile(direction, (RADIAL_POINTS, 1))
    reach = target.copy()
    seeds = _seeds_outward(surface, centre, point + reach[:, None] * direction)
    for _ in range(3):
        found = surface.closest_point(
            surface.mesh.vertices, point + reach[:, None] * direction, seeds=seeds
        )
        seeds = found.triangle, found.parameters
        offset = found.position - point
        chord = np.linalg.norm(offset, axis=1)
        half_turn = 0.5 * np.arccos(np.clip(found.normal @ normal, -1.0, 1.0))
        length = chord / np.sinc(half_turn / np.pi)
        reach *= target / np.maximum(length, 1e-12 * radius)
    turn = np.arccos(np.clip(found.normal @ normal, -1.0, 1.0))
    share = 0.5 * gauss * pressure(0.5 * (nodes + 1.0))
    weight = np.repeat(share, ANGULAR_POINTS) * np.sinc(turn / np.pi)
    return found.triangle, found.parameters, weight / weight.sum(), offset


def _seeds_outward(
    surface: LimitSurface, centre: ClosestPoints, queries: Array
) -> tuple[NDArray[np.int64], Array]:
    """Triangles and parameters of the feet of rings of queries, each sought from the ring within.

    The surface is followed from the centre, so that another sheet behind it is never found.
    """
    triangle = np.repeat(centre.triangle, ANGULAR_POINTS)
    parameters = np.repeat(centre.parameters, ANGULAR_POINTS, axis=0)
    rings = []
    for ring in np.split(queries, RADIAL_POINTS):
        found = surface.closest_point(surface.mesh.vertices, ring, seeds=(triangle, parameters))
        triangle, parameters = found.triangle, found.parameters
        rings.append((triangle, parameters))
    return np.concatenate([t for t, _ in rings]), np.concatenate([p for _, p in rings])


def surface_load(shell: Discretisation, traction: Array) -> Array:
    """Nodal forces (n, 3) [N] of a dead load per undeformed area: (3,) or (p, 3) [Pa]."""
    per_point = np.broadcast_to(np.asarray(traction, dtype=float), (len(shell.weights), 3))
    return np.asarray(shell.value_matrix().T @ (shell.weights[:, None] * per_point))


def line_load(mesh: ControlMesh, path: Index, total: Array) -> Array:
    """Nodal forces (n, 3) of a total force (3,) [N] spread evenly along a path of mesh edges.

    `path` lists the vertices one after the other. The limit curves of the edges are integrated by
    Gauss points. Raises LoadError where two neighbours in the path share no edge of the surface.
    """
    nodes, weights = np.polynomial.legendre.leggauss(LINE_POINTS)
    places, gauss = 0.5 * (nodes + 1.0), 0.5 * weights
    values, length = np.zeros(len(mesh.vertices)), 0.0
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for a, b in zip(path[:-1], path[1:], strict=True):
        triangle, corner_a, corner_b = _triangle_of(mesh, int(a), int(b))
        step = corners[corner_b] - corners[corner_a]
        at = np.full(LINE_POINTS, triangle)
        rows = basis_rows(mesh, at, corners[corner_a] + places[:, None] * step)
        of = np.repeat(np.arange(LINE_POINTS), np.diff(rows.node_offsets))
        along = np.zeros((LINE_POINTS, 3))
        np.add.at(along, of, (rows.first @ step)[:, None] * mesh.vertices[rows.nodes])
        weight = gauss * np.linalg.norm(along, axis=1)
        np.add.at(values, rows.nodes, weight[of] * rows.values)
        length += float(weight.sum())
    return np.outer(values / length, total)


def contact_torque(patch: ContactPatch, torque: float) -> Array:
    """Nodal forces (n, 3) [N] of a torque [N m] of the contact about its axis."""
    return torque * patch.torque_pattern()


def _triangle_of(mesh: ControlMesh, a: int, b: int) -> tuple[int, int, int]:
    """An active triangle with the edge a-b, and the corners a and b are in it."""
    triangles = mesh.triangles
    both = mesh.active & np.any(triangles == a, axis=1) & np.any(triangles == b, axis=1)
    found = np.flatnonzero(both)
    if not len(found):
        raise LoadError(f'vertices {a} and {b} share no edge of the surface')
    corners = triangles[found[0]].tolist()
    return int(found[0]), corners.index(a), corners.index(b)
