# SPDX-License-Identifier: Apache-2.0
"""`make demo`: a recorded grasp through the live nodes, then the paper's Table I beside ours.

Three real processes on a ROS domain of their own: `replay` sends the recording, `deformation`
answers every contact sample with the surface, `scan_compare` judges it against the scans. This
script only listens. `grasp_report` works the same bag offline meanwhile, in the time that the
nodes leave. Exit code 1 if a sample stayed without an answer.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
START_TIMEOUT_S = 300.0
STOP_TIMEOUT_S = 10.0
SETTLE_TIMEOUT_S = 60.0

os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(name, '1')

import rclpy  # noqa: E402  (the domain must be set before)
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from shape_msgs.msg import Mesh  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402


class Listener(Node):
    """Counts the answers and keeps the last scan figures."""

    def __init__(self) -> None:
        super().__init__('demo_listener')
        self.surfaces: set[int] = set()
        self.errors: list[float] = []
        self.meshes = 0
        many = QoSProfile(depth=5000)
        self.create_subscription(PointCloud2, 'deformation/surface', self._surface, many)
        self.create_subscription(Float64, 'scan/mean_error', self._error, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(Mesh, 'deformation/mesh', self._mesh, latched)

    def _surface(self, message: PointCloud2) -> None:
        self.surfaces.add(_stamp(message))

    def _mesh(self, message: Mesh) -> None:
        self.meshes += 1

    def _error(self, message: Float64) -> None:
        self.errors.append(message.data)


def _stamp(message: PointCloud2) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def main() -> int:
    """Run the demo; 1 if a sample was lost or the report failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--bag', type=Path, default=ROOT / 'bags' / 'tennis_ball_two_finger')
    parser.add_argument('--rate', type=float, default=1.0, help='bag seconds per second')
    parser.add_argument('--out', type=Path, default=ROOT / 'out' / 'demo')
    options = parser.parse_args()
    print(f'1/2  {options.bag.name} through the live nodes', flush=True)
    with offline(options.bag, options.out) as report:
        summary = live(options.bag, options.rate)
        print(
            f'     {summary["contacts"]} contact samples, {summary["answered"]} answered by a '
            f'surface, {summary["lost"]} lost; {summary["compared"]} of {summary["scans"]} scans '
            'compared live'
        )
        print('2/2  the same bag offline, against the published table', flush=True)
        print(report.communicate()[0], end='')
    if report.returncode == 0:
        print(f'open {options.out / "report.html"}')
    return report.returncode or int(summary['lost'] > 0)


@contextmanager
def offline(bag: Path, out: Path) -> Iterator[subprocess.Popen[str]]:
    """`grasp_report` at work, behind the nodes; ended with the block."""
    report = subprocess.Popen(
        ['nice', '-n', '19', BIN / 'grasp_report', bag, '--out', out, '--no-samples'],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield report
    finally:
        _stop(report)


def live(bag: Path, rate: float) -> dict[str, int]:
    """Play `bag` into the nodes and count what comes back."""
    sent, scans = _recorded(bag, '/hand/contacts'), _recorded(bag, '/scan/points')
    pose = _object_pose(bag)
    parameters = ['--ros-args', '-p', 'object:=tennis_ball', '-p', f'object_pose:={pose}']
    logs = Path(tempfile.mkdtemp(prefix='grasp_demo_'))
    rclpy.init()
    listener = Listener()
    executor = SingleThreadedExecutor()
    executor.add_node(listener)
    processes = [
        # Two cores carry four processes here: the thin wall is refreshed several times as often.
        _start('deformation', [*parameters, '-p', 'theory:=koiter'], logs),
        _start('scan_compare', parameters, logs),
        # It reads the recording meanwhile, and plays when the nodes are there.
        _start(
            'replay',
            [str(bag), '--rate', str(rate), '--start-paused', '--wait', f'{START_TIMEOUT_S:g}']
            + ['--topics', '/hand/contacts', '/object_pose', '/scan/points'],
            logs,
        ),
    ]
    *nodes, player = processes
    resume = listener.create_client(Trigger, 'replay/resume')

    def until(condition: Callable[[], bool], seconds: float) -> bool:
        deadline = time.monotonic() + seconds
        while not condition():
            executor.spin_once(timeout_sec=0.05)
            if any(node.poll() is not None for node in nodes) or player.poll():
                raise SystemExit(f'a node ended; the logs are in {logs}')
            if time.monotonic() > deadline:
                return False
        return True

    # The mesh is published when the shell is built and every sample is answered from then on.
    def ready() -> bool:
        there = listener.meshes > 0 and listener.count_publishers('scan/mean_error') > 0
        return there and resume.service_is_ready()

    try:
        if not until(ready, START_TIMEOUT_S):
            raise SystemExit(f'the nodes did not start; their logs are in {logs}')
        playing = resume.call_async(Trigger.Request())
        if not until(playing.done, START_TIMEOUT_S):
            raise SystemExit(f'the replay does not play; its log is in {logs}')
        until(lambda: player.poll() is not None, float('inf'))
        until(
            lambda: len(listener.surfaces) >= sent and len(listener.errors) >= scans,
            SETTLE_TIMEOUT_S,
        )
    finally:
        _stop(*processes)
        executor.shutdown()
        listener.destroy_node()
        rclpy.try_shutdown()
    return {
        'contacts': sent,
        'answered': len(listener.surfaces),
        'lost': sent - len(listener.surfaces),
        'scans': scans,
        'compared': len(listener.errors),
    }


def _recorded(bag: Path, topic: str) -> int:
    """How many messages of `topic` the recording holds."""
    information = yaml.safe_load((bag / 'metadata.yaml').read_text())
    for entry in information['rosbag2_bagfile_information']['topics_with_message_count']:
        if entry['topic_metadata']['name'] == topic:
            return int(entry['message_count'])
    raise SystemExit(f'{bag} holds no {topic}')


def _object_pose(bag: Path) -> str:
    """The recorded pose of the object as a ROS parameter value."""
    document = yaml.safe_load((bag / 'experiment.yaml').read_text())
    return '[' + ', '.join(repr(float(value)) for value in document['object_pose']) + ']'


def _start(executable: str, arguments: list[str], logs: Path) -> subprocess.Popen[bytes]:
    stream = (logs / f'{executable}.log').open('wb')
    return subprocess.Popen(
        [BIN / executable, *arguments], stdout=stream, stderr=subprocess.STDOUT
    )


def _stop(*processes: subprocess.Popen[Any]) -> None:
    """End all of them at once: each takes a second or two to leave."""
    left = [process for process in processes if process.poll() is None]
    for process in left:
        process.send_signal(signal.SIGINT)
    for process in left:
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


if __name__ == '__main__':
    sys.exit(main())
