# SPDX-License-Identifier: Apache-2.0
"""From a scan of the undeformed object to its control mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ..surface.control_mesh import ControlMesh, MeshError, control_mesh
from ..surface.limit import LimitSurface
from ..surface.scan_fit import ScanFit, fit_scan
from ..theory.thin_wall import thick_wall_warning, thickness_over_radius
from .drawn import with_small_triangles
from .file_mesh import LimitTarget
from .remesh import decimated, even_mesh, smoothed
from .scan_clean import CleanScan, boundary_loops, clean_scan
from .shell_object import ObjectError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

DETAIL = 30_000
"""Vertices to which a larger scan is brought down before it is remeshed."""

SMOOTHINGS = 10
HOLE_SHARE = 0.5
"""A rim shorter than that share of the object's size counts as a hole of the scan."""

SPACING, LARGE_SHARE, MOST_TRIANGLES = 1.0, 0.05, 100_000
"""Where more than that share of a scan lies in triangles with edges above the first, in edges of
the control mesh, all are divided, up to so many."""

VERTEX_STEPS = (160, 320, 640, 1280, 2560, 5120, 10_240)
"""Numbers of control vertices that are tried to reach a wanted error."""


@dataclass(frozen=True)
class PreparedScan:
    """A scan made into a control mesh.

    Attributes:
        fit: the control mesh and its distances from the scan.
        points: (q, 3) scan points that were fitted [m].
        scan: the scan smoothed and thinned, with its holes.
        report: what was found and done, by name.
        slenderness: thickness over the smallest radius of curvature (95 % of the surface is
            less curved).
    """

    fit: ScanFit
    points: FloatArray
    scan: CleanScan
    report: dict[str, int]
    slenderness: float

    def warnings(self) -> list[str]:
        """What the user should know about the object."""
        found = []
        wall = thick_wall_warning(self.slenderness)
        if wall is not None:
            found.append(wall)
        lost = 1.0 - float(self.fit.counted.mean())
        if lost > 0.02:
            found.append(
                f'{100 * lost:.1f} % of the scan points lie off the fitted surface and were not '
                'counted'
            )
        return found


@dataclass(frozen=True)
class Refinement:
    """Where a mesh is finer than elsewhere.

    Attributes:
        places: (k, 3) [m]. edge: wanted edge length there [m], told by the surface fitted so far.
        around: whether also around them, see `with_small_triangles`.
    """

    places: FloatArray
    edge: Callable[[LimitTarget], float]
    around: bool = False


def prepare(
    vertices: FloatArray,
    triangles: IntArray,
    thickness: float | FloatArray,
    *,
    face: str = 'outer',
    control_vertices: int = 640,
    error: float | None = None,
    longest_rim: float | None = None,
    refinement: Refinement | None = None,
) -> PreparedScan:
    """Clean, orient, remesh and fit a scan.

    Args:
        vertices: (n, 3) scan points [m]. triangles: (m, 3).
        thickness: wall [m]: one number, or samples (k, 4) of x, y, z, thickness.
        face: 'outer' or 'middle': what was scanned.
        control_vertices: about how many control vertices to use.
        error: instead, use as many as bring the systematic part of the distance below this [m].
        longest_rim: holes with a rim up to this are closed [m] (default: half the object's size).
        refinement: where the mesh is to be fine.

    Raises:
        ObjectError: the scan cannot carry a surface, the wall is too thick for one, or the
            wanted error is not reached.
    """
    first = _dense(clean_scan(vertices, triangles, split_fans=False), control_vertices)
    report = dict(first.report)
    coarse = decimated(
        smoothed(first.vertices, first.triangles, SMOOTHINGS), first.triangles, DETAIL
    )
    scan = clean_scan(*coarse)
    size = float(np.ptp(scan.vertices, axis=0).max())
    rim_limit = HOLE_SHARE * size if longest_rim is None else longest_rim
    counts = [control_vertices] if error is None else list(VERTEX_STEPS)
    result = None
    for count in counts:
        even = even_mesh(scan, count, rim_limit)
        report['holes_closed'] = even.holes_closed
        try:
            mesh = control_mesh(even.vertices, even.triangles)
        except MeshError as problem:
            message = f'the remeshed scan cannot carry a surface: {problem}'
            raise ObjectError(message) from problem
        if refinement is not None and len(refinement.places):
            # Triangles through scan points are as rough as these: how round a place is and where
            # vertices go is told by a surface that is fitted to the scan.
            smooth = LimitTarget(fit_scan(mesh, first.vertices, np.empty((0, 3)), 0.0).mesh)
            mesh = with_small_triangles(
                mesh, smooth, refinement.places, refinement.edge(smooth), around=refinement.around
            )
        result = _fitted(first, scan, mesh, thickness, face, rim_limit)
        if error is not None and result.systematic_m <= error:
            break
    assert result is not None
    if error is not None and result.systematic_m > error:
        raise ObjectError(
            f'{counts[-1]} control vertices leave a systematic error of '
            f'{result.systematic_m:.3g} m; the wanted {error:.3g} m is not reached: smooth the '
            'scan or ask for less'
        )
    wall = _vertex_walls(result.mesh.vertices, thickness)
    slenderness = _slenderness(result.mesh, wall)
    _refuse_folds(slenderness, wall)
    return PreparedScan(result, first.vertices, scan, report, slenderness)


def _dense(scan: CleanScan, count: int) -> CleanScan:
    """A scan whose triangles are smaller than those of `count` control vertices will be.

    A drawn or decimated mesh has vertices at its edges only: nothing would hold the fit between.
    """
    import trimesh

    vertices, triangles = scan.vertices, scan.triangles
    area = trimesh.triangles.area(vertices[triangles])
    longest = SPACING * float(np.sqrt(area.sum() / count))
    while len(triangles) < MOST_TRIANGLES:
        corners = vertices[triangles]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        area = trimesh.triangles.area(corners)
        if float(area[edges.max(axis=1) > longest].sum()) < LARGE_SHARE * float(area.sum()):
            break
        vertices, triangles = trimesh.remesh.subdivide(vertices, triangles)
    return CleanScan(vertices, triangles, scan.report)


def _refuse_folds(share: float, wall: FloatArray) -> None:
    if share >= 1.0:
        raise ObjectError(
            f'a wall of {1e3 * float(wall.max()):.3g} mm is thicker than the object is round: no '
            'shell; check the unit of the scan and the thickness'
        )


def _fitted(
    first: CleanScan,
    scan: CleanScan,
    mesh: ControlMesh,
    thickness: float | FloatArray,
    face: str,
    longest_rim: float,
) -> ScanFit:
    wall = _vertex_walls(mesh.vertices, thickness)
    if face == 'outer':
        # moved in by half the wall, a surface bent tighter than that would fold
        _refuse_folds(0.5 * _slenderness(mesh, wall), wall)
    half_wall = 0.5 * wall if face == 'outer' else 0.0 * wall
    rims = [
        scan.vertices[loop]
        for loop in boundary_loops(scan.triangles)
        if _perimeter(scan.vertices[loop]) > longest_rim
    ]
    rim = np.concatenate(rims) if rims else np.empty((0, 3))
    return fit_scan(mesh, first.vertices, rim, half_wall)


def _perimeter(loop: FloatArray) -> float:
    return float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())


def _vertex_walls(places: FloatArray, thickness: float | FloatArray) -> FloatArray:
    """(n,) thickness at each place: constant, or from the four nearest samples by distance."""
    if np.ndim(thickness) == 0:
        return np.full(len(places), float(thickness))
    samples = np.asarray(thickness, dtype=np.float64)
    distance, near = cKDTree(samples[:, :3]).query(places, k=min(4, len(samples)))
    distance, near = distance.reshape(len(places), -1), near.reshape(len(places), -1)
    weight = 1.0 / np.maximum(distance, 1e-9)
    return (weight * samples[near, 3]).sum(axis=1) / weight.sum(axis=1)


def vertex_thickness(mesh: ControlMesh, thickness: float | FloatArray) -> FloatArray | None:
    """(n,) thickness at each control vertex, None if it is the same everywhere."""
    return None if np.ndim(thickness) == 0 else _vertex_walls(mesh.vertices, thickness)


def _slenderness(mesh: ControlMesh, wall: FloatArray) -> float:
    triangle = np.arange(mesh.triangle_count)
    middle = np.full((len(triangle), 2), 1.0 / 3.0)
    mean, gauss = LimitSurface(mesh).evaluate(mesh.vertices, triangle, middle).curvatures()
    return thickness_over_radius(mean, gauss, wall[mesh.triangles].mean(axis=1))
