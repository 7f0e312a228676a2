# SPDX-License-Identifier: Apache-2.0
"""Whether the contacts can close a grasp by squeezing, and which friction that needs.

A grasp is force-closed where some squeeze, strictly inside all friction cones, balances itself and
the contacts resist every wrench (Murray, Li & Sastry, A mathematical introduction to robotic
manipulation, 1994, prop. 5.3). Both are questions about points, normals and friction alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.cone import ConeError, solve_cone
from shell_deform.grasp.contacts import (
    FORCES,
    GraspContacts,
    contact_wrenches,
    cross,
    size_of,
    tangents,
    why_open,
)

Array = NDArray[np.float64]

STEEPEST = 20.0
"""Friction beyond which no squeeze counts: 87 degrees."""

STEEPENING = 4.0
"""Where a share of the friction balances nothing, so many times as much is tried."""

NARROWED = 1e-6
"""A margin of less than this share of a cone is taken away by one last step of Newton."""

ROUGHLY = 3e-3
"""Relative width of `nearly_needed`."""

SMALLEST_SHARE = 1e-6
"""Less friction than this counts as none."""

LEAST_PRESSED = 1e-5
"""A contact with less of the mean push takes no part: round-off presses as much."""

MOST_NARROWINGS = 40


@dataclass(frozen=True)
class Closure:
    """What a squeeze needs.

    Attributes:
        closed: whether the grasp is force-closed at its friction.
        why: one sentence why not, empty when closed.
        needed: largest share of its friction that a contact needs under the best squeeze; below
            1 that squeeze is inside all cones. `STEEPEST` over the friction where none is.
        squeeze: (k, 4) push, two tangential forces and spin force of that squeeze, mean push 1.
        by_point: (k, 3) change of `needed` per motion of each point [1/m].
        by_normal: (k, 3) change of `needed` per turn of each normal [1/rad].
    """

    closed: bool
    why: str
    needed: float
    squeeze: Array
    by_point: Array
    by_normal: Array

    def needed_friction(self, grasp: GraspContacts) -> float:
        """Coefficient of friction that closure needs, where all contacts have the same [-]."""
        if not grasp.count or not len(self.squeeze):
            return float(STEEPEST)
        return float(min(self.needed * grasp.friction.max(), STEEPEST))


def closure(grasp: GraspContacts, guess: float | None = None) -> Closure:
    """Closure of k contacts by an exact programme over their friction cones.

    `guess`: `needed` of a similar grasp, which saves time. The spin that a contact carries is
    friction times push times its arm. A contact that does not press is none.
    """
    pressing = grasp.pressing
    if pressing.all() or pressing.sum() < 2:
        return _closure(grasp, guess)
    found = _closure(grasp.chosen(pressing), guess)
    by_point, by_normal = np.zeros((2, grasp.count, 3))
    by_point[pressing], by_normal[pressing] = found.by_point, found.by_normal
    squeeze = np.zeros((grasp.count if len(found.squeeze) else 0, FORCES))
    if len(squeeze):
        squeeze[pressing] = found.squeeze
    return replace(found, squeeze=squeeze, by_point=by_point, by_normal=by_normal)


def nearly_needed(grasp: GraspContacts, guess: float) -> float:
    """`Closure.needed` of contacts that all press, to `ROUGHLY` of it; infinite if none would do.

    `guess`: that of a similar grasp.
    """
    found = _narrowed(_frictional(grasp), guess, STEEPEST / grasp.friction.max(), ROUGHLY)
    return np.inf if found is None else found[0]


def _closure(grasp: GraspContacts, guess: float | None) -> Closure:
    """`closure` of contacts that all press."""
    why = why_open(grasp)
    nothing = np.zeros((grasp.count, 3))
    if grasp.pressing.sum() < 2 or np.any(grasp.friction <= 0.0):
        return Closure(False, why, float(STEEPEST), np.zeros((0, FORCES)), nothing, nothing)
    if 'one place' in why:
        return Closure(False, why, float(STEEPEST), np.zeros((0, FORCES)), nothing, nothing)
    size, wrenches = size_of(grasp), _frictional(grasp)
    steepest = float(STEEPEST / grasp.friction.max())
    found = _narrowed(wrenches, guess, steepest)
    if found is None:
        why = why or 'the contacts cannot balance a squeeze, whatever the friction'
        return Closure(False, why, steepest, np.zeros((0, FORCES)), nothing, nothing)
    needed, squeeze, multipliers, slope = found
    if not why and needed >= 1.0:
        why = 'a balanced squeeze needs more friction than there is'
    by_point, by_normal = nothing, nothing
    if needed > SMALLEST_SHARE:
        by_point, by_normal = _sensitivity(grasp, slope, squeeze, multipliers, size)
    forces = squeeze.copy()
    forces[:, 1:] *= grasp.friction[:, None]
    return Closure(not why, why, needed, forces, by_point, by_normal)


def _frictional(grasp: GraspContacts) -> Array:
    """(6, k, 4) wrenches of unit pushes and of the friction of unit pushes, lengths over size."""
    wrenches = contact_wrenches(grasp, grasp.point.mean(axis=0), size_of(grasp))
    wrenches[:, :, 1:] *= grasp.friction[None, :, None]
    return wrenches


def _narrowed(
    wrenches: Array, guess: float | None, steepest: float, narrow: float = NARROWED
) -> tuple[float, Array, Array, float] | None:
    """Least share of friction, squeeze (k, 4), multipliers (7,), slope; None where there is none.

    The margin at a share gives a squeeze, and the squeeze its own share, which is never too small
    (Dinkelbach, Manage. Sci. 13(7):492, 1967). Newton's step on the margin goes farther; where it
    leaves what is known to be too small or large, a place between is tried, nearer to the small
    one each time because Newton's steps end nearer to the answer each time.
    """
    share = min(steepest, 1.0 if guess is None else guess * (1.0 + 1e-4) + SMALLEST_SHARE)
    low, best, between, lost = 0.0, None, 0.5, False
    for _ in range(MOST_NARROWINGS):
        found = _squeezed(wrenches, share)
        if found is None:
            low = share
            if best is None:
                if share >= steepest:
                    return None
                share = min(STEEPENING * share, steepest)
                continue
        else:
            margin, squeeze, multipliers = found
            pushes = squeeze[:, 0]
            slope = _slope(wrenches, squeeze, multipliers, share)
            if abs(margin) <= narrow * pushes.min():
                return share - margin / slope, squeeze, multipliers, slope
            if margin < 0.0:
                if share >= steepest:
                    return None
                low = share
            own = float((np.linalg.norm(squeeze[:, 1:], axis=1) / pushes).max())
            if best is None or own < best[0]:
                best = own, squeeze, multipliers, slope
            if own < SMALLEST_SHARE:
                break
            steeper = 1.0 + margin / (slope * share)
            share = min(share / steeper, best[0]) if steeper > 0.0 else best[0]
        if best[0] - low <= narrow * best[0]:
            break
        between = 0.5 if found is None and lost else between
        lost = found is None
        if lost or not share > low:
            share = low + between * (best[0] - low)
            between = between**2
        share = min(share, steepest)
    return best


def _slope(wrenches: Array, squeeze: Array, multipliers: Array, share: float) -> float:
    """Growth of the margin with the share of friction, by the multipliers of the optimum."""
    return max(-float(multipliers[:6] @ wrenches[:, :, 0] @ squeeze[:, 0]) / share, 1e-12)


def _squeezed(wrenches: Array, share: float) -> tuple[float, Array, Array] | None:
    """`_widest` where every contact presses, otherwise None.

    Contacts that lie outside their cones whatever they do leave the others a margin of exactly
    zero at any share of their friction: the squeeze is then theirs, and says nothing of the grasp.
    A programme without end is one whose contacts pull as hard as others push.
    """
    try:
        found = _widest(wrenches, share)
    except ConeError:
        return None
    return found if found[1][:, 0].min() > LEAST_PRESSED else None


def _widest(wrenches: Array, share: float) -> tuple[float, Array, Array]:
    """Squeeze (k, 4) of mean push 1 with the largest margin m = min(N - |T| / share).

    Unknown are the cones (N - m, T / share) and 1 - m, which is never negative.
    """
    count = wrenches.shape[1]
    matrix = np.zeros((7, FORCES * count + 1))
    matrix[:6, :-1] = wrenches.reshape(6, -1) * np.tile([1.0, share, share, share], count)
    pushes = wrenches[:, :, 0].sum(axis=1)
    matrix[:6, -1] = -pushes
    matrix[6, :-1:FORCES] = 1.0
    matrix[6, -1] = -count
    right = np.append(-pushes, 0.0)
    cost = np.zeros(FORCES * count + 1)
    cost[-1] = 1.0
    x, y = solve_cone(cost, matrix, right, count)
    squeeze = x[:-1].reshape(count, FORCES).copy()
    squeeze[:, 0] += 1.0 - x[-1]
    squeeze[:, 1:] *= share
    return 1.0 - float(x[-1]), squeeze, y


def _sensitivity(
    grasp: GraspContacts, slope: float, squeeze: Array, multipliers: Array, size: float
) -> tuple[Array, Array]:
    """Change of the needed share with points and normals, by the multipliers of the optimum.

    With z the multipliers of the balance, the margin changes by z dW f; what takes it back is a
    change of the share by minus that over `slope`, the growth of the margin with the share.
    """
    first, second = tangents(grasp.normal)
    across = grasp.friction[:, None] * squeeze[:, 1:]
    force = squeeze[:, :1] * grasp.normal + across[:, :1] * first + across[:, 1:2] * second
    z_force, z_moment = multipliers[:3], multipliers[3:6] / size
    offset = grasp.point - grasp.point.mean(axis=0)
    velocity = z_force + cross(z_moment, offset)
    by_point = cross(force, z_moment)
    by_normal = cross(force, velocity)
    by_normal += (grasp.arm * across[:, 2])[:, None] * cross(grasp.normal, z_moment)
    return -by_point / slope, -by_normal / slope
