# SPDX-License-Identifier: Apache-2.0
"""Linear theory from rest for one set of contacts, as the tick uses it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.tick.fusion_types import Measured, Response
from shell_deform.live.tick.linearity import linear_error, softened_depth

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AtRest:
    """What pushes on k contacts do to the unloaded shell.

    Attributes:
        fingers: (k,). compliance: (k, k) of the contact centres [m/N].
        second_order: (k, k (k + 1) / 2) of the same [m/N^2], pairs i <= j.
        columns: (n, 3, k) motion of the surface per unit push [m/N].
        lateral: (2 k, 3) directions across the axes.
        travel_offset: (k,) displacement of each patch minus the travel of its finger [m].
        coarseness: (k,) relative stiffness error of the mesh under each contact.
    """

    fingers: NDArray[np.int64]
    compliance: Array
    second_order: Array
    columns: Array
    lateral: Array
    travel_offset: Array
    coarseness: Array

    @cached_property
    def stiffness(self) -> Array:
        """(k, k) pushes per displacement [N/m]."""
        return np.asarray(np.linalg.pinv(self.compliance), float)

    @cached_property
    def response(self) -> Response:
        """The same for the fusion: pushes are the only inputs that move anything."""
        k = len(self.fingers)
        displacement_by = np.zeros((k, 3 * k + 1))
        displacement_by[:, :k] = self.compliance
        return Response(
            force=np.zeros(k),
            displacement=np.zeros(k),
            travel_offset=self.travel_offset,
            rigid=np.zeros(0),
            rigid_scale=1.0,
            reaction=np.zeros(2 * k),
            lateral=self.lateral,
            rigid_reaction=np.zeros(0),
            displacement_by=displacement_by,
            reaction_by=np.zeros((2 * k, 3 * k + 1)),
            rigid_by=np.zeros((0, 3 * k + 1)),
        )

    def linearisation_error(self, push: Array, displacement: Array) -> float:
        """Share of `displacement` (k,) [m] that linear theory misses under pushes (k,) [N]."""
        return linear_error(self.compliance, self.second_order, push, displacement)

    def error(self, displacement: Array) -> float:
        """Error estimate [m] of linear theory for contacts displaced by (k,) [m]."""
        share = self.linearisation_error(self.stiffness @ displacement, displacement)
        return share * float(np.abs(displacement).max(initial=0.0))

    def widened(self, measured: Measured) -> Measured:
        """The same with gauges widened by what linear theory invents of the measured motion.

        Otherwise a gauge and a stiffness that is too high outvote the encoders.
        """
        moved = np.where(measured.present, measured.travel + self.travel_offset, np.nan)
        if not np.isfinite(moved).all():
            return measured
        push = self.stiffness @ moved
        less = self.linearisation_error(push, moved) * np.abs(push)
        return measured._replace(sigma_push=np.hypot(measured.sigma_push, less))

    def doubt(self, push: Array, measured: Measured, uses_motion: bool) -> float:
        """What linear theory misses [m] where pushes (k,) [N] were found from `measured`."""
        depth = softened_depth(self.compliance, self.second_order, push)
        moved = np.abs(np.where(measured.present, measured.travel + self.travel_offset, 0.0))
        if uses_motion and np.isfinite(moved).all():
            depth = float(moved.max(initial=0.0))
        size = float(np.abs(self.compliance @ push).max(initial=0.0))
        if depth <= 0.0 or size == 0.0:
            return 0.0
        share = self.linearisation_error(push * depth / size, np.array([depth]))
        return max(share * depth, abs(depth - size))
