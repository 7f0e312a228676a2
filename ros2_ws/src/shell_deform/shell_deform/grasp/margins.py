# SPDX-License-Identifier: Apache-2.0
"""How far each finger is from slipping under the forces that it carries now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.contacts import GraspContacts

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Margins:
    """Of each of k contacts.

    Attributes:
        needed_angle: (k,) angle of the force to the normal [rad]; pi / 2 without push.
        slip_margin: (k,) friction times push minus tangential force [N].
        soft_margin: (k,) 1 - (T / mu N)^2 - (spin / mu N arm)^2 [-]: 1 where nothing is asked,
            0 at slip (Howe & Cutkosky, IJRR 15(6):531, 1996), never below -1.
        slip_sigma: (k,) of the slip margin [N].
        tangential_sigma: (k,) of the tangential force [N].
    """

    needed_angle: Array
    slip_margin: Array
    soft_margin: Array
    slip_sigma: Array
    tangential_sigma: Array


LEAST_SOFT_MARGIN = -1.0


def margins(
    grasp: GraspContacts,
    push_sigma: Array,
    tangential_sigma: Array,
    friction_sigma: float,
    normal_sigma: Array | float = 0.0,
) -> Margins:
    """Margins with sigmas of push and tangential force (k,) [N], friction [-], normals [rad].

    A normal that turns by its sigma has that share of the push across it. A contact that does not
    press has no margin: its needed angle is 90 degrees, its soft margin -1.
    """
    push = np.maximum(grasp.push, 0.0)
    across = np.linalg.norm(grasp.tangential, axis=1)
    limit = grasp.friction * push
    angle = np.where(push > 0.0, np.arctan2(across, push), 0.5 * np.pi)
    used = _share(across, limit) ** 2
    # A point carries no torque about itself: what is asked of it there is of no account.
    turned = np.where(grasp.arm > 0.0, _share(np.abs(grasp.spin), limit * grasp.arm), 0.0) ** 2
    soft = np.maximum(1.0 - np.minimum(used + turned, 2.0), LEAST_SOFT_MARGIN)
    of_tangential = np.hypot(tangential_sigma, push * normal_sigma)
    sigma = np.sqrt(
        (grasp.friction * push_sigma) ** 2 + (push * friction_sigma) ** 2 + of_tangential**2
    )
    return Margins(
        needed_angle=angle,
        slip_margin=limit - across,
        soft_margin=np.where(push > 0.0, soft, LEAST_SOFT_MARGIN),
        slip_sigma=sigma,
        tangential_sigma=of_tangential,
    )


def _share(asked: Array, there: Array) -> Array:
    """asked / there, at most 2; nothing asked of nothing is 0."""
    safe = np.where(there > 0.0, there, 1.0)
    share = np.minimum(asked / safe, 2.0)
    return np.where(there > 0.0, share, np.where(asked > 0.0, 2.0, 0.0))
