"""A scanner made of numbers: what a NextEngine would see of a known surface, errors included.

For error budgets and tests; whatever it makes is synthetic and says so in its source. The model
follows the manufacturer's description and the study of Polo and Felicisimo (Sensors 2012, 12,
9046): noise along the viewing ray that grows with the incidence, loss beyond a largest incidence,
shadows of the fingers for camera and laser, and a rigid error of each view of a family.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scan_compare.rigid import Pose, rotation_from_vector
from scan_compare.scan import Scan

LARGEST_INCIDENCE = np.deg2rad(67.0)


@dataclass(frozen=True)
class Capsule:
    """A finger or pin that casts a shadow: all points within `radius` of a segment [m]."""

    start: np.ndarray
    end: np.ndarray
    radius: float


@dataclass(frozen=True)
class VirtualScanner:
    """views (v, 3): unit directions from the object towards the scanner; noise [m]: standard
    deviation along the ray at normal incidence; view_shift [m] and view_turn [rad]: standard
    deviations of each view's rigid error; baseline [rad]: angle between camera and laser; shadows:
    whether `fingers` hide points.
    """

    views: np.ndarray
    noise: float = 0.127e-3
    view_shift: float = 0.1e-3
    view_turn: float = np.deg2rad(0.1)
    baseline: float = np.deg2rad(15.0)
    shadows: bool = True
    fingers: tuple[Capsule, ...] = ()

    def without(self, cause: str) -> VirtualScanner:
        """Return the scanner without 'noise', 'occlusion' or 'merging' errors."""
        if cause == 'noise':
            return replace(self, noise=0.0)
        if cause == 'merging':
            return replace(self, view_shift=0.0, view_turn=0.0)
        if cause == 'occlusion':
            return replace(self, shadows=False)
        return self


def turntable(count: int, elevation: float = np.deg2rad(20.0)) -> np.ndarray:
    """Return `count` viewing directions (count, 3) around z, alternately above and below."""
    angle = 2.0 * np.pi * np.arange(count) / count
    tilt = elevation * np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    return np.column_stack(
        (np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt))
    )


def scan_surface(
    points: np.ndarray, normals: np.ndarray, scanner: VirtualScanner, seed: int
) -> Scan:
    """Scan a surface given by dense points (n, 3) [m] with outward normals (n, 3).

    Each point is measured by the view that sees it best. The random numbers of a cause do not
    depend on whether the other causes are switched on: budgets compare like with like.
    """
    cosine = normals @ scanner.views.T
    if scanner.shadows:
        for index, view in enumerate(scanner.views):
            cosine[:, index] = np.where(_hidden(points, view, scanner), -1.0, cosine[:, index])
    else:
        # without occlusion every point is seen as well as from straight above
        cosine = np.where(cosine == cosine.max(axis=1, keepdims=True), 1.0, -1.0)
    best = np.argmax(cosine, axis=1)
    seen = cosine[np.arange(len(points)), best] > np.cos(LARGEST_INCIDENCE)
    noise_generator, view_generator = (np.random.default_rng([seed, cause]) for cause in range(2))
    along = scanner.noise * noise_generator.standard_normal(len(points))
    along /= np.maximum(cosine[np.arange(len(points)), best], np.cos(LARGEST_INCIDENCE))
    measured = points + along[:, None] * scanner.views[best]
    centre = points.mean(axis=0)
    for index, error in enumerate(_view_errors(scanner, view_generator)):
        own = best == index
        measured[own] = error.apply(measured[own] - centre) + centre
    return Scan(measured[seen], None, 'm', False, f'synthetic scan, seed {seed}')


def _view_errors(scanner: VirtualScanner, generator: np.random.Generator) -> list[Pose]:
    numbers = generator.standard_normal((len(scanner.views), 6))
    # the first view defines the frame of the family
    numbers[0] = 0.0
    return [
        Pose(rotation_from_vector(scanner.view_turn * row[:3]), scanner.view_shift * row[3:])
        for row in numbers
    ]


def _hidden(points: np.ndarray, view: np.ndarray, scanner: VirtualScanner) -> np.ndarray:
    """Return which points (n,) a finger hides from the camera or from the laser."""
    helper = np.eye(3)[int(np.argmin(np.abs(view)))]
    aside = np.cross(view, helper)
    aside /= np.linalg.norm(aside)
    laser = np.cos(scanner.baseline) * view + np.sin(scanner.baseline) * aside
    hidden = np.zeros(len(points), bool)
    for finger in scanner.fingers:
        for direction in (view, laser):
            hidden |= _ray_distance(points, direction, finger) < finger.radius
    return hidden


def _ray_distance(points: np.ndarray, direction: np.ndarray, finger: Capsule) -> np.ndarray:
    """Return the distance (n,) [m] of rays points + s direction, s >= 0, to a finger's segment."""
    axis = finger.end - finger.start
    length = float(axis @ axis)
    between = points - finger.start
    d_axis = float(direction @ axis)
    p_axis, p_direction = between @ axis, between @ direction
    denominator = length - d_axis**2
    safe = denominator if abs(denominator) > 1e-15 else 1.0
    along_ray = (d_axis * p_axis - length * p_direction) / safe
    along_ray = np.where(abs(denominator) > 1e-15, along_ray, -p_direction)
    for _ in range(2):
        share = np.clip((p_axis + along_ray * d_axis) / (length or 1.0), 0.0, 1.0)
        along_ray = np.maximum(0.0, share * d_axis - p_direction)
    gap = between + along_ray[:, None] * direction - share[:, None] * axis
    return np.linalg.norm(gap, axis=1)
