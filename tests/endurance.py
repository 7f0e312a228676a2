# SPDX-License-Identifier: Apache-2.0
"""The whole suite at full rate, one core kept busy: `endurance.py --minutes 30`.

Emulated hand, deformation, scan_compare, the page and a recording of everything; the hand moves,
closes and opens, and a scan comes after each closing. Every message of contacts is accounted for:
what the hand has published, what the estimator took or says it lost, what stands in the recording
or was told as lost there. Prints a table of figures and goals; exit code 1 when one is missed.
"""

from __future__ import annotations

import argparse
import array
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from processes import resident_mb
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from grasp_common.messages import raw_stamp

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
BALL = ROOT / 'ros2_ws/src/barrett_hand_bridge/config/squeezed_ball.yaml'
NODES = {
    'hand_bridge': (
        'backend:=emulator',
        'initialize_on_start:=true',
        f'emulator_object:={BALL}',
    ),
    'deformation': ('object:=tennis_ball', 'placement:=first_touch', 'theory:=koiter'),
    'scan_compare': ('object:=tennis_ball',),
    'grasp_view': ('port:=8975',),
}
STREAM = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
GROWTH_MB = 60.0
REFRESH_HZ = 5.0
LONGEST_S = 3
BUSY_CORE = (os.cpu_count() or 1) - 1


class Suite:
    """All processes, and a node that hears them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.contacts = self.surfaces = self.not_finite = 0
        self.last_ns = self.published = 0
        self.refresh: list[float] = []
        self.without = self.longest_without = 0
        self.told: dict[str, dict[str, str]] = {}
        rclpy.init()
        self.node = rclpy.create_node('endurance')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        listen = self.node.create_subscription
        # As it comes over the wire: a listener that unpacks everything is a load of its own.
        listen(PointCloud2, 'hand/contacts', self._contact, STREAM, raw=True)
        listen(PointCloud2, 'deformation/surface', self._surface, STREAM, raw=True)
        listen(DiagnosticArray, '/diagnostics', self._diagnostics, 10)
        self.trajectories = self.node.create_publisher(
            JointTrajectory, 'hand/joint_trajectory', 10
        )
        self.scans = self.node.create_publisher(PointCloud2, 'scan/points', 2)

    def start(self, name: str, *arguments: str) -> None:
        """Start one executable of the environment."""
        with (self.folder / f'{name}.log').open('wb') as log:
            self.processes[name] = subprocess.Popen(
                [BIN / name, *arguments], stdout=log, stderr=subprocess.STDOUT
            )

    def log(self, name: str) -> str:
        """What a process has written."""
        return (self.folder / f'{name}.log').read_text(errors='replace')

    def _contact(self, message: bytes) -> None:
        self.contacts += 1

    def _surface(self, message: bytes) -> None:
        self.surfaces += 1
        self.last_ns = raw_stamp(message)
        if self.surfaces % 20 == 0:
            cloud = deserialize_message(message, PointCloud2)
            self.not_finite += not np.isfinite(np.frombuffer(cloud.data, np.float32)).all()

    def _diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {one.key: one.value for one in status.values}
            self.told[status.name.split(':')[0]] = values
            if 'background refresh rate [Hz]' in values and values['state'] == 'CONTACT':
                self.refresh.append(float(values['background refresh rate [Hz]']))
                # Told once a second.
                self.without = 0 if self.refresh[-1] else self.without + 1
                self.longest_without = max(self.longest_without, self.without)

    def accounted(self) -> tuple[int, int]:
        """Messages of contacts so far: published by the hand, taken or told lost by the estimator.

        Only while the hand is silent, a second after its last one, do the two belong together.
        """
        estimator = self.told['deformation']
        taken = int(estimator['messages']) + int(estimator['lost'])
        return int(self.told['hand_bridge']['contacts published']), taken

    def set_active(self, active: bool) -> None:
        """Let the hand speak or be silent."""
        client = self.node.create_client(ChangeState, 'hand_bridge/change_state')
        self.wait(client.service_is_ready, 60.0, 'the life cycle of the hand')
        number = Transition.TRANSITION_ACTIVATE if active else Transition.TRANSITION_DEACTIVATE
        future = client.call_async(ChangeState.Request(transition=Transition(id=number)))
        self.wait(future.done, 60.0, 'a change of the life cycle')
        self.node.destroy_client(client)

    def settle(self) -> None:
        """Silence the hand until everybody has told what has come.

        That the last messages before a silence were lost is seen at the next one only.
        """
        self.set_active(False)
        self.spin(4.0)
        self.set_active(True)
        before = self.contacts
        self.wait(lambda: self.contacts > before + 10, 30.0, 'contacts')
        self.set_active(False)
        self.spin(3.0)
        seen = -1
        while seen != (seen := sum(self.accounted())):
            self.spin(4.0)

    def spin(self, seconds: float) -> None:
        """Hear for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=min(left, 0.05))

    def wait(self, condition: Any, seconds: float, what: str) -> None:
        """Hear until something is so."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise SystemExit(f'not in {seconds:g} s: {what}')
            self.spin(0.1)

    def call(self, service: str) -> str:
        """Call a service and wait for its answer."""
        client = self.node.create_client(Trigger, service)
        self.wait(client.service_is_ready, 60.0, service)
        future = client.call_async(Trigger.Request())
        self.wait(future.done, 120.0, service)
        self.node.destroy_client(client)
        return str(future.result().message)

    def move(self) -> None:
        """Bring the pins before the ball."""
        point = JointTrajectoryPoint(
            positions=[1.5708, 0.75, 0.75], time_from_start=Duration(sec=3)
        )
        names = ['spread', 'finger_1_inner', 'finger_2_inner']
        self.trajectories.publish(JointTrajectory(joint_names=names, points=[point]))
        self.spin(6.0)

    def scan(self) -> None:
        """A scan of the undeformed ball, 50 000 points."""
        points = np.random.default_rng(0).normal(size=(50_000, 3))
        points *= 0.0325 / np.linalg.norm(points, axis=1)[:, None]
        cloud = PointCloud2(
            height=1, width=len(points), point_step=12, row_step=12 * len(points),
            fields=[PointField(name=n, offset=4 * i, datatype=7, count=1)
                    for i, n in enumerate('xyz')],
            data=array.array('B', points.astype('<f4').tobytes()),
        )  # fmt: skip
        cloud.header.frame_id = 'hand_base'
        cloud.header.stamp.sec, cloud.header.stamp.nanosec = divmod(self.last_ns, 10**9)
        self.scans.publish(cloud)

    def stop(self) -> dict[str, int]:
        """End everything; the exit codes."""
        codes = {}
        for name in reversed(self.processes):
            process = self.processes[name]
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                codes[name] = process.wait(60.0)
            except subprocess.TimeoutExpired:
                process.kill()
                codes[name] = process.wait()
        rclpy.try_shutdown()
        return codes


def run(suite: Suite, seconds: float) -> list[tuple[str, str, str, bool]]:
    """Run the suite; rows of quantity, figure, goal, and whether it is met."""
    for name, parameters in NODES.items():
        words = [word for parameter in parameters for word in ('-p', parameter)]
        suite.start(name, '--ros-args', *words)
    suite.wait(lambda: suite.contacts > 100, 180.0, 'contacts')
    suite.wait(lambda: 'serving' in suite.log('deformation'), 180.0, 'a shell')
    suite.settle()
    published, taken = suite.accounted()
    suite.start('record', '-a', '-o', str(suite.folder / 'bag'))
    suite.wait(lambda: 'record' in suite.told, 60.0, 'a recording')
    suite.spin(5.0)
    suite.set_active(True)
    suite.call('hand/tare')
    busy = subprocess.Popen([sys.executable, '-c', 'while True: pass'], start_new_session=True)
    os.sched_setaffinity(busy.pid, {BUSY_CORE})
    dead: set[str] = set()
    memory: list[dict[str, float]] = []
    end = time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            suite.move()
            answer = suite.call('hand/close')
            suite.spin(4.0)
            suite.scan()
            suite.spin(3.0)
            suite.call('hand/open')
            dead |= {name for name, one in suite.processes.items() if one.poll() is not None}
            memory.append({n: resident_mb(one.pid) for n, one in suite.processes.items()})
            left = max(end - time.monotonic(), 0.0)
            told = ', '.join(f'{name} {mb:.0f}' for name, mb in memory[-1].items())
            print(
                f'{left:.0f} s left: {answer}; {suite.surfaces} answers; '
                f'refresh {np.median(suite.refresh or [0.0]):.1f} Hz; MB: {told}',
                file=sys.stderr,
            )
    finally:
        busy.kill()
        busy.wait()
    suite.settle()
    after = suite.accounted()
    suite.published = after[0] - published
    unaccounted = suite.published - (after[1] - taken)
    # Medians of the last two thirds: a comparison that is being computed is no growth.
    third = max(len(memory) // 3, 1)
    growth = {
        name: float(
            np.median([one[name] for one in memory[-third:]])
            - np.median([one[name] for one in memory[third : 2 * third] or memory])
        )
        for name in memory[-1]
    }
    most = max(growth, key=lambda name: growth[name])
    refresh = float(np.median(suite.refresh)) if suite.refresh else 0.0
    return [
        ('processes that died', ', '.join(sorted(dead)) or '0', '0', not dead),
        ('answers that are not finite', str(suite.not_finite), '0', suite.not_finite == 0),
        ('messages of contacts that the hand has published', str(suite.published), '', True),
        ('of them neither taken nor told lost by deformation', str(unaccounted), '0',
         unaccounted == 0),
        ('told lost by deformation', suite.told['deformation']['lost'], '', True),
        ('jumps of time seen by deformation', suite.told['deformation']['jumps of time'], '0',
         suite.told['deformation']['jumps of time'] == '0'),
        ('restarts of the background process', suite.told['deformation']['background restarts'],
         '0', suite.told['deformation']['background restarts'] == '0'),
        ('refresh of the nonlinear answer, median (Hz)', f'{refresh:.1f}', '>= 5',
         refresh >= REFRESH_HZ),
        ('longest in contact without a new nonlinear answer (s)', str(suite.longest_without),
         f'<= {LONGEST_S}', suite.longest_without <= LONGEST_S),
        (f'growth after warming up, most: {most} (MB)', f'{growth[most]:.0f}', f'< {GROWTH_MB:g}',
         growth[most] < GROWTH_MB),
    ]  # fmt: skip


def recorded(bag: Path, suite: Suite) -> tuple[str, str, str, bool]:
    """The row that compares the recording with what the hand has published."""
    metadata = yaml.safe_load((bag / 'metadata.yaml').read_text())
    counts = {
        one['topic_metadata']['name']: one['message_count']
        for one in metadata['rosbag2_bagfile_information']['topics_with_message_count']
    }
    missing = suite.published - counts['/hand/contacts']
    lost = int(suite.told['record']['lost'])
    return (
        f'contacts missing in the recording (of {lost} messages told lost by record)',
        str(missing), '<= told', 0 <= missing <= lost,
    )  # fmt: skip


def main() -> int:
    """Run and print; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=30.0)
    options = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', '61')
    with tempfile.TemporaryDirectory(prefix='endurance_') as folder:
        suite = Suite(Path(folder))
        try:
            rows = run(suite, 60.0 * options.minutes)
        finally:
            codes = suite.stop()
        tracebacks = [name for name in suite.processes if 'Traceback' in suite.log(name)]
        rows.append(('exit codes', str(set(codes.values())), '{0}', set(codes.values()) == {0}))
        rows.append(('tracebacks', ', '.join(tracebacks) or '0', '0', not tracebacks))
        check = subprocess.run(
            [BIN / 'bag_check', Path(folder) / 'bag'], capture_output=True, text=True, check=False
        )
        rows.append(('the recording is sound', str(check.returncode == 0), 'True',
                     check.returncode == 0))  # fmt: skip
        rows.append(recorded(Path(folder) / 'bag', suite))
    print(
        f'\n{options.minutes:g} minutes, load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores\n'
    )
    print('| quantity | figure | goal | met |\n|---|---|---|---|')
    for quantity, figure, goal, met in rows:
        print(f'| {quantity} | {figure} | {goal} | {"yes" if met else "**no**"} |')
    return 0 if all(met for *_, met in rows) else 1


if __name__ == '__main__':
    sys.exit(main())
