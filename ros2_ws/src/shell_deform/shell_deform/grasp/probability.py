# SPDX-License-Identifier: Apache-2.0
"""How sure closure is: its probability under the sigmas of points, normals and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import erf, sqrt

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.closure import SMALLEST_SHARE, Closure, closure
from shell_deform.grasp.contacts import GraspContacts, cross, size_of

Array = NDArray[np.float64]

LEAST_SIGMA = 1e-12

CERTAIN = 4.0
"""Sigmas between a grasp and the edge of closure beyond which nothing is looked at closer."""

FARTHEST_LOOK = 2.5
"""Sigmas from a grasp beyond which no other is looked at."""

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
    """Sigma of `Closure.needed` [-].

    Where nothing is needed it has no slopes: any turn of a normal or of the lines between the
    contacts makes it grow by the angle over the friction.
    """
    slopes = _Slopes.of(grasp, found, sigmas)
    if found.needed > SMALLEST_SHARE or not grasp.count:
        return slopes.size
    turn = sigmas.normal**2 + (sigmas.point / size_of(grasp)) ** 2
    return float(np.sqrt(turn.mean())) / max(float(grasp.friction.min()), LEAST_SIGMA)


def closure_probability(grasp: GraspContacts, found: Closure, sigmas: Sigmas) -> float:
    """Probability that the grasp is force-closed [-].

    Two contacts close where both cones hold the line between them: two events that have points
    and friction in common. With more contacts all cones tighten together: the probability is that
    of the side of a plane, which touches the edge of closure where it is likeliest to be met
    (first-order reliability, Hasofer & Lind, J. Eng. Mech. 100(1):111, 1974).
    """
    if not len(found.squeeze) or (found.why and found.needed < 1.0):
        return 0.0
    pressing = grasp.pressing
    if not pressing.all():
        parts = (found.squeeze, found.by_point, found.by_normal)
        squeeze, by_point, by_normal = (part[pressing] for part in parts)
        grasp = grasp.chosen(pressing)
        found = replace(found, squeeze=squeeze, by_point=by_point, by_normal=by_normal)
        sigmas = Sigmas(sigmas.point[pressing], sigmas.normal[pressing], sigmas.friction)
    if grasp.count == 2:
        return _of_two(grasp, sigmas)
    far = (1.0 - found.needed) / max(closure_sigma(grasp, found, sigmas), LEAST_SIGMA)
    slopes = _Slopes.of(grasp, found, sigmas)
    if abs(far) < CERTAIN and slopes.size > 0.0:
        far = _at_the_edge(grasp, slopes, sigmas, far)
    return normal_share(far)


@dataclass(frozen=True)
class _Slopes:
    """Change of `needed` by one sigma of each point (k, 3), normal (k, 3), and of the friction."""

    point: Array
    normal: Array
    friction: float

    @classmethod
    def of(cls, grasp: GraspContacts, found: Closure, sigmas: Sigmas) -> _Slopes:
        """Those of a grasp; a normal that turns about itself changes nothing."""
        turn = found.by_normal
        turn = turn - np.einsum('ki,ki->k', turn, grasp.normal)[:, None] * grasp.normal
        return cls(
            found.by_point * sigmas.point[:, None],
            turn * sigmas.normal[:, None],
            -found.needed * sigmas.friction,
        )

    def along(self, other: _Slopes) -> float:
        """Their inner product."""
        return float(
            np.vdot(self.point, other.point)
            + np.vdot(self.normal, other.normal)
            + self.friction * other.friction
        )

    @property
    def size(self) -> float:
        """Their length."""
        return float(np.sqrt(self.along(self)))


def _at_the_edge(grasp: GraspContacts, slopes: _Slopes, sigmas: Sigmas, far: float) -> float:
    """Distance to the edge of closure in sigmas from a second look there, `far` by the first."""
    steps = float(np.clip(far, -FARTHEST_LOOK, FARTHEST_LOOK)) / slopes.size
    turn = steps * sigmas.normal[:, None] * slopes.normal
    normal = grasp.normal + cross(turn, grasp.normal)
    there = replace(
        grasp,
        point=grasp.point + steps * sigmas.point[:, None] * slopes.point,
        normal=normal / np.linalg.norm(normal, axis=1)[:, None],
        friction=grasp.friction * max(1.0 + steps * sigmas.friction * slopes.friction, 0.0),
    )
    found = closure(there, 1.0)
    if not len(found.squeeze):
        return far
    own = _Slopes.of(there, found, sigmas)
    needed = found.needed + _lengthened(there, found, sigmas)
    return (steps * own.along(slopes) + 1.0 - needed) / max(own.size, LEAST_SIGMA)


def _lengthened(grasp: GraspContacts, found: Closure, sigmas: Sigmas) -> float:
    """What turns of the normals across the tangential force add to `needed` on average.

    They can only widen an angle: by sigma^2 / (2 tan angle), of second order.
    """
    across = np.linalg.norm(found.squeeze[:, 1:], axis=1)
    tangent = across / np.maximum(found.squeeze[:, 0], 1e-12)
    widened = sigmas.normal**2 / (2.0 * np.maximum(tangent, sigmas.normal + LEAST_SIGMA))
    return float(np.linalg.norm(found.by_normal, axis=1) @ widened)


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
