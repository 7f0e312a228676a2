# SPDX-License-Identifier: Apache-2.0
"""How uncertain a registered pose is: noise of single points, and errors that views share.

The pose is a linear function of the distances near the solution, found by iterated robust weights.
Three things make its covariance larger than least squares would say:

* robust weights change with the distances (Huber, Robust Statistics, 1981, section 7.6): the
  derivative of weight times distance takes the place of the weight in the normal matrix;
* the distances left over are smaller than the errors, by the freedom of the fit (MacKinnon and
  White, J. Econometrics 29 (1985) 305);
* every view of a merged scan was laid onto the others with an error of its own, and part of it
  went into the pose: its size is estimated from what it leaves over, by equating scores of every
  group of points with their expectation (method of moments for variance components; Searle,
  Casella, McCulloch, Variance Components, 1992, chapter 5), so that few groups are no bias.

Where nobody says which point belongs to which view, groups are patches of several sizes, and the
size that makes the pose least certain counts, at the upper end of what it may be. Views that
overlap everywhere show in no patch: there they only scatter the points more than the scanner
does. What exceeds its noise is then taken for the errors of FEWEST_VIEWS views laid through each
other. A scanner that is worse than stated looks the same, and widens the sigma too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.stats import chi2

from scan_compare.statistics import ALIKE, group_by_cell

PATCH_SHARES = (ALIKE, 2.0 * ALIKE, 4.0 * ALIKE)
"""Sides of the patches that stand for unknown views, in radii of the object."""

MOST_GROUPS = 150
"""More patches than this are too small to be views; the next size is taken."""

SIGNIFICANT = 2.0
"""Standard deviations by which scores of patches exceed those of noise alone to count."""

FEWEST_VIEWS = 6
"""A whole object is merged of as many views or more: one towards each side. Fewer err together."""

LEAST_SLOPE = 0.25
"""No direction is taken for more than twice as uncertain as with fixed weights."""


@dataclass(frozen=True)
class Influence:
    """The pose as a linear function of the distances.

    rows (n, 6): change of each distance with the motion (arc, translation). pose (n, 6): change of
    the estimated motion with each distance, times minus one. distance (n,): what is left over [m].
    free (n, k): columns that were fitted beside the pose (a uniform offset), with `fitted` (n, k)
    their dependence on the distances.
    """

    rows: np.ndarray
    pose: np.ndarray
    distance: np.ndarray
    free: np.ndarray
    fitted: np.ndarray


def slope_matrix(
    rows: np.ndarray, weight: np.ndarray, slope: np.ndarray, patch: np.ndarray, pull: np.ndarray
) -> np.ndarray:
    """Return the normal matrix (k, k) of robust weights that follow the distances.

    weight (n,): the weights; slope (n,): derivative of weight times distance of single points;
    patch (n,): the patch of each point, whose mean moves a common weight; pull (patches,): the
    derivative of that weight times the sum of weighted distances.
    """
    fixed = (rows * weight[:, None]).T @ rows
    followed = (rows * slope[:, None]).T @ rows
    members = np.maximum(np.bincount(patch, weight > 0.0, minlength=len(pull)), 1.0)
    inside = np.where(weight > 0.0, 1.0, 0.0)
    mean = np.column_stack(
        [np.bincount(patch, inside * column, minlength=len(pull)) / members for column in rows.T]
    )
    followed = followed + (mean * pull[:, None]).T @ mean
    root = np.linalg.cholesky(fixed)
    half = np.linalg.solve(root, np.linalg.solve(root, followed).T)
    values, vectors = np.linalg.eigh(0.5 * (half + half.T))
    back = root @ vectors
    return (back * np.clip(values, LEAST_SLOPE, None)) @ back.T


def covariance(
    influence: Influence,
    foot: np.ndarray,
    radius: float,
    views: np.ndarray | None,
    scanner_sigma: float,
) -> np.ndarray:
    """Return the covariance (6, 6) of the motion (arc, translation).

    foot (n, 3): where the points lie [m]; radius of the object [m]; views (n,): the number of the
    view of each point, None where it is unknown; scanner_sigma: noise of one point [m].
    """
    used = np.any(influence.pose != 0.0, axis=1)
    n = int(np.count_nonzero(used))
    freedom = 6 + influence.free.shape[1]
    pulled = influence.pose * influence.distance[:, None]
    white = pulled.T @ pulled * (n / max(n - freedom, 1))
    groupings = groups_alike(foot, radius, views)
    # Patches are tried for want of views: only what noise alone would not show counts there.
    doubt = 0.0 if views is not None else SIGNIFICANT
    found = [_shared(influence, groups, doubt) for groups in groupings]
    if views is None:
        found.append(_mixed(influence, used, scanner_sigma))
    return white + max(found, key=lambda part: float(np.trace(part)), default=np.zeros((6, 6)))


def groups_alike(foot: np.ndarray, radius: float, views: np.ndarray | None) -> list[np.ndarray]:
    """Return numbers (n,) of the groups whose points err alike: views, or patches of some sizes.

    foot (n, 3) [m], radius of the object [m], views (n,) or None as for `covariance`.
    """
    if views is not None:
        return [np.unique(views, return_inverse=True)[1].reshape(-1)]
    found = []
    for share in PATCH_SHARES:
        cell, count = group_by_cell(foot, share * radius)
        if 2 <= count <= MOST_GROUPS:
            found.append(cell)
    return found


def _shared(influence: Influence, groups: np.ndarray, doubt: float) -> np.ndarray:
    """Return the covariance (6, 6) that rigid errors of groups of points give the pose.

    Two components: turns (as arcs) and shifts, each alike in all directions and groups. Zero
    where the scores do not exceed those of noise alone by `doubt` of their standard deviations.
    """
    count = int(groups.max()) + 1
    rows, pose = influence.rows, influence.pose
    # How much of each point's error the pose and what is fitted beside it take up.
    columns = np.column_stack((rows, influence.free))
    taken = np.column_stack((pose, influence.fitted))
    inside = rows * np.any(pose != 0.0, axis=1).astype(float)[:, None]
    own = _by_group(inside, rows, groups, count)
    of_columns = _by_group(inside, columns, groups, count)
    of_taken = _by_group(taken, rows, groups, count)
    # Scores s = K' e of all groups: their own rows, less what the fit took out of them.
    distance = influence.distance[:, None]
    score = _by_group(inside, distance, groups, count)[:, :, 0]
    parts = (slice(0, 3), slice(3, 6))
    # The squares of K, weighed by those of the distances: within the group, across, the fit's.
    noisy = taken * distance**2
    noise = (
        _by_group(inside**2, distance**2, groups, count)[:, :, 0]
        - 2.0 * np.einsum('gik,gik->gi', _by_group(inside, noisy, groups, count), of_columns)
        + np.einsum('gik,kl,gil->gi', of_columns, taken.T @ noisy, of_columns)
    )
    white = np.array([float(noise[:, part].sum()) for part in parts])
    # What rigid errors of the group h do to the scores of the group g, (g, 6, h, 6).
    reach = -np.einsum('gik,hkj->gihj', of_columns, of_taken)
    reach[np.arange(count), :, np.arange(count)] += own
    shared = np.array([[np.sum(reach[:, of, :, error] ** 2) for error in parts] for of in parts])
    seen = np.array([float(np.sum(score[:, part] ** 2)) for part in parts])
    if np.all(seen <= white * (1.0 + doubt * np.sqrt(2.0 / (3 * count)))):
        return np.zeros((6, 6))
    scale = np.maximum(np.abs(shared).max(axis=1), 1e-300)
    sizes, _ = nnls(shared / scale[:, None], np.maximum(seen - white, 0.0) / scale)
    if doubt > 0.0:
        # Which points belong together is a guess: the upper end of the 80 % interval of the size.
        freedom = max(3 * count - 6, 3)
        sizes = sizes * freedom / chi2.ppf(0.1, freedom)
    pulls = _by_group(pose, rows, groups, count)
    return sum(
        size * np.einsum('gik,gjk->ij', pulls[:, :, part], pulls[:, :, part])
        for size, part in zip(sizes, parts, strict=True)
    ) + np.zeros((6, 6))


def _mixed(influence: Influence, used: np.ndarray, scanner_sigma: float) -> np.ndarray:
    """Return the covariance (6, 6) that views laid through each other give the pose.

    Every view shifts by as much as the points scatter beyond the scanner's noise.
    """
    square = influence.distance[used] ** 2
    noise = scanner_sigma**2
    # Of normal noise squares scatter by sqrt(2) of their mean.
    excess = float(square.mean()) - noise * (1.0 + SIGNIFICANT * np.sqrt(2.0 / len(square)))
    if excess <= 0.0:
        return np.zeros((6, 6))
    view = np.arange(len(used)) % FEWEST_VIEWS
    pulls = _by_group(influence.pose, influence.rows, view, FEWEST_VIEWS)[:, :, 3:]
    return (float(square.mean()) - noise) * np.einsum('gik,gjk->ij', pulls, pulls)


def _by_group(left: np.ndarray, right: np.ndarray, groups: np.ndarray, count: int) -> np.ndarray:
    """Return the sums of left_i right_i^T over each group, (groups, k, m)."""
    found = np.empty((count, left.shape[1], right.shape[1]))
    for i in range(left.shape[1]):
        for j in range(right.shape[1]):
            found[:, i, j] = np.bincount(groups, left[:, i] * right[:, j], minlength=count)
    return found
