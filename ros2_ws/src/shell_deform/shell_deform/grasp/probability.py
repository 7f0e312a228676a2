# SPDX-License-Identifier: Apache-2.0
"""How sure closure is: its probability under the sigmas of points, normals and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from shell_deform.grasp.closure import SMALLEST_SHARE, Closure, nearly_needed
from shell_deform.grasp.contacts import GraspContacts, cross, size_of

Array = NDArray[np.float64]

LEAST_SIGMA = 1e-12

LEAST_GUESS = 0.2
DRAWS = 64
"""Grasps with other points and normals in which more than two contacts are looked at."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)

FARTHEST = 6.0
"""Sigmas from the mean of a normal variable beyond which nothing is looked at."""

UPRIGHT = 1.57
"""A contact that leans farther from the line of two [rad] needs more friction than there is."""


@dataclass(frozen=True)
class Sigmas:
    """Standard deviations of what closure depends on, independent of each other.

    Attributes:
        point: (k,) of each coordinate of each point [m]. normal: (k,) of its turn about each of
            two axes across it [rad].
        friction: common to all contacts, as a share of their friction [-].
    """

    point: Array
    normal: Array
    friction: float


def closure_sigma(grasp: GraspContacts, found: Closure, sigmas: Sigmas) -> float:
    """Sigma of `Closure.needed` [-], to first order.

    Where nothing is needed it has no slopes: any turn of a normal or of the lines between the
    contacts makes it grow by the angle over the friction.
    """
    if found.needed > SMALLEST_SHARE or not grasp.count:
        turn = found.by_normal
        # A normal that turns about itself changes nothing.
        turn = turn - np.einsum('ki,ki->k', turn, grasp.normal)[:, None] * grasp.normal
        return float(
            np.sqrt(
                np.sum((found.by_point * sigmas.point[:, None]) ** 2)
                + np.sum((turn * sigmas.normal[:, None]) ** 2)
                + (found.needed * sigmas.friction) ** 2
            )
        )
    turns = sigmas.normal**2 + (sigmas.point / size_of(grasp)) ** 2
    return float(np.sqrt(turns.mean())) / max(float(grasp.friction.min()), LEAST_SIGMA)


def closure_probability(grasp: GraspContacts, found: Closure, sigmas: Sigmas) -> float:
    """Probability that the grasp is force-closed [-].

    Two contacts close where both cones hold the line between them, which is integrated. With more,
    what closure needs has kinks, and those of grasps that are alike on all sides meet at the grasp
    itself: it is drawn. Of each draw of points and normals the friction decides by its own
    distribution.
    """
    if not len(found.squeeze) or (found.why and found.needed < 1.0):
        return 0.0
    grasp, sigmas = pressing_part(grasp, sigmas)
    if grasp.count == 2:
        return _of_two(grasp, sigmas)
    needed = [drawn_needed(grasp, sigmas, number, found.needed) for number in range(DRAWS)]
    return share_closed(np.array(needed), sigmas.friction)


def pressing_part(grasp: GraspContacts, sigmas: Sigmas) -> tuple[GraspContacts, Sigmas]:
    """The contacts that press, and their sigmas."""
    pressing = grasp.pressing
    if pressing.all():
        return grasp, sigmas
    own = Sigmas(sigmas.point[pressing], sigmas.normal[pressing], sigmas.friction)
    return grasp.chosen(pressing), own


def drawn_needed(grasp: GraspContacts, sigmas: Sigmas, number: int, guess: float) -> float:
    """`Closure.needed` of contacts that all press, with draw `number` of their errors.

    `guess`: that without errors.
    """
    unit = _units(grasp.count)[number]
    turned = grasp.normal + cross(sigmas.normal[:, None] * unit[:, 3:], grasp.normal)
    length = np.sqrt(np.einsum('ki,ki->k', turned, turned))
    moved = replace(
        grasp,
        point=grasp.point + sigmas.point[:, None] * unit[:, :3],
        normal=turned / length[:, None],
    )
    # From far below, where nothing balances, the search would begin with many failures.
    return nearly_needed(moved, max(guess, LEAST_GUESS))


def share_closed(needed: Array, friction: float) -> float:
    """Share of draws (d,) closed by a friction with relative sigma `friction`."""
    away = (1.0 - np.minimum(needed, 1.0 / LEAST_SIGMA)) / max(friction, LEAST_SIGMA)
    return float(np.mean(ndtr(away)))


@lru_cache(maxsize=8)
def _units(count: int) -> Array:
    """(d, k, 6) standard normal draws, always the same; mean 0 and covariance exactly 1.

    In pairs of opposite sign, so that what is of first order in them cancels.
    """
    half = np.random.default_rng(count).normal(size=(max(DRAWS // 2, 6 * count), 6 * count))
    values, vectors = np.linalg.eigh(half.T @ half / len(half))
    half = half @ (vectors / np.sqrt(values)) @ vectors.T
    half = half[: DRAWS // 2]
    return np.concatenate([half, -half]).reshape(-1, count, 6)


def _of_two(grasp: GraspContacts, sigmas: Sigmas) -> float:
    """Both normals within the friction angles of the line of the contacts, where both squeeze.

    Integrated over the friction that they have in common: at each the two have only the turn of
    their line in common.
    """
    line = grasp.point[1] - grasp.point[0]
    length = float(np.linalg.norm(line))
    line = line / length
    along = np.array([1.0, -1.0]) * (grasp.normal @ line)
    # Fingers inside a ring push it apart: the squeeze is then a pull along the line.
    along = along if along.sum() >= 0.0 else -along
    towards = grasp.normal - (grasp.normal @ line)[:, None] * line
    across = np.linalg.norm(towards, axis=1)
    angle = np.arctan2(across, along)
    towards /= np.where(across > 0.0, across, 1.0)[:, None]
    turn = float(sigmas.point @ sigmas.point) / length**2
    wobble = np.sqrt(sigmas.normal**2 + turn) + LEAST_SIGMA
    spread = max(sigmas.friction, LEAST_SIGMA)
    steep = np.tan(np.minimum(angle, UPRIGHT)) / grasp.friction
    away, weight = _around((steep - 1.0) / spread)
    limit = np.arctan(np.maximum(grasp.friction[:, None] * (1.0 + spread * away), 0.0))
    inside = [share_within(*one) for one in zip(angle, wobble, limit, strict=True)]
    # A turn of the line that widens one angle widens the other where both lean the same way.
    common = -float(towards[0] @ towards[1]) * turn / float(wobble[0] * wobble[1])
    if abs(common) < LEAST_SIGMA:
        return float(np.clip(weight @ (inside[0] * inside[1]), 0.0, 1.0))
    first, second = ndtri(np.clip(inside, LEAST_SIGMA, 1.0 - LEAST_SIGMA))
    return float(np.clip(weight @ both_below(first, second, common), 0.0, 1.0))


def _around(edges: Array) -> tuple[Array, Array]:
    """Values (n,) of a standard normal variable and their weights, densest beside `edges` (e,)."""
    cuts = np.concatenate([[-FARTHEST], np.sort(np.clip(edges, -FARTHEST, FARTHEST)), [FARTHEST]])
    half = 0.5 * np.diff(cuts)[:, None]
    value = (cuts[:-1, None] + half * (NODES + 1.0)).ravel()
    return value, (half * WEIGHTS).ravel() * _density(value)


def share_within(angle: float, wobble: float, limit: Array) -> Array:
    """(n,) share of unit vectors within `limit` (n,) of a line, below a right angle.

    Their mean is `angle` from the line; they turn by `wobble` about each of two axes across it.
    All in rad. In the plane across the mean, where the turns lie, the cone about the line is a
    conic: at each turn across it a share of a normal variable.
    """
    sine, cosine, edge = np.sin(angle), np.cos(angle), np.cos(limit)[:, None]
    narrow = edge**2 - sine**2
    closed = narrow > LEAST_SIGMA
    widest = np.sin(limit)[:, None] / np.sqrt(np.where(closed, narrow, 1.0))
    half = np.minimum(np.where(closed, widest, np.inf) / wobble, FARTHEST)
    turn = 0.5 * half * (NODES + 1.0)
    square = 1.0 + (wobble * turn) ** 2
    root = edge * np.sqrt(np.maximum(cosine**2 - narrow * square, 0.0))
    above, below = sine * cosine + root, sine * cosine - root
    # The smaller end from the larger one, which loses nothing to cancellation.
    room = cosine**2 - edge**2 * square
    with np.errstate(all='ignore'):
        upper = np.where(closed, above / narrow, np.inf)
        lower = np.where(sine * cosine > 0.0, -room / above, below / narrow)
    # Behind a right angle the cone of a closed conic is that of the line the other way.
    lower = np.where(np.isfinite(lower) & ~(closed & (cosine < 0.0)), lower, np.inf)
    share = np.maximum(ndtr(upper / wobble) - ndtr(lower / wobble), 0.0)
    return np.asarray((half * share * _density(turn)) @ WEIGHTS)


def _density(value: Array) -> Array:
    """Of a standard normal variable."""
    return np.asarray(np.exp(-0.5 * value**2) / sqrt(2.0 * pi))


def both_below(a: Array, b: Array, correlation: float) -> Array:
    """Probability that two standard normal variables lie below a and b, elementwise.

    Plackett's identity (Biometrika 41:351, 1954): its derivative with the correlation is the
    density, here integrated over the arc sine of it.
    """
    end = float(np.arcsin(np.clip(correlation, -0.999999, 0.999999)))
    angle = 0.5 * end * (NODES + 1.0)
    here, there = np.asarray(a)[..., None], np.asarray(b)[..., None]
    square = here**2 + there**2 - 2.0 * here * there * np.sin(angle)
    density = np.exp(-square / (2.0 * np.cos(angle) ** 2)) @ WEIGHTS
    return np.asarray(np.clip(ndtr(a) * ndtr(b) + end * density / (4.0 * pi), 0.0, 1.0))
