"""Figures of the hand bridge against emulated hands. `python tests/benchmarks/hand.py`.

`--seconds 600` and `--seeds 200` are the long form. Emulator and driver are two processes; the
serial line is paced byte by byte, the CAN bus frame by frame.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from barrett_hand_bridge.gcl.driver import SerialHand, open_port
from barrett_hand_bridge.hand import HandError
from barrett_hand_bridge.kinematics import HandGeometry, finger_frames
from barrett_hand_bridge.puck.bus import open_bus
from barrett_hand_bridge.puck.driver import CanHand
from barrett_hand_bridge.trial import bias_counts, coverage, force_errors

Row = tuple[str, str, str]
BIN = Path(sys.executable).parent
GROUP = '239.74.163.2'

# Joint 2 and spread in degrees, finger, tip in mm: the published vectors.
VECTORS = [
    (0, 0, 1, (-25.0, -142.868, 132.439)),
    (0, 0, 3, (0.0, 142.868, 132.439)),
    (60, 0, 1, (-25.0, -41.603, 176.542)),
    (90, 0, 3, (0.0, -3.819, 151.079)),
    (0, 90, 1, (-167.868, 0.0, 132.439)),
    (45, 180, 2, (25.0, 69.446, 178.154)),
]


@contextmanager
def emulator(*options: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A `hand_emulator` process; yields where it is, and the process."""
    process = subprocess.Popen(
        [str(BIN / 'hand_emulator'), '--json', '--until-eof', *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None and process.stdin is not None
    try:
        yield str(json.loads(process.stdout.readline())['port']), process
    finally:
        process.stdin.close()
        process.wait()
        process.stdout.close()


@dataclass(frozen=True)
class Cycles:
    """What came of cycling a hand for a time: rates in 1/s, the median cycle's included."""

    rate_hz: float
    median_hz: float
    lost: int
    late: int


def cycles(hand: SerialHand | CanHand, seconds: float) -> Cycles:
    """Cycle a hand for a time."""
    late = [0]
    spans: list[float] = []

    def count_late() -> None:
        late[0] += 1

    hand.late = count_late
    lost = 0
    begin = time.monotonic()
    while time.monotonic() - begin < seconds:
        before = time.monotonic()
        try:
            hand.sample(None)
            spans.append(time.monotonic() - before)
        except HandError:
            lost += 1
    rate = len(spans) / (time.monotonic() - begin)
    return Cycles(rate, 1.0 / float(np.median(spans)), lost, late[0])


def serial_rows(seconds: float) -> Iterator[Row]:
    """Cycle rate of the BH8-262 at its three line speeds."""
    with emulator() as (port, _):
        for baud in (9600, 19200, 38400):
            hand = SerialHand(lambda: open_port(port), baud=baud)
            ceiling = hand.connect().ceiling_hz
            hand.initialize()
            hand.sample(None)
            got = cycles(hand, seconds if baud == 38400 else min(seconds, 5.0))
            hand.close()
            yield (
                f'BH8-262 cycle at {baud} baud, {ceiling:.0f} Hz ceiling',
                f'{100 * got.rate_hz / ceiling:.1f} % (median cycle '
                f'{100 * got.median_hz / ceiling:.1f} %), {got.lost} lost, {got.late} late',
                '>= 95 % of the ceiling, none lost',
            )


def free_port() -> str:
    """A UDP port that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('', 0))
        return str(probe.getsockname()[1])


def can_rows(seconds: float) -> Iterator[Row]:
    """Cycle rate of the BH8-280: three gauges and four positions."""
    port = free_port()
    with emulator('--hand', '280', '--can-port', port):
        hand = CanHand(lambda: open_bus('udp_multicast', GROUP, int(port)))
        for _ in range(20):
            try:
                hand.connect()
                break
            except HandError:
                time.sleep(0.2)
        hand.initialize()
        hand.sample(None)
        got = cycles(hand, seconds)
        hand.close()
    yield (
        'BH8-280 cycle over udp_multicast, paced',
        f'{got.rate_hz:.0f} Hz, {got.lost} lost, {got.late} late',
        '>= 500 Hz, none lost',
    )


def stale_rows() -> Iterator[Row]:
    """How soon the driver knows that the hand has fallen silent, in periods of the link."""
    spans = []
    with emulator(*(3 * ('--fault', 'mute@signal:0.2'))) as (port, process):
        hand = SerialHand(lambda: open_port(port))
        hand.connect()
        hand.initialize()
        last: list[float] = []

        def late() -> None:
            # Only the first word of each silence counts.
            if last:
                spans.append((time.monotonic() - last.pop()) / hand.cycle_s)

        hand.late = late
        for _ in range(3):
            end = time.monotonic() + 2.0
            hand.sample(None)
            last[:] = [time.monotonic()]
            process.send_signal(signal.SIGUSR1)
            while time.monotonic() < end:
                try:
                    hand.sample(None)
                    last[:] = [time.monotonic()]
                except HandError:
                    last.clear()
        hand.close()
    yield (
        'BH8-262 silent -> stale, periods of the link',
        f'median {np.median(spans):.2f}, worst {max(spans):.2f} of {len(spans)}',
        '<= 3',
    )


def node_rows(seconds: float) -> Iterator[Row]:
    """What the node itself measures: last byte of a cycle read -> contacts published."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import PointCloud2

    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init()
    node = rclpy.create_node('hand_benchmark')
    said: list[dict[str, str]] = []
    heard = [0]

    def on_contacts(message: PointCloud2) -> None:
        heard[0] += 1

    def on_diagnostics(message: DiagnosticArray) -> None:
        said.append({value.key: value.value for value in message.status[0].values})

    node.create_subscription(PointCloud2, 'hand/contacts', on_contacts, qos_profile_sensor_data)
    node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, 10)
    bridge = subprocess.Popen(
        [str(BIN / 'hand_bridge'), '--ros-args', '-p', 'backend:=emulator']
        + ['-p', 'initialize_on_start:=true', '--log-level', 'error']
    )
    try:
        deadline = time.monotonic() + 60.0
        while heard[0] == 0 and time.monotonic() < deadline:
            rclpy.spin_once(node, timeout_sec=0.1)
        begin, before = time.monotonic(), heard[0]
        while time.monotonic() - begin < seconds:
            rclpy.spin_once(node, timeout_sec=0.1)
        rate = (heard[0] - before) / (time.monotonic() - begin)
        values = said[-1]
    finally:
        bridge.terminate()
        bridge.wait()
        node.destroy_node()
        rclpy.try_shutdown()
    median, p99 = (values[f'cycle to published, {name} (ms)'] for name in ('median', 'p99'))
    yield (
        'last byte of a cycle -> hand/contacts published',
        f'median {median} ms, p99 {p99} ms',
        'median <= 2 ms, p99 <= 8 ms',
    )
    yield (
        'hand/contacts through the node at 38400 baud',
        f'{rate:.0f} Hz heard, {values["cycles per second"]} Hz cycled, '
        f'{values["resynchronisations"]} resynchronised',
        '',
    )


def force_rows(seeds: int) -> Iterator[Row]:
    """Recovered force after half an hour of drift, one emulated hand per seed."""
    errors = force_errors(range(seeds))
    yield (
        f'bias of the force, 0.5 to 20 N, 30 min of drift, {seeds} hands',
        f'{bias_counts(errors):.2f} gauge counts',
        '<= 1',
    )
    yield (
        f'errors within the 90 % level of sigma_n, {seeds} hands',
        f'{100 * coverage(errors):.1f} %',
        '85 to 95 %',
    )


def kinematics_rows() -> Iterator[Row]:
    """Forward kinematics against the published vectors."""
    worst = 0.0
    for joint_2, spread, finger, tip_mm in VECTORS:
        inner = math.radians(joint_2)
        frames = finger_frames(HandGeometry(), finger, math.radians(spread), inner, inner / 3)
        worst = max(worst, float(np.abs(frames.tip[:3, 3] * 1e3 - np.array(tip_mm)).max()))
    yield 'forward kinematics against the published vectors', f'{worst:.1e} mm', '<= 1e-3 mm'


def main(arguments: list[str] | None = None) -> list[Row]:
    """Measure and print; returns the rows (what, value, goal)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=10.0, help='time of each rate (s)')
    parser.add_argument('--seeds', type=int, default=20, help='emulated hands of the force rows')
    options = parser.parse_args(arguments)
    parts: list[Callable[[], Iterator[Row]]] = [
        kinematics_rows,
        lambda: serial_rows(options.seconds),
        lambda: can_rows(options.seconds),
        stale_rows,
        lambda: node_rows(options.seconds),
        lambda: force_rows(options.seeds),
    ]
    rows: list[Row] = []
    for part in parts:
        for row in part():
            print(f'{row[0]:<62} {row[1]:<52} {row[2]}', flush=True)
            rows.append(row)
    return rows


if __name__ == '__main__':
    main()
