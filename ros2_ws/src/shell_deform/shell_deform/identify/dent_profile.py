# SPDX-License-Identifier: Apache-2.0
"""Wall thickness from the shape of scanned dents.

A dent is as wide as sqrt(R h) while its force goes as E h^2.5: its shape fixes the thickness,
which forces and displacements alone cannot. Per contact and scan, the mean distance of the scan
from the model's outer face is taken in rings about the contact; the thickness that levels all
rings is found by least squares. Two things of each dent are left free: its depth, since material
sheared and squeezed by the pin moves the pin but not the shell around it, and, within the
registration's uncertainty, its level. Rings nearer than two walls are left out for that reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import OptimizeResult, least_squares

from shell_deform.identify.force_curve import ForceCurve, IdentificationError
from shell_deform.objects.shell_object import MeshFile, ShellObject

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Two-sided 90 % of a normal distribution.
NINETY_PERCENT = 1.6448536269514722
# Rings reach from two walls to this multiple of sqrt(R h), where a dent has faded.
REACH, WALLS_LEFT_OUT, RINGS = 2.2, 2.0, 7
# Errors of a scanner are alike over about this length [m].
ALIKE = 5e-3
RING_POINTS, FEWEST_RINGS, DENT_POINTS = 20, 4, 4000
# What remains between the fitted shell and a solid, as a share of the depth.
MODEL_SHARE = 0.003
# Depths of the model around those measured, and the share of these at which rings are computed.
SHALLOWEST, DEEPEST = 0.55, 1.15
FEW_DEPTHS, MANY_DEPTHS = 5, 9
# Thickness: relative first step, longest step and accuracy of ln h, tries, widest change.
FIRST_STEP, LONGEST_STEP, TOLERANCE, TRIES, WIDEST = 0.08, 0.25, 0.01, 7, 1.2
# Rings are laid anew where ln h moved by more than this, so often.
NEAR, ROUNDS = 0.1, 3
# Points further from the first model than this share of the depth are on something else.
ELSEWHERE = 0.5
# Rings that stay further off than this share of the depth belong to no dent of this object.
MISFIT = 0.05


def interval_above_zero(value: float, sigma: float) -> tuple[float, float]:
    """90 % interval of a quantity that is fitted as its logarithm."""
    factor = float(np.exp(NINETY_PERCENT * sigma / value))
    return value / factor, value * factor


@dataclass(frozen=True)
class DentScan:
    """A scan (n, 3) [m] of the squeezed object in the object's frame.

    name: what messages call it. displacement: of each contact while it was taken [m].
    """

    name: str
    points: Array
    displacement: float


@dataclass(frozen=True)
class ThicknessFit:
    """What the dents say.

    Attributes:
        thickness, sigma: of the thin shell whose dents these are [m].
        solid_thickness, solid_sigma: of the wall itself, if it is a solid [m]: the wall of a
            solid shears, which narrows the dent as a thinner shell would.
        depth: (k,) depth of each dent that the rings ask for [m].
        rms: of what remains between rings and model [m]. reduced_chi_square: near 1 when noise
            and model explain it; above, it has widened `sigma`.
    """

    thickness: float
    sigma: float
    solid_thickness: float
    solid_sigma: float
    depth: Array
    rms: float
    reduced_chi_square: float

    @property
    def solid_interval(self) -> tuple[float, float]:
        """90 % interval of the solid thickness [m]."""
        return interval_above_zero(self.solid_thickness, self.solid_sigma)


@dataclass(frozen=True)
class _Dent:
    """Points (m, 3) around one contact, ring and sector (m,) of each; measured depth [m].

    width: of a ring [m].
    """

    name: str
    points: Array
    ring: Index
    sector: Index
    width: float
    displacement: float


def fit_thickness(
    curve: ForceCurve,
    scans: Sequence[DentScan],
    young: float,
    scanner_sigma: float,
    registration_sigma: float,
) -> ThicknessFit:
    """The thickness whose dents are those of the scans; the outer face at rest is taken as known.

    `young` [Pa] goes with the thickness of `curve`: another one is tried with the modulus of equal
    E h^2.5, which matters through the gas alone. `scanner_sigma` [m] of a point along the normal,
    `registration_sigma` [m] of a scan at a contact.

    Raises IdentificationError for objects of uneven thickness, scans that show no dent around a
    contact, and dents that are none of this object.
    """
    known = curve.shell_object
    if known.vertex_thickness_m is not None:
        raise IdentificationError(
            f'{known.name}: its thickness differs from place to place; only an even one is found'
        )
    if not scans:
        raise IdentificationError('no row names a scan; the thickness needs the shape of a dent')
    for _ in range(ROUNDS):
        found = _fit(curve, known, scans, young, scanner_sigma, registration_sigma)
        change = np.log(found.thickness / curve.shell_object.thickness_m)
        if abs(change) < NEAR:
            break
        # where the rings lie depends on the thickness
        young *= float(np.exp(-2.5 * change))
        curve = curve.with_thickness(found.thickness)
    return found


def _fit(
    curve: ForceCurve,
    known: ShellObject,
    scans: Sequence[DentScan],
    young: float,
    scanner_sigma: float,
    registration_sigma: float,
) -> ThicknessFit:
    """With rings where the thickness of `curve` wants them; `known` has the outer face at rest."""
    first_guess = curve.shell_object.thickness_m
    dents = [dent for scan in scans for dent in _dents(curve, scan)]
    nodes = _depths(scans)

    def distances(log_ratio: float) -> list[Array]:
        other = curve
        if log_ratio:
            other = curve.with_thickness(first_guess * float(np.exp(log_ratio)))
        return _distances(other, known, dents, nodes, young * float(np.exp(-2.5 * log_ratio)))

    first = distances(0.0)
    rings = [_Rings(dent, nodes, d, scanner_sigma) for dent, d in zip(dents, first, strict=True)]

    def profiles(found: list[Array]) -> list[CubicSpline]:
        return [ring.means(nodes, values) for ring, values in zip(rings, found, strict=True)]

    at, table = [0.0, FIRST_STEP], [profiles(first), profiles(distances(FIRST_STEP))]
    for _ in range(TRIES):
        fit = _solve(rings, table, registration_sigma)
        _check(curve, rings, fit)
        change = at[1] - at[0]
        wanted = at[0] + change * float(fit.x[0])
        if abs(wanted - at[1]) < TOLERANCE:
            return _answer(curve, rings, fit, wanted, change)
        following = at[1] + float(np.clip(wanted - at[1], -LONGEST_STEP, LONGEST_STEP))
        if abs(following) > WIDEST:
            break
        at, table = [at[1], following], [table[1], profiles(distances(following))]
    raise IdentificationError(
        f'{_names(rings)}: no thickness near {1e3 * known.thickness_m:.3g} mm gives such dents; '
        'check the registration of the scans and the thickness in the object file'
    )


def _dents(curve: ForceCurve, scan: DentScan) -> list[_Dent]:
    """The scan's points around every contact that it shows."""
    h = curve.shell_object.thickness_m
    reach = REACH * h / np.sqrt(curve.thickness_over_radius)
    inner = max(WALLS_LEFT_OUT * h, 2.0 * curve.pin_radius)
    edges = np.linspace(inner, max(reach, 2.0 * inner), RINGS + 1)
    found = []
    for patch in curve.contacts:
        away = scan.points - patch.point
        along = away @ patch.axis
        first, second = patch.lateral
        across = np.stack([away @ first, away @ second])
        radius = np.hypot(*across)
        near = np.abs(along) < edges[-1]
        near &= (radius >= edges[0]) & (radius < edges[-1])
        chosen = np.flatnonzero(near)
        if len(chosen) < RINGS * RING_POINTS:
            continue
        chosen = chosen[:: max(1, len(chosen) // DENT_POINTS)]
        ring = np.searchsorted(edges, radius[chosen], side='right') - 1
        sectors = np.maximum(1, (np.pi * (edges[:-1] + edges[1:]) / ALIKE).astype(int))
        turn = np.arctan2(*across[:, chosen]) / (2.0 * np.pi) + 0.5
        sector = np.minimum((turn * sectors[ring]).astype(int), sectors[ring] - 1)
        width = float(edges[1] - edges[0])
        found.append(_Dent(scan.name, scan.points[chosen], ring, sector, width, scan.displacement))
    if not found:
        raise IdentificationError(
            f'{scan.name}: fewer than {RINGS * RING_POINTS} of its {len(scan.points)} points lie '
            f'{1e3 * edges[0]:.0f} to {1e3 * edges[-1]:.0f} mm from a contact of '
            f'{curve.shell_object.name}; give its unit, and register it to the frame of the object'
        )
    return found


def _depths(scans: Sequence[DentScan]) -> Array:
    """Depths [m] at which the model is solved."""
    measured = [scan.displacement for scan in scans]
    low, high = SHALLOWEST * min(measured), DEEPEST * max(measured)
    return np.linspace(low, high, FEW_DEPTHS if high < 3.0 * low else MANY_DEPTHS)


def _distances(
    curve: ForceCurve, known: ShellObject, dents: list[_Dent], nodes: Array, young: float
) -> list[Array]:
    """Per dent (d, m): distance of its points from the model's outer face at each depth [m]."""
    shape = known.surface
    # a mesh of the middle surface stays where it is, and so does the outer face in the scan
    fixed_middle = isinstance(shape, MeshFile) and shape.face != 'outer'
    thickness = (known if fixed_middle else curve.shell_object).thickness_m
    points = np.concatenate([dent.points for dent in dents])
    places = np.cumsum([len(dent.points) for dent in dents])[:-1]
    gauge = known.gas.gauge_pressure_pa
    states = curve.equilibria(nodes, young, gauge)
    faces, offset = curve.outer_faces(states, young, gauge, thickness)
    rows = [curve.surface.closest_point(face, points, offset).distance for face in faces]
    return np.split(np.stack(rows), places, axis=1)


class _Rings:
    """Mean distance of a dent's points in rings, and how well each is known."""

    def __init__(self, dent: _Dent, nodes: Array, distance: Array, scanner_sigma: float) -> None:
        self.name, self.displacement = dent.name, dent.displacement
        residual = CubicSpline(nodes, distance)(dent.displacement)
        far = max(ELSEWHERE * dent.displacement, 5.0 * scanner_sigma)
        self._members: list[Index] = []
        sigma = []
        for k in range(RINGS):
            # a finger or a pin in the scan is far from the model or from all the others
            inside = np.flatnonzero((dent.ring == k) & (np.abs(residual) < far))
            if len(inside) < RING_POINTS:
                continue
            off = np.abs(residual[inside] - np.median(residual[inside]))
            inside = inside[off <= 5.0 * max(1.4826 * float(np.median(off)), scanner_sigma)]
            self._members.append(inside)
            sigma.append(_mean_sigma(residual[inside], dent.sector[inside], scanner_sigma))
        if len(sigma) < FEWEST_RINGS:
            raise IdentificationError(
                f'{dent.name}: {len(sigma)} of {RINGS} rings around a contact hold {RING_POINTS} '
                f'points or more and {FEWEST_RINGS} are needed; give a denser scan, or one that '
                'sees the dent'
            )
        # neighbouring rings within the length over which errors are alike say the same
        alike = np.sqrt(max(1.0, ALIKE / dent.width))
        self.sigma = np.hypot(alike * np.array(sigma), MODEL_SHARE * dent.displacement)

    def means(self, nodes: Array, distance: Array) -> CubicSpline:
        """Mean distance of the rings (r,) [m] as a function of the model's depth [m]."""
        return CubicSpline(
            nodes, np.stack([distance[:, m].mean(axis=1) for m in self._members], axis=1)
        )


def _mean_sigma(residual: Array, sector: Index, scanner_sigma: float) -> float:
    """Standard deviation of a ring's mean [m]: noise of the points, or scatter of its sectors."""
    floor = scanner_sigma / np.sqrt(len(residual))
    count = np.bincount(sector)
    seen = count > 0
    if np.count_nonzero(seen) < 3:
        return scanner_sigma
    mean = np.bincount(sector, residual)[seen] / count[seen]
    return float(max(floor, np.std(mean, ddof=1) / np.sqrt(len(mean))))


def _solve(
    rings: list[_Rings], table: list[list[CubicSpline]], registration_sigma: float
) -> OptimizeResult:
    """Least squares with rings that are linear in ln h between two thicknesses.

    Unknown (1 + 2 k,): the place between the two, then each dent's relative depth, and its level
    in units of the registration's sigma.
    """
    k = len(rings)

    def residual(unknown: Array) -> Array:
        place, level = unknown[0], unknown[1 + k :]
        parts = [level]
        for i, ring in enumerate(rings):
            w = float(unknown[1 + i]) * ring.displacement
            mean = (1.0 - place) * table[0][i](w) + place * table[1][i](w)
            parts.append((mean - registration_sigma * level[i]) / ring.sigma)
        return np.concatenate(parts)

    start = np.concatenate([[0.0], np.full(k, 0.95), np.zeros(k)])
    low = np.concatenate([[-np.inf], np.full(k, SHALLOWEST), np.full(k, -np.inf)])
    high = np.concatenate([[np.inf], np.full(k, DEEPEST), np.full(k, np.inf)])
    return least_squares(residual, start, jac='3-point', x_scale='jac', bounds=(low, high))


def _check(curve: ForceCurve, rings: list[_Rings], fit: OptimizeResult) -> None:
    """Raise IdentificationError for a dent whose depth or form is none of this object."""
    k, place = len(rings), len(rings)
    for i, ring in enumerate(rings):
        left = fit.fun[place : place + len(ring.sigma)] * ring.sigma
        place += len(ring.sigma)
        rms = float(np.sqrt(np.mean(left**2)))
        if rms > MISFIT * ring.displacement or fit.active_mask[1 : 1 + k][i]:
            raise IdentificationError(
                f'{ring.name}: no dent {1e3 * ring.displacement:.3g} mm deep in '
                f'{curve.shell_object.name} looks like that (rings differ by {1e3 * rms:.2g} mm '
                'rms); check the registration of the scan, and that it was taken at the '
                'displacement of its row'
            )


def _answer(
    curve: ForceCurve, rings: list[_Rings], fit: OptimizeResult, log_ratio: float, change: float
) -> ThicknessFit:
    k = len(rings)
    weight = np.concatenate([ring.sigma for ring in rings])
    depth = fit.x[1 : 1 + k] * np.array([ring.displacement for ring in rings])
    chi_square = float(2.0 * fit.cost / max(1, len(weight) - 1 - k))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)
    relative = abs(change) * float(np.sqrt(covariance[0, 0] * max(1.0, chi_square)))
    h = curve.shell_object.thickness_m * float(np.exp(log_ratio))
    excess = curve.excess_stiffness
    return ThicknessFit(
        thickness=h,
        sigma=h * relative,
        # anything between none and all of the excess, as for the modulus
        solid_thickness=h * (1.0 + 0.5 * excess),
        solid_sigma=h * float(np.hypot(relative, excess / np.sqrt(12.0))),
        depth=depth,
        rms=float(np.sqrt(np.mean((fit.fun[k:] * weight) ** 2))),
        reduced_chi_square=chi_square,
    )


def _names(rings: list[_Rings]) -> str:
    return ', '.join(dict.fromkeys(ring.name for ring in rings))
