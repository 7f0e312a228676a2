# SPDX-License-Identifier: Apache-2.0
"""Rigid pins on the outer face of a thick wall, and the quadrature points that they press."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.shell_points import ShellPoints
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.frames import lateral_vectors
from shell_deform.surface.limit import LimitSurface

Array = NDArray[np.float64]
Index = NDArray[np.int64]

POINTS_ACROSS = 1
"""Triangles under a pin are split until so many of their parts span its radius."""

MOST_SPLITS = 5

LEAST_LEVER = 0.02
"""Least mean square lever of the pressures about an axis of tilt, over the squared radius, that
holds a pin against tilting about it; an even disc has 1/4. Under a pin within one or two elements
of a coarse mesh the pressures have none, and it keeps its direction."""


class WallError(ValueError):
    """A wall for which the thick theory has no meaning."""


@dataclass(frozen=True)
class Stamp:
    """A rigid pin on the outer face: what lies under it moves alike along its axis, and slides.

    Attributes:
        centre: (3,) on the undeformed middle surface [m]. axis: (3,) unit direction of the push,
            into the object. radius: of the pressed patch, along the outer face [m].
    """

    centre: Array
    axis: Array
    radius: float

    def like(self, other: Stamp) -> bool:
        """Whether both are the same pin."""
        return (
            self.radius == other.radius
            and np.array_equal(self.centre, other.centre)
            and np.array_equal(self.axis, other.axis)
        )

    def overlaps(self, other: Stamp) -> bool:
        """Whether both press on some of the same wall."""
        away = float(np.linalg.norm(self.centre - other.centre))
        return away < self.radius + other.radius and float(self.axis @ other.axis) > 0.0


@dataclass(frozen=True)
class StampPoints:
    """Quadrature points under the stamps, g of them.

    Attributes:
        point: (g,) number of each. stamp: (g,) the stamp it lies under. cell: (g,) the pressure
            that acts on it, one an element. axis: (g, 3) out of the wall. height: (g,) of the
            undeformed outer face along it [m]. arm: (g, 2) offset from the stamp's centre along
            its two lateral vectors, over its radius.
        outward: (k, 3) normal of the surface at each stamp. wall: (k,) its thickness there [m].
        tilts: (k,) whether a stamp may tilt: the pressures under it turn it both ways.
    """

    point: Index
    stamp: Index
    cell: Index
    axis: Array
    height: Array
    arm: Array
    outward: Array
    wall: Array
    tilts: NDArray[np.bool_]

    @property
    def cells(self) -> int:
        """Number of pressures."""
        return int(self.cell.max(initial=-1)) + 1


def pins_before(
    stamps: Sequence[Stamp], others: Sequence[Stamp]
) -> tuple[NDArray[np.bool_], Index]:
    """(k,) whether each of `stamps` is among `others`; (k,) which one it is or has left, or -1."""
    stays, before = np.zeros(len(stamps), dtype=bool), np.full(len(stamps), -1)
    for k, stamp in enumerate(stamps):
        for i, other in enumerate(others):
            if stamp.like(other):
                stays[k], before[k] = True, i
    for k in np.flatnonzero(~stays).tolist():
        for i, other in enumerate(others):
            if i not in before and stamps[k].overlaps(other):
                before[k] = i
    return stays, before


def stamp_splits(mesh: ControlMesh, stamps: Sequence[Stamp]) -> Index:
    """(t,) splits of each triangle so that parts small against the pins lie under them."""
    corners = mesh.vertices[mesh.triangles]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    middle = corners.mean(axis=1)
    splits = np.zeros(len(mesh.triangles), dtype=np.int64)
    for stamp in stamps:
        near = np.linalg.norm(middle - stamp.centre, axis=1) < stamp.radius + 0.7 * edge
        wanted = np.ceil(np.log2(np.maximum(edge * POINTS_ACROSS / stamp.radius, 1.0)))
        splits[near] = np.maximum(splits[near], np.minimum(wanted[near], MOST_SPLITS))
    return splits


def stamp_points(
    shell: ShellPoints, surface: LimitSurface, points: Array, stamps: Sequence[Stamp]
) -> StampPoints:
    """Points under each stamp: the nearest ones that make up its area on the outer face.

    `points` (p, 3): all quadrature points on the undeformed middle surface [m]. Raises WallError
    for a stamp under which there are too few.
    """
    outer = points + 0.5 * shell.thickness[:, None] * shell.reference.normal
    mean, gauss = shell.reference.mean_and_gauss
    half = 0.5 * shell.thickness
    stretch = 1.0 - 2.0 * half * mean + half**2 * gauss
    area = shell.weights * stretch
    taken = np.full(len(points), -1, dtype=np.int64)
    parts: list[tuple[Index, int]] = []
    normals, walls = np.zeros((len(stamps), 3)), np.zeros(len(stamps))
    for k, stamp in enumerate(stamps):
        foot = surface.closest_point(shell.mesh.vertices, stamp.centre[None])
        normals[k] = foot.normal[0]
        walls[k] = shell.thickness[np.argmin(np.linalg.norm(points - stamp.centre, axis=1))]
        centre = stamp.centre + 0.5 * walls[k] * normals[k]
        distance = np.linalg.norm(outer - centre, axis=1)
        near = np.flatnonzero((distance < 1.5 * stamp.radius) & (taken < 0))
        near = near[np.argsort(distance[near], kind='stable')]
        within = np.cumsum(area[near]) - 0.5 * area[near] < np.pi * stamp.radius**2
        own = np.sort(near[within])
        if len(own) < 3:
            raise WallError(
                f'a pin of {1e3 * stamp.radius:.3g} mm at {np.round(1e3 * stamp.centre, 2)} mm '
                f'presses on fewer than three points of the mesh: refine it there'
            )
        taken[own] = k
        parts.append((own, k))
    point = np.concatenate([own for own, _ in parts]) if parts else np.zeros(0, np.int64)
    stamp_of = np.repeat([k for _, k in parts], [len(own) for own, _ in parts]).astype(np.int64)
    axis = np.array([-stamps[k].axis for k in stamp_of.tolist()]).reshape(-1, 3)
    arm = np.zeros((len(point), 2))
    for k, stamp in enumerate(stamps):
        own = stamp_of == k
        offset = outer[point[own]] - (stamp.centre + 0.5 * walls[k] * normals[k])
        for i, lateral in enumerate(lateral_vectors(stamp.axis)):
            arm[own, i] = offset @ lateral / stamp.radius
    height = np.einsum('gi,gi->g', axis, outer[point])
    element = np.searchsorted(shell.point_offsets, point, side='right') - 1
    cell = np.unique(element, return_inverse=True)[1].reshape(-1).astype(np.int64)
    tilts = np.array(
        [
            _least_lever(shell.weights[point], cell, arm, stamp_of == k) > LEAST_LEVER
            for k in range(len(stamps))
        ],
        dtype=bool,
    )
    arm[~tilts[stamp_of]] = 0.0
    return StampPoints(
        point.astype(np.int64), stamp_of, cell, axis, height, arm, normals, walls, tilts
    )


def _least_lever(weight: Array, cell: Index, arm: Array, own: NDArray[np.bool_]) -> float:
    """Least eigenvalue of the second moment of the cells' mean arms, over the radius squared."""
    weight, cell, arm = weight[own], cell[own], arm[own]
    area = np.bincount(cell, weight)
    moments = np.stack([np.bincount(cell, weight * a) for a in arm.T], axis=1)
    pressed = area > 0.0
    area, means = area[pressed], moments[pressed] / area[pressed, None]
    away = means - np.average(means, axis=0, weights=area)
    return float(np.linalg.eigvalsh((area * away.T) @ away / area.sum())[0])
