# SPDX-License-Identifier: Apache-2.0
"""How sure closure is: its probability under the sigmas of points, normals and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import erf, sqrt

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.closure import SMALLEST_SHARE, Closure, nearly_needed
from shell_deform.grasp.contacts import GraspContacts, cross, size_of

Array = NDArray[np.float64]

LEAST_SIGMA = 1e-12

LEAST_GUESS = 0.2
DRAWS = 64
"""Grasps with other points and normals in which more than two contacts are looked at."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


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

    Two contacts close where both cones hold the line between them: two events that have points
    and friction in common. With more, what closure needs has kinks, and those of grasps that are
    alike on all sides meet at the grasp itself: it is drawn. Of each draw of points and normals
    the friction decides by its own distribution.
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
    return float(np.mean([normal_share(one) for one in away.tolist()]))


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
    """Both angles between the line of the contacts and the normals below the friction angles."""
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
    wobble = sigmas.normal**2 + turn
    # A turn across the angle can only widen it: on average by half its square over the tangent.
    angle = angle + wobble / (2.0 * np.maximum(np.tan(angle), np.sqrt(wobble) + LEAST_SIGMA))
    room = np.arctan(grasp.friction) - angle
    slack = sigmas.friction * grasp.friction / (1.0 + grasp.friction**2)
    # A turn of the line that widens one angle widens the other where both lean the same way.
    common = -float(towards[0] @ towards[1]) * turn + float(slack[0] * slack[1])
    variance = wobble + slack**2
    sigma = np.maximum(np.sqrt(variance), LEAST_SIGMA)
    return both_below(room[0] / sigma[0], room[1] / sigma[1], common / (sigma[0] * sigma[1]))


def normal_share(value: float) -> float:
    """Share of a standard normal variable below `value`."""
    return 0.5 * (1.0 + erf(value / sqrt(2.0)))


def both_below(a: float, b: float, correlation: float) -> float:
    """Probability that two standard normal variables lie below a and b.

    Plackett's identity (Biometrika 41:351, 1954): its derivative with the correlation is the
    density, here integrated over the arc sine of it.
    """
    end = float(np.arcsin(np.clip(correlation, -0.999999, 0.999999)))
    angle = 0.5 * end * (NODES + 1.0)
    density = np.exp(-(a * a + b * b - 2.0 * a * b * np.sin(angle)) / (2.0 * np.cos(angle) ** 2))
    share = normal_share(a) * normal_share(b)
    return float(np.clip(share + 0.5 * end * (WEIGHTS @ density) / (2.0 * np.pi), 0.0, 1.0))
