"""The live estimator without processes: solver and tick take turns, as the tests say."""

import numpy as np

from shell_deform.live.estimator import Estimator, Settings
from shell_deform.live.exchange import REQUEST
from shell_deform.live.fusion import ErrorModel
from shell_deform.live.load_case import load_of
from shell_deform.live.pose import IDENTITY
from shell_deform.live.solving import LiveSolver
from shell_deform.live.worker import share

SURE = ErrorModel(
    drift=0.0, quantum=0.0, mounting=1e-7, slip=1e-7, modulus=1e-4, model=0.0, outside=1e-3
)


class Pipeline:
    """Solver, shared memory and estimator of one model."""

    def __init__(self, model, errors=None):
        self.solver = LiveSolver(model)
        self.memory, _ = share(self.solver)
        self.estimator = Estimator(
            self.memory.rest, self.memory.rest_normals, Settings(errors or SURE)
        )
        self.estimator.pose = IDENTITY
        self._sequence = 0

    def tick(self, sample):
        """Serve one sample from what is known."""
        return self.estimator.tick(sample)

    def refresh(self):
        """Let the solver answer the last tick, and adopt its result."""
        request = np.zeros(1, REQUEST)
        self.estimator.fill_request(request[0])
        self._sequence += 1
        self.memory.write_request(request, self._sequence)
        self.solver.take(load_of(self.memory.read_request()[0]))
        self.solver.refine()
        index = self.memory.free_slot()
        self.solver.fill(self.memory.slots[index])
        self.memory.publish(index, self._sequence)
        self.estimator.adopt(self.memory.take())

    def settle(self, sample, rounds=3):
        """Tick and refresh until both agree."""
        for _ in range(rounds):
            self.tick(sample)
            self.refresh()
        return self.tick(sample)
