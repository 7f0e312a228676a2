# SPDX-License-Identifier: Apache-2.0
"""One scan against one deformed surface: registration, distances and every statistic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.dent import FIT_RADIUS, Contacts, DentProfile, contacts_of, profiles
from scan_compare.distance import Coverage, Distances, coverage, measure
from scan_compare.registration import (
    SAMPLE,
    SCANNER_SIGMA,
    Registration,
    RegistrationError,
    register,
    thin,
)
from scan_compare.rigid import IDENTITY, Pose
from scan_compare.scan import Scan
from scan_compare.statistics import (
    LocalMeans,
    Summary,
    local_means,
    mean_unsigned_noise,
    summarise,
)
from scan_compare.uncertainty import mean_error_sigma, merging_sigma, pose_sigma

OUTLIER_SHARE = 0.25
"""Scan points further from the surface than this share of its extent are no part of it."""

OFFSET_FLOORS = 3.0
"""An undeformed region that lies this many noise floors off on average is another object's."""

Progress = Callable[[str], None]


class ComparisonError(ValueError):
    """A scan and a surface that cannot be compared; the message says why."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything a comparison found; `to_json` gives it in the words of the contract.

    points (n, 3): scan points in the object's frame [m]; used (n,): which of them count (neither
    outliers nor beside an open surface); distances: of all of them; in_dent (n,). Scalars in
    metres; None where the scan gives no answer. merging_sigma_m: how far the merging of views
    moves a neighbourhood as wide as a dent's fit.
    """

    source: str
    points: np.ndarray
    triangles: np.ndarray | None
    used: np.ndarray
    in_dent: np.ndarray
    distances: Distances
    surface: DeformedSurface
    registration: Registration
    undeformed_registration: Registration | None
    undeformed_points: np.ndarray | None
    vertex: Summary
    area: Summary | None
    dent: Summary | None
    outside: Summary | None
    dent_area: Summary | None
    outside_area: Summary | None
    local: LocalMeans
    coverage: Coverage
    model_to_scan: Summary | None
    profiles: tuple[DentProfile, ...]
    scanner_sigma_m: float
    noise_floor_m: float
    mean_error_sigma_m: float
    mean_error_noise_free_m: float
    merging_sigma_m: float | None
    max_error_m: float | None
    dent_max_error_m: float | None
    outside_max_error_m: float | None
    outliers: int
    beyond_edge: int
    notes: tuple[str, ...]

    @property
    def deepest(self) -> DentProfile | None:
        """The profile of the largest measured depth; None without any."""
        return max(self.profiles, key=lambda profile: profile.apex_m, default=None)

    @property
    def measured_max_displacement_m(self) -> float | None:
        """Largest measured depth at a contact [m]; None without a profile."""
        return None if self.deepest is None else self.deepest.apex_m

    @property
    def measured_max_displacement_sigma_m(self) -> float | None:
        """Its standard deviation [m]."""
        return None if self.deepest is None else self.deepest.apex_sigma_m

    @property
    def undeformed_residual_m(self) -> float | None:
        """Mean unsigned distance of the undeformed region [m]: the floor this scan shows."""
        return None if self.outside is None else self.outside.mean_m

    @property
    def beyond_noise(self) -> bool:
        """Whether the mean error stands out of the scanner's noise.

        It must exceed the floor by a tenth (what one may expect of the stated sigma) and by
        three standard deviations.
        """
        excess = self.vertex.mean_m - self.noise_floor_m
        return excess > max(0.1 * self.noise_floor_m, 3.0 * self.mean_error_sigma_m)

    def to_json(self) -> dict[str, object]:
        """Return the statistics as plain numbers, strings, lists and dictionaries."""
        measured = self.measured_max_displacement_m
        return {
            'scan': self.source,
            'mean_error_m': self.vertex.mean_m,
            'rms_error_m': self.vertex.rms_m,
            'median_error_m': self.vertex.median_m,
            'p95_error_m': self.vertex.p95_m,
            'max_error_m': self.max_error_m,
            'raw_max_error_m': self.vertex.max_m,
            'max_error_disc_radius_m': self.local.radius_m,
            'signed_mean_error_m': self.vertex.signed_mean_m,
            'mean_error_sigma_m': self.mean_error_sigma_m,
            'mean_error_noise_free_m': self.mean_error_noise_free_m,
            'dent_mean_error_m': None if self.dent is None else self.dent.mean_m,
            'max_displacement_m': self.surface.max_displacement,
            'measured_max_displacement_m': measured,
            'measured_max_displacement_sigma_m': self.measured_max_displacement_sigma_m,
            'mean_error_of_max_displacement': (
                None if not measured else self.vertex.mean_m / measured
            ),
            'noise_floor_m': self.noise_floor_m,
            'scanner_sigma_m': self.scanner_sigma_m,
            'undeformed_residual_m': self.undeformed_residual_m,
            'merging_sigma_m': self.merging_sigma_m,
            'beyond_noise': self.beyond_noise,
            'area_weighted': _summary_json(self.area),
            'dent': _summary_json(self.dent),
            'dent_area_weighted': _summary_json(self.dent_area),
            'dent_max_error_m': self.dent_max_error_m,
            'outside_dent': _summary_json(self.outside),
            'outside_dent_area_weighted': _summary_json(self.outside_area),
            'outside_dent_max_error_m': self.outside_max_error_m,
            'model_to_scan': _summary_json(self.model_to_scan),
            'coverage': {
                'patch': self.coverage.patch,
                'dent': self.coverage.dent,
                'contact_5mm': self.coverage.contact,
                'reach_m': self.coverage.reach_m,
            },
            'points': int(len(self.points)),
            'points_used': int(np.count_nonzero(self.used)),
            'points_outlying': self.outliers,
            'points_beside': self.beyond_edge,
            'registration': registration_json(self.registration),
            'undeformed_registration': (
                None
                if self.undeformed_registration is None
                else registration_json(self.undeformed_registration)
            ),
            'profiles': [_profile_json(profile) for profile in self.profiles],
            'notes': list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class Setup:
    """What is known of a scan before it is compared; all of it may be left out.

    Attributes:
        scanner_sigma_m: noise of one scan point along the surface normal [m].
        start: pose of the scan to start from; None searches all rotations.
        start_contacts: (c, 3) points in the object's frame that it was made from [m].
        mask: (n,) points of the undeformed region, found automatically if None.
        contacts: on the outer face at rest, found from the model if None.
        registration: this pose is used instead of finding one.
        outlier_m: distance beyond which a point is no part of the object [m]; None: a quarter of
            its extent.
    """

    scanner_sigma_m: float = SCANNER_SIGMA
    start: Pose | None = IDENTITY
    start_contacts: np.ndarray | None = None
    mask: np.ndarray | None = None
    contacts: Contacts | None = None
    registration: Registration | None = None
    outlier_m: float | None = None


def compare(
    scan: Scan,
    surface: DeformedSurface,
    undeformed_scan: Scan | None = None,
    setup: Setup | None = None,
    progress: Progress = lambda _: None,
) -> Comparison:
    """Compare a scan with the deformed outer face of a shell.

    `undeformed_scan`: of the same object before it was squeezed, from the same place of the
    scanner. Raises RegistrationError or ComparisonError.
    """
    setup = setup or Setup()
    sigma = setup.scanner_sigma_m
    if len(scan.points) == 0:
        raise ComparisonError(f'{scan.source}: the scan has no points; scan the object again')
    if not np.all(np.isfinite(scan.points)):
        raise ComparisonError(f'{scan.source}: the scan has points that are not finite')
    progress('registration')
    found = setup.registration or _registered(
        scan, surface, sigma, start=setup.start, mask=setup.mask, contacts=setup.start_contacts
    )
    points = found.pose.apply(scan.points)
    progress('distances')
    distances = measure(surface, points)
    limit = OUTLIER_SHARE * surface.extent if setup.outlier_m is None else setup.outlier_m
    outlying = np.abs(distances.distance) > limit
    used = ~outlying & ~distances.beyond_edge
    if not used.any():
        raise ComparisonError(
            f'{scan.source}: no scan point lies within {1e3 * limit:.3g} mm of the surface; '
            'check unit, object and start pose'
        )
    progress('statistics')
    undeformed, undeformed_points = _undeformed(undeformed_scan, surface, found.pose, sigma)
    in_dent = distances.displacement > surface.dent_threshold
    merged = _merging_sigma(surface, distances, used & ~in_dent, undeformed_points)
    means = local_means(points[used], distances.distance[used])
    if means is None:
        raise ComparisonError(f'{scan.source}: no points to average')
    contacts = contacts_of(surface) if setup.contacts is None else setup.contacts
    seen = coverage(surface, distances, used, _deformed_contacts(surface, contacts))

    def depth_sigma(point: np.ndarray, direction: np.ndarray) -> float:
        return float(np.hypot(merged or 0.0, pose_sigma((found, undeformed), point, direction)))

    largest = means.largest(means.quotable)
    disc_in_dent = means.share(in_dent[used]) > 0.5
    value, areas = distances.distance[used], _areas(scan, surface, distances, used)
    summaries = _summaries(value, areas, in_dent[used])
    floor = mean_unsigned_noise(sigma)
    return Comparison(
        source=scan.source,
        points=points,
        triangles=scan.triangles,
        used=used,
        in_dent=in_dent,
        distances=distances,
        surface=surface,
        registration=found,
        undeformed_registration=undeformed,
        undeformed_points=undeformed_points,
        vertex=_required(summarise(value)),
        **summaries,
        local=means,
        coverage=seen,
        model_to_scan=summarise(seen.model_to_scan, seen.model_area),
        profiles=tuple(profiles(points[used], surface, contacts, undeformed_points, depth_sigma)),
        scanner_sigma_m=sigma,
        noise_floor_m=floor,
        mean_error_sigma_m=mean_error_sigma(distances, used, found, scan.view),
        mean_error_noise_free_m=_noise_free_mean(means, sigma),
        merging_sigma_m=merged,
        max_error_m=largest,
        dent_max_error_m=means.largest(means.quotable & disc_in_dent),
        outside_max_error_m=means.largest(means.quotable & ~disc_in_dent),
        outliers=int(np.count_nonzero(outlying)),
        beyond_edge=int(np.count_nonzero(distances.beyond_edge & ~outlying)),
        notes=_notes(scan, found, summaries['outside'], floor, merged, largest),
    )


def _summaries(
    value: np.ndarray, areas: np.ndarray, dented: np.ndarray
) -> dict[str, Summary | None]:
    """Return the statistics of distances (k,) by area, and of those in the dent and outside."""
    return {
        'area': summarise(value, areas),
        'dent': summarise(value[dented]),
        'outside': summarise(value[~dented]),
        'dent_area': summarise(value[dented], areas[dented]),
        'outside_area': summarise(value[~dented], areas[~dented]),
    }


def _notes(
    scan: Scan,
    found: Registration,
    outside: Summary | None,
    floor: float,
    merged: float | None,
    largest: float | None,
) -> tuple[str, ...]:
    """Return what the reader of the numbers must know beside them."""
    notes = [*scan.notes, *found.doubts]
    if outside is not None and abs(outside.signed_mean_m) > OFFSET_FLOORS * floor:
        side = 'outside' if outside.signed_mean_m > 0.0 else 'inside'
        notes.append(
            f'the undeformed region lies {1e3 * abs(outside.signed_mean_m):.2f} mm {side} the '
            "model's outer face: check the object's size and thickness, and what was scanned"
        )
    if merged is None:
        notes.append(
            'too few undeformed places of 50 points: what the merging of views does to a depth is '
            'unknown, its sigma is a lower bound'
        )
    if largest is None:
        notes.append('no disc holds 50 points: no local maximum is quoted, see the raw maximum')
    return tuple(notes)


def _undeformed(
    scan: Scan | None, surface: DeformedSurface, start: Pose, sigma: float
) -> tuple[Registration | None, np.ndarray | None]:
    if scan is None:
        return None, None
    found = _registered(scan, surface.at_rest(), sigma, start=start)
    return found, found.pose.apply(scan.points)


def _merging_sigma(
    surface: DeformedSurface,
    distances: Distances,
    rigid: np.ndarray,
    undeformed: np.ndarray | None,
) -> float | None:
    """Return how far the merging of views moves a neighbourhood as wide as a dent's fit [m]."""
    return merging_sigma(
        distances.foot[rigid],
        distances.distance[rigid],
        None if undeformed is None else _at_rest(surface, undeformed),
        2.0 * FIT_RADIUS,
    )


def _at_rest(surface: DeformedSurface, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return feet (k, 3) and distances (k,) [m] of an undeformed scan, some of its points."""
    distances = measure(surface.at_rest(), points[thin(len(points), SAMPLE)])
    on_surface = ~distances.beyond_edge
    return distances.foot[on_surface], distances.distance[on_surface]


def _registered(
    scan: Scan,
    surface: DeformedSurface,
    sigma: float,
    *,
    start: Pose | None,
    mask: np.ndarray | None = None,
    contacts: np.ndarray | None = None,
) -> Registration:
    try:
        return register(
            scan.points,
            surface,
            start=start,
            mask=mask,
            scanner_sigma_m=sigma,
            contacts=contacts,
            views=scan.view,
        )
    except RegistrationError as error:
        raise RegistrationError(f'{scan.source}: {error}') from None


def _deformed_contacts(surface: DeformedSurface, contacts: Contacts) -> np.ndarray:
    """Return where contact points (c, 3) of the rest face lie on the deformed outer face [m]."""
    if len(contacts.point) == 0:
        return np.empty((0, 3))
    rest = surface.at_rest()
    foot = rest.limit.closest_point(rest.deformed, contacts.point, rest.offset)
    return surface.evaluate(foot.triangle, foot.parameters).position


def _areas(
    scan: Scan, surface: DeformedSurface, distances: Distances, used: np.ndarray
) -> np.ndarray:
    """Return the area (k,) [m^2] each used point stands for.

    A mesh brings its own; in a cloud the model's area of a control triangle is shared among the
    points whose feet lie on it.
    """
    own = scan.vertex_areas()
    if own is not None and own[used].sum() > 0.0:
        return own[used]
    samples = surface.samples
    n = surface.mesh.triangle_count
    triangle_area = np.bincount(samples.triangle, samples.area, minlength=n)
    triangle = distances.triangle[used]
    return triangle_area[triangle] / np.bincount(triangle, minlength=n)[triangle]


def _noise_free_mean(means: LocalMeans, sigma: float) -> float:
    """Return the mean unsigned distance [m] without the part that scanner noise adds to it.

    Mean |local mean| over discs, weighted by the points of their centre cells; the noise left in
    a disc of k points, sigma / sqrt(k), is taken out of the squares.
    """
    weight = np.bincount(means.cell, minlength=len(means.mean))
    squared = np.maximum(0.0, means.mean**2 - sigma**2 / means.count)
    return float(weight @ np.sqrt(squared) / weight.sum())


def _required(summary: Summary | None) -> Summary:
    if summary is None:
        raise ComparisonError('no scan point to average')
    return summary


def registration_json(found: Registration) -> dict[str, object]:
    """Return a registration as plain numbers and lists; angles in radians, lengths in metres."""
    deviation = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    return {
        'rotation': found.rotation.tolist(),
        'translation_m': found.translation.tolist(),
        'rms_m': found.rms_m,
        'trimmed_fraction': found.trimmed_fraction,
        'condition_number': found.condition_number,
        'unobservable': found.unobservable.tolist(),
        'rotation_sigma_rad': deviation[:3].tolist(),
        'translation_sigma_m': deviation[3:].tolist(),
        'centre_m': found.centre.tolist(),
        'steps': found.steps,
        'converged': found.converged,
        'explained_fraction': found.explained_fraction,
        'doubts': list(found.doubts),
        'ambiguous_poses': found.ambiguous_poses,
        'text': found.text,
    }


def _summary_json(summary: Summary | None) -> dict[str, object] | None:
    return None if summary is None else asdict(summary)


def _profile_json(profile: DentProfile) -> dict[str, object]:
    return {
        'contact_m': profile.contact.tolist(),
        'max_displacement_m': profile.apex_m,
        'max_displacement_sigma_m': profile.apex_sigma_m,
        'extrapolation_sigma_m': profile.extrapolation_sigma_m,
        'extrapolated': profile.extrapolated,
        'hidden_radius_m': profile.hidden_radius_m,
        'deepest_seen_m': profile.deepest_seen_m,
        'reference': profile.reference,
        'method': profile.method,
        'bent_apex_m': profile.bent_apex_m,
        'radius_m': profile.radius.tolist(),
        'depth_m': profile.depth.tolist(),
        'model_depth_m': [None if np.isnan(v) else float(v) for v in profile.model],
    }
