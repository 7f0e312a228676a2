"""Rigid registration of a scan onto the smooth outer face of a shell.

No library registers onto a Loop limit surface, and trimesh's default may scale or mirror, which
would hide any deformation. Here: Gauss-Newton on the distances to the surface itself, rotation
and translation only. Directions that the undeformed region fixes well are taken from it alone;
directions it cannot see (a ball may spin) are taken from the dents, with the depth of the dents
left free; directions that nothing fixes stay at the start. Each is named in the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scan_compare.deformed_surface import DeformedSurface
from scan_compare.distance import Distances, displacement_vectors, measure
from scan_compare.observability import (
    STRONG_SENSITIVITY,
    VISIBLE_SENSITIVITY,
    describe_direction,
    information,
    motion_rows,
    split_by_contacts,
)
from scan_compare.rigid import IDENTITY, Pose, nearest_rotation, rotation_from_vector
from scan_compare.robust import (
    beside,
    coherent_weight,
    spread_of,
    tukey,
    weight_beside_depth,
)
from scan_compare.statistics import ALIKE, group_by_cell

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
    translations [m], zero along unobservable motions. text: the explanation in words.
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
    rigid_weight: np.ndarray
    all_weight: np.ndarray
    depth: np.ndarray


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


def register(
    scan_points: np.ndarray,
    surface: DeformedSurface,
    *,
    start: Pose | None = IDENTITY,
    mask: np.ndarray | None = None,
    scanner_sigma_m: float = SCANNER_SIGMA,
    sample: int = SAMPLE,
    contacts: np.ndarray | None = None,
) -> Registration:
    """Find the rigid motion that lays `scan_points` (n, 3) [m] onto `surface`.

    start: pose to start from (from the hand's contacts: `rigid.pose_from_points`), or None to
    search all rotations. mask (n,): scan points of the undeformed region; None finds the region
    from the model's displacements and trims what does not fit. scanner_sigma_m: noise of one
    point. contacts (c, 3): points in the object's frame that `start` was made from; directions
    that only they fix are named so. Deterministic. Raises RegistrationError if too few points
    lie on the surface.
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
        # imported here: the search itself refines its candidates with `refine`
        from scan_compare.pose_search import search_pose

        start, ambiguous = search_pose(points[chosen], usable[chosen], surface, scanner_sigma_m)
    coarse = chosen[: min(COARSE_SAMPLE, len(chosen))]
    pose, _, _, _ = refine(points[coarse], usable[coarse], surface, start, scanner_sigma_m)
    pose, fit, steps, converged = refine(
        points[chosen], usable[chosen], surface, pose, scanner_sigma_m
    )
    step = _solve(fit, scanner_sigma_m)
    known = np.empty((0, 3)) if contacts is None else np.asarray(contacts, float)
    return _describe(fit, step, pose, steps, converged, ambiguous, known)


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
    on_surface = ~distances.beside
    in_dent = distances.displacement > surface.dent_threshold
    rigid = usable & on_surface & ~in_dent
    if np.count_nonzero(rigid) < 20:
        raise RegistrationError(
            f'only {np.count_nonzero(rigid)} of {len(points)} scan points lie on the undeformed '
            'region; give a start pose nearer to the truth or a scan that shows more of it'
        )
    motions = motion_rows(distances.foot, distances.normal)
    value = distances.distance
    rigid_weight = np.where(rigid, tukey(value, spread_of(value[rigid], sigma)), 0.0)
    rigid_weight *= coherent_weight(points, value, rigid, sigma)
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
    return _Fit(
        distances, motions.rows, motions.centre, motions.radius, rigid_weight, all_weight, depth
    )


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
    rows = beside(fit.rows @ weak, columns, fit.all_weight)
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
    free = beside(rows, np.ones((len(rows), 1)), fit.rigid_weight)
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


def _describe(
    fit: _Fit,
    step: _Step,
    pose: Pose,
    steps: int,
    converged: bool,
    ambiguous: int,
    contacts: np.ndarray,
) -> Registration:
    used = fit.rigid_weight > 0.0
    distance = fit.distances.distance
    values = np.linalg.eigvalsh(information(fit.rows, fit.rigid_weight))
    scale = np.diag(np.r_[np.full(3, 1.0 / fit.radius), np.ones(3)])
    covariance = scale @ _covariance(fit, step) @ scale
    rms = float(np.sqrt(np.mean(distance[used] ** 2)))
    trimmed = float(1.0 - used.mean())
    condition = float(values[-1] / max(values[0], 1e-300))
    return Registration(
        rotation=nearest_rotation(pose.rotation),
        translation=pose.translation,
        rms_m=rms,
        trimmed_fraction=trimmed,
        condition_number=condition,
        unobservable=step.hidden.T.copy(),
        covariance=covariance,
        centre=fit.centre,
        radius_m=fit.radius,
        steps=steps,
        converged=converged,
        ambiguous_poses=ambiguous,
        text=_explain(fit, step, rms, trimmed, condition, converged, ambiguous, contacts),
    )


def _covariance(fit: _Fit, step: _Step) -> np.ndarray:
    """Return the covariance (6, 6) of the motion (arc, translation), robust to clusters.

    Sum of outer products of the influence of clusters, in which errors are alike, on the estimate,
    so that neither the noise level nor its independence has to be assumed. A uniform offset that
    is kept apart from the pose is none of its errors.
    """
    distance = fit.distances.distance
    if step.offset_free:
        distance = distance - np.average(distance, weights=fit.rigid_weight)
    influence = np.zeros((len(distance), 6))
    if step.strong.shape[1]:
        influence = _influence(step.strong_rows, fit.rigid_weight, distance) @ step.strong.T
    if step.weak.shape[1]:
        rows = step.weak_rows
        weighted = rows * fit.all_weight[:, None]
        normal = weighted.T @ rows
        direct = weighted * distance[:, None]
        through_strong = influence @ (weighted.T @ fit.rows).T
        weak = np.linalg.solve(normal, (direct + through_strong).T).T
        influence = influence - weak @ step.weak.T
    cluster, count = group_by_cell(fit.distances.foot, ALIKE * fit.radius)
    total = np.column_stack(
        [np.bincount(cluster, influence[:, k], minlength=count) for k in range(6)]
    )
    return total.T @ total


def _influence(rows: np.ndarray, weight: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return the influence (n, k) of each distance on the weighted least-squares solution."""
    weighted = rows * weight[:, None]
    return -np.linalg.solve(weighted.T @ rows, (weighted * distance[:, None]).T).T


def _explain(
    fit: _Fit,
    step: _Step,
    rms: float,
    trimmed: float,
    condition: float,
    converged: bool,
    ambiguous: int,
    contacts: np.ndarray,
) -> str:
    parts = [
        f'rigid, no scale; rms {1e3 * rms:.3f} mm on the undeformed region, '
        f'{100 * trimmed:.0f} % of the scan left out (dent, outliers, beside the surface); '
        f'condition number {condition:.3g}'
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
    if ambiguous > 1:
        parts.append(
            f'{ambiguous} poses fit equally well (a symmetry of the object): state a start pose'
        )
    if trimmed > MOST_TRIMMED:
        parts.append('most of the scan does not fit: check start pose, unit and object')
    if not converged:
        parts.append('the fit did not settle: treat the pose with caution')
    return '. '.join(parts)
