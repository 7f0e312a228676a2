# SPDX-License-Identifier: Apache-2.0
"""The background process: builds the shell, then solves the newest load case, again and again.

Started as `python -m shell_deform.live.background.worker SOCKET EVENT`: a fresh interpreter
without ROS. The socket carries one line of JSON with what to build, and back a line with the sizes
together with the descriptor of the shared memory, or a line with the reason why not. Afterwards
every posted load case adds one to the event counter, so a count above one tells how many were
overtaken. The end of the socket is the end of the process. In between a counter in the shared
memory rises wherever the process goes round a loop, so that a watcher knows one that hangs.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import sys
import time

import numpy as np

from shell_deform.building import build_model
from shell_deform.contact.finger_bodies import FingerBodies, read_finger_bodies
from shell_deform.live.background.courtesy import Courtesy
from shell_deform.live.background.fingertips import FingertipSolver
from shell_deform.live.background.gripping import plan_of
from shell_deform.live.background.load_case import load_of
from shell_deform.live.background.motion import Motion
from shell_deform.live.background.rest_shell import packed
from shell_deform.live.background.solving import LiveSolver
from shell_deform.live.exchange import Layout, SharedMemory, create
from shell_deform.model import ShellModel
from shell_deform.objects import ObjectError, load_object
from shell_deform.readout import mesh_warning
from shell_deform.theory import AUTO, KOITER, THICK

WAITING_BEAT_S = 0.1
"""A process that waits for load cases says so at this interval [s]."""


Solver = LiveSolver | FingertipSolver


def build(options: dict[str, object]) -> Solver:
    """What solves the shell that `options` describe, see `worker_link.Build`."""
    bodies = read_finger_bodies(str(options.get('bodies') or ''))
    model = _model(options, bodies)
    if options.get('by_cells') and model.theory == THICK:
        raise ObjectError(
            'load_shape cells is for thin walls; theory thick presses by rigid pins: take theory '
            'koiter'
        )
    if not bodies.files or options.get('by_cells'):
        return LiveSolver(model, pins_slide=bool(options.get('pins_slide')))
    return FingertipSolver(model, bodies.loaded())


def _model(options: dict[str, object], bodies: FingerBodies) -> ShellModel:
    count = options.get('control_vertices')
    # Of an object without contacts auto would not know that no pins press.
    thin = options.get('by_cells') and options['theory'] == AUTO
    shell = bodies.on(load_object(str(options['object'])))
    places = np.array(options.get('refine_at') or (), float).reshape(-1, 3)
    radius = float(str(options.get('refine_radius') or 0.0)) or None
    if len(places) and bodies.files and not options.get('by_cells'):
        # What a body needs under it depends on how round the object is there, not on its radius.
        shell, places = bodies.touching(shell, places), places[:0]
    return build_model(
        shell,
        theory=KOITER if thin else str(options['theory']),
        control_vertices=int(str(count)) if count else None,
        refine_at=places if len(places) else None,
        refine_radius=radius if len(places) else None,
    )


def share(solver: Solver) -> tuple[SharedMemory, int]:
    """Shared memory with the surface at rest in it, and its descriptor."""
    mesh = solver.model.shell.mesh
    triangles = mesh.triangles[mesh.active]
    outer, grips = solver.unloaded_outer, len(solver.model.grips)
    layout = Layout(len(solver.model.rest), len(triangles), outer is not None, grips)
    memory, descriptor = create(layout)
    memory.rest[:] = solver.unloaded_surface
    memory.rest_normals[:] = solver.unloaded_normals
    if memory.rest_outer is not None:
        memory.rest_outer[:] = outer
    memory.rest_grips[:] = solver.rest_grips
    memory.triangles[:] = triangles
    return memory, descriptor


def hand_over(solver: Solver, connection: socket.socket, curl: float) -> None:
    """Give the shell at rest to the other side, for contacts that are still unknown here."""
    rest = packed(solver.rest_shell(curl))
    with contextlib.suppress(BrokenPipeError):
        socket.send_fds(connection, [b'rest\n'], [rest])
    os.close(rest)


class Loop:
    """Serves load cases from shared memory until the other side is gone."""

    def __init__(
        self, solver: Solver, memory: SharedMemory, event: int, courtesy: Courtesy | None
    ) -> None:
        """`courtesy`: where the work is done, None for this thread."""
        self.solver = solver
        self.memory = memory
        self.event = event
        self.dropped = 0
        self.resets = 0
        self.jumps = 0
        self.results = 0
        self.failure = ''
        self.courtesy = courtesy

    def run(self, connection: socket.socket) -> None:
        """Wait for load cases; returns when `connection` closes."""
        while True:
            self.memory.beat()
            ready, _, _ = select.select([self.event, connection.fileno()], [], [], WAITING_BEAT_S)
            if connection.fileno() in ready and _is_gone(connection):
                return
            if self.event in ready:
                self.dropped += os.eventfd_read(self.event) - 1
                if self.courtesy is None:
                    self.serve_newest()
                else:
                    self.courtesy.run(self.serve_newest)

    def serve_newest(self) -> None:
        """Solve the newest load case and publish: first the state, then columns of its own.

        Whatever a set of contacts leads to, the next one finds a working solver: after an error it
        starts over from the unloaded shell, and the result says why.
        """
        request = self.memory.read_request()
        if request is None:
            return
        answers = int(request[0]['begin'])
        self.solver.is_awaited = lambda: int(self.memory.request['begin'][0]) != answers
        load = load_of(request[0], self.resets, self.jumps)
        self.resets, self.jumps = int(request[0]['resets']), int(request[0]['jumps'])
        try:
            began = time.perf_counter()
            self.solver.take(load)
            self.failure = ''
            turning = self.solver.turning
            if not turning:
                # Columns of before the turn would say little about the shell after it.
                self._publish(answers, fresh=False)
            # Columns can wait while they serve and a newer load case has come.
            wait = self.solver.columns_serve and self.solver.is_awaited() and not turning
            if (not wait and self.solver.refine()) or turning:
                self._publish(answers, fresh=True)
            if self.solver.motion is not None:
                self.solver.motion.took(time.perf_counter() - began)
        except MemoryError:
            raise
        except Exception as error:
            if str(error) != self.failure:
                self.failure = str(error)
                print(f'deformation worker: {error}', file=sys.stderr, flush=True)
            self.solver.start_over()
            self._publish(answers, fresh=False)

    def _publish(self, answers: int, fresh: bool) -> None:
        index = self.memory.free_slot()
        slot = self.memory.slots[index]
        self.solver.fill(slot)
        slot.record['answers'] = answers
        slot.record['dropped'] = self.dropped
        slot.record['fresh_columns'] = int(fresh)
        if self.failure:
            slot.record['share'] = 0.0
            slot.record['message'] = f'started over: {self.failure}'.encode()[:200]
        self.results += 1
        self.memory.publish(index, self.results)


def step_back(niceness: int) -> Courtesy | None:
    """Become nice; where the work is done from then on, None for this thread."""
    courtesy = Courtesy() if niceness else None
    os.nice(niceness)
    return courtesy


def _is_gone(connection: socket.socket) -> bool:
    """Whether the other side has closed a socket that is ready to be read."""
    try:
        return not connection.recv(1)
    except ConnectionResetError:
        # It has left without reading all.
        return True


def main() -> int:
    """Run the process; returns the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    connection = socket.socket(fileno=int(sys.argv[1]))
    line = connection.makefile('r').readline()
    if not line:
        # Whoever started this process ahead ended before it knew what to build.
        return 0
    options = json.loads(line)
    courtesy = None
    if options['beside']:
        courtesy = step_back(int(options['niceness']))
    try:
        solver = build(options)
    except (ValueError, OSError) as error:
        connection.sendall(json.dumps({'error': str(error)}).encode() + b'\n')
        return 1
    memory, descriptor = share(solver)
    layout = memory.layout
    plan = plan_of(solver.model)
    hello = {
        'vertices': layout.vertices,
        'triangles': layout.triangles,
        'outer': layout.outer,
        'theory': solver.model.theory,
        'reason': solver.model.reason,
        'mesh_warning': mesh_warning(solver.model.shell.mesh) or '',
        'thickness': float(solver.model.shell.thickness.mean()),
        'grips': plan.names,
        'origins': plan.origins.tolist(),
        'alone': plan.alone,
    }
    try:
        socket.send_fds(connection, [json.dumps(hello).encode() + b'\n'], [descriptor])
    except BrokenPipeError:
        # Whoever asked for the shell has ended meanwhile.
        return 0
    os.close(descriptor)
    # The surface at rest is served meanwhile. A shell may have no place for a contact there; the
    # first real one then takes longer.
    solver.tracker.beat = memory.beat
    with contextlib.suppress(ValueError, RuntimeError):
        solver.warm_up()
    hand_over(solver, connection, float(str(options.get('curl') or 0.0)))
    if not options['beside']:
        # So long nobody else had an answer, and somebody waits for the first one.
        courtesy = step_back(int(options['niceness']))
    if isinstance(solver, LiveSolver):
        solver.motion = Motion(float(solver.model.shell.thickness.mean()))
    Loop(solver, memory, int(sys.argv[2]), courtesy).run(connection)
    return 0


if __name__ == '__main__':
    sys.exit(main())
