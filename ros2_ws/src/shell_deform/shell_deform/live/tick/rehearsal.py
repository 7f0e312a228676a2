# SPDX-License-Identifier: Apache-2.0
"""The live estimator without processes: tick and solver take turns, as the caller says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from shell_deform.contact.body_file import FingerBody
from shell_deform.live.background.fingertips import FingertipSolver
from shell_deform.live.background.gripping import plan_of
from shell_deform.live.background.load_case import load_of
from shell_deform.live.background.solving import LiveSolver
from shell_deform.live.background.worker import share
from shell_deform.live.exchange import REQUEST
from shell_deform.live.pose import IDENTITY
from shell_deform.live.tick.estimator import Estimator, Served, Settings
from shell_deform.live.tick.first_touch import FirstTouch
from shell_deform.live.tick.load_path import LoadPath
from shell_deform.live.tick.sample import ContactSample
from shell_deform.model import ShellModel


class Rehearsal:
    """Solver, shared memory and estimator of one model, the object where the contacts are."""

    def __init__(
        self,
        model: ShellModel,
        settings: Settings | None = None,
        bodies: Mapping[int, FingerBody] | None = None,
        pins_slide: bool = False,
    ) -> None:
        """`bodies`: what fingers carry, see `FingertipSolver`; None for pins, see `LiveSolver`."""
        self.solver: LiveSolver | FingertipSolver = (
            FingertipSolver(model, bodies) if bodies else LiveSolver(model, pins_slide=pins_slide)
        )
        self.solver.warm_up()
        self.memory, _ = share(self.solver)
        self.estimator = Estimator(
            self.memory.rest,
            self.memory.rest_normals,
            settings or Settings(),
            self.memory.rest_outer,
            (plan_of(model), self.memory.rest_grips) if model.grips else None,
        )
        self.estimator.pose = IDENTITY
        self.estimator.first_touch = FirstTouch(self.solver.rest_shell())
        self._request = np.zeros(1, REQUEST)
        self._sequence = 0
        self._jumps = self._obeyed = 0

    def jump(self) -> None:
        """Time has jumped: the solver takes the contacts of the next load case up anew."""
        self._jumps += 1

    def tick(self, sample: ContactSample) -> Served:
        """Serve one sample from what is known, and leave its load case for the solver."""
        served = self.estimator.tick(sample)
        self._request = np.zeros(1, REQUEST)
        self.estimator.fill_request(self._request[0])
        return served

    def refresh(self) -> None:
        """Let the solver answer the last tick, and adopt its result."""
        self.solve()
        self.adopt()

    def solve(self) -> None:
        """Let the solver answer the last tick."""
        self._sequence += 1
        self.memory.write_request(self._request, self._sequence)
        self._request[0]['jumps'] = self._jumps
        self.solver.take(load_of(self._request[0], jumps=self._obeyed))
        self._obeyed = self._jumps
        self.solver.refine()
        index = self.memory.free_slot()
        self.solver.fill(self.memory.slots[index])
        self.memory.publish(index, self._sequence)

    def adopt(self) -> None:
        """Let the ticks to come start from the solver's last answer."""
        self.estimator.adopt(self.memory.take())

    def follow(self, sample: ContactSample, path: LoadPath, friction: float) -> Served:
        """Serve a sample of fingers that carry bodies when its part of the path is solved."""
        self.tick(sample)
        self.put_on(path, friction)
        while self.take_from(path):
            self.adopt()
        return self.tick(sample)

    def put_on(self, path: LoadPath, friction: float) -> None:
        """Leave the load case of the last tick on a path."""
        self.estimator.fill_request(self._request[0], as_reported=True)
        self._request[0]['friction'] = friction
        path.take(self._request)

    def take_from(self, path: LoadPath) -> bool:
        """Solve the next load case of a path; whether there was one."""
        request = path.next()
        if request is None:
            return False
        request[0]['hurried'] = path.waiting > 0
        self._request = request
        self.solve()
        return True

    def settle(self, sample: ContactSample, rounds: int = 3) -> Served:
        """Tick and refresh in turn, so that both agree."""
        for _ in range(rounds):
            self.tick(sample)
            self.refresh()
        return self.tick(sample)
