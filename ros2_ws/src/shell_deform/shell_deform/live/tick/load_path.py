# SPDX-License-Identifier: Apache-2.0
"""The way of fingers that carry bodies, as the load cases that the background process takes.

Friction has memory: what a grasp is depends on how it came there, so no load case may be
overtaken. They are thinned along their path instead. A sample becomes a load case where a finger
or a grip has moved by a step since the last one, where the way turns back, and where fingers touch
or let go: a rule that knows lengths and no times, so that a grasp played slowly or fast is the
same. What still waits when all have let go is given up: the next grasp does not depend on it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.worker_link import WorkerProcess
from shell_deform.live.exchange import DRIVE_FORCE
from shell_deform.live.pose import IDENTITY, Pose, pose_of

Array = NDArray[np.float64]

WHOLE = 1.0 - 1e-9
"""A step but for round-off."""

TURNS_BACK = 0.3
"""A way that comes back by this share of a step has turned."""

FORCE_STEP = 0.25
"""What a step is for a finger that is driven by its force [N]."""

MOST_PASSED = 256
"""Load cases of one grasp that are kept for a process that has to go through it again."""

MOST_WAITING = 64
"""Load cases that wait; beyond, every second one is left out."""


class LoadPath:
    """Chooses load cases from samples and keeps those that wait to be solved.

    Attributes:
        left_out: how many were given up because too many waited.
    """

    def __init__(self, step: float, reach: float) -> None:
        """`step` [m]; `reach` [m]: half the size of the bodies, which turns count with."""
        self.step, self.reach = step, reach
        self.left_out = 0
        self.clear()

    def clear(self) -> None:
        """Begin anew: with the next sample."""
        self._last: np.ndarray | None = None
        self._farthest: np.ndarray | None = None
        self._waiting: deque[np.ndarray] = deque()

    @property
    def waiting(self) -> int:
        """How many load cases have not been handed on yet."""
        return len(self._waiting)

    def take(self, request: np.ndarray) -> None:
        """Look at the load case (1,) of a sample; it is copied where it is kept."""
        last = self._last
        away = np.inf if last is None else self._steps(last[0], request[0])
        if away >= WHOLE:
            self._keep(request)
            return
        farthest = self._farthest
        if farthest is not None and last is not None:
            most = self._steps(last[0], farthest[0])
            if away < most and self._steps(farthest[0], request[0]) > TURNS_BACK:
                self._keep(farthest)
                if self._steps(farthest[0], request[0]) >= WHOLE:
                    self._keep(request)
                    return
                self._farthest = request.copy()
                return
            if away <= most:
                return
        self._farthest = request.copy()

    def next(self) -> np.ndarray | None:
        """The load case that has waited longest, or None; it does not wait any more."""
        return self._waiting.popleft() if self._waiting else None

    def _keep(self, request: np.ndarray) -> None:
        self._last, self._farthest = request.copy(), None
        if not request[0]['contacts']:
            # Where all fingers have let go, nobody remembers how they had come there.
            self._waiting.clear()
        self._waiting.append(self._last)
        if len(self._waiting) > MOST_WAITING:
            kept = list(self._waiting)[1::2]
            self.left_out += len(self._waiting) - len(kept)
            self._waiting = deque(kept)

    def _steps(self, first: np.void, second: np.void) -> float:
        """The way between two load cases in steps; infinite where other fingers touch."""
        count = int(first['contacts'])
        one, other = first['touch'][:count], second['touch'][:count]
        if (
            count != int(second['contacts'])
            or not np.array_equal(one['finger'], other['finger'])
            or first['friction'] != second['friction']
            or first['drive'] != second['drive']
        ):
            return float(np.inf)
        held = np.abs(second['grip'] - first['grip']).reshape(-1, 2, 3)
        shifts, turns = np.linalg.norm(held, axis=2).T
        carried = float((shifts + self.reach * turns).max()) / self.step
        if not count:
            return carried
        poses = [_pose(request) for request in (first, second)]
        places, normals, along = (
            [view(pose, touch) for pose, touch in zip(poses, (one, other), strict=True)]
            for view in (_places, _normals, _along)
        )
        ways = np.linalg.norm(places[1] - places[0], axis=1)
        ways += self.reach * np.linalg.norm(normals[1] - normals[0], axis=1)
        ways += self.reach * np.linalg.norm(np.nan_to_num(along[1] - along[0]), axis=1)
        forced = ~(np.isfinite(one['travel']) & np.isfinite(other['travel']))
        forced |= int(first['drive']) == DRIVE_FORCE
        pushes = np.where(forced, np.abs(other['force'] - one['force']) / FORCE_STEP, 0.0)
        return max(carried, float(np.maximum(ways / self.step, pushes).max()))


def _pose(request: np.void) -> Pose:
    return pose_of(request['pose']) if request['placed'] else IDENTITY


def _places(pose: Pose, touch: np.ndarray) -> Array:
    return pose.to_object(touch['point'])


def _normals(pose: Pose, touch: np.ndarray) -> Array:
    return np.asarray(touch['normal'] @ pose.rotation)


def _along(pose: Pose, touch: np.ndarray) -> Array:
    return np.asarray(touch['along'] @ pose.rotation)


@dataclass
class _Reader:
    """A process, the number of the load case it takes next, and of the newest one it was given."""

    worker: WorkerProcess
    number: int
    asked: int = 0

    @property
    def is_idle(self) -> bool:
        """Whether it has answered all that it was given."""
        return self.worker.answered >= self.asked


class PathFeed:
    """Hands the load cases of a path to the background process, each when the last is answered.

    Those of the present grasp are kept: a process that replaces another one, or has built a mesh
    for where the fingers rest, goes through them from the first: it remembers the same friction.
    """

    def __init__(self, path: LoadPath) -> None:
        self.path = path
        self.whole = True
        """Whether the grasp is kept from its beginning."""
        self._passed: list[np.ndarray] = []
        self._first = 0
        self._reader: _Reader | None = None
        self._candidate: _Reader | None = None

    def clear(self) -> None:
        """Begin anew: time has jumped, or the object is another one."""
        self.path.clear()
        self._forget()

    def feed(self, worker: WorkerProcess) -> bool:
        """Hand on what can be; whether every load case is answered."""
        if worker.memory is None:
            return False
        self._reader = reader = self._reader_of(worker)
        if not reader.is_idle:
            return False
        if not self._left(reader):
            request = self.path.next()
            if request is None:
                return True
            self._keep(request)
        self._ask(reader, self._left(reader) > 1 or self.path.waiting > 0)
        return False

    def caught_up(self, candidate: WorkerProcess) -> bool:
        """Take a process beside the serving one along; whether it has answered the whole grasp."""
        if candidate.memory is None:
            return False
        self._candidate = reader = self._reader_of(candidate)
        if not reader.is_idle:
            return False
        if not self._left(reader):
            return reader.asked > 0
        self._ask(reader, self._left(reader) > 1)
        return False

    @property
    def behind(self) -> int:
        """Load cases that have no answer yet."""
        reader = self._reader
        if reader is None:
            return self.path.waiting
        return self.path.waiting + self._left(reader) + int(not reader.is_idle)

    def _reader_of(self, worker: WorkerProcess) -> _Reader:
        for reader in (self._reader, self._candidate):
            if reader is not None and reader.worker is worker:
                return reader
        return _Reader(worker, self._first)

    def _left(self, reader: _Reader) -> int:
        """How many load cases a process has not been given."""
        reader.number = max(reader.number, self._first)
        return self._first + len(self._passed) - reader.number

    def _ask(self, reader: _Reader, hurried: bool) -> None:
        request = self._passed[reader.number - self._first]
        request[0]['hurried'] = hurried
        reader.asked = reader.worker.post(request)
        reader.number += 1

    def _keep(self, request: np.ndarray) -> None:
        if not request[0]['contacts']:
            # Where all fingers have let go, nobody remembers how they had come there.
            self._forget()
        self._passed.append(request)
        if len(self._passed) > MOST_PASSED:
            del self._passed[0]
            self._first += 1
            self.whole = False

    def _forget(self) -> None:
        self._first += len(self._passed)
        self._passed.clear()
        self.whole = True
