# SPDX-License-Identifier: Apache-2.0
"""What an equilibrium says of its grasp for as long as it serves: made once, read every sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.capacity import DIRECTIONS, epsilon
from shell_deform.grasp.contacts import GraspContacts
from shell_deform.grasp.slip import Sharing, SlipRates, slip_rates, slipping_regions
from shell_deform.grasp.stiffness import adversary_work, grasp_stiffness, rigid_share
from shell_deform.live.pose import Pose
from shell_deform.live.tick.adopted import Adopted

Array = NDArray[np.float64]

ADVERSARY = 1.0
"""Push [N] whose work against the grasp is told."""


@dataclass(frozen=True)
class HeldGrasp:
    """Of one equilibrium, in the frame of the contacts.

    Attributes:
        rates: what the weight and 26 forces change of the contacts; None before they are known.
        smallest_stiffness: [N/m], turns counted at `length` [m]. adversary_work: [J].
        epsilon: Ferrari and Canny's [N] at `length`; weakest: (6,) where.
        rigid_share: of the contacts' motion [-]. energy: stored by the squeeze [J].
        push: (k,) of the equilibrium [N]. stress: largest von Mises [Pa] under it.
        stress_doubt: relative sigma of that. strain: largest principal [-].
    """

    rates: SlipRates | None
    smallest_stiffness: float
    adversary_work: float
    epsilon: float
    weakest: Array
    length: float
    rigid_share: float
    energy: float
    push: float
    stress: float
    stress_doubt: float
    strain: float


def held_grasp(
    adopted: Adopted, grasp: GraspContacts, pose: Pose, down: Array, seed: Array | None
) -> HeldGrasp:
    """Everything about `grasp` that waits for the next equilibrium; `seed` of its `weakest`."""
    apart = np.linalg.norm(grasp.point[:, None] - grasp.point[None], axis=2)
    length = 0.5 * float(apart.max(initial=0.0)) or 1.0
    origin = pose.rotation @ adopted.centre + pose.translation
    quality, weakest = epsilon(grasp, origin, length, seed)
    rates, stiff, work = None, 0.0, 0.0
    if adopted.grasp_known:
        turn = pose.rotation
        both = np.kron(np.eye(2), turn)
        sharing = Sharing(
            adopted.sharing.push @ both.T,
            np.einsum('ab,kbw->kaw', turn, adopted.sharing.tangential) @ both.T,
            adopted.sharing.spin @ both.T,
        )
        loads = np.zeros((1 + len(DIRECTIONS), 6))
        loads[0, :3], loads[1:, :3] = down, DIRECTIONS
        rates = slip_rates(slipping_regions(grasp, adopted.slipping), sharing, loads)
        stiff = grasp_stiffness(adopted.compliance, length).smallest
        work = adversary_work(adopted.compliance, ADVERSARY)
    response = adopted.response
    motion = response.displacement[:, None] * adopted.axis
    return HeldGrasp(
        rates, stiff, work, quality, weakest, length,
        rigid_share(adopted.touch_point, motion), adopted.energy, float(response.force.mean()),
        adopted.stress, adopted.stress_doubt, adopted.strain,
    )  # fmt: skip
