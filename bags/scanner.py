# SPDX-License-Identifier: Apache-2.0
"""A desktop laser scanner, simulated: views, noise along the ray, occlusion, merging, thinning.

Modelled on the NextEngine in its Macro mode, whose stated accuracy is 0.127 mm; an independent
measurement found +-0.81 mm (Polo and Felicisimo, Sensors 2012, 12, 9046). Working distance,
baseline and sampling are assumptions, stated in every recording. Each error source can be
switched off by itself, so that an error budget can be made from the same seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bags.calculix import Array
from bags.surfaces import Surface


@dataclass(frozen=True)
class ErrorSources:
    """Which errors the simulated scanner makes."""

    noise: bool = True
    lateral: bool = True
    incidence: bool = True
    occlusion: bool = True
    registration: bool = True
    placement: bool = True


@dataclass(frozen=True)
class View:
    """One look at the object, from a direction given in the frame of the surface."""

    azimuth_deg: float
    elevation_deg: float


@dataclass(frozen=True)
class Scanner:
    """What the simulated scanner is like (m and degrees).

    `density`: points a view samples on a square of the pitch; fewer where they are thinned anyway.

    What no estimator knows of, none by default: an error that all points of a laser line share
    (`line_sigma_m`, a line every `line_pitch_m`), points that fly off by `fringe_m` (a share of
    those seen, the steepest first), and a share of lines that are lost.
    """

    working_distance_m: float = 0.17
    baseline_m: float = 0.08
    pitch_m: float = 0.00025
    density: float = 1.0
    noise_sigma_m: float = 0.000127
    steepest_incidence_deg: float = 67.5
    registration_sigma_m: float = 0.00005
    registration_sigma_deg: float = 0.05
    placement_sigma_m: float = 0.0005
    placement_sigma_deg: float = 0.5
    most_points: int = 60000
    line_sigma_m: float = 0.0
    line_pitch_m: float = 0.001
    fringe_share: float = 0.0
    fringe_m: float = 0.0003
    missing_lines: float = 0.0
    errors: ErrorSources = field(default_factory=ErrorSources)


@dataclass(frozen=True)
class Obstacle:
    """A finger link or a pin: a capsule about the segment from `start` to `end` (m)."""

    start: Array
    end: Array
    radius_m: float


@dataclass(frozen=True)
class Scan:
    """A merged scan.

    `points` (n, 3) as the scanner reports them, float32; `true_points` the same points without
    any error, in the frame of the object's truth; `view` the view of each point. `placement` is
    the hidden rigid error (rotation, shift) of the whole scan: reported = R x + t.
    """

    points: np.ndarray
    true_points: Array
    view: np.ndarray
    placement_rotation: Array
    placement_shift: Array


def generator(seed: int, *path: int) -> np.random.Generator:
    """An independent random stream for every (seed, path)."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *path])))


def scan(
    surface: Surface,
    views: list[View],
    obstacles: list[Obstacle],
    centre: Array,
    scanner: Scanner,
    seed: int,
) -> Scan:
    """Scan a surface from several views about `centre`, merge the views and thin them.

    Deterministic by `seed`. Raises ValueError when no point is seen at all.
    """
    errors = scanner.errors
    parts, trues, which = [], [], []
    for number, view in enumerate(views):
        random = generator(seed, number)
        true, reported = _one_view(surface, view, obstacles, centre, scanner, random)
        if errors.registration:
            turn = _small_rotation(random, scanner.registration_sigma_deg)
            shift = random.normal(0.0, scanner.registration_sigma_m, 3)
            reported = (reported - centre) @ turn.T + centre + shift
        parts.append(reported)
        trues.append(true)
        which.append(np.full(len(true), number, dtype=np.uint8))
    points, true_points = np.concatenate(parts), np.concatenate(trues)
    view_of = np.concatenate(which)
    if not len(points):
        raise ValueError('the scanner sees no point of the surface: check views and obstacles')
    kept = thinned(points, scanner.most_points, generator(seed, 1000))
    turn, shift = np.eye(3), np.zeros(3)
    if errors.placement:
        random = generator(seed, 1001)
        turn = _small_rotation(random, scanner.placement_sigma_deg)
        shift = random.normal(0.0, scanner.placement_sigma_m, 3) + centre - turn @ centre
    placed = points[kept] @ turn.T + shift
    return Scan(placed.astype(np.float32), true_points[kept], view_of[kept], turn, shift)


def _small_rotation(random: np.random.Generator, sigma_deg: float) -> Array:
    """Rotation by a vector of normal angles, Rodrigues' formula."""
    vector = np.radians(random.normal(0.0, sigma_deg, 3))
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-300)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def directions(view: View) -> tuple[Array, Array]:
    """Unit vectors from the object to the camera, and sideways to the laser."""
    azimuth, elevation = np.radians([view.azimuth_deg, view.elevation_deg])
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    return towards, np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])


def _one_view(
    surface: Surface,
    view: View,
    obstacles: list[Obstacle],
    centre: Array,
    scanner: Scanner,
    random: np.random.Generator,
) -> tuple[Array, Array]:
    errors = scanner.errors
    towards, sideways = directions(view)
    camera = centre + scanner.working_distance_m * towards
    laser = camera + scanner.baseline_m * sideways
    points, normals = sample(surface, scanner.pitch_m / np.sqrt(scanner.density), random)
    ray = camera - points
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    to_laser = laser - points
    to_laser /= np.linalg.norm(to_laser, axis=1, keepdims=True)
    cosine = np.einsum('nd,nd->n', ray, normals)
    laser_cosine = np.einsum('nd,nd->n', to_laser, normals)
    # The image grid sees a slanted face with fewer points per area.
    seen = (cosine > 0.05) & (laser_cosine > 0.05) & (random.random(len(points)) < cosine)
    if errors.incidence:
        steepest = np.cos(np.radians(scanner.steepest_incidence_deg))
        seen &= (cosine > steepest) & (laser_cosine > steepest)
    if errors.occlusion:
        for eye, slant in ((camera, cosine), (laser, laser_cosine)):
            seen &= in_front(points, slant, eye)
            index = np.flatnonzero(seen)
            for obstacle in obstacles:
                hidden = behind(points[index], eye, obstacle)
                seen[index[hidden]] = False
                index = index[~hidden]
    line = np.floor(points @ sideways / scanner.line_pitch_m).astype(int)
    line -= line.min()
    if scanner.missing_lines:
        seen &= random.random(int(line.max()) + 1)[line] >= scanner.missing_lines
    true = points[seen]
    reported = true.copy()
    if errors.lateral:
        up = np.cross(towards, sideways)
        offsets = random.uniform(-0.5, 0.5, (len(true), 2)) * scanner.pitch_m
        reported += offsets[:, :1] * sideways + offsets[:, 1:] * up
    if errors.noise:
        along = random.normal(0.0, 1.0, len(true)) * scanner.noise_sigma_m / cosine[seen]
        reported += along[:, None] * ray[seen]
    if scanner.line_sigma_m:
        shared = random.normal(0.0, scanner.line_sigma_m, int(line.max()) + 1)
        reported += shared[line[seen], None] * ray[seen]
    if scanner.fringe_share and len(true):
        steep = np.argsort(cosine[seen])[: int(scanner.fringe_share * len(true))]
        reported[steep] += scanner.fringe_m * ray[seen][steep]
    return true, reported


MISFITS = {
    'views': Scanner(registration_sigma_m=0.0001, registration_sigma_deg=0.1),
    'lines': Scanner(line_sigma_m=0.00005),
    'fringes': Scanner(fringe_share=0.05, missing_lines=0.33),
}
"""Scanners that no estimator knows: views laid on each other twice as badly; noise that a laser
line shares; fringes at steep places and lost lines."""


def sample(surface: Surface, pitch: float, random: np.random.Generator) -> tuple[Array, Array]:
    """Points spread evenly by area, one per pitch^2, with interpolated unit normals."""
    corners = surface.vertices[surface.faces]
    double = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    cumulative = np.cumsum(double / 2)
    count = int(cumulative[-1] / pitch**2)
    face = np.searchsorted(cumulative, random.random(count) * cumulative[-1])
    face = np.minimum(face, len(double) - 1)
    root, second = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1 - root, root * (1 - second), root * second], axis=1)
    points = np.einsum('nc,ncd->nd', weights, corners[face])
    normals = np.einsum('nc,ncd->nd', weights, surface.normals[surface.faces[face]])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def in_front(points: Array, cosine: Array, eye: Array, cell: float = 0.004) -> Array:
    """Which points the surface itself does not hide from `eye`, by a depth buffer.

    `cell` is the buffer's angular cell in rad (0.7 mm at 0.17 m); a slanted face may lie behind
    its own cell by the cell times the tangent of the incidence.
    """
    relative = points - eye
    depth = np.linalg.norm(relative, axis=1)
    axis = relative.mean(axis=0)
    axis /= np.linalg.norm(axis)
    first = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    forward = relative @ axis
    column = np.floor(relative @ first / forward / cell).astype(int)
    row = np.floor(relative @ second / forward / cell).astype(int)
    column -= column.min()
    key = (row - row.min()) * (column.max() + 1) + column
    nearest = np.full(key.max() + 1, np.inf)
    np.minimum.at(nearest, key, depth)
    slope = np.sqrt(1 - np.minimum(cosine, 1.0) ** 2) / np.maximum(cosine, 0.05)
    return depth <= nearest[key] + 0.0005 + cell * depth * slope


def behind(points: Array, eye: Array, obstacle: Obstacle) -> np.ndarray:
    """Which points an obstacle hides from `eye`: the sight line passes within its radius."""
    sight = eye - points
    along = obstacle.end - obstacle.start
    between = points - obstacle.start
    a = np.einsum('nd,nd->n', sight, sight)
    b = sight @ along
    c = float(along @ along)
    d = np.einsum('nd,nd->n', sight, between)
    e = between @ along
    determinant = np.maximum(a * c - b * b, 1e-18)
    s = np.clip((b * e - c * d) / determinant, 0.0, 1.0)
    t = np.clip((b * s + e) / max(c, 1e-18), 0.0, 1.0)
    s = np.clip((b * t - d) / a, 0.0, 1.0)
    gap = between + s[:, None] * sight - t[:, None] * along
    return np.einsum('nd,nd->n', gap, gap) < obstacle.radius_m**2


def thinned(points: Array, most: int, random: np.random.Generator) -> np.ndarray:
    """Indices of at most `most` points, evenly spread: one per cubic cell, drawn at random.

    No averaging, so the noise of every kept point stays what the scanner made it.
    """
    if len(points) <= most:
        return np.arange(len(points))
    order = random.permutation(len(points))
    shuffled = points[order]
    low, high = 1e-5, 0.01
    for _ in range(30):
        cell = np.sqrt(low * high)
        first = _first_per_cell(shuffled, cell)
        low, high = (cell, high) if len(first) > most else (low, cell)
        if most * 0.98 <= len(first) <= most:
            break
    first = _first_per_cell(shuffled, high) if len(first) > most else first
    return np.sort(order[first])


def _first_per_cell(points: Array, cell: float) -> np.ndarray:
    cells = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    span = cells.max(axis=0) + 1
    key = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
    return np.unique(key, return_index=True)[1]
