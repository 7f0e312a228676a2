# SPDX-License-Identifier: Apache-2.0
"""First slip while the fingers stand still: a load is shared out by the stiffness of the shell.

A worm drive holds its finger where it is. The object moves against the fingers by what its wall
gives, and each contact's force changes in proportion to the load; the first contact whose force
reaches its friction cone slips. What is left until all of them do is the reserve of `capacity`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.contacts import GraspContacts

Array = NDArray[np.float64]

NEVER = 1e9
"""Factor of a load that no contact feels."""

MODEL_SHARE = 0.03
"""Relative sigma of a first slip by the tangent, beside the full nonlinear solve."""


@dataclass(frozen=True)
class Sharing:
    """How fingers that stand still share out a wrench on the object, about one origin.

    Attributes:
        push: (k, 6) change of each push per unit wrench [N per N or N m].
        tangential: (k, 3, 6) of the force across the normal. spin: (k, 6) of the torque [N m].
    """

    push: Array
    tangential: Array
    spin: Array


@dataclass(frozen=True)
class Slipping:
    """What k contacts have once all of each region slips one way.

    Attributes:
        share: (k,) of its present push that each keeps [-]. arm: (k,) mean arm then [m].
    """

    share: Array
    arm: Array


def slipping_regions(grasp: GraspContacts, slipping: Slipping | None) -> GraspContacts:
    """The contacts once they slip, with the tangential forces that they have now; None: pins."""
    if slipping is None:
        return grasp
    return replace(grasp, push=slipping.share * grasp.push, arm=slipping.arm)


@dataclass(frozen=True)
class Slip:
    """What slips first, and when.

    Attributes:
        factor: multiple of the load at first slip [-], `NEVER` where none ever does.
        contact: which one slips, -1 for none.
        lost: whether it does so by losing its push.
    """

    factor: float
    contact: int
    lost: bool


def first_slip(grasp: GraspContacts, sharing: Sharing, wrench: Array) -> Slip:
    """First slip as `wrench` (6,) grows from nothing; factor 0 where a contact slips already."""
    found = first_slips(grasp, sharing, np.asarray(wrench, float)[None])
    return Slip(float(found[0][0]), int(found[1][0]), bool(found[2][0]))


def first_slips(
    grasp: GraspContacts, sharing: Sharing, wrenches: Array
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Factors, contacts and whether the push is lost, for wrenches (d, 6)."""
    if not grasp.count:
        count = len(wrenches)
        return np.zeros(count), np.full(count, -1), np.zeros(count, bool)
    return slips_along(grasp, slip_rates(grasp, sharing, wrenches))


@dataclass(frozen=True)
class SlipRates:
    """What d loads change of k contacts, made once for many pushes of the same contacts.

    Attributes:
        push: (k, d). across: (k, 4, d) of tangential force and spin over the arm, over friction.
        square: (k, d) of what both leave to the cone.
    """

    push: Array
    across: Array
    square: Array

    def along(self, loads: list[int]) -> SlipRates:
        """Of some of the loads."""
        return SlipRates(self.push[:, loads], self.across[:, :, loads], self.square[:, loads])


def slip_rates(grasp: GraspContacts, sharing: Sharing, wrenches: Array) -> SlipRates:
    """Rates of wrenches (d, 6) at contacts of the friction and arms of `grasp`."""
    safe, arm = _scales(grasp)
    push = sharing.push @ wrenches.T
    across = np.concatenate(
        [
            sharing.tangential @ wrenches.T,
            (sharing.spin @ wrenches.T / arm[:, None])[:, None],
        ],
        axis=1,
    )
    across = across / safe[:, None, None]
    return SlipRates(push, across, push**2 - np.einsum('kad,kad->kd', across, across))


def slips_along(
    grasp: GraspContacts, rates: SlipRates
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """`first_slips` from rates.

    With N = N0 + a N1 and the scaled tangential force v = v0 + a v1, slip is |v| = N: a quadratic
    equation of a for each contact.
    """
    safe, arm = _scales(grasp)
    v0 = np.concatenate([grasp.tangential, (grasp.spin / arm)[:, None]], axis=1) / safe[:, None]
    room = grasp.push**2 - np.einsum('ka,ka->k', v0, v0)
    cross = grasp.push[:, None] * rates.push - np.einsum('ka,kad->kd', v0, rates.across)
    root = cross**2 - rates.square * room[:, None]
    meets = (rates.square < 0.0) | ((cross < 0.0) & (root >= 0.0))
    below = np.sqrt(np.maximum(root, 0.0)) - cross
    meets &= below > 0.0
    factor = np.where(meets, room[:, None] / np.where(meets, below, 1.0), NEVER)
    factor[(grasp.push <= 0.0) | (room <= 0.0)] = 0.0
    factor = np.minimum(factor, NEVER)
    first = factor.argmin(axis=0)
    each = np.arange(len(first))
    least = factor[first, each]
    lost = grasp.push[first] + least * rates.push[first, each] <= 1e-9 * grasp.push.max()
    return least, np.where(least < NEVER, first, -1), lost


def slip_sigma(
    grasp: GraspContacts,
    rates: SlipRates,
    factor: Array,
    contact: NDArray[np.int64],
    friction_share: float,
) -> Array:
    """(d,) sigma of factors whose first contacts are `contact`; 0 where none slips.

    `friction_share`: relative sigma of the friction that all contacts have in common. At slip
    N^2 = |v|^2 with v over the friction, so ln of the friction moves the factor by
    N^2 / (v v' - N N').
    """
    safe, arm = _scales(grasp)
    along = np.arange(len(factor))
    push_rate, across_rate = rates.push[contact, along], rates.across[contact, :, along]
    spin = grasp.spin / arm
    across = np.concatenate([grasp.tangential, spin[:, None]], axis=1) / safe[:, None]
    across = across[contact] + factor[:, None] * across_rate
    push = grasp.push[contact] + factor * push_rate
    steepness = np.einsum('da,da->d', across, across_rate) - push * push_rate
    growth = push**2 / np.where(steepness > 0.0, steepness, np.inf)
    sigma = np.hypot(friction_share * growth, MODEL_SHARE * factor)
    return np.where((contact >= 0) & (factor > 0.0), sigma, 0.0)


def _scales(grasp: GraspContacts) -> tuple[Array, Array]:
    """Friction, never zero, and arms, infinite for a point: it carries no torque by itself."""
    arm = np.where(grasp.arm > 0.0, grasp.arm, np.inf)
    return np.maximum(grasp.friction, 1e-12), arm
