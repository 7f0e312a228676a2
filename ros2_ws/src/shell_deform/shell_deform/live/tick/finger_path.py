# SPDX-License-Identifier: Apache-2.0
"""The node's side of fingers that carry bodies: what is asked of them, and of their load cases."""

from __future__ import annotations

import numpy as np

from shell_deform.contact.finger_bodies import read_finger_bodies, sizes
from shell_deform.live.background.worker_link import WorkerProcess
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.estimator import Estimator
from shell_deform.live.tick.finger_motion import FingerMotion
from shell_deform.live.tick.load_path import LoadPath, PathFeed
from shell_deform.live.tick.sample import ContactSample, SampleError


class FingerPath:
    """Follows fingers that carry bodies; not `active` where they carry none."""

    def __init__(self, bodies: str = '', step: float = 2e-4, by_cells: bool = False) -> None:
        """`bodies` as in `finger_bodies`; `step` [m] between two load cases.

        `by_cells`: their touch cells say where they press, so nothing of their way counts. Raises
        ObjectError for bodies that cannot be.
        """
        self.options = bodies, step, by_cells
        self.step = step
        self.carried = read_finger_bodies(bodies).loaded()
        self.active = bool(self.carried) and not by_cells
        width, reach = sizes(list(self.carried.values())) if self.carried else (1.0, 0.0)
        self._motion = FingerMotion(width, reach)
        self._feed = PathFeed(LoadPath(step, reach))

    def clear(self) -> None:
        """Time has jumped: what the fingers did before is no part of their way any more."""
        self._motion.forget()
        self._feed.clear()

    def check(self, sample: ContactSample) -> None:
        """Raise SampleError for a sample in which a body cannot have come where it is."""
        if self.active:
            self._motion.check(sample)

    def take(
        self, estimator: Estimator, request: np.ndarray, worker: WorkerProcess, friction: float
    ) -> bool:
        """Take the sample of the last tick; whether every load case so far is answered.

        `request` (1,) is filled beside what counts resets and jumps.
        """
        estimator.fill_request(request[0], as_reported=True)
        request[0]['friction'] = friction
        self._feed.path.take(request)
        return self.feed(worker)

    def feed(self, worker: WorkerProcess) -> bool:
        """Hand on the next load case when the last one is answered; whether all are."""
        return not self.active or self._feed.feed(worker)

    @property
    def whole(self) -> bool:
        """Whether a process that has built another mesh can be taken through the grasp."""
        return self._feed.whole

    def caught_up(self, candidate: WorkerProcess) -> bool:
        """Take such a process along the way of the fingers; whether it has come where they are."""
        return not self.active or self._feed.caught_up(candidate)

    def refuse(self, adopted: Adopted | None) -> None:
        """Raise SampleError where the background process could not take a finger up."""
        if self.active and adopted is not None and adopted.refused:
            raise SampleError(f'{adopted.message}; the last good state is kept')

    @property
    def figures(self) -> dict[str, object]:
        """What /diagnostics says of it."""
        if not self.active:
            return {}
        return {
            'load cases behind': self._feed.behind,
            'way behind, up to [mm]': 1e3 * self.step * self._feed.behind,
            'load cases left out': self._feed.path.left_out,
        }
