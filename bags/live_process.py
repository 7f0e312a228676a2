# SPDX-License-Identifier: Apache-2.0
"""The node as it is started, on a recorded squeeze, beside the solid: `-m bags.live_process`.

Starts `deformation` with the recording's object and no other parameter, replays the contacts to it
in real time, and compares the outer face that it published at every held scan with the solid's:
the table of `bags.live_bias`, of real processes. Below stands what /diagnostics told: the theory
that `auto` has taken and why, refresh rate, tick. An object whose wall `auto` calls thin publishes
no outer face and is refused. Works on the ROS domain of the environment.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh

from bags.experiments import EXPERIMENTS
from bags.live_bias import BAGS, HEAD, beside_solid, held_scans, shown
from bags.processes import end_process
from grasp_replay.experiment import read_experiment

FIELDS = 11
"""Numbers per vertex of a surface with an outer face."""
SILENCE_S = 300.0
TOLD = (
    'theory', 'why this theory', 'trouble of the mesh', 'background refresh rate [Hz]',
    'background solve [ms]', 'tick median [ms]', 'tick p99 [ms]', 'load cases overtaken',
)  # fmt: skip


@contextlib.contextmanager
def running(name: str, *arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    """An executable of the environment, which ends with the block."""
    command = [str(Path(sys.executable).parent / name), *map(str, arguments)]
    process = subprocess.Popen(command, stdout=sys.stderr, stdin=subprocess.DEVNULL)
    try:
        yield process
    finally:
        end_process(process)


class Listener:
    """Keeps the surfaces of some stamps, and all diagnostics of the node."""

    def __init__(self, wanted: list[int]) -> None:
        """`wanted`: stamps [ns] of which the first answer from there on is kept."""
        self.node = rclpy.create_node('live_process')
        self.meshes = 0
        self.surfaces: dict[int, NDArray[np.float32]] = {}
        self.told: list[dict[str, str]] = []
        self._wanted = wanted
        once = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(Mesh, 'deformation/mesh', self._mesh, once)
        self.node.create_subscription(PointCloud2, 'deformation/surface', self._keep, 5000)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._tell, 50)

    def _mesh(self, _mesh: Mesh) -> None:
        self.meshes += 1

    def _keep(self, message: PointCloud2) -> None:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        for wanted in self._wanted:
            if wanted <= stamp and wanted not in self.surfaces:
                data = np.frombuffer(message.data, np.float32)
                self.surfaces[wanted] = data.reshape(message.width, -1)

    def _tell(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if 'deformation' in status.name:
                self.told.append({value.key: value.value for value in status.values})

    def spin_until(self, condition: Callable[[], object], what: str) -> None:
        """Listen; SystemExit where `condition` does not come true."""
        end = time.monotonic() + SILENCE_S
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.05)
            if time.monotonic() > end:
                raise SystemExit(f'{what} did not come within {SILENCE_S:g} s')


def main() -> int:
    """Play the recording and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('recording', nargs='?', default='tennis_ball_two_finger')
    name = parser.parse_args().recording
    if name not in EXPERIMENTS:
        parser.error(f'no recording {name}; there are {", ".join(EXPERIMENTS)}')
    rows, setting = held_scans(name), EXPERIMENTS[name].setting()
    rclpy.init()
    heard = Listener(list(rows))
    thing = read_experiment(BAGS / name).object_file
    with running('deformation', '--ros-args', '-p', f'object:={thing}'):
        heard.spin_until(lambda: heard.meshes, 'deformation/mesh')
        topics = ('--topics', '/hand/contacts', '/object_pose')
        with running('replay', BAGS / name, '--wait', '30', *topics) as player:
            heard.spin_until(lambda: player.poll() is not None, 'the end of the recording')
        heard.spin_until(lambda: set(rows) <= set(heard.surfaces), 'an answer to the last scan')
    heard.node.destroy_node()
    rclpy.try_shutdown()
    print(HEAD)
    for stamp, packed in sorted(heard.surfaces.items()):
        if packed.shape[1] < FIELDS:
            raise SystemExit(f'{thing} has a thin wall under auto: bags.live_bias compares those')
        values = packed.astype(float)
        # Only the hand knows the depth under a pin as such: here it is that of the surface.
        found = beside_solid(
            setting, rows[stamp], values, values[:, 8:11], float(values[:, 6].max()), True
        )
        print(f'| {name} | {shown(found)} |')
    last = heard.told[-1]
    print('\n' + '\n'.join(f'{key}: {last.get(key, "")}' for key in TOLD))
    rates = [float(one['background refresh rate [Hz]']) for one in heard.told]
    print(f'background refresh rate, largest told [Hz]: {max(rates):.1f}')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
