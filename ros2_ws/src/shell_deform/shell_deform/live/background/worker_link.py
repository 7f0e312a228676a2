# SPDX-License-Identifier: Apache-2.0
"""The node's end of the background process: starts it, feeds it, replaces it where need be."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp_common.watchdog import Watchdog, end_with_parent, is_stopped
from shell_deform.live.background.rest_shell import RestShell, unpacked
from shell_deform.live.exchange import REQUEST, Layout, SharedMemory, Slot
from shell_deform.live.grip_motion import GripPlan

Array = NDArray[np.float64]

BACK_OFF_FIRST_S = 0.2
BACK_OFF_LAST_S = 10.0
HEALTHY_S = 1.0
"""A process that served for so long was a good one: the next one does not wait longer [s]."""
PATIENCE_S = 2.0
"""A process that was asked to end is ended after this [s]."""
LOOKED_AFTER_S = 0.2
"""How often processes that do not serve yet are looked after [s]."""
SPARE_AFTER_S = 1.0
"""A spare process is started so long after the other one is ready: the start is busy enough."""
THREAD_VARIABLES = (
    'OMP_NUM_THREADS',
    'OPENBLAS_NUM_THREADS',
    'MKL_NUM_THREADS',
    'NUMBA_NUM_THREADS',
)
# The solver changes between two threads and works in one at a time: no heap for each.
ONE_HEAP = 'MALLOC_ARENA_MAX'


class WorkerError(RuntimeError):
    """The background process cannot build what it was asked for."""


@dataclass(frozen=True)
class Build:
    """What to build: object name or file, theory, control vertices (0: the object's own).

    `niceness` is what the process adds to its own, to leave the processor to the fast loop.
    `refine_at`: places of the object where the mesh is graded, instead of the object file's own,
    for contacts of `refine_radius` [m]. `curl`: of the shell, where it was measured before.
    `bodies`: what the fingers carry, see `finger_bodies`; `by_cells`: their touch cells, not
    contact, say where they press. `pins_slide`: whether fingers without a body do not rub.
    """

    object_name: str
    theory: str
    control_vertices: int = 0
    niceness: int = 10
    refine_at: tuple[tuple[float, float, float], ...] = ()
    refine_radius: float = 0.0
    curl: float = 0.0
    bodies: str = ''
    by_cells: bool = False
    pins_slide: bool = False


class WorkerProcess:
    """One running process and, once it has built the shell, the memory shared with it.

    Without a `build` it starts ahead, while its owner still finds out what is wanted: `start`
    tells it.
    """

    def __init__(self, build: Build | None = None) -> None:
        self.memory: SharedMemory | None = None
        self.build: Build | None = None
        """What it was told to build."""
        self.thickness = 0.0
        self.theory = self.theory_reason = ''
        """The one taken: `auto` is none; why it took that, empty where it was asked for."""
        self.mesh_warning = ''
        """What is wrong with the mesh, and the way out."""
        self.plan = GripPlan((), np.zeros((0, 3)), False)
        self._has_rest = False
        self._sequence = 0
        self._seen = 0
        self._first_answer = 0
        ours, theirs = socket.socketpair()
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        environment = {**os.environ, **{name: '1' for name in (*THREAD_VARIABLES, ONE_HEAP)}}
        command = [sys.executable, '-m', 'shell_deform.live.background.worker']
        self.process = subprocess.Popen(
            [*command, str(theirs.fileno()), str(self._event)],
            pass_fds=(theirs.fileno(), self._event),
            env=environment,
            preexec_fn=end_with_parent,
            stdin=subprocess.DEVNULL,
        )
        theirs.close()
        ours.setblocking(False)
        self._socket = ours
        if build is not None:
            self.start(build)

    def start(self, build: Build, beside: bool = False) -> None:
        """Tell the process what to build, once.

        `beside`: another one serves meanwhile, so that it is courteous from the beginning.
        """
        self.build = build
        options = {
            'object': build.object_name,
            'theory': build.theory,
            'control_vertices': build.control_vertices,
            'niceness': build.niceness,
            'refine_at': build.refine_at,
            'refine_radius': build.refine_radius,
            'curl': build.curl,
            'bodies': build.bodies,
            'by_cells': build.by_cells,
            'pins_slide': build.pins_slide,
            'beside': beside,
        }
        # One that died already is found dead, and replaced, by whoever looks after it.
        with contextlib.suppress(BrokenPipeError):
            self._socket.sendall(json.dumps(options).encode() + b'\n')

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self.process.poll() is None

    def became_ready(self) -> bool:
        """True once, when the shell is built; raises WorkerError if it cannot be."""
        if self.memory is not None:
            return False
        try:
            line, descriptors, _, _ = socket.recv_fds(self._socket, 65536, 1)
        except BlockingIOError:
            return False
        if not line:
            return False
        hello = json.loads(line)
        if 'error' in hello:
            raise WorkerError(str(hello['error']))
        origins = np.array(hello['origins'], float).reshape(-1, 3)
        self.plan = GripPlan(tuple(hello['grips']), origins, bool(hello['alone']))
        layout = Layout(hello['vertices'], hello['triangles'], hello['outer'], len(origins))
        self.memory = SharedMemory(descriptors[0], layout)
        self.theory, self.theory_reason = str(hello['theory']), str(hello['reason'])
        self.mesh_warning = str(hello['mesh_warning'])
        self.thickness = float(hello['thickness'])
        return True

    def handed_over(self) -> RestShell | None:
        """The shell at rest, once, when it has come."""
        if self.memory is None or self._has_rest:
            return None
        try:
            line, descriptors, _, _ = socket.recv_fds(self._socket, 16, 1)
        except BlockingIOError:
            return None
        if not line or not descriptors:
            return None
        self._has_rest = True
        return unpacked(descriptors[0])

    def post(self, request: np.ndarray) -> int:
        """Replace the load case in the mailbox; never waits. Returns its number, from 1 on."""
        if self.memory is None:
            return 0
        self._sequence += 1
        self.memory.write_request(request, self._sequence)
        # Full only after 2^64 unread load cases; the newest one is in the mailbox anyway.
        with contextlib.suppress(BlockingIOError):
            os.eventfd_write(self._event, 1)
        return self._sequence

    @property
    def answered(self) -> int:
        """Number of the load case that the newest result answers, 0 before the first."""
        return 0 if self.memory is None else self.memory.answered

    def newer_result(self) -> Slot | None:
        """The newest result if it was not taken before."""
        if self.memory is None or self.memory.newest() == self._seen:
            return None
        slot = self.memory.take()
        self._seen = int(slot.record['begin'])
        return slot if int(slot.record['answers']) >= self._first_answer else None

    def disown(self) -> None:
        """Results of load cases posted so far are not taken any more."""
        self._first_answer = self._sequence + 1

    def dismiss(self) -> None:
        """Ask the process to end: it goes when its socket closes."""
        self._socket.close()

    def stop(self, patience_s: float = PATIENCE_S) -> None:
        """End the process: by closing its socket, by force after `patience_s`."""
        self._socket.close()
        try:
            self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if self._event >= 0:
            os.close(self._event)
            self._event = -1


class WorkerLink:
    """Keeps a process running; one that ends before it serves is started after ever longer pauses.

    Beside it a spare one waits with its imports done: it replaces one that ends, or builds the
    `candidate`, the same shell on a mesh graded elsewhere, which is promoted once it answers.
    """

    def __init__(self, build: Build, ahead: WorkerProcess | None = None) -> None:
        """`ahead`: a process started ahead for this; one that builds something else is ended."""
        self.restarts = 0
        self.candidate: WorkerProcess | None = None
        self._build = build
        self._candidate_build = build
        self._spare: WorkerProcess | None = None
        self._leaving: list[tuple[WorkerProcess, float]] = []
        if ahead is not None and ahead.build not in (None, build):
            ahead.stop(0.0)
            ahead = None
        self.worker = ahead or WorkerProcess()
        if self.worker.build is None:
            self.worker.start(build)
        self._back_off = BACK_OFF_FIRST_S
        self._start_at = 0.0
        self._started = self._ready = self._looked_after = -np.inf
        self._watchdog = Watchdog(self.worker.process.pid)

    @property
    def trouble(self) -> str:
        """Why the process does not get on, in words that follow its name; '' while it does."""
        return self._watchdog.trouble if self.worker.alive else 'ended and is started again'

    @property
    def is_lost(self) -> bool:
        """Whether no answer comes until `tend` is called; lack of processor time is no loss."""
        serves = self.worker.alive and self.worker.memory is not None
        return not serves or self._watchdog.hopeless

    @property
    def processes(self) -> list[int]:
        """Numbers of all processes that are kept."""
        kept = (self.worker, self.candidate, self._spare)
        return [one.process.pid for one in kept if one is not None]

    def tend(self, now: float) -> bool:
        """Look after the process at steady time `now` [s]; True when it has just become ready.

        Raises WorkerError if the object cannot be built at all.
        """
        if not np.isfinite(self._started):
            self._started = now
        self._see_off(now)
        self._look_after_others(now)
        if self.worker.memory is not None and self.worker.alive:
            self._watchdog.look(self.worker.memory.beats, now)
            if self._watchdog.hopeless:
                self.worker.process.kill()
                self.worker.process.wait()
            if (
                self._spare is None
                and self.candidate is None
                and now > self._ready + SPARE_AFTER_S
            ):
                self._spare = WorkerProcess()
        if self.worker.alive or self.worker.memory is None and self._waiting_line():
            ready = self.worker.became_ready()
            if ready:
                self._ready = now
            return ready
        if self._start_at == 0.0:
            if self._started <= self._ready < now - HEALTHY_S:
                self._back_off = BACK_OFF_FIRST_S
            self._start_at = now + self._back_off
            self._back_off = min(2.0 * self._back_off, BACK_OFF_LAST_S)
        if now >= self._start_at:
            self.worker.stop()
            self._replace()
            self.restarts += 1
            self._started, self._start_at = now, 0.0
        return False

    def _look_after_others(self, now: float) -> None:
        """End processes that somebody stopped before they serve; a dead spare is none."""
        if now - self._looked_after < LOOKED_AFTER_S:
            return
        self._looked_after = now
        for one in (self.worker, self.candidate, self._spare):
            if (
                one is not None
                and one.memory is None
                and one.alive
                and is_stopped(one.process.pid)
            ):
                one.process.kill()
        if self._spare is not None and not self._spare.alive:
            self._leave(self._spare)
            self._spare = None

    def grade(self, places: Array, radius: float, curl: float) -> None:
        """Build the shell again with its mesh graded at `places` (k, 3) for contacts of `radius`.

        The running process goes on; `tend_candidate` tells how the other one gets on.
        """
        if self.candidate is not None:
            return
        rounded = tuple((float(x), float(y), float(z)) for x, y, z in places)
        build = replace(self._build, refine_at=rounded, refine_radius=radius, curl=curl)
        self.candidate, self._candidate_build = self._next_process(), build
        self.candidate.start(build, beside=True)

    def tend_candidate(self) -> str:
        """Look after the candidate; why it was given up, or ''."""
        candidate = self.candidate
        if candidate is None:
            return ''
        try:
            candidate.became_ready()
        except WorkerError as error:
            self.drop_candidate()
            return str(error)
        if not candidate.alive:
            self.drop_candidate()
            return 'its process ended'
        return ''

    def promote(self) -> None:
        """The candidate takes the place of the process that served so far."""
        assert self.candidate is not None
        self._leave(self.worker)
        self.worker, self._build, self.candidate = self.candidate, self._candidate_build, None
        self._watchdog = Watchdog(self.worker.process.pid)
        self._start_at = 0.0

    def drop_candidate(self) -> None:
        """End the candidate, if there is one."""
        if self.candidate is not None:
            self._leave(self.candidate)
            self.candidate = None

    def _next_process(self) -> WorkerProcess:
        """The spare process, or a new one."""
        spare, self._spare = self._spare, None
        return spare if spare is not None and spare.alive else WorkerProcess()

    def _replace(self) -> None:
        """Another process that builds the same."""
        self.worker = self._next_process()
        self.worker.start(self._build)
        self._watchdog = Watchdog(self.worker.process.pid)

    def _leave(self, process: WorkerProcess) -> None:
        """Ask a process to end without waiting for it."""
        process.dismiss()
        self._leaving.append((process, -np.inf))

    def _see_off(self, now: float) -> None:
        """Forget processes that have ended; the slow ones by force."""
        staying = []
        for process, asked in self._leaving:
            if process.alive:
                asked = now if not np.isfinite(asked) else asked
                if now - asked > PATIENCE_S:
                    process.process.kill()
                staying.append((process, asked))
            else:
                process.stop(0.0)
        self._leaving = staying

    def _waiting_line(self) -> bool:
        """Whether a dead process has left a message to read."""
        try:
            return bool(self.worker._socket.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def rebuild(self, build: Build) -> None:
        """Replace the process by one for another object."""
        self.drop_candidate()
        self.worker.stop()
        self._build = build
        self._replace()
        self._start_at, self._started, self._ready = 0.0, -np.inf, -np.inf

    def stop(self) -> None:
        """End all processes."""
        self.drop_candidate()
        if self._spare is not None:
            self._leave(self._spare)
            self._spare = None
        self.worker.stop()
        for process, _ in self._leaving:
            process.stop()


def empty_request() -> np.ndarray:
    """A load case (1,) of dtype REQUEST to fill again and again."""
    return np.zeros(1, dtype=REQUEST)
