"""A squeeze without processes, so that every kernel of the live path is compiled beforehand."""

from __future__ import annotations

import numpy as np

from shell_deform.live.estimator import Estimator, Settings
from shell_deform.live.exchange import REQUEST
from shell_deform.live.fusion import ErrorModel
from shell_deform.live.load_case import load_of
from shell_deform.live.pose import IDENTITY
from shell_deform.live.sample import ContactSample
from shell_deform.live.solving import LiveSolver
from shell_deform.live.worker import share
from shell_deform.model import ShellModel

ROUNDS = 3


def rehearse(model: ShellModel, sample: ContactSample) -> None:
    """Serve `sample` and let the solver answer, a few times in turn."""
    solver = LiveSolver(model)
    solver.warm_up()
    memory, _ = share(solver)
    estimator = Estimator(memory.rest, memory.rest_normals, Settings(ErrorModel()))
    estimator.warm_up()
    estimator.pose = IDENTITY
    for sequence in range(1, ROUNDS + 1):
        estimator.tick(sample)
        request = np.zeros(1, REQUEST)
        estimator.fill_request(request[0])
        solver.take(load_of(request[0]))
        solver.refine()
        index = memory.free_slot()
        solver.fill(memory.slots[index])
        memory.publish(index, sequence)
        estimator.adopt(memory.take())
    estimator.tick(sample)
