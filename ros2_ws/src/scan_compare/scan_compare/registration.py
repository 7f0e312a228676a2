# SPDX-License-Identifier: Apache-2.0
"""Rigid registration of a scan onto the smooth outer face of a shell.

No library registers onto a Loop limit surface, and trimesh's default may scale or mirror, which
would hide any deformation. Here: Gauss-Newton on the distances to the surface itself, rotation
and translation only. Directions that the undeformed region fixes well are taken from it alone;
directions it cannot see (a ball may spin) are taken from the dents, with the depth of the dents
left free; directions that nothing fixes stay at the start. Each is named in the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.distance import Distances, displacement_vectors, measure
from scan_compare.fit_check import FitCheck, check_fit
from scan_compare.observability import (
    STRONG_SENSITIVITY,
    VISIBLE_SENSITIVITY,
    describe_direction,
    information,
    motion_rows,
    split_by_contacts,
)
from scan_compare.pose_covariance import Influence, covariance, slope_matrix
from scan_compare.pose_search import search_pose
from scan_compare.rigid import IDENTITY, Pose, nearest_rotation, rotation_from_vector
from scan_compare.robust import (
    RobustWeights,
    partialled_out,
    robust_weights,
    weight_beside_depth,
)

SCANNER_SIGMA = 0.127e-3
"""Stated accuracy of the NextEngine scanner, taken as one standard deviation [m]."""

SAMPLE = 50_000
"""Scan points used: their noise moves the pose by a few micrometres."""

COARSE_SAMPLE = 2_000
"""Scan points used until the pose has settled for the first time."""

MOST_STEPS = 60
MOST_TRIMMED = 0.6
SETTLED = 1e-7
"""A step shorter than this [m] ends the fit: points change sides of the dent's border below it."""

OFFSET_SENSITIVITY = 0.4
"""A uniform offset is kept apart from the pose unless that makes the pose this much weaker."""

MOST_UNCERTAIN = 0.2e-3
"""A weak direction that noise alone leaves this uncertain [m] counts as unobservable."""


class RegistrationError(ValueError):
    """A scan that cannot be registered; the message says why and what would help."""


@dataclass(frozen=True)
class Registration:
    """The pose of a scan and how well it is known.

    rotation (3, 3), translation (3,) [m]: scan frame to object frame. rms_m: of the distances in
    the region used. trimmed_fraction: share of the scan left out of the fit (dent, outliers,
    beside the surface). condition_number: of the 6 x 6 normal matrix of the undeformed region.
    unobservable: (k, 6) unit motions (rotation as arc at `radius_m`, translation) about `centre`
    that no distance fixes. covariance (6, 6): of small rotations [rad] about `centre` and
    translations [m], zero along unobservable motions. explained_fraction, doubts: of `fit_check`;
    a registration with doubts must not be trusted, settled or not. text: the explanation in
    words, doubts first.
    """

    rotation: np.ndarray
    translation: np.ndarray
    rms_m: float
    trimmed_fraction: float
    condition_number: float
    unobservable: np.ndarray
    covariance: np.ndarray
    centre: np.ndarray
    radius_m: float
    steps: int
    converged: bool
    explained_fraction: float
    doubts: tuple[str, ...]
    ambiguous_poses: int
    text: str

    @property
    def pose(self) -> Pose:
        """The motion from the scan's frame to the object's."""
        return Pose(self.rotation, self.translation)


@dataclass(frozen=True)
class _Fit:
    """Linear equations of one step, at the current pose.

    depth (n,): the model's displacement along the normal in the dents, zero elsewhere.
    """

    distances: Distances
    rows: np.ndarray
    centre: np.ndarray
    radius: float
    robust: RobustWeights
    all_weight: np.ndarray
    depth: np.ndarray

    @property
    def rigid_weight(self) -> np.ndarray:
        """Weights (n,) of the undeformed region."""
        return self.robust.weight


@dataclass(frozen=True)
class _Step:
    """A small motion (6,) (arc, translation) and the directions that made it up."""

    motion: np.ndarray
    strong: np.ndarray
    strong_rows: np.ndarray
    weak: np.ndarray
    weak_rows: np.ndarray
    hidden: np.ndarray
    offset_free: bool


@dataclass(frozen=True)
class _Settled:
    """Where the fit ended, after how many steps, and what speaks against it."""

    pose: Pose
    steps: int
    converged: bool
    ambiguous: int
    check: FitCheck


def register(
    scan_points: np.ndarray,
    surface: DeformedSurface,
    *,
    start: Pose | None = IDENTITY,
    mask: np.ndarray | None = None,
    scanner_sigma_m: float = SCANNER_SIGMA,
    sample: int = SAMPLE,
    contacts: np.ndarray | None = None,
    views: np.ndarray | None = None,
) -> Registration:
    """Find the rigid motion that lays `scan_points` (n, 3) [m] onto `surface`.

    start: pose to start from (from the hand's contacts: `rigid.pose_from_points`), or None to
    search all rotations. mask (n,): scan points of the undeformed region; None finds the region
    from the model's displacements and trims what does not fit. scanner_sigma_m: noise of one
    point. contacts (c, 3): points in the object's frame that `start` was made from; directions
    that only they fix are named so. views (n,): the number of the view that each point is
    from, whose errors are alike; None where it is unknown. Deterministic. Raises
    RegistrationError if too few points lie on the surface.
    """
    points = np.asarray(scan_points, float)
    if len(points) < 20:
        raise RegistrationError(f'{len(points)} scan points; at least 20 are needed')
    if not scanner_sigma_m > 0.0:
        raise RegistrationError(f'scanner sigma {scanner_sigma_m} m; it must be positive')
    usable = np.ones(len(points), bool) if mask is None else np.asarray(mask, bool)
    chosen = thin(len(points), sample)
    ambiguous = 0
    if start is None:
        found = search_pose(points[chosen], usable[chosen], surface, scanner_sigma_m)
        start, ambiguous = found.pose, found.alike
    coarse = chosen[: min(COARSE_SAMPLE, len(chosen))]
    pose, _, _, _ = refine(points[coarse], usable[coarse], surface, start, scanner_sigma_m)
    pose, fit, steps, converged = refine(
        points[chosen], usable[chosen], surface, pose, scanner_sigma_m
    )
    step = _solve(fit, scanner_sigma_m)
    known = np.empty((0, 3)) if contacts is None else np.asarray(contacts, float)
    of_view = None if views is None else np.asarray(views)[chosen]
    spread = _covariance(fit, step, of_view, scanner_sigma_m)
    outside = usable[chosen] & (fit.distances.displacement <= surface.dent_threshold)
    check = check_fit(
        points[chosen],
        surface,
        fit.distances.distance,
        outside,
        _rms(fit),
        scanner_sigma_m,
    )
    settled = _Settled(pose, steps, converged, ambiguous, check)
    return _describe(fit, step, settled, known, spread)


def thin(count: int, wanted: int) -> np.ndarray:
    """Return indices of about `wanted` of `count` points, without pattern, always the same."""
    order = np.random.default_rng(0).permutation(count)
    return order[: min(wanted, count)]


def refine(
    points: np.ndarray,
    usable: np.ndarray,
    surface: DeformedSurface,
    start: Pose,
    sigma: float,
    most_steps: int = MOST_STEPS,
) -> tuple[Pose, _Fit, int, bool]:
    """Gauss-Newton from `start`; returns pose, last equations, steps and convergence."""
    pose = start
    seeds = None
    converged = False
    fit = _equations(points, usable, surface, pose, sigma, None)
    steps = 0
    while steps < most_steps and not converged:
        step = _solve(fit, sigma)
        pose = _moved(step.motion, fit.centre, fit.radius).after(pose)
        seeds = (fit.distances.triangle, fit.distances.parameters)
        # a far jump would leave the seeds on the wrong triangles
        near = float(np.linalg.norm(step.motion)) < 0.02 * surface.extent
        fit = _equations(points, usable, surface, pose, sigma, seeds if near else None)
        converged = float(np.linalg.norm(step.motion)) < SETTLED
        steps += 1
    return pose, fit, steps, converged


def _equations(
    points: np.ndarray,
    usable: np.ndarray,
    surface: DeformedSurface,
    pose: Pose,
    sigma: float,
    seeds: tuple[np.ndarray, np.ndarray] | None,
) -> _Fit:
    distances = measure(surface, pose.apply(points), seeds)
    on_surface = ~distances.beyond_edge
    in_dent = distances.displacement > surface.dent_threshold
    rigid = usable & on_surface & ~in_dent
    if np.count_nonzero(rigid) < 20:
        raise RegistrationError(
            f'only {np.count_nonzero(rigid)} of {len(points)} scan points lie on the undeformed '
            'region; give a start pose nearer to the truth or a scan that shows more of it'
        )
    motions = motion_rows(distances.foot, distances.normal)
    value = distances.distance
    robust = robust_weights(points, value, rigid, sigma)
    rigid_weight = robust.weight
    dent = np.flatnonzero(on_surface & in_dent)
    depth = np.zeros(len(points))
    all_weight = rigid_weight.copy()
    if dent.size:
        vectors = displacement_vectors(
            surface, distances.triangle[dent], distances.parameters[dent]
        )
        depth[dent] = np.einsum('ni,ni->n', vectors, distances.normal[dent])
        offset = float(np.median(value[rigid]))
        all_weight[dent] = weight_beside_depth(value[dent] - offset, depth[dent], sigma)
    return _Fit(distances, motions.rows, motions.centre, motions.radius, robust, all_weight, depth)


def _solve(fit: _Fit, sigma: float) -> _Step:
    """Strong directions from the undeformed region, weak ones from everything."""
    values, vectors = np.linalg.eigh(information(fit.rows, fit.rigid_weight))
    is_strong = values >= STRONG_SENSITIVITY**2
    strong, weak = vectors[:, is_strong], vectors[:, ~is_strong]
    distance = fit.distances.distance
    strong_rows, offset_free = _strong_rows(fit, strong)
    motion = strong @ _least_squares(strong_rows, -distance, fit.rigid_weight)
    if weak.shape[1] == 0:
        nothing = np.zeros((len(distance), 0))
        return _Step(motion, strong, strong_rows, weak, nothing, weak, offset_free)
    columns = fit.depth[:, None]
    if offset_free:
        columns = np.column_stack((np.ones(len(distance)), fit.depth))
    rows = partialled_out(fit.rows @ weak, columns, fit.all_weight)
    moved = distance + fit.rows @ motion
    weak_values, weak_vectors = np.linalg.eigh(information(rows, fit.all_weight))
    spread = sigma / np.sqrt(np.maximum(weak_values, 1e-300) * fit.all_weight.sum())
    seen = weak_values >= VISIBLE_SENSITIVITY**2 * _dent_share(fit)
    seen &= spread < MOST_UNCERTAIN
    visible = weak @ weak_vectors[:, seen]
    visible_rows = rows @ weak_vectors[:, seen]
    motion = motion + visible @ _least_squares(visible_rows, -moved, fit.all_weight)
    hidden = weak @ weak_vectors[:, ~seen]
    return _Step(motion, strong, strong_rows, visible, visible_rows, hidden, offset_free)


def _strong_rows(fit: _Fit, strong: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the equations of the strong directions, free of a uniform offset where that works.

    A shell that is everywhere a little too large, seen from one side, would otherwise be shifted
    towards the scanner and its error halved. A nearly flat view cannot tell the two apart: there
    the shift is fitted.
    """
    rows = fit.rows @ strong
    free = partialled_out(rows, np.ones((len(rows), 1)), fit.rigid_weight)
    least = np.linalg.eigvalsh(information(free, fit.rigid_weight))
    usual = np.linalg.eigvalsh(information(rows, fit.rigid_weight))
    if strong.shape[1] and least[0] >= OFFSET_SENSITIVITY**2 * usual[0]:
        return free, True
    return rows, False


def _dent_share(fit: _Fit) -> float:
    """Return the share of the weight in the dent: what fixes weak motions may be small."""
    extra = fit.all_weight[fit.rigid_weight == 0.0].sum()
    total = float(fit.all_weight.sum())
    return float(extra) / total if extra > 0.0 and total > 0.0 else 1.0


def _least_squares(rows: np.ndarray, target: np.ndarray, weight: np.ndarray) -> np.ndarray:
    if rows.shape[1] == 0:
        return np.zeros(0)
    weighted = rows * weight[:, None]
    return np.linalg.solve(weighted.T @ rows, weighted.T @ target)


def _moved(motion: np.ndarray, centre: np.ndarray, radius: float) -> Pose:
    rotation = rotation_from_vector(motion[:3] / radius)
    return Pose(rotation, centre - rotation @ centre + motion[3:])


def _rms(fit: _Fit) -> float:
    return float(np.sqrt(np.mean(fit.distances.distance[fit.rigid_weight > 0.0] ** 2)))


def _describe(
    fit: _Fit, step: _Step, settled: _Settled, contacts: np.ndarray, spread: np.ndarray
) -> Registration:
    values = np.linalg.eigvalsh(information(fit.rows, fit.rigid_weight))
    scale = np.diag(np.r_[np.full(3, 1.0 / fit.radius), np.ones(3)])
    found = Registration(
        rotation=nearest_rotation(settled.pose.rotation),
        translation=settled.pose.translation,
        rms_m=_rms(fit),
        trimmed_fraction=float(np.mean(fit.rigid_weight == 0.0)),
        condition_number=float(values[-1] / max(values[0], 1e-300)),
        unobservable=step.hidden.T.copy(),
        covariance=scale @ spread @ scale,
        centre=fit.centre,
        radius_m=fit.radius,
        steps=settled.steps,
        converged=settled.converged,
        explained_fraction=settled.check.explained,
        doubts=settled.check.doubts,
        ambiguous_poses=settled.ambiguous,
        text='',
    )
    return replace(found, text=_explain(fit, step, found, contacts))


def _covariance(
    fit: _Fit, step: _Step, views: np.ndarray | None, scanner_sigma: float
) -> np.ndarray:
    """Return the covariance (6, 6) of the motion (arc, translation).

    A uniform offset that is kept apart from the pose is none of its errors.
    """
    distance, weight = fit.distances.distance, fit.rigid_weight
    free = np.ones((len(distance), 1 if step.offset_free else 0))
    fitted = free * weight[:, None] / weight.sum()
    distance = distance - free @ (fitted.T @ distance)
    # At the solution both sets of equations hold at once, each for all motions together.
    strong = step.strong_rows * weight[:, None]
    weak = step.weak_rows * fit.all_weight[:, None]
    directions = np.column_stack((step.strong, step.weak))
    equations = np.column_stack((strong, weak))
    normal = equations.T @ (fit.rows @ directions)
    of_strong = slice(0, step.strong.shape[1])
    if step.strong.shape[1]:
        robust = fit.robust
        normal[of_strong, of_strong] = slope_matrix(
            step.strong_rows, weight, robust.slope, robust.patch, robust.pull
        )
    pose = np.zeros((len(distance), 6))
    if directions.shape[1]:
        pose = np.linalg.solve(normal, equations.T).T @ directions.T
    influence = Influence(fit.rows, pose, distance, free, fitted)
    return covariance(influence, fit.distances.foot, fit.radius, views, scanner_sigma)


def _explain(fit: _Fit, step: _Step, found: Registration, contacts: np.ndarray) -> str:
    parts = [
        *found.doubts,
        f'rigid, no scale; rms {1e3 * found.rms_m:.3f} mm on the undeformed region, '
        f'{100 * found.trimmed_fraction:.0f} % of the scan left out (dent, outliers, beside the '
        f'surface); condition number {found.condition_number:.3g}',
    ]
    if step.offset_free:
        parts.append('a uniform offset between scan and model is left in the errors')
    if step.weak.shape[1]:
        source = 'the dents (their depth left free)' if fit.depth.any() else 'the whole surface'
        names = [describe_direction(d, fit.centre, fit.radius) for d in step.weak.T]
        parts.append(f'fixed by {source}: ' + '; '.join(names))
    by_contacts, open_ = split_by_contacts(step.hidden, contacts, fit.centre, fit.radius)
    for directions, how in ((by_contacts, 'fixed by the contacts'), (open_, 'kept at the start')):
        if directions.shape[1]:
            names = [describe_direction(d, fit.centre, fit.radius) for d in directions.T]
            parts.append(f'unobservable, {how}: ' + '; '.join(names))
    if found.ambiguous_poses > 1:
        parts.append(
            f'{found.ambiguous_poses} poses fit equally well (a symmetry of the object): state a '
            'start pose'
        )
    if found.trimmed_fraction > MOST_TRIMMED:
        parts.append('most of the scan does not fit: check start pose, unit and object')
    if not found.converged:
        parts.append('the fit did not settle: treat the pose with caution')
    return '. '.join(parts)
