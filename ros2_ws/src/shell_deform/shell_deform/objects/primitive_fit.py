# SPDX-License-Identifier: Apache-2.0
"""Which primitive a scan shows, and how much of it: a sphere, a cylinder or a cone.

A scanner sees one side. A surface fitted to half a ball is a bowl, and solves as one; where a
primitive fits as well, it is the better object file.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from .scan_clean import CleanScan, boundary_loops

FloatArray = npt.NDArray[np.float64]

SAMPLE = 2000
"""Points that are fitted."""

LARGEST_RMS = 0.01
"""A primitive fits if its distance is below this share of the object's size."""

SIDE_SHARE = 0.6
"""... on at least this share of the area: flat ends do not lie on the side of a can."""

CONICAL = 0.02
"""A side whose radius changes by less than this share of it is that of a cylinder."""


@dataclass(frozen=True)
class PrimitiveFit:
    """A primitive that a scan shows.

    Attributes:
        surface: it as an object file writes it, lengths in m.
        rms_m: distance of the scan from it.
        missing: share of its area that the scan does not show.
    """

    surface: dict[str, dict[str, object]]
    rms_m: float
    missing: float

    @property
    def kind(self) -> str:
        """Its name."""
        return next(iter(self.surface))

    def sentence(self) -> str:
        """What to write into the object file, and why."""
        numbers = ', '.join(f'{key}: {value}' for key, value in self.surface[self.kind].items())
        shown = (
            f'{100.0 * self.missing:.0f} % of it is missing in the scan; '
            if (self.missing > 0.05)
            else ''
        )
        return (
            f'a {self.kind} fits the scan to {1e3 * self.rms_m:.2g} mm rms: {shown}'
            f'`surface: {{{self.kind}: {{{numbers}}}}}` describes it without a scan'
        )


def capped_share(scan: CleanScan) -> float:
    """Share of the shape, closed by flat lids, that the lids would be; 0 for a closed scan."""
    lids = 0.0
    for loop in boundary_loops(scan.triangles):
        rim = scan.vertices[loop]
        spokes = rim - rim.mean(axis=0)
        lids += 0.5 * float(
            np.linalg.norm(np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0))
        )
    area = float(_areas(scan)[0].sum())
    return lids / (lids + area) if area > 0.0 else 0.0


def fitting_primitive(scan: CleanScan) -> PrimitiveFit | None:
    """The simplest primitive that a scan of its outer face lies on; None if none fits."""
    area, normal = _areas(scan)
    centre = scan.vertices[scan.triangles].mean(axis=1)
    size = float(np.ptp(scan.vertices, axis=0).max())
    chosen = np.random.default_rng(0).permutation(len(centre))[:SAMPLE]
    points, normals, weight = centre[chosen], normal[chosen], area[chosen] / area[chosen].mean()
    total = float(area.sum())
    corners = scan.vertices[scan.triangles[chosen]]
    return _sphere(points, weight, size, total) or _side(corners, normals, weight, size, total)


def _areas(scan: CleanScan) -> tuple[FloatArray, FloatArray]:
    """(m,) areas [m^2] and (m, 3) unit normals of the triangles."""
    a, b, c = (scan.vertices[scan.triangles[:, k]] for k in range(3))
    vector = np.cross(b - a, c - a)
    length = np.linalg.norm(vector, axis=1)
    return 0.5 * length, vector / np.maximum(length, 1e-300)[:, None]


def _rms(residual: FloatArray, weight: FloatArray) -> float:
    return float(np.sqrt(np.average(residual**2, weights=weight)))


def _sphere(
    points: FloatArray, weight: FloatArray, size: float, area: float
) -> PrimitiveFit | None:
    system = np.column_stack([2.0 * points, np.ones(len(points))])
    found = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    start = np.append(found[:3], np.sqrt(max(found[3] + found[:3] @ found[:3], 1e-12)))

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(points - x[:3], axis=1) - x[3])

    x = least_squares(residual, start, loss='soft_l1', f_scale=0.003 * size).x
    rms, radius = _rms(residual(x), weight), float(x[3])
    # a nearly flat patch lies on any large sphere
    if rms > LARGEST_RMS * size or radius > size:
        return None
    missing = max(0.0, 1.0 - area / (4.0 * np.pi * radius**2))
    return PrimitiveFit({'sphere': {'outer_diameter_m': _rounded(2.0 * radius)}}, rms, missing)


def _side(
    corners: FloatArray, normals: FloatArray, weight: FloatArray, size: float, area: float
) -> PrimitiveFit | None:
    """A cylinder or cone whose side the scan shows, with or without its ends."""
    points = corners.mean(axis=1)
    side = np.ones(len(points), dtype=bool)
    x = None
    for _ in range(3):
        if weight[side].sum() < SIDE_SHARE * weight.sum() or side.sum() < 20:
            return None
        x = _fitted_side(points[side], normals[side], weight[side], size)
        distance = np.abs(_side_residual(x, points))
        axis, _ = _frame(x)
        flat = np.abs(normals @ axis) > 0.7
        side = (distance < 3.0 * LARGEST_RMS * size) & ~flat
    assert x is not None
    if not side.any() or weight[side].sum() < SIDE_SHARE * weight.sum():
        return None
    rms = _rms(_side_residual(x, points[side]), weight[side])
    axis, origin = _frame(x)
    # centres of triangles end half a triangle before the rim
    height = (corners[side] - origin) @ axis
    low = float(np.quantile(height.min(axis=1), 0.005))
    high = float(np.quantile(height.max(axis=1), 0.995))
    radii = x[4] + x[5] * np.array([low, high])
    if rms > LARGEST_RMS * size or radii.min() <= 0.0 or radii.max() > size:
        return None
    length = high - low
    whole = np.pi * float(radii.sum()) * length * float(np.hypot(1.0, x[5]))
    shown = area * float(weight[side].sum() / weight.sum())
    missing = max(0.0, 1.0 - shown / whole)
    if abs(radii[1] - radii[0]) < CONICAL * radii.mean():
        closed = float(weight[~side].sum()) > 0.05 * float(weight.sum())
        surface: dict[str, object] = {
            'outer_diameter_m': _rounded(float(radii.sum())),
            'length_m': _rounded(length),
            'ends': 'closed' if closed else 'open',
        }
        return PrimitiveFit({'cylinder': surface}, rms, missing)
    diameters = [_rounded(2.0 * float(radius)) for radius in sorted(radii)]
    return PrimitiveFit(
        {'cone': {'outer_diameters_m': diameters, 'length_m': _rounded(length)}}, rms, missing
    )


def _fitted_side(
    points: FloatArray, normals: FloatArray, weight: FloatArray, size: float
) -> FloatArray:
    """(6,): axis direction (two angles), a point on it (two coordinates), radius, its slope."""
    # the normals of a cone make one angle with its axis: they lie in a plane
    mean = np.average(normals, axis=0, weights=weight)
    spread = (weight[:, None] * (normals - mean)).T @ (normals - mean)
    axis = np.linalg.eigh(spread)[1][:, 0]
    angles = np.array([np.arccos(np.clip(axis[2], -1.0, 1.0)), np.arctan2(axis[1], axis[0])])
    start = np.concatenate([angles, [0.0, 0.0, 0.4 * size, 0.0]])
    middle = points.mean(axis=0)
    across = _across(start)
    flat = (points - middle) @ across.T
    system = np.column_stack([2.0 * flat, np.ones(len(flat))])
    circle = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    start[2:4] = across @ middle + circle[:2]
    start[4] = np.sqrt(max(circle[2] + circle[:2] @ circle[:2], 1e-12))
    return np.asarray(
        least_squares(
            lambda x: _side_residual(x, points), start, loss='soft_l1', f_scale=0.003 * size,
            x_scale=[0.1, 0.1, size, size, size, 0.1],
        ).x
    )  # fmt: skip


def _frame(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit axis (3,) and the point (3,) on it that is nearest to the origin."""
    theta, phi = x[:2]
    axis = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    return axis, x[2:4] @ _across(x)


def _across(x: FloatArray) -> FloatArray:
    """(2, 3) unit vectors across the axis."""
    theta, phi = x[:2]
    first = np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)])
    return np.array([first, [-np.sin(phi), np.cos(phi), 0.0]])


def _side_residual(x: FloatArray, points: FloatArray) -> FloatArray:
    axis, origin = _frame(x)
    offset = points - origin
    height = offset @ axis
    radius = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    return np.asarray((radius - x[4] - x[5] * height) / np.hypot(1.0, x[5]))


def _rounded(length: float) -> float:
    """To a hundredth of a millimetre."""
    return round(length, 5)
