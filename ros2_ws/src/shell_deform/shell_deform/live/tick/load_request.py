# SPDX-License-Identifier: Apache-2.0
"""The mailbox record by which the tick asks the background process for an equilibrium."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shell_deform.live.exchange import DRIVE_CODES
from shell_deform.live.pose import Pose
from shell_deform.live.tick.sample import ContactSample

if TYPE_CHECKING:
    from shell_deform.live.tick.adopted import Adopted
    from shell_deform.live.tick.fusion import Posterior


def write_load(
    record: np.void,
    sample: ContactSample,
    drive: str,
    tendon: float,
    pose: Pose | None,
    adopted: Adopted | None,
    posterior: Posterior | None,
) -> None:
    """Fill a mailbox record: what the sample says and, where a tick fused it, its best inputs.

    `sample` has one row per finger in contact, at most MAX_CONTACTS; `tendon` [m/N]; `pose` None
    to infer it.
    """
    count = len(sample.finger)
    record['stamp'] = sample.stamp
    record['drive'] = DRIVE_CODES[drive]
    record['contacts'] = count
    record['tendon'] = tendon
    record['placed'] = int(pose is not None)
    if pose is not None:
        record['pose'] = pose.numbers
    force = sample.push[:count]
    displacement = np.full(count, np.nan)
    record['generation'] = 0
    if adopted is not None and posterior is not None and len(adopted.fingers):
        record['generation'] = adopted.generation
        response, k = adopted.response, len(adopted.fingers)
        if len(posterior.inputs) == response.displacement_by.shape[1]:
            index = np.searchsorted(adopted.fingers, sample.finger[:count])
            known = index < k
            known[known] = adopted.fingers[index[known]] == sample.finger[:count][known]
            force = force.copy()
            force[known] = (response.force + posterior.inputs[:k])[index[known]]
            moved = response.displacement + response.displacement_by @ posterior.inputs
            displacement[known] = moved[index[known]]
            r = len(response.rigid)
            record['rigid'][:r] = response.rigid + posterior.inputs[3 * k : 3 * k + r]
    touch = record['touch']
    touch['finger'][:count] = sample.finger[:count]
    touch['point'][:count] = sample.point[:count]
    touch['normal'][:count] = sample.normal[:count]
    touch['radius'][:count] = sample.radius[:count]
    touch['force'][:count] = force
    touch['travel'][:count] = sample.travel[:count]
    touch['displacement'][:count] = displacement
    touch['along'][:count] = sample.along[:count]
