# SPDX-License-Identifier: Apache-2.0
"""What scans of a million points cost the nodes beside: `python tests/benchmarks/scan_node.py`.

The deformation node answers contacts at 250 Hz; then scans are sent faster than they are compared.
The same figures are printed without and with them.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from figures import Row, show
from live_node import BEST_EFFORT, Hand, deformation, running
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

sys.path.insert(0, str(Path(__file__).parents[2] / 'ros2_ws/src/scan_compare/test'))

from scan_observer import cloud  # noqa: E402
from scan_shells import ball, scan_points, two_dents  # noqa: E402

COMPARE_WITHIN_S = 300.0
SLICE_S = 5.0


def send(count: int, points: int) -> None:
    """Play the scanner in its own process: scans half a second apart, until all are judged."""
    rclpy.init()
    node = rclpy.create_node('bench_scanner')
    publisher = node.create_publisher(PointCloud2, 'scan/points', 10)
    judged: list[Float64] = []
    node.create_subscription(Float64, 'scan/mean_error', judged.append, 10)
    rows = scan_points(ball(two_dents(2e-3)), points)
    while publisher.get_subscription_count() == 0:
        rclpy.spin_once(node, timeout_sec=0.05)
    for _ in range(count):
        publisher.publish(cloud(('x', 'y', 'z'), rows, time.time_ns(), 'hand_base'))
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.05)
    end = time.monotonic() + COMPARE_WITHIN_S
    while len(judged) < count and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)
    rclpy.shutdown()


@dataclass
class Heard:
    """What the other nodes said in one stretch of time."""

    refreshes: int = 0
    judged: int = 0
    health: list[float] = field(default_factory=list)
    answers: list[float] = field(default_factory=list)


class Watch:
    """Listens beside the hand: refreshes, diagnostics of `scan_compare`, a parameter service."""

    def __init__(self, hand: Hand) -> None:
        self.heard = Heard()
        self.comparing = False
        node = hand.node
        node.create_subscription(
            PointCloud2, 'deformation/nonlinear', self._refreshed, BEST_EFFORT
        )
        node.create_subscription(Float64, 'scan/mean_error', self._judged, 10)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._healthy, 10)
        node.create_timer(0.2, self._ask)
        self._client = node.create_client(GetParameters, 'scan_compare/get_parameters')
        self._asked: float | None = None

    def _refreshed(self, _: PointCloud2) -> None:
        self.heard.refreshes += 1

    def _judged(self, _: Float64) -> None:
        self.heard.judged += 1

    def _healthy(self, message: DiagnosticArray) -> None:
        if message.status[0].name.startswith('scan_compare'):
            self.heard.health.append(time.perf_counter())
            self.comparing = {v.key: v.value for v in message.status[0].values}['busy'] == 'True'

    def _ask(self) -> None:
        if self._asked is None and self._client.service_is_ready():
            self._asked = time.perf_counter()
            request = GetParameters.Request(names=['object'])
            self._client.call_async(request).add_done_callback(self._answered)

    def _answered(self, _: object) -> None:
        assert self._asked is not None
        self.heard.answers.append(time.perf_counter() - self._asked)
        self._asked = None


def rows(scans: int, points: int, seconds: float) -> Iterator[Row]:
    """The figures of `seconds` without scans, then of as long as scans are compared."""
    hand = Hand()
    hand.listen('deformation', 'deformation/surface')
    watch = Watch(hand)
    compare = str(Path(sys.executable).parent / 'scan_compare')
    scanner = (sys.executable, __file__, '--send', str(scans), '--points', str(points))
    with deformation(), running(compare, '--ros-args', '-p', 'waiting_memory:=1000.0'):
        hand.play_until(lambda: bool(hand.latency['deformation'] and watch.heard.health))
        hand.play(2.0)
        yield from stretch(hand, watch, 'alone', seconds)
        with running(*scanner) as process:
            while process.poll() is None and not watch.comparing:
                hand.spin(0.05)
            yield from stretch(
                hand, watch, f'beside {scans} scans of {points} points', SLICE_S, process
            )
    judged = watch.heard.judged
    yield Row('scans judged', f'{judged} of {scans}', 'all', judged == scans)
    hand.close()


def stretch(
    hand: Hand, watch: Watch, when: str, seconds: float, until: subprocess.Popen | None = None
) -> Iterator[Row]:
    """Play contacts for `seconds`, again and again until the process `until` has ended."""
    watch.heard = heard = Heard()
    played, sent, latency = 0.0, 0, []
    while True:
        sent += hand.play(seconds)
        played += seconds
        latency += hand.latency['deformation']
        if until is None or until.poll() is not None:
            break
    middle, tail = 1e3 * np.percentile(latency, (50, 99))
    yield Row(f'contacts in to surface out, {when}', f'{middle:.2f} ms, p99 {tail:.1f} ms')
    yield Row('  samples without a surface', f'{sent - len(latency)} of {sent}', '0')
    yield Row('  nonlinear refreshes', f'{heard.refreshes / played:.1f} a second')
    gap = max(np.diff(heard.health), default=np.inf)
    yield Row('  longest gap of diagnostics of scan_compare', f'{gap:.2f} s', '<= 2 s', gap <= 2.0)
    answer = max(heard.answers, default=np.inf)
    yield Row(
        '  longest answer of its parameter service', f'{answer:.2f} s', '<= 1 s', answer <= 1.0
    )


def main() -> int:
    """Measure and print; returns 1 when a figure is short of its goal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--send', type=int, help=argparse.SUPPRESS)
    parser.add_argument('--scans', type=int, default=4, help='scans that are sent')
    parser.add_argument('--points', type=int, default=1_000_000, help='points of a scan')
    parser.add_argument('--seconds', type=float, default=10.0, help='time without scans')
    options = parser.parse_args()
    if options.send:
        send(options.send, options.points)
        return 0
    rclpy.init()
    short = show(rows(options.scans, options.points, options.seconds))
    rclpy.shutdown()
    return int(short > 0)


if __name__ == '__main__':
    sys.exit(main())
