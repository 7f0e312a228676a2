# SPDX-License-Identifier: Apache-2.0
"""Comparisons in a process of their own, so that no callback of the node ever waits for one.

The process is a fresh interpreter, never a fork; it computes one comparison at a time, in the
order in which the jobs came, below the priority of the nodes that answer live.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread

import numpy as np

from grasp_common.formats import RawMesh
from grasp_common.watchdog import end_with_parent, is_stopped
from scan_compare.comparison import ComparisonError, Setup, compare
from scan_compare.deformed_surface import (
    DeformedSurface,
    SurfaceError,
    outer_face_at_rest,
    published_mesh,
    surface_from_limit_positions,
    surface_of_outer_face,
)
from scan_compare.registration import RegistrationError
from scan_compare.report.files import write_report
from scan_compare.report.table import verdict
from scan_compare.rigid import Pose
from scan_compare.scan import Scan
from scan_compare.scan_file import ScanFileError, read_scan, scan_of
from scan_compare.units import UnitError
from shell_deform.objects import ObjectError, ShellObject, load_object, object_mesh
from shell_deform.surface.control_mesh import ControlMesh, MeshError
from shell_deform.surface.limit import LimitSurface

FAILURES = (
    ComparisonError,
    MeshError,
    ObjectError,
    OSError,
    RegistrationError,
    ScanFileError,
    SurfaceError,
    UnitError,
)
NICENESS = 10
"""What the process adds to its niceness, as the solver's background process does: a scan can wait,
the surface that answers the next contact cannot."""

LOOKED_AFTER_S = 0.2
"""How often the process is looked after [s]."""

PATIENCE_S = 2.0
"""How long an ending process is waited for before it is killed [s]."""


@dataclass(frozen=True)
class Cloud:
    """A scan as it arrived: points (n, 3) in `unit`, or the file to read it from."""

    source: str
    points: np.ndarray | None
    unit: str | None

    @property
    def size(self) -> int:
        """Memory of the points [bytes]; a file is read when its turn comes."""
        return 0 if self.points is None else self.points.nbytes


@dataclass(frozen=True)
class Job:
    """One comparison to do.

    rest, deformed: limit positions (n, 3) [m] and triangles (m, 3), or None for the object at
    rest; outer: points (n, 3) of the outer face over them [m], None: half a wall off; start: pose
    of the scan or None to search; stamp_ns, frame: handed through.
    """

    number: int
    cloud: Cloud
    object: str
    triangles: np.ndarray | None
    rest: np.ndarray | None
    deformed: np.ndarray | None
    start: Pose | None
    scanner_sigma_m: float
    outlier_m: float | None
    undeformed: Cloud | None
    report_directory: str
    stamp_ns: int
    frame: str
    notes: tuple[str, ...] = ()
    outer: np.ndarray | None = None


@dataclass(frozen=True)
class Result:
    """What came of a job: an `error` sentence, or points, distances and statistics.

    seconds: how long the comparison took, without its wait.
    """

    number: int
    stamp_ns: int
    frame: str
    error: str = ''
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3), np.float32))
    distance: np.ndarray = field(default_factory=lambda: np.empty(0, np.float32))
    statistics: dict[str, object] = field(default_factory=dict)
    sentence: str = ''
    seconds: float = 0.0


Results = SimpleQueue[Result]


def run(job: Job) -> Result:
    """Do one comparison; every expected failure becomes a result with an error sentence."""
    try:
        surface = _surface(job)
        scan = _scan(job.cloud, surface)
        undeformed = None if job.undeformed is None else _scan(job.undeformed, surface.at_rest())
        comparison = compare(
            scan,
            surface,
            undeformed,
            Setup(scanner_sigma_m=job.scanner_sigma_m, start=job.start, outlier_m=job.outlier_m),
        )
        if job.report_directory:
            write_report(comparison, Path(job.report_directory) / f'scan_{job.stamp_ns}')
    except FAILURES as error:
        return Result(job.number, job.stamp_ns, job.frame, str(error))
    statistics = comparison.to_json()
    statistics['notes'] = [*comparison.notes, *job.notes]
    return Result(
        job.number,
        job.stamp_ns,
        job.frame,
        points=comparison.points.astype(np.float32),
        distance=comparison.distances.distance.astype(np.float32),
        statistics=statistics,
        sentence='; '.join((verdict(comparison), *job.notes)),
    )


def _surface(job: Job) -> DeformedSurface:
    shell = load_object(job.object)
    if job.triangles is None or job.rest is None or job.deformed is None:
        limit = _LIMITS.of(job.object, None, None)
        vertices = limit.mesh.vertices
        return DeformedSurface(limit, vertices, vertices, shell.thickness_m)
    if len(job.deformed) != len(job.rest) or int(job.triangles.max()) >= len(job.rest):
        raise SurfaceError(
            f'deformation/surface has {len(job.deformed)} points but deformation/mesh names '
            f'vertex {int(job.triangles.max())}'
        )
    limit = _LIMITS.of(job.object, job.triangles, job.rest)
    if job.outer is None:
        return surface_from_limit_positions(limit, job.rest, job.deformed, shell.thickness_m)
    at_rest = outer_face_at_rest(limit, job.rest, shell.thickness_m)
    return surface_of_outer_face(limit, at_rest, job.outer, shell.thickness_m)


class _Limits:
    """The limit surface in use: its tables and factors serve one comparison after the other."""

    def __init__(self) -> None:
        self._key: tuple[str, bytes] | None = None
        self._limit: LimitSurface | None = None

    def of(self, name: str, triangles: np.ndarray | None, rest: np.ndarray | None) -> LimitSurface:
        """Return the surface of an object, or of the topology on `deformation/mesh`.

        The object's own mesh is preferred when it is the same one: it knows its creases.
        """
        key = (name, b'' if triangles is None else triangles.tobytes())
        if self._limit is None or key != self._key:
            self._limit = LimitSurface(_mesh(name, triangles, rest))
            self._key = key
        return self._limit


_LIMITS = _Limits()


def _mesh(name: str, triangles: np.ndarray | None, rest: np.ndarray | None) -> ControlMesh:
    shell = load_object(name)
    if triangles is None or rest is None:
        return object_mesh(shell)
    return _same_mesh(shell, triangles) or published_mesh(triangles, rest)


def _same_mesh(shell: ShellObject, triangles: np.ndarray) -> ControlMesh | None:
    for wanted in (None, len(np.unique(triangles))):
        mesh = object_mesh(shell, wanted)
        if np.array_equal(mesh.triangles[mesh.active], triangles):
            return mesh
    return None


def _scan(cloud: Cloud, surface: DeformedSurface) -> Scan:
    if cloud.points is None:
        return read_scan(cloud.source, cloud.unit, surface.extent)
    return scan_of(RawMesh(cloud.points.copy(), None), cloud.source, cloud.unit, surface.extent)


def main() -> None:
    """The process: `python -c '... main()' SOCKET`."""
    # Ctrl-C reaches the whole process group; the node decides when this process ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    serve(Connection(int(sys.argv[1])))


def serve(connection: Connection) -> None:
    """Answer jobs until the other end closes."""
    while True:
        try:
            job = connection.recv()
        except (EOFError, OSError):
            return
        began = time.monotonic()
        try:
            result = run(job)
        except Exception as error:  # a defect must reach the diagnostics, not end the process
            result = Result(job.number, job.stamp_ns, job.frame, f'defect: {error!r}')
        try:
            connection.send(replace(result, seconds=time.monotonic() - began))
        except OSError:
            return


def exchange(connection: Connection, jobs: SimpleQueue[Job | None], results: Results) -> None:
    """Carry jobs to the process and results back until it ends, or a None asks for the end.

    In a thread of its own: a large scan goes through the pipe as fast as the process, which yields
    to all others, takes it.
    """
    try:
        while (job := jobs.get()) is not None:
            connection.send(job)
            results.put(connection.recv())
    except (EOFError, OSError):
        pass
    finally:
        connection.close()


class Worker:
    """Owns the process: starts it, hands it one job after the other, restarts it when it died."""

    def __init__(self) -> None:
        self._running: Job | None = None
        self._waiting: deque[Job] = deque()
        self._looked_after = 0.0
        self.restarts = -1
        self._start()

    @property
    def busy(self) -> bool:
        """Whether a comparison is being computed or waits."""
        return self._running is not None or bool(self._waiting)

    @property
    def _alive(self) -> bool:
        return self._process.poll() is None

    @property
    def waiting(self) -> int:
        """Jobs that wait for the one being computed."""
        return len(self._waiting)

    @property
    def waiting_size(self) -> int:
        """Memory of their points [bytes]."""
        return sum(job.cloud.size for job in self._waiting)

    def submit(self, job: Job) -> None:
        """Take a job; it is computed after those that wait already."""
        self._waiting.append(job)
        self._hand_over()

    def drop_oldest(self) -> Job | None:
        """Give up the job that has waited longest; None if none waits."""
        return self._waiting.popleft() if self._waiting else None

    def poll(self) -> Result | None:
        """Return a result if one is there; never waits for a computation or a transfer."""
        self._look_after()
        # asked before the results are: what an ended thread has brought is among them; that of an
        # idle process waits for a job and hears nothing
        ended = not self._thread.is_alive() or not (self._running or self._alive)
        try:
            result = self._results.get_nowait()
        except Empty:
            return self._died() if ended else None
        self._running = None
        self._hand_over()
        return result

    def _hand_over(self) -> None:
        if self._running is None and self._waiting:
            self._running = self._waiting.popleft()
            self._jobs.put(self._running)

    def _look_after(self) -> None:
        """Replace a process that somebody stopped; its comparison begins again in the new one."""
        now = time.monotonic()
        if now - self._looked_after < LOOKED_AFTER_S:
            return
        self._looked_after = now
        if not is_stopped(self._process.pid):
            return
        if self._running is not None:
            self._waiting.appendleft(self._running)
            self._running = None
        self._jobs.put(None)
        self._process.kill()
        self._wait()
        self._start()
        self._hand_over()

    def _wait(self) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(PATIENCE_S)

    def _died(self) -> Result | None:
        lost, self._running = self._running, None
        self._jobs.put(None)
        self._wait()
        code = self._process.returncode
        self._start()
        self._hand_over()
        if lost is None:
            return None
        return Result(
            lost.number,
            lost.stamp_ns,
            lost.frame,
            f'the comparing process ended with code {code} and was started again',
        )

    def _start(self) -> None:
        self._jobs: SimpleQueue[Job | None] = SimpleQueue()
        self._results: Results = SimpleQueue()
        ours, theirs = socket.socketpair()
        # Not multiprocessing's own start: it keeps a second process beside this one, which nobody
        # would look after.
        self._process = subprocess.Popen(
            [
                sys.executable,
                '-c',
                'from scan_compare.worker import main; main()',
                str(theirs.fileno()),
            ],
            pass_fds=(theirs.fileno(),),
            preexec_fn=end_with_parent,
            stdin=subprocess.DEVNULL,
        )
        theirs.close()
        self._thread = Thread(
            target=exchange,
            args=(Connection(ours.detach()), self._jobs, self._results),
            daemon=True,
        )
        self._thread.start()
        self.restarts += 1

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._jobs.put(None)
        self._process.terminate()
        self._wait()
        if self._alive:
            self._process.kill()
            self._process.wait()
        self._thread.join()
