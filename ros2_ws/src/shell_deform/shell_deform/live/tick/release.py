# SPDX-License-Identifier: Apache-2.0
"""What the tick does when fingers let go: who still presses, and when rest is the better tangent.

A hand reports a contact for a while after its finger has left, and its encoders go on: taken at
their word they would pull the shell outward and carry it along. And a shell released faster than
the background process follows comes so far from the last equilibrium that linear theory from rest
is the better tangent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.fusion_types import Measured, Response
from shell_deform.live.tick.sample import FLAG_NO_GAUGE, ContactSample

Array = NDArray[np.float64]

CERTAIN = 3.0
"""Standard deviations by which a finger has gone back, or pushes, before that is believed."""


def pressing(sample: ContactSample, model: ErrorModel) -> ContactSample:
    """The rows of fingers that have not left.

    A finger has left when it stands behind the place of its first touch and pushes no more than
    its gauge's noise. Where the drive ignores motion the gauge alone says how much presses.
    """
    # A travel that is not known (NaN) is never behind.
    if model.drive == 'force' or not (sample.travel < 0.0).any():
        return sample
    spread = np.hypot(np.nan_to_num(sample.sigma_travel, nan=model.default_travel), model.mounting)
    behind = sample.travel < -CERTAIN * spread
    if not behind.any():
        return sample
    blind = (sample.flags & FLAG_NO_GAUGE) != 0
    slack = blind | (sample.push < CERTAIN * model.push_sigma(sample.sigma_normal))
    return sample.rows(~(behind & slack))


def measured_displacement(response: Response, measured: Measured) -> Array:
    """Displacement (k,) of the contacts [m] as measured, before anything is fused.

    A finger that is gone has let its dent spring back; where no motion is known the dent goes
    with the push.
    """
    there = response.displacement
    by_push = there * np.clip(measured.push / np.maximum(response.force, 1e-9), 0.0, 2.0)
    now = measured.travel + response.travel_offset
    now = np.where(np.isfinite(now), now, by_push)
    return np.where(measured.present, now, 0.0)
