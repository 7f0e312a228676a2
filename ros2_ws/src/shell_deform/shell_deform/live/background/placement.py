# SPDX-License-Identifier: Apache-2.0
"""Where the object is, from the contacts of first touch.

At first touch the shell is undeformed: every contact point lies on its outer face and every
contact normal is the face's inward normal there. A rigid pose is fitted to both by Gauss-Newton
from a weak prior around the pose the object would have centred between the fingers. Motions the
contacts do not fix (turning a sphere, sliding along a cylinder) stay at the prior, keep its width
in the covariance where it matters, and are named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.pose import Pose, rotation_of
from shell_deform.surface.limit import LimitSurface

Array = NDArray[np.float64]

PRIOR_SHIFT = 0.1
PRIOR_TURN = 1.0
OPEN_SHARE = 0.5


@dataclass(frozen=True)
class Placement:
    """A fitted pose.

    Attributes:
        pose: of the object. covariance: (6, 6) of translation [m] and rotation vector [rad] about
            the object's origin, in its frame, without the motions that stay open.
        contacts: how many were used. misfit: root mean square of the normalised residuals.
        open_directions: what the contacts leave open, in words; empty if nothing.
    """

    pose: Pose
    covariance: Array
    contacts: int
    misfit: float
    open_directions: str


def place(
    surface: LimitSurface,
    control_points: Array,
    half_wall: float,
    points: list[Array],
    normals: list[Array],
    sigma_point: float = 5e-4,
    sigma_normal: float = 0.05,
    start: Pose | None = None,
) -> Placement:
    """Fit the pose to contact points on the outer face and inward normals (3,).

    `control_points` (n, 3) undeformed; `sigma_point` [m] and `sigma_normal` [rad] of the contacts.
    """
    measured = np.array(points)
    inward = np.array(normals)
    pose = start or _first_guess(control_points, measured, inward, half_wall)
    prior = np.concatenate([np.full(3, 1.0 / PRIOR_SHIFT), np.full(3, 1.0 / PRIOR_TURN)])
    away = np.zeros(6)
    for _ in range(30):
        residual, jacobian = _residual(
            surface, control_points, half_wall, pose, measured, inward, sigma_point, sigma_normal
        )
        normal_matrix = jacobian.T @ jacobian + np.diag(prior**2)
        free = np.linalg.solve(normal_matrix, -jacobian.T @ residual - prior**2 * away)
        limit = 0.3 / max(0.3, float(np.linalg.norm(free[3:])))
        step = np.asarray(limit * free, dtype=float)
        away = away + step
        pose = Pose(
            pose.rotation @ rotation_of(step[3:]), pose.translation + pose.rotation @ step[:3]
        )
        if np.linalg.norm(step[:3]) < 1e-9 and np.linalg.norm(step[3:]) < 1e-8:
            break
    covariance = np.linalg.inv(normal_matrix)
    # In units of the prior an open motion keeps about its prior width.
    scaled = covariance * np.outer(prior, prior)
    values, vectors = np.linalg.eigh(scaled)
    fixed = values < OPEN_SHARE**2
    kept = vectors[:, fixed] * np.sqrt(values[fixed])
    known = (kept @ kept.T) / np.outer(prior, prior)
    return Placement(
        pose=pose,
        covariance=known,
        contacts=len(measured),
        misfit=float(np.sqrt(np.mean(residual**2))),
        open_directions=_in_words(vectors[:, ~fixed]),
    )


def _first_guess(control_points: Array, points: Array, inward: Array, half_wall: float) -> Pose:
    """Unturned, with the object's middle where lines along the normals come closest."""
    middle = 0.5 * (control_points.min(axis=0) + control_points.max(axis=0))
    reach = 0.5 * float(np.linalg.norm(np.ptp(control_points, axis=0))) / np.sqrt(3.0) + half_wall
    matrix = 1e-3 * np.eye(3)
    right = 1e-3 * (points + reach * inward).mean(axis=0)
    for point, normal in zip(points, inward, strict=True):
        across = np.eye(3) - np.outer(normal, normal)
        matrix += across
        right += across @ point
    alone = len(points) == 1
    centre = points[0] + reach * inward[0] if alone else np.linalg.solve(matrix, right)
    return Pose(np.eye(3), centre - middle)


def _residual(
    surface: LimitSurface,
    control_points: Array,
    half_wall: float,
    pose: Pose,
    points: Array,
    inward: Array,
    sigma_point: float,
    sigma_normal: float,
) -> tuple[Array, Array]:
    """Normalised residuals (4 p,) and their derivatives (4 p, 6) in the object's frame.

    The derivative of the normal goes through the surface's own curvature, by differences.
    """

    def evaluate(motion: Array) -> Array:
        moved = Pose(
            pose.rotation @ rotation_of(motion[3:]),
            pose.translation + pose.rotation @ motion[:3],
        )
        found = surface.closest_point(
            control_points, moved.to_object(points), offset=half_wall, threads=1
        )
        turned = inward @ moved.rotation
        return np.concatenate(
            [found.distance / sigma_point, ((found.normal + turned) / sigma_normal).ravel()]
        )

    here = evaluate(np.zeros(6))
    steps = np.array([1e-6] * 3 + [1e-5] * 3)
    jacobian = np.zeros((len(here), 6))
    for i in range(6):
        motion = np.zeros(6)
        motion[i] = steps[i]
        jacobian[:, i] = (evaluate(motion) - evaluate(-motion)) / (2.0 * steps[i])
    return here, jacobian


def _in_words(directions: Array) -> str:
    """Name the open motions (6, m)."""
    if directions.shape[1] == 0:
        return ''
    names = ['shift along x', 'shift along y', 'shift along z', 'turn about x', 'turn about y']
    names.append('turn about z')
    share = np.einsum('im,im->i', directions, directions)
    parts = [name for name, part in zip(names, share, strict=True) if part > 0.3]
    return 'the contacts leave open: ' + (', '.join(parts) or 'a combined motion')
