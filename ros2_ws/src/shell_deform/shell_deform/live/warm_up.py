"""Everything a tick compiles or loads, once before the first sample."""

from __future__ import annotations

import os

import numpy as np

from shell_deform.live.estimator import Estimator, Settings
from shell_deform.live.exchange import REQUEST, Layout, create
from shell_deform.live.pose import IDENTITY
from shell_deform.live.sample import FLAG_CONTACT, ContactSample


def warm_up() -> None:
    """Answer one sample of one finger on a made-up shell of four vertices.

    The arrays have the types and layouts of real ones, so that every kernel of the tick is loaded
    from the compile cache here and not while a sample waits.
    """
    memory, descriptor = create(Layout(4, 4))
    os.close(descriptor)
    slot = memory.slots[0]
    record = slot.record
    record['contacts'] = record['stable'] = 1
    record['finger'][0] = 1
    record['axis'][0] = slot.normals[:] = memory.rest_normals[:] = [0.0, 0.0, 1.0]
    record['pose'] = IDENTITY.numbers
    for name in ('share', 'rigid_scale', 'bend_reach', 'third_reach', 'linear_compliance'):
        record[name] = 1.0
    for name in ('displacement_by', 'reaction_by'):
        np.fill_diagonal(record[name], 1.0)
    estimator = Estimator(memory.rest, memory.rest_normals, Settings())
    estimator.adopt(slot)
    estimator.tick(
        ContactSample(
            stamp=1,
            finger=np.ones(1, np.int64),
            flags=np.full(1, FLAG_CONTACT),
            point=np.zeros((1, 3)),
            normal=np.array([[0.0, 0.0, 1.0]]),
            force=np.zeros((1, 3)),
            sigma_normal=np.ones(1),
            sigma_tangential=np.full(1, np.inf),
            radius=np.ones(1),
            travel=np.zeros(1),
            sigma_travel=np.ones(1),
        )
    )
    estimator.linear()
    estimator.nonlinear()
    estimator.fill_request(np.zeros(1, REQUEST)[0])
