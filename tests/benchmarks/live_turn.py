# SPDX-License-Identifier: Apache-2.0
"""Figures of the running node while an arm turns what it grips: refresh rate, error served.

Poses go from this process to the real node at 100 Hz, turning at 30 degrees a second; each surface
that comes back is compared with the converged equilibrium of its own pose.

    python tests/benchmarks/live_turn.py [--seconds 1.5]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import rclpy
from figures import Row, show
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2

from shell_deform.building import build_model
from shell_deform.model import ShellModel
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports.grips import arc_motion

SCANNER_M = 0.127e-3
SPEED = np.radians(30.0)
PERIOD = 0.01
LONGEST_START = 120.0
LONGEST_BEND = 0.6
"""Beyond 19 degrees the tube kinks [s]."""

TUBE = """
name: tube
surface: {{cylinder: {{outer_diameter_m: 0.04, length_m: 0.16, ends: open}}}}
thickness_m: 0.002
young_modulus_pa: 3.0e+6
poisson_ratio: 0.45
contacts:
  - {{kind: grip, where: lower}}
  - {{kind: grip, where: upper{free}}}
control_vertices: 650
source: a benchmark
"""
X, Y, Z = np.eye(3)
Motions = Callable[[float], np.ndarray]


def twisted(angle: float) -> np.ndarray:
    """(2, 6) the upper end turned about the axis."""
    return np.array([np.zeros(6), [*np.zeros(3), *(angle * Z)]])


def bent(angle: float) -> np.ndarray:
    """(2, 6) the upper end goes along an arc."""
    return np.array([np.zeros(6), arc_motion(Z, Y, 0.16, angle)])


def together(angle: float) -> np.ndarray:
    """(2, 6) both ends turned about an axis 0.3 m beside the tube."""
    ends = np.outer([-0.08, 0.08], Z) - 0.3 * X
    turn = Rotation.from_rotvec(angle * Y)
    return np.concatenate([turn.apply(ends) - ends, np.tile(angle * Y, (2, 1))], axis=1)


class Arm:
    """Publishes the poses of both grips and keeps what comes back."""

    def __init__(self, grips: tuple) -> None:
        self.grips = grips
        self.node = rclpy.create_node('arm')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.surfaces: list[tuple[int, np.ndarray]] = []
        self.wrenches: list[float] = []
        many = QoSProfile(depth=500)
        self.poses = [
            self.node.create_publisher(PoseStamped, f'grip/{grip.name}/pose', 10) for grip in grips
        ]
        listen = self.node.create_subscription
        listen(PointCloud2, 'deformation/surface', self._surface, many)
        listen(
            WrenchStamped,
            f'deformation/grip/{grips[-1].name}/wrench',
            lambda _: self.wrenches.append(time.monotonic()),
            many,
        )

    def _surface(self, message: PointCloud2) -> None:
        stamp = message.header.stamp
        packed = np.frombuffer(message.data, np.float32).reshape(-1, len(message.fields))
        self.surfaces.append((stamp.sec * 10**9 + stamp.nanosec, packed[:, :3].astype(float)))

    def move(self, motions: np.ndarray) -> int:
        """Publish where the grips are; the stamp of the last one."""
        stamp = time.time_ns()
        for publisher, grip, motion in zip(self.poses, self.grips, motions, strict=True):
            message = PoseStamped()
            message.header.frame_id = 'object'
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            p, q = message.pose.position, message.pose.orientation
            p.x, p.y, p.z = (float(v) for v in grip.origin + motion[:3])
            q.x, q.y, q.z, q.w = (float(v) for v in Rotation.from_rotvec(motion[3:]).as_quat())
            publisher.publish(message)
        return stamp

    def spin(self, until: float) -> None:
        """Handle what comes until a steady time [s]."""
        while (left := until - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=left)


def measured(name: str, free: str, motions: Motions, seconds: float) -> Iterator[Row]:
    """Rows of one way of turning, for so long."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'tube.yaml'
        path.write_text(TUBE.format(free=free))
        model = build_model(load_object(str(path)))
        arm = Arm(model.grips)
        arguments = ['--ros-args', '-p', f'object:={path}', '-p', 'background_niceness:=0']
        command = [str(Path(sys.executable).parent / 'deformation'), *arguments]
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT
        ) as node:
            try:
                yield from _turn(name, arm, model, motions, seconds)
            finally:
                node.terminate()


def _turn(
    name: str, arm: Arm, model: ShellModel, motions: Motions, seconds: float
) -> Iterator[Row]:
    """The same with the node that is there."""
    deadline = time.monotonic() + LONGEST_START
    while not arm.wrenches and time.monotonic() < deadline:
        arm.move(motions(1e-4))
        arm.spin(time.monotonic() + 0.1)
    if not arm.wrenches:
        raise RuntimeError('the node does not answer')
    arm.spin(time.monotonic() + 0.5)
    arm.surfaces.clear()
    arm.wrenches.clear()
    sent: dict[int, float] = {}
    began = time.monotonic()
    while (passed := time.monotonic() - began) < seconds:
        sent[arm.move(motions(SPEED * passed))] = SPEED * passed
        arm.spin(began + passed + PERIOD)
    refreshes = np.array(arm.wrenches)
    arm.spin(time.monotonic() + 0.5)
    solver, state, errors = EquilibriumSolver(model), None, []
    # Of the poses of one instant the last answer has all grips where they are.
    answers = {stamp: surface for stamp, surface in arm.surfaces if stamp in sent}
    for stamp, surface in list(answers.items())[::3]:
        state = solver.solve(gripped(motions(sent[stamp])), state)
        truth = model.surface.limit_positions(state.positions)
        errors.append(np.linalg.norm(surface - truth, axis=1))
    rate = len(refreshes) / seconds
    longest = float(np.diff(refreshes).max()) if len(refreshes) > 1 else np.inf
    p99 = float(np.percentile(np.concatenate(errors), 99))
    worst = max(float(one.max()) for one in errors)
    yield Row(f'{name}: answered of {len(sent)} poses', f'{len(answers)}', 'all',
              len(answers) >= len(sent) - 1)  # fmt: skip
    yield Row(
        f'{name}: refresh [Hz]; longest gap [ms]', f'{rate:.1f}; {1e3 * longest:.0f}', '>= 10',
        rate >= 10.0,
    )  # fmt: skip
    yield Row(
        f'{name}: served beside converged, p99; most [mm]', f'{1e3 * p99:.4f}; {1e3 * worst:.4f}',
        '0.127', p99 <= SCANNER_M,
    )  # fmt: skip


def rows(seconds: float) -> Iterator[Row]:
    """All ways of turning."""
    yield from measured('twist', '', twisted, seconds)
    yield from measured('bend', ', free: [x, z]', bent, min(seconds, LONGEST_BEND))

    yield from measured('whole grasp', '', together, seconds)


def main() -> int:
    """Print the table; returns 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=1.5, help='of each turn (default 1.5)')
    options = parser.parse_args()
    os.environ.setdefault('ROS_DOMAIN_ID', '77')
    rclpy.init()
    return 1 if show(rows(options.seconds)) else 0


if __name__ == '__main__':
    sys.exit(main())
