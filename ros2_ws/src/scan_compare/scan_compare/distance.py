# SPDX-License-Identifier: Apache-2.0
"""Signed distances between scan points and the smooth outer face, in both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from scan_compare.deformed_surface import DeformedSurface


@dataclass(frozen=True)
class Distances:
    """Feet of scan points on the outer face.

    triangle (n,), parameters (n, 2): where the foot lies; foot, normal (n, 3) [m]; distance (n,)
    signed, positive outside [m]; beyond_edge (n,): the point lies beyond the edge of an open
    surface, its distance is not one along the normal; displacement (n,): of the limit surface
    at the foot [m], interpolated between the control vertices.
    """

    triangle: np.ndarray
    parameters: np.ndarray
    foot: np.ndarray
    normal: np.ndarray
    distance: np.ndarray
    beyond_edge: np.ndarray
    displacement: np.ndarray


Seeds = tuple[np.ndarray, np.ndarray]


def measure(surface: DeformedSurface, points: np.ndarray, seeds: Seeds | None = None) -> Distances:
    """Project `points` (n, 3) [m] onto the deformed outer face of `surface`.

    seeds: triangle (n,) and parameters (n, 2) of an earlier answer for nearby points.
    """
    closest = surface.limit.closest_point(surface.deformed, points, surface.offset, seeds=seeds)
    return Distances(
        closest.triangle,
        closest.parameters,
        closest.position,
        closest.normal,
        closest.distance,
        closest.on_boundary,
        np.linalg.norm(
            displacement_vectors(surface, closest.triangle, closest.parameters), axis=1
        ),
    )


def displacement_vectors(
    surface: DeformedSurface, triangle: np.ndarray, parameters: np.ndarray
) -> np.ndarray:
    """Return displacements (n, 3) [m] at points of the limit surface.

    Exact at the control vertices and linear between them: enough to tell the dent region, and a
    hundred times cheaper than two evaluations of the limit surface.
    """
    at_vertices = surface.limit.limit_matrix @ (surface.deformed - surface.rest)
    u, v = parameters[:, :1], parameters[:, 1:]
    corners = surface.mesh.triangles[triangle]
    return (
        (1.0 - u - v) * at_vertices[corners[:, 0]]
        + u * at_vertices[corners[:, 1]]
        + v * at_vertices[corners[:, 2]]
    )


@dataclass(frozen=True)
class Coverage:
    """Which part of the model the scan saw, and the distances seen from the model.

    reach_m: a sample of the model counts as seen if a scan point lies within this distance of
    its foot along the surface; patch, dent, contact: seen share of the area of the outer face,
    of its dent region, and within 5 mm of the contacts (None where there is none);
    model_to_scan (k,): signed distances from seen samples to the nearest scan point along the
    model's normal [m]; model_area (k,): area each stands for [m^2].
    """

    reach_m: float
    patch: float
    dent: float | None
    contact: float | None
    model_to_scan: np.ndarray
    model_area: np.ndarray


CONTACT_NEIGHBOURHOOD = 5e-3
"""Coverage is also given within this distance [m] of each contact."""

COVERAGE_POINTS = 150_000
"""Coverage is judged from at most this many scan points: they lie closer than the reach."""

SMALLEST_REACH = 0.5e-3
"""A scan point speaks for at least this neighbourhood [m] of the model."""


def coverage(
    surface: DeformedSurface,
    distances: Distances,
    used: np.ndarray,
    contacts: np.ndarray,
) -> Coverage:
    """Find which samples of the model have a scan point's foot near them.

    used (n,): which scan points count; contacts (c, 3): contact points on the outer face [m],
    may be empty. Feet are compared, not the points themselves: an error of the model hides
    nothing. The reach is three times the median spacing of the feet, at least SMALLEST_REACH.
    """
    samples = surface.samples
    chosen = np.flatnonzero(used)
    if len(chosen) > COVERAGE_POINTS:
        order = np.random.default_rng(0).permutation(len(chosen))
        chosen = chosen[order[:COVERAGE_POINTS]]
    feet = distances.foot[chosen]
    total = float(samples.area.sum())
    if len(feet) == 0:
        return Coverage(SMALLEST_REACH, 0.0, None, None, np.empty(0), np.empty(0))
    reach = max(SMALLEST_REACH, 3.0 * _spacing(feet))
    gap, nearest = cKDTree(feet).query(samples.position, distance_upper_bound=reach)
    seen = np.isfinite(gap)
    dent = samples.displacement > surface.dent_threshold
    near = np.zeros(len(seen), bool)
    for contact in contacts:
        near |= np.linalg.norm(samples.position - contact, axis=1) < CONTACT_NEIGHBOURHOOD
    return Coverage(
        reach_m=reach,
        patch=float(samples.area[seen].sum() / total),
        dent=_share(samples.area, seen, dent),
        contact=_share(samples.area, seen, near),
        model_to_scan=distances.distance[chosen[nearest[seen]]],
        model_area=samples.area[seen],
    )


def _share(area: np.ndarray, seen: np.ndarray, region: np.ndarray) -> float | None:
    if not region.any():
        return None
    return float(area[seen & region].sum() / area[region].sum())


def _spacing(points: np.ndarray) -> float:
    """Return the median distance [m] to the nearest neighbour, from at most 2000 points."""
    step = max(1, len(points) // 2000)
    if len(points) < 2:
        return 0.0
    gap, _ = cKDTree(points).query(points[::step], k=2)
    return float(np.median(gap[:, 1]))
