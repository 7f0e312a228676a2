# SPDX-License-Identifier: Apache-2.0
"""How much of the friction that fingers can give a turned object already takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.contact_field import Touch

Array = NDArray[np.float64]

WARN_FROM = 0.8
"""Fingers that give more than this share of their friction are about to slip: the warning comes
before the last tenth of the torque, also where samples are a tenth of it apart."""


@dataclass(frozen=True)
class FrictionShare:
    """Torque of friction about an axis [N m], and the largest the pressures allow.

    Where every point slips around the axis, the two are equal.
    """

    torque: float
    capacity: float

    @property
    def share(self) -> float:
        """Torque over capacity; 0 where nothing touches."""
        return abs(self.torque) / self.capacity if self.capacity > 0.0 else 0.0

    def as_dict(self) -> dict[str, float | bool]:
        """The JSON form."""
        return {
            'torque_nm': self.torque,
            'capacity_nm': self.capacity,
            'share': self.share,
            'warning': self.slips,
        }

    @property
    def slips(self) -> bool:
        """Whether it is time to warn."""
        return self.share > WARN_FROM


def friction_share(
    touches: Sequence[Touch], friction: Sequence[float], origin: Array, axis: Array
) -> FrictionShare:
    """Friction of bodies with coefficients `friction` about an axis (3,) through `origin` (3,).

    The exact sum over contact points: coefficient times pressure times arm.
    """
    torque = capacity = 0.0
    for touch in touches:
        arms = touch.face.position - origin
        around = np.cross(axis, arms)
        torque += float(touch.weights @ np.einsum('pi,pi->p', touch.friction, around))
        reach = np.linalg.norm(around, axis=1)
        capacity += friction[touch.body] * float((touch.weights * touch.pressure) @ reach)
    return FrictionShare(torque, capacity)
