"""Publishes contacts at 250 Hz to the real node and to an echo node; prints latencies as JSON.

Run by `live.py`. Latency is from the publish call to the callback of the answer, in this process.
"""

from __future__ import annotations

import array
import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

RATE = 250.0
BEST_EFFORT = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
NAMES = ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius', 'travel')
ROW = np.dtype([(name, '<f4') for name in NAMES] + [('finger', 'u1'), ('flags', 'u1')])


def contacts(stamp: int, depth: float) -> PointCloud2:
    """Two opposite pins at a depth [m]."""
    rows = np.zeros(2, ROW)
    side = np.array([1.0, -1.0])
    rows['x'], rows['nx'] = side * (0.0325 - depth), -side
    rows['fx'] = -side * 5e3 * depth
    rows['sigma_n'], rows['radius'], rows['travel'] = 0.05, 1e-3, depth
    rows['finger'], rows['flags'] = [1, 2], 1
    message = PointCloud2(
        height=1,
        width=2,
        point_step=ROW.itemsize,
        row_step=2 * ROW.itemsize,
        data=array.array('B', rows.tobytes()),
        fields=[
            PointField(
                name=name,
                offset=ROW.fields[name][1],
                count=1,
                datatype=PointField.FLOAT32 if ROW[name].kind == 'f' else PointField.UINT8,
            )
            for name in ROW.names
        ],
    )
    message.header.frame_id = 'hand_base'
    message.header.stamp.sec = stamp // 10**9
    message.header.stamp.nanosec = stamp % 10**9
    return message


def echo() -> None:
    """A node that answers every sample at once with a cloud of the same size as the surface."""
    rclpy.init()
    node = rclpy.create_node('echo')
    publisher = node.create_publisher(PointCloud2, 'echo/surface', 10)
    answer = PointCloud2(height=1, width=650, point_step=32, row_step=32 * 650)
    answer.data = array.array('B', bytes(32 * 650))

    def reply(message: PointCloud2) -> None:
        answer.header = message.header
        publisher.publish(answer)

    node.create_subscription(PointCloud2, 'hand/contacts', reply, BEST_EFFORT)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


def measure(seconds: float) -> dict[str, object]:
    """Publish for `seconds` and collect the latencies [s] of both nodes."""
    rclpy.init()
    node = rclpy.create_node('latency')
    publisher = node.create_publisher(PointCloud2, 'hand/contacts', 10)
    sent: dict[int, float] = {}
    found: dict[str, list[float]] = {'deformation': [], 'echo': []}

    def listen(name: str, topic: str) -> None:
        def keep(message: PointCloud2) -> None:
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if stamp in sent:
                found[name].append(time.perf_counter() - sent[stamp])

        node.create_subscription(PointCloud2, topic, keep, BEST_EFFORT)

    listen('deformation', 'deformation/surface')
    listen('echo', 'echo/surface')
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def play(duration: float, remember: bool) -> int:
        start, count = time.perf_counter(), 0
        while time.perf_counter() - start < duration:
            if time.perf_counter() - start >= count / RATE:
                stamp = time.time_ns()
                depth = 2e-3 + 1e-3 * np.sin(2.0 * (time.perf_counter() - start))
                message = contacts(stamp, float(depth))
                if remember:
                    sent[stamp] = time.perf_counter()
                publisher.publish(message)
                count += 1
            executor.spin_once(timeout_sec=0.0005)
        return count

    deadline = time.monotonic() + 60.0
    heard = node.create_subscription(
        PointCloud2, 'deformation/nonlinear', lambda _: ready.append(True), BEST_EFFORT
    )
    ready: list[bool] = []
    while len(ready) < 5:
        if time.monotonic() > deadline:
            raise TimeoutError('the deformation node did not serve within 60 s')
        play(0.2, False)
    node.destroy_subscription(heard)
    play(1.0, False)
    count = play(seconds, True)
    settle = time.monotonic() + 1.0
    while time.monotonic() < settle:
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    return {'sent': count, **found}


def main() -> int:
    """Start both nodes on a domain of their own, measure, print JSON."""
    if sys.argv[1] == '--echo':
        echo()
        return 0
    os.environ.setdefault('ROS_DOMAIN_ID', '87')
    deformation = str(Path(sys.executable).parent / 'deformation')
    started = [
        subprocess.Popen(
            [deformation, '--ros-args', '-p', 'drive:=motion'],
            stderr=sys.stderr,
            stdout=sys.stderr,
        ),
        subprocess.Popen([sys.executable, __file__, '--echo']),
    ]
    try:
        print(json.dumps(measure(float(sys.argv[1]))))
    finally:
        for process in started:
            process.terminate()
        for process in started:
            process.wait(20)
    return 0


if __name__ == '__main__':
    sys.exit(main())
