# SPDX-License-Identifier: Apache-2.0
"""Random grasps of an object: where the fingers touch and along which lines they close."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.surface.frames import lateral_vectors

Array = NDArray[np.float64]

HANDS = {'two_pins': 2, 'three_pins': 3, 'two_fingertips': 2, 'three_fingertips': 3}
"""Fingers of a hand: two that close on one line, or three that close on one point."""
FINGERTIPS = ('two_fingertips', 'three_fingertips')

ATTEMPTS = 200
THINNEST = 1e-6
"""Two places nearer than this [m] are one."""


class SamplingError(ValueError):
    """No grasp can be sampled; the text says of what."""


@dataclass(frozen=True)
class SampledGrasp:
    """Places (k, 3) [m] on the undeformed middle surface and directions (k, 3) of the pushes.

    `along` (3,): the way to the tips of all fingers, across their pushes.
    """

    at: Array
    axis: Array
    along: Array


def sample_grasp(
    points: Array, triangles: NDArray[np.int64], hand: str, lean: float, key: tuple[int, int]
) -> SampledGrasp:
    """The grasp that belongs to `key` (seed, number), and to no other circumstance.

    Two pins: a place even over the surface, a line within `lean` [rad] of the normal there, and
    where it leaves the object. Three pins: their lines 120 degrees apart in a plane through the
    middle of such a line. Raises SamplingError where no line leaves the surface again.
    """
    rng = np.random.default_rng(key)
    corners = points[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    for _ in range(ATTEMPTS):
        number = int(rng.choice(len(area), p=area / area.sum()))
        u, v = rng.random(2)
        u, v = (1.0 - u, 1.0 - v) if u + v > 1.0 else (u, v)
        edges = corners[number, 1:] - corners[number, 0]
        place = corners[number, 0] + u * edges[0] + v * edges[1]
        line = _leaning(rng, -cross[number] / area[number], lean)
        far = _leaves(corners, place, line)
        if far is None:
            continue
        if HANDS[hand] == 2:
            along = _across(rng, line)
            return SampledGrasp(np.stack([place, far]), np.stack([line, -line]), along)
        found = _three(rng, corners, 0.5 * (place + far), line)
        if found is not None:
            return found
    raise SamplingError(f'no line through the object meets its surface twice in {ATTEMPTS} tries')


def _leaning(rng: np.random.Generator, direction: Array, lean: float) -> Array:
    """A direction within `lean` of another, even over that cone."""
    cosine = 1.0 - rng.random() * (1.0 - np.cos(lean))
    turn = 2.0 * np.pi * rng.random()
    first, second = lateral_vectors(direction)
    across = np.cos(turn) * first + np.sin(turn) * second
    return np.asarray(cosine * direction + np.sqrt(1.0 - cosine * cosine) * across)


def _three(
    rng: np.random.Generator, corners: Array, middle: Array, line: Array
) -> SampledGrasp | None:
    """Three pins that close on `middle`, the first against `line`."""
    normal = _across(rng, line)
    places, axes = [], []
    for turn in np.radians([0.0, 120.0, 240.0]):
        outward = -np.cos(turn) * line + np.sin(turn) * np.cross(normal, line)
        found = _leaves(corners, middle, outward)
        if found is None:
            return None
        places.append(found)
        axes.append(-outward)
    return SampledGrasp(np.stack(places), np.stack(axes), normal)


def _across(rng: np.random.Generator, line: Array) -> Array:
    """A random unit vector across a line."""
    normal = _leaning(rng, line, np.pi)
    normal -= (normal @ line) * line
    return np.asarray(normal / np.linalg.norm(normal))


def _leaves(corners: Array, start: Array, line: Array) -> Array | None:
    """Farthest point (3,) where a line from `start` (3,) meets triangles (m, 3, 3), or None.

    Moeller & Trumbore, J. Graph. Tools 2(1):21 (1997), for all triangles at once.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(line, second)
    scale = np.einsum('mi,mi->m', first, across)
    usable = np.abs(scale) > 1e-18
    inverse = 1.0 / np.where(usable, scale, 1.0)
    away = start - corners[:, 0]
    u = inverse * np.einsum('mi,mi->m', away, across)
    other = np.cross(away, first)
    v = inverse * (other @ line)
    reach = inverse * np.einsum('mi,mi->m', second, other)
    meets = usable & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (reach > THINNEST)
    return start + float(reach[meets].max()) * line if meets.any() else None
