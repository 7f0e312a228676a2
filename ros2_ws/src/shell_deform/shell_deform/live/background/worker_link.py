"""The node's end of the background process: starts it, feeds it, replaces it where need be."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
from dataclasses import dataclass

import numpy as np

from shell_deform.live.background.rest_shell import RestShell, unpacked
from shell_deform.live.background.watchdog import Watchdog
from shell_deform.live.exchange import REQUEST, Layout, SharedMemory, Slot

BACK_OFF_FIRST_S = 0.2
BACK_OFF_LAST_S = 10.0
HEALTHY_S = 10.0
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
    """

    object_name: str
    theory: str
    control_vertices: int = 0
    niceness: int = 10


class WorkerProcess:
    """One running process and, once it has built the shell, the memory shared with it.

    Without a `build` it starts ahead, while its owner still finds out what is wanted: `start`
    tells it.
    """

    def __init__(self, build: Build | None = None) -> None:
        self.memory: SharedMemory | None = None
        self.thickness = 0.0
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
            stdin=subprocess.DEVNULL,
        )
        theirs.close()
        ours.setblocking(False)
        self._socket = ours
        if build is not None:
            self.start(build)

    def start(self, build: Build) -> None:
        """Tell the process what to build, once."""
        options = {
            'object': build.object_name,
            'theory': build.theory,
            'control_vertices': build.control_vertices,
            'niceness': build.niceness,
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
        self.memory = SharedMemory(descriptors[0], Layout(hello['vertices'], hello['triangles']))
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

    def post(self, request: np.ndarray) -> None:
        """Replace the load case in the mailbox; never waits."""
        if self.memory is None:
            return
        self._sequence += 1
        self.memory.write_request(request, self._sequence)
        try:
            os.eventfd_write(self._event, 1)
        except BlockingIOError:
            # Only after 2^64 unread load cases; the newest one is in the mailbox anyway.
            return

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

    def stop(self, patience_s: float = 2.0) -> None:
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
    """Keeps a process running; after a death the next one waits longer, up to ten seconds."""

    def __init__(self, build: Build, ahead: WorkerProcess | None = None) -> None:
        """`ahead`: a process started ahead for this."""
        self.restarts = 0
        self._build = build
        self.worker = ahead or WorkerProcess()
        self.worker.start(build)
        self._back_off = BACK_OFF_FIRST_S
        self._start_at = 0.0
        self._started = -np.inf
        self._watchdog = Watchdog(self.worker.process.pid)

    @property
    def trouble(self) -> str:
        """Why the process does not get on, in words that follow its name; '' while it does."""
        return self._watchdog.trouble if self.worker.alive else 'ended and is started again'

    def tend(self, now: float) -> bool:
        """Look after the process at steady time `now` [s]; True when it has just become ready.

        Raises WorkerError if the object cannot be built at all.
        """
        if not np.isfinite(self._started):
            self._started = now
        if self.worker.memory is not None and self.worker.alive:
            self._watchdog.look(self.worker.memory.beats, now)
            if self._watchdog.hopeless:
                self.worker.process.kill()
                self.worker.process.wait()
        if self.worker.alive or self.worker.memory is None and self._waiting_line():
            return self.worker.became_ready()
        if self._start_at == 0.0:
            if now - self._started > HEALTHY_S:
                self._back_off = BACK_OFF_FIRST_S
            self._start_at = now + self._back_off
            self._back_off = min(2.0 * self._back_off, BACK_OFF_LAST_S)
        if now >= self._start_at:
            self.worker.stop()
            self._replace()
            self.restarts += 1
            self._started, self._start_at = now, 0.0
        return False

    def _replace(self) -> None:
        """A new process that builds the same."""
        self.worker = WorkerProcess(self._build)
        self._watchdog = Watchdog(self.worker.process.pid)

    def _waiting_line(self) -> bool:
        """Whether a dead process has left a message to read."""
        try:
            return bool(self.worker._socket.recv(1, socket.MSG_PEEK))
        except OSError:
            return False

    def rebuild(self, build: Build) -> None:
        """Replace the process by one for another object."""
        self.worker.stop()
        self._build = build
        self._replace()
        self._start_at, self._started = 0.0, -np.inf

    def stop(self) -> None:
        """End the process."""
        self.worker.stop()


def empty_request() -> np.ndarray:
    """A load case (1,) of dtype REQUEST to fill again and again."""
    return np.zeros(1, dtype=REQUEST)
