# SPDX-License-Identifier: Apache-2.0
"""The ROS half of what-if: a `deformation` process of its own under /what_if, and its contacts."""

from __future__ import annotations

import json
import math
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2

from . import messages
from .page import Page
from .poses import Floats
from .scene_model import Mesh
from .solver_process import SolverProcess, WhatIfError, executable
from .what_if import (
    Finger,
    Touch,
    contacts_of,
    nearest,
    object_variant,
    opposite,
    pointed,
    vertex_normals,
)
from .what_if_panel import FINGERS, WhatIfPanel, Wish

NAMESPACE = '/what_if'
RATE_HZ = 30.0
SETTLE_S = 0.4
FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 10.0
"""Before another solver is made where none stands by; twice as long each time [s]."""
SPARE_AFTER_S = 2.0
"""A spare is started so long after the solver has answered: its own start is busy enough [s]."""


def known_objects(chosen: str) -> dict[str, dict[str, Any]]:
    """The objects that `shell_objects` knows, and `chosen` (name or file), by name."""
    described: dict[str, dict[str, Any]] = {}
    for arguments in ([], [chosen]):
        if chosen in described:
            break
        done = subprocess.run(
            [executable('shell_deform', 'shell_objects'), *arguments, '--json'],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        if done.returncode != 0:
            raise WhatIfError(f'object {chosen!r}: {done.stderr.strip()}')
        described.update({one['name']: one for one in json.loads(done.stdout)['objects']})
    return described


def _shell(wish: Wish) -> Wish:
    """What of a wish the solver builds: friction and mass are asked of it as they come."""
    return replace(wish, friction=0.0, mass_kg=0.0)


class WhatIf:
    """Publishes the fingers' contacts and keeps the solver's parameters as the sliders say."""

    def __init__(self, node: Node, page: Page, chosen: str) -> None:
        """Start the solver; raises WhatIfError if that cannot be done."""
        self._objects = known_objects(chosen)
        name = chosen if chosen in self._objects else list(self._objects)[-1]
        self._panel = WhatIfPanel(page.server, self._objects, name)
        page.show_cones()
        self._written = 0
        self._clock = node.get_clock()
        self._mesh: Mesh | None = None
        self._normals: Floats | None = None
        self._touches: dict[int, Touch] = {}
        self._served = self._asked = self._panel.wish
        self._changed_at = 0.0
        self._future: Future | None = None
        self._publisher = node.create_publisher(PointCloud2, f'{NAMESPACE}/hand/contacts', 10)
        self._client = node.create_client(SetParameters, f'{NAMESPACE}/deformation/set_parameters')
        self._pause = FIRST_PAUSE_S
        self._spare: SolverProcess | None = None
        self._prepared: tuple[Wish, Path] | None = None
        self._start()
        node.create_timer(1.0 / RATE_HZ, self._publish)

    def _start(self) -> None:
        """Let a solver, the spare where there is one, serve what was served."""
        spare, self._spare = self._spare, None
        self._solver = spare or SolverProcess()
        served, prepared = self._served, self._prepared
        if spare is not None and prepared is not None and prepared[0] == _shell(served):
            path = prepared[1]
        else:
            path = self._write(self._solver, served)
        parameters = {
            'object': path, 'theory': served.theory, 'drive': 'force',
            'frame': 'object', 'friction': served.friction, 'mass': served.mass_kg,
        }  # fmt: skip
        words = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
        self._solver.begin(['--ros-args', '-r', f'__ns:={NAMESPACE}', *words])
        self._ended, self._quiet_since = time.monotonic(), math.inf

    def _look_after(self) -> None:
        """Replace a solver that has ended or was stopped, and say so; keep a spare ready."""
        now = time.monotonic()
        if self._solver.alive:
            self._ended = now
        if self._spare is not None and not self._spare.alive:
            self._spare.drop()
            self._spare = None
        if self._solver.alive:
            self._keep_a_spare(now)
            return
        self._panel.say('the solver has ended and another one takes its place …')
        if self._spare is None and now - self._ended < self._pause:
            return
        self._pause, self._ended = min(2.0 * self._pause, LONGEST_PAUSE_S), now
        self._solver.drop()
        self._future = None
        self._start()

    def _keep_a_spare(self, now: float) -> None:
        """Have another solver stand by, with the shell that is served built."""
        if self._spare is None and now - self._quiet_since > SPARE_AFTER_S:
            self._spare, self._quiet_since, self._prepared = SolverProcess(), now, None
        served, prepared = self._served, self._prepared
        if self._spare is None or (prepared is not None and prepared[0] == _shell(served)):
            return
        if self._asked == served and now - self._changed_at > SPARE_AFTER_S:
            self._prepared = _shell(served), self._write(self._spare, served)
            self._spare.prepare(self._prepared[1], served.theory)

    def _write(self, solver: SolverProcess, wish: Wish) -> Path:
        """The wished object as a file of a new name, so that `solver` sees a change."""
        self._written += 1
        path = solver.folder / str(self._written) / f'{wish.object_name}.yaml'
        path.parent.mkdir()
        variant = object_variant(
            self._objects[wish.object_name], wish.young_modulus_pa, wish.gauge_pressure_pa
        )
        path.write_text(json.dumps(variant, indent=1))
        return path

    def tick(self, mesh: Mesh | None) -> None:
        """Follow the mesh, the drags and the sliders; called at the page's rate."""
        if mesh is not None and mesh is not self._mesh:
            self._mesh, self._normals = mesh, vertex_normals(mesh)
            # A solver that has answered was a good one, however soon it ends.
            self._pause, self._quiet_since = FIRST_PAUSE_S, time.monotonic()
            self._panel.say('')
            self._place()
        self._follow_drags()
        self._panel.show(self.fingers)
        try:
            self._follow_wish()
            self._look_after()
        except (OSError, WhatIfError) as error:
            # A full disk, say: it is tried again.
            self._panel.say(f'{error}')

    def _follow_drags(self) -> None:
        """Put fingers where they were dragged to, and finger 2 opposite finger 1 where it is held.

        Once it is not held there any more, it stays.
        """
        while not self._panel.drags.empty():
            drag = self._panel.drags.get()
            # Between two objects there are no fingers.
            if self._touches and self._mesh is not None and self._normals is not None:
                self._panel.release(drag.finger)
                self._touches[drag.finger] = pointed(
                    self._mesh, self._normals, drag.origin, drag.direction
                )
        if not self._panel.opposing or not self._touches:
            return
        assert self._mesh is not None and self._normals is not None
        far = opposite(self._mesh, self._normals, self._touches[1])
        if far is not None:
            self._touches[2] = far

    def _place(self) -> None:
        """Fingers at the object's own contacts, else around its x axis; kept where they were."""
        assert self._mesh is not None and self._normals is not None
        at = [contact['at_m'] for contact in self._objects[self._served.object_name]['contacts']]
        size = float(abs(self._mesh.rest).max())
        at += [[size, 0.0, 0.0], [-size, 0.0, 0.0], [0.0, size, 0.0]][len(at) :]
        for number in range(1, FINGERS + 1):
            kept = self._touches.get(number)
            place = at[number - 1] if kept is None else kept.point
            self._touches[number] = nearest(self._mesh, self._normals, place)

    @property
    def fingers(self) -> list[Finger]:
        """The fingers as they stand, those without force left out."""
        return [
            Finger(number, self._touches[number], self._panel.force(number))
            for number in sorted(self._touches)
            if number < FINGERS or self._panel.force(number) > 0.0
        ]

    def _publish(self) -> None:
        fingers = self.fingers
        if fingers:
            described = self._objects[self._served.object_name]
            contacts = contacts_of(fingers, float(described['thickness_m']), 0.002)
            self._publisher.publish(
                messages.contacts_message(contacts, self._clock.now().to_msg())
            )

    def _follow_wish(self) -> None:
        wish, now = self._panel.wish, time.monotonic()
        if wish != self._asked:
            self._asked, self._changed_at = wish, now
        if self._future is not None and self._future.done():
            result = self._future.result().results
            refused = '; '.join(one.reason for one in result if not one.successful)
            self._panel.say(f'refused: {refused}' if refused else '')
            self._future = None
        settled = now - self._changed_at > SETTLE_S
        if self._asked == self._served or not settled or self._future is not None:
            return
        if not self._client.service_is_ready():
            return
        changes = self._changes()
        request = SetParameters.Request(
            parameters=[change.to_parameter_msg() for change in changes]
        )
        self._future = self._client.call_async(request)
        self._panel.say('solving anew …')

    def _changes(self) -> list[Parameter]:
        """Parameters that bring the solver nearer to what is asked; one thing at a time."""
        asked, served = self._asked, self._served
        if (asked.friction, asked.mass_kg) != (served.friction, served.mass_kg):
            self._served = replace(served, friction=asked.friction, mass_kg=asked.mass_kg)
            return [
                Parameter('friction', value=asked.friction),
                Parameter('mass', value=asked.mass_kg),
            ]
        if asked.theory != served.theory:
            self._served = replace(served, theory=asked.theory)
            return [Parameter('theory', value=asked.theory)]
        path = self._write(self._solver, asked)
        if asked.object_name != served.object_name:
            self._touches.clear()
        self._served = asked
        return [Parameter('object', value=str(path))]

    def close(self) -> None:
        """End the solver and its spare."""
        for one in (self._spare, self._solver):
            if one is not None:
                one.end()
