# SPDX-License-Identifier: Apache-2.0
"""Record a staged grasp from the live nodes, in lockstep on simulated time.

This process plays the world: it moves the emulated hand, publishes /clock, the scans and the
object's pose. `hand_bridge` reads the hand over a real pty and `record` writes the bag; both are
processes of their own. The next step is taken only when the bridge has answered the last one.
"""

from __future__ import annotations

import array
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from bags.processes import end_process
from bags.scanner import Scan
from bags.stage import Stage, along_pins, quaternion

START_NS = 1_600_000_000_000_000_000
FLAG_CONTACT = 1
FLAG_STALE = 4
BAUD = 38400
BIN = Path(sys.executable).parent
HAND_TOPICS = (
    '/hand/joint_states',
    *(f'/hand/finger_{finger}/gauge_counts' for finger in (1, 2, 3)),
    *(f'/hand/finger_{finger}/wrench' for finger in (1, 2, 3)),
    '/hand/contacts',
)
WORLD_TOPICS = ('/object_pose', '/scan/points')
# A clock sent again makes one cycle more on the wire: only for one that was really lost.
CLOCK_PATIENCE_S = 3.0
TOPICS = (*HAND_TOPICS, *WORLD_TOPICS, '/diagnostics')


class RecordingError(RuntimeError):
    """The live nodes did not keep step; the message says which and shows their last words."""


def stamp(time_ns: int) -> Time:
    """A time in ns as a message."""
    return Time(sec=int(time_ns // 1_000_000_000), nanosec=int(time_ns % 1_000_000_000))


def cloud_message(points: np.ndarray, time_ns: int, frame: str) -> PointCloud2:
    """Points (n, 3) float32 in m as an unordered cloud x y z."""
    data = np.ascontiguousarray(points, dtype='<f4')
    return PointCloud2(
        header=Header(stamp=stamp(time_ns), frame_id=frame),
        height=1,
        width=int(len(data)),
        fields=[
            PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
            for index, name in enumerate('xyz')
        ],
        is_bigendian=False,
        point_step=12,
        row_step=int(12 * len(data)),
        data=array.array('B', data.tobytes()),
        is_dense=True,
    )


def pose_message(
    rotation: np.ndarray, origin: np.ndarray, time_ns: int, frame: str
) -> PoseStamped:
    """A pose in a frame."""
    message = PoseStamped(header=Header(stamp=stamp(time_ns), frame_id=frame))
    x, y, z, w = quaternion(rotation)
    message.pose.orientation.x, message.pose.orientation.y = x, y
    message.pose.orientation.z, message.pose.orientation.w = z, w
    message.pose.position.x = float(origin[0])
    message.pose.position.y = float(origin[1])
    message.pose.position.z = float(origin[2])
    return message


@dataclass
class Live:
    """The processes of one recording and what they have said."""

    folder: Path
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def start(self, name: str, *command: str) -> None:
        """Start an executable of the environment; its output goes to `<name>.log`."""
        log = (self.folder / f'{name}.log').open('wb')
        environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self.processes[name] = subprocess.Popen(
            [str(BIN / command[0]), *command[1:]],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=environment,
        )
        log.close()

    def said(self, name: str) -> str:
        """Everything a process has written."""
        return (self.folder / f'{name}.log').read_text(errors='replace')

    def check(self) -> None:
        """Raise RecordingError when a process has ended."""
        for name, process in self.processes.items():
            if process.poll() is not None:
                raise RecordingError(
                    f'{name} ended with {process.returncode}:\n{self.said(name)[-2000:]}'
                )

    def stop(self) -> None:
        """End every process by SIGINT, the recorder last; kill what does not."""
        for name in sorted(self.processes, key=lambda name: name == 'record'):
            end_process(self.processes[name])
        self.processes.clear()


class World:
    """Clock, scans and object pose on topics; lets one step pass at a time."""

    def __init__(
        self, stage: Stage, live: Live, period_s: float, frame: str = 'hand_base'
    ) -> None:
        """Publishers and the subscription that tells when the bridge has answered."""
        self.stage = stage
        self.live = live
        self.frame = frame
        self.period_s = period_s
        self.now_ns = START_NS
        self.stamps: list[int] = []
        self._answered_ns = 0
        self._contacts: dict[int, tuple[np.ndarray, bool]] = {}
        self._node = rclpy.create_node('recorded_world')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._clock = self._node.create_publisher(Clock, '/clock', 10)
        latched = QoSProfile(
            depth=50,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._poses = self._node.create_publisher(PoseStamped, '/object_pose', 100)
        self._scans = self._node.create_publisher(PointCloud2, '/scan/points', latched)
        self._node.create_subscription(PointCloud2, '/hand/contacts', self._on_contacts, 100)

    def _on_contacts(self, message: PointCloud2) -> None:
        at = {field.name: field.offset for field in message.fields}
        raw = np.frombuffer(message.data, np.uint8).reshape(-1, message.point_step)
        if raw[0, at['flags']] & FLAG_STALE:
            return
        self._contacts = {
            int(row[at['finger']]): (
                row[at['x'] : at['x'] + 12].view('<f4').astype(float),
                bool(row[at['flags']] & FLAG_CONTACT),
            )
            for row in raw
        }
        self._answered_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec

    def measured_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and origin of the object in the hand frame, as the pins tell it.

        A pinched object hangs between its two pins; any other keeps its place and follows their
        mean height. Before all touch, the pose is that of the stand. How far the object has
        slipped under the pins no pin can tell: that turn is the true one, as from a camera.
        """
        setting = self.stage.setting
        points = [self._contacts[finger][0] for finger in self.stage.fingers]
        if not all(self._contacts[finger][1] for finger in self.stage.fingers):
            return setting.rotation @ self.stage.slip, setting.origin
        if setting.pinched:
            return along_pins(points[0], points[1]) @ self.stage.slip, 0.5 * (
                points[0] + points[1]
            )
        rise = np.mean(
            [
                point[2] - setting.touches[finger].point[2]
                for finger, point in zip(self.stage.fingers, points, strict=True)
            ]
        )
        return setting.rotation, setting.origin + [0.0, 0.0, float(rise)]

    def wait_for(self, condition: Callable[[], bool], what: str, timeout: float = 60.0) -> None:
        """Spin until a condition holds; RecordingError when it does not within `timeout` s."""
        deadline = time.monotonic() + timeout
        while not condition():
            self.live.check()
            if time.monotonic() > deadline:
                logs = '\n'.join(self.live.said(name)[-800:] for name in self.live.processes)
                raise RecordingError(f'{what} did not happen within {timeout:g} s:\n{logs}')
            self._executor.spin_once(timeout_sec=0.05)

    def wait_until_recorded(self) -> None:
        """Until the recorder has subscribed every topic."""
        own = {'/hand/contacts': 1}
        self.wait_for(
            lambda: all(
                self._node.count_subscribers(topic) > own.get(topic, 0) for topic in TOPICS
            ),
            'the recorder subscribing all topics',
        )

    def tick(self, counts: dict[int, float]) -> None:
        """One period: move, let time pass, publish the clock, wait for the bridge's answer."""
        self.stage.step(counts, self.period_s)
        self.now_ns += round(self.period_s * 1e9)
        self.stamps.append(self.now_ns)
        tries = 0
        self._clock.publish(Clock(clock=stamp(self.now_ns)))
        patience = time.monotonic() + CLOCK_PATIENCE_S
        while self._answered_ns < self.now_ns:
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() > patience:
                self.live.check()
                tries += 1
                if tries > 40:
                    raise RecordingError(
                        f'hand_bridge did not answer the clock at {self.now_ns}:\n'
                        + self.live.said('hand_bridge')[-2000:]
                    )
                self._clock.publish(Clock(clock=stamp(self.now_ns)))
                patience = time.monotonic() + CLOCK_PATIENCE_S
        rotation, origin = self.measured_pose()
        self._poses.publish(pose_message(rotation, origin, self.now_ns, self.frame))

    def hold(self, seconds: float) -> None:
        """Let time pass with the fingers where they are."""
        for _ in range(round(seconds / self.period_s)):
            self.tick(self.stage.counts)

    def move_to(self, force_n: float, seconds: float) -> None:
        """Close or open to a force (0: open) along a smooth ramp of the motors."""
        start, end = self.stage.counts, self.stage.counts_for(force_n)
        steps = max(round(seconds / self.period_s), 1)
        for step in range(1, steps + 1):
            part = 0.5 - 0.5 * float(np.cos(np.pi * step / steps))
            self.tick({f: start[f] + part * (end[f] - start[f]) for f in start})

    def show(self, scan: Scan) -> int:
        """Publish a scan stamped now; returns its stamp in ns."""
        self._scans.publish(cloud_message(scan.points, self.now_ns, self.frame))
        return self.now_ns

    def settle(self, seconds: float = 1.0) -> None:
        """Let the recorder take what is still under way (wall time)."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Give everything back."""
        self._executor.shutdown()
        self._node.destroy_node()


def bridge_parameters(stage: Stage, calibration: Path, period_s: float) -> dict:
    """What the bridge is told: nominal pins, calibration, pace; not the hidden imperfections."""
    pins = {finger: touch.pin for finger, touch in stage.setting.touches.items()}
    told = [pins.get(finger) for finger in (1, 2, 3)]
    default = next(iter(pins.values()))
    return {
        'use_sim_time': True,
        'backend': 'serial',
        'port': stage.port.path,
        'baud': BAUD,
        'calibration': str(calibration),
        'tare_on_start': True,
        'poll_period': period_s,
        'opposed_fingers': list(stage.fingers) if stage.setting.pinched else [0],
        'pin_length': [round(float((pin or default).length_m), 6) for pin in told],
        'pin_forward': [round(float((pin or default).forward_m), 6) for pin in told],
        'pin_lean': [round(float((pin or default).lean_rad), 6) for pin in told],
    }


def start_nodes(live: Live, stage: Stage, calibration: Path, period_s: float, bag: Path) -> dict:
    """Start bridge and recorder; returns the bridge's parameters."""
    parameters = bridge_parameters(stage, calibration, period_s)
    file = live.folder / 'hand_bridge.yaml'
    file.write_text(yaml.safe_dump({'hand_bridge': {'ros__parameters': parameters}}))
    live.start('hand_bridge', 'hand_bridge', '--ros-args', '--params-file', str(file))
    live.start(
        'record', 'record', *TOPICS, '--output', str(bag), '--time', 'header', '--use-sim-time'
    )
    return parameters
