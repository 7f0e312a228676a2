# SPDX-License-Identifier: Apache-2.0
"""The model side of a comparison: a deformed shell, its outer face and its dent region.

The solver works on the middle surface; a scanner sees the outer face. That of a thin wall lies
half a thickness further along the deformed normal; that of a thick one, which shears and gets
thinner under a pin, comes from the solver and is the limit surface itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from shell_deform.surface.control_mesh import ControlMesh, control_mesh
from shell_deform.surface.limit import LimitSurface, surface_points
from shell_deform.surface.loop_basis import BasisRows, basis_rows
from shell_deform.surface.outer_ring import with_outer_ring

DENT_SHARE = 0.1
"""The dent region is where the displacement exceeds this share of its maximum."""

SMALLEST_DENT = 1e-5
"""A model whose largest displacement [m] is below this has no dent region."""

SAMPLES_PER_FACE = 30_000
"""About this many samples of the limit surface serve areas, coverage and starting points."""


class SurfaceError(ValueError):
    """Control points, thickness or topology that do not make a surface."""


@dataclass(frozen=True)
class SurfaceSamples:
    """Points spread over the limit surface, each standing for `area` [m^2] of the outer face.

    triangle (s,), parameters (s, 2): where they lie; position (s, 3): on the outer face [m];
    normal (s, 3): outward; displacement (s,): of the limit surface [m].
    """

    triangle: np.ndarray
    parameters: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    displacement: np.ndarray


@dataclass(frozen=True, eq=False)
class _Places:
    """Points of a mesh with their basis rows; parameter_area of each (a triangle has 1/2)."""

    triangle: np.ndarray
    parameters: np.ndarray
    parameter_area: float
    rows: BasisRows


@lru_cache(maxsize=4)
def _lattice(limit: LimitSurface) -> _Places:
    """Sample every triangle of a mesh alike; kept, for every scan meets several deformations."""
    active = np.flatnonzero(limit.mesh.active)
    per_side = max(2, round((SAMPLES_PER_FACE / max(len(active), 1)) ** 0.5))
    lattice = triangle_lattice(per_side)
    triangle = np.repeat(active, len(lattice))
    parameters = np.tile(lattice, (len(active), 1))
    rows = basis_rows(limit.mesh, triangle, parameters)
    return _Places(triangle, parameters, 0.5 / len(lattice), rows)


@dataclass(frozen=True, eq=False)
class DeformedSurface:
    """A shell at rest and deformed.

    limit: the Loop surface of the control mesh; rest, deformed: control points (n, 3) [m];
    thickness: h [m]; is_outer: whether the limit surface is the outer face, else it is the middle
    surface. Raises SurfaceError if they do not fit.
    """

    limit: LimitSurface
    rest: np.ndarray
    deformed: np.ndarray
    thickness: float
    is_outer: bool = False

    def __post_init__(self) -> None:
        n = self.limit.mesh.vertex_count
        for name, points in (('rest', self.rest), ('deformed', self.deformed)):
            if points.shape != (n, 3):
                raise SurfaceError(
                    f'{name} control points of shape {points.shape}; the mesh needs ({n}, 3)'
                )
            if not np.all(np.isfinite(points)):
                raise SurfaceError(f'{name} control points with NaN or infinite coordinates')
        if not (np.isfinite(self.thickness) and self.thickness >= 0.0):
            raise SurfaceError(f'thickness {self.thickness} m; it must be zero or positive')

    @property
    def mesh(self) -> ControlMesh:
        """The control mesh (topology)."""
        return self.limit.mesh

    @property
    def offset(self) -> float:
        """Distance [m] from the limit surface to the outer face."""
        return 0.0 if self.is_outer else 0.5 * self.thickness

    def at_rest(self) -> DeformedSurface:
        """Return the same shell without any deformation."""
        return replace(self, deformed=self.rest)

    @cached_property
    def samples(self) -> SurfaceSamples:
        """About SAMPLES_PER_FACE samples of the deformed outer face."""
        return self._evaluate(_lattice(self.limit))

    def evaluate(self, triangle: np.ndarray, parameters: np.ndarray) -> SurfaceSamples:
        """Evaluate the outer face at points (p,) of given parameters (p, 2); areas are zero."""
        rows = basis_rows(self.mesh, triangle, parameters)
        return self._evaluate(_Places(triangle, parameters, 0.0, rows))

    def _evaluate(self, places: _Places) -> SurfaceSamples:
        middle = surface_points(places.rows, self.deformed)
        rest = middle
        if self.rest is not self.deformed:
            rest = surface_points(places.rows, self.rest)
        return SurfaceSamples(
            places.triangle,
            places.parameters,
            middle.position + self.offset * middle.normal,
            middle.normal,
            places.parameter_area
            * _outer_area(middle.first, middle.second, middle.normal, self.offset),
            np.linalg.norm(middle.position - rest.position, axis=1),
        )

    @cached_property
    def max_displacement(self) -> float:
        """Largest displacement [m] of the limit surface, over samples and vertices."""
        matrix = self.limit.limit_matrix
        at_vertices = np.linalg.norm(matrix @ (self.deformed - self.rest), axis=1)
        used = np.unique(self.mesh.triangles[self.mesh.active])
        return float(max(self.samples.displacement.max(), at_vertices[used].max()))

    @property
    def dent_threshold(self) -> float:
        """Displacement [m] above which a point belongs to the dent region; inf without a dent."""
        if self.max_displacement < SMALLEST_DENT:
            return float('inf')
        return DENT_SHARE * self.max_displacement

    @cached_property
    def extent(self) -> float:
        """Largest side [m] of the box around the deformed outer face."""
        position = self.samples.position
        return float((position.max(axis=0) - position.min(axis=0)).max())


def surface_from_limit_positions(
    limit: LimitSurface, rest: np.ndarray | None, deformed: np.ndarray, thickness: float
) -> DeformedSurface:
    """Build a DeformedSurface from limit positions (n, 3) of the control vertices [m].

    This is what `deformation/surface` carries; the control points follow through the
    limit-position matrix. rest: limit positions at rest, or None for the mesh's own control
    points. Raises SurfaceError.
    """
    mesh = limit.mesh
    if deformed.shape != (mesh.vertex_count, 3):
        raise SurfaceError(
            f'{len(deformed)} surface points for a control mesh of {mesh.vertex_count} vertices; '
            'surface and object do not belong together'
        )
    rest_control = mesh.vertices if rest is None else limit.control_points(rest)
    return DeformedSurface(limit, rest_control, limit.control_points(deformed), thickness)


def surface_of_outer_face(
    limit: LimitSurface, rest: np.ndarray, deformed: np.ndarray, thickness: float
) -> DeformedSurface:
    """Build a DeformedSurface from points (n, 3) of the outer face over the control vertices [m].

    The smooth surface through them is the outer face. Raises SurfaceError.
    """
    for points in (rest, deformed):
        if points.shape != (limit.mesh.vertex_count, 3):
            raise SurfaceError(
                f'{len(points)} points of the outer face for a control mesh of '
                f'{limit.mesh.vertex_count} vertices; surface and object do not belong together'
            )
    return DeformedSurface(
        limit, limit.control_points(rest), limit.control_points(deformed), thickness, True
    )


def outer_face_at_rest(limit: LimitSurface, rest: np.ndarray, thickness: float) -> np.ndarray:
    """Points (n, 3) [m] of the outer face over limit positions at rest (n, 3) [m]."""
    normals = limit.vertex_normals(limit.control_points(rest))
    return np.asarray(rest + 0.5 * thickness * normals)


def published_mesh(triangles: np.ndarray, rest: np.ndarray) -> ControlMesh:
    """The topology of published triangles; points (n, 3) that none names lie beyond an edge.

    Raises SurfaceError when there are not as many of them as that takes.
    """
    inside = int(triangles.max()) + 1
    mesh = control_mesh(rest[:inside], triangles)
    if inside < len(rest):
        mesh = with_outer_ring(mesh)
    if mesh.vertex_count != len(rest):
        raise SurfaceError(
            f'{len(rest)} surface points; the triangles name {inside}, and beyond the edges of '
            f'their surface belong {mesh.vertex_count - inside}'
        )
    return mesh


def triangle_lattice(per_side: int) -> np.ndarray:
    """Return the per_side**2 centroids (k, 2) of the regular subdivision of a triangle."""
    cells = []
    for i in range(per_side):
        for j in range(per_side - i):
            cells.append(((i + 1 / 3) / per_side, (j + 1 / 3) / per_side))
            if i + j < per_side - 1:
                cells.append(((i + 2 / 3) / per_side, (j + 2 / 3) / per_side))
    return np.array(cells)


def _outer_area(
    first: np.ndarray, second: np.ndarray, normal: np.ndarray, offset: float
) -> np.ndarray:
    """Return the area (p,) of the parallel surface per unit of parameter area.

    Steiner's formula: dA (1 - 2 H z + K z^2) at distance z along the normal, with the
    curvatures of the second fundamental form b = x_ab . n.
    """
    metric = np.einsum('pia,pib->abp', first, first)
    metric_uu, metric_uv, metric_vv = metric[0, 0], metric[0, 1], metric[1, 1]
    determinant = metric_uu * metric_vv - metric_uv**2
    b_uu, b_uv, b_vv = np.einsum('pik,pi->kp', second, normal)
    safe = np.where(determinant > 0.0, determinant, 1.0)
    twice_mean = (metric_vv * b_uu - 2.0 * metric_uv * b_uv + metric_uu * b_vv) / safe
    gauss = (b_uu * b_vv - b_uv**2) / safe
    return np.sqrt(np.maximum(determinant, 0.0)) * (1.0 - offset * twice_mean + offset**2 * gauss)
