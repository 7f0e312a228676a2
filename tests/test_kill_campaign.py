# SPDX-License-Identifier: Apache-2.0
"""Whatever is killed, and whenever: nothing is left running, and no folder behind.

`make soak` (`kills`) takes 200 moments of each kind; KILLS=N: so many of each node, with -s for
the times; SEED: other moments.
"""

import contextlib
import os
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from tests.processes import descendants, living

from grasp_common.messages import cloud

SOAK = bool(os.environ.get('SOAK'))
MOMENTS = 25 if SOAK else 1
CHILD_MOMENTS = int(os.environ.get('KILLS', 50 if SOAK else 2))
SEED = os.environ.get('SEED', '')
CONTACT = np.dtype(
    [(name, '<f4') for name in ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz')]
    + [(name, '<f4') for name in ('sigma_n', 'radius', 'sigma_t')]
    + [(name, 'u1') for name in ('finger', 'flags')]
)
NODES = {
    'hand_bridge': (('backend:=emulator', 'initialize_on_start:=true'), 'connected to', 2),
    'deformation': ((), 'building', 1),
    'grasp_view': (('what_if:=true', 'port:=8974'), 'page ready', 2),
    'scan_compare': (('object:=tennis_ball',), '', 1),
}


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGHUP])
@pytest.mark.parametrize('name', sorted(NODES))
def test_a_node_that_is_ended_at_any_moment_leaves_nothing(
    start, wait_until, tmp_path, name, number
):
    parameters, ready, children = NODES[name]
    arguments = [word for parameter in parameters for word in ('-p', parameter)]
    moments = random.Random(f'{name} {number}')
    for moment in range(MOMENTS):
        folder = tmp_path / f'tmp_{moment}'
        folder.mkdir()
        node = start(name, '--ros-args', *arguments, TMPDIR=str(folder))
        if ready:
            node.wait_for(ready, 120.0)
        wait_until(lambda node=node: len(descendants(node.process.pid)) >= children, 60.0)
        time.sleep(moments.uniform(0.0, 3.0))
        below = descendants(node.process.pid)
        if moment % 2 == 0:
            # One that somebody stopped does not see by itself that its owner is gone.
            with contextlib.suppress(ProcessLookupError):
                os.kill(moments.choice(below), signal.SIGSTOP)
        node.process.send_signal(number)
        code = node.ended()
        # A signal that comes before a node has begun ends it as it stands.
        assert code in ((-number,) if number == signal.SIGKILL else (-number, 0)), node.text
        wait_until(lambda below=below: not any(map(living, below)), 10.0)
        wait_until(
            lambda folder=folder: not list(folder.iterdir()),
            10.0,
            lambda folder=folder: str(list(folder.rglob('*'))),
        )
        assert 'Traceback' not in node.text, node.text


WITH_CHILDREN = {
    'hand_bridge': (('backend:=emulator', 'initialize_on_start:=true'), 'hand/contacts'),
    'deformation': (('placement:=first_touch', 'theory:=koiter'), 'deformation/nonlinear_age'),
    'scan_compare': (('object:=tennis_ball',), ''),
    'grasp_view': (('what_if:=true', 'port:=8976'), '/what_if/deformation/nonlinear_age'),
}
CHILDREN = {
    'hand_bridge': ('stop_guard', 'hand_emulator'),
    'deformation': ('background.worker',),
    'scan_compare': ('scan_compare.worker',),
    'grasp_view': ('with_parent', 'bin/deformation', 'background.worker'),
}
# Solvers have a spare, and what-if a spare node, whose solver stands by, too.
AT_REST = {'hand_bridge': 2, 'deformation': 2, 'scan_compare': 1, 'grasp_view': 7}


LATENCY_S = 0.1
"""An age comes so much later than it was told, at most, and is so much older [s]."""


class Hand:
    """A hand that squeezes a ball steadily, and what the nodes answer to it."""

    def __init__(self, topic):
        rclpy.init()
        self.node = rclpy.create_node('steady_hand')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.fresh_at = self.told_at = 0.0
        self.link = ''
        if topic.endswith('age'):
            self.node.create_subscription(Float64, topic, self._age, 10)
        elif topic:
            self.node.create_subscription(DiagnosticArray, '/diagnostics', self._told, 10)
        if topic == 'deformation/nonlinear_age':
            self.contacts = self.node.create_publisher(PointCloud2, 'hand/contacts', 10)
            self.node.create_timer(0.02, self._squeeze)

    def _squeeze(self):
        rows = np.zeros(2, CONTACT)
        rows['x'], rows['nx'], rows['fx'] = [-0.0325, 0.0325], [1.0, -1.0], [5.0, -5.0]
        rows['sigma_n'], rows['radius'], rows['sigma_t'] = 0.05, 1e-3, np.inf
        rows['finger'], rows['flags'] = [1, 2], 1
        now = self.node.get_clock().now().nanoseconds
        self.contacts.publish(cloud(rows, now, 'hand_base'))

    def _age(self, message):
        # When the newest equilibrium's sample was there: what is served of before is no answer.
        if np.isfinite(message.data):
            self.fresh_at = time.monotonic() - message.data - LATENCY_S

    def _told(self, message):
        for status in message.status:
            values = {one.key: one.value for one in status.values}
            if 'losses of the link' in values and values['state'] != 'lost':
                self.fresh_at = time.monotonic()

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def end(self):
        self.executor.remove_node(self.node)
        self.node.destroy_node()
        rclpy.try_shutdown()


def _named(pid, words):
    """Living processes below one whose command line holds one of the words."""
    found = []
    for one in descendants(pid):
        with contextlib.suppress(OSError):
            command = Path(f'/proc/{one}/cmdline').read_bytes().replace(b'\0', b' ').decode()
            if living(one) and any(word in command for word in words):
                found.append(one)
    return found


@pytest.mark.timeout(7200)
@pytest.mark.parametrize('name', sorted(WITH_CHILDREN))
def test_a_process_of_a_node_that_is_killed_or_stopped_is_replaced(
    start, wait_until, domain_id, name
):
    parameters, topic = WITH_CHILDREN[name]
    words = [word for parameter in parameters for word in ('-p', parameter)]
    node = start(name, '--ros-args', *words)
    kinds = CHILDREN[name]
    hand = Hand(topic)
    moments = random.Random(name + SEED)
    noticed, restored, complete = [], [], []

    def whole(besides=0):
        hand.spin(0.01)
        return len(set(_named(node.process.pid, kinds)) - {besides}) >= AT_REST[name]

    def served(since):
        hand.spin(0.01)
        return not topic or hand.fresh_at > since

    try:
        for moment in range(CHILD_MOMENTS):
            wait_until(whole, 120.0, lambda: node.text)
            began = time.monotonic()
            wait_until(lambda began=began: served(began), 120.0, lambda: node.text)
            hand.spin(moments.uniform(0.0, 2.0))
            victim = moments.choice(sorted(_named(node.process.pid, kinds)))
            how = (signal.SIGSTOP, signal.SIGKILL)[moment % 2]
            struck = time.monotonic()
            os.kill(victim, how)
            # Gone from the kernel's tables: whoever owns it has noticed, and ended a stopped one.
            wait_until(lambda v=victim: hand.spin(0.01) or not Path(f'/proc/{v}').exists(), 60.0)
            gone = time.monotonic()
            noticed.append(gone - struck)
            wait_until(lambda gone=gone: served(gone), 60.0, lambda: node.text)
            answered = time.monotonic() - struck
            wait_until(lambda v=victim: whole(v), 60.0, lambda: node.text)
            complete.append(time.monotonic() - struck)
            restored.append(answered if topic else complete[-1])
            assert node.process.poll() is None, node.text
        below = descendants(node.process.pid)
        assert node.stop() == 0, node.text
        wait_until(lambda: not any(map(living, below)), 10.0)
        assert 'Traceback' not in node.text, node.text
    finally:
        hand.end()
    print(f'{name}: {len(noticed)} moments, load {os.getloadavg()[0]:.1f}')
    times = {'noticed': noticed, 'answers again': restored, 'with its spares': complete}
    for what, seconds in times.items():
        shares = ', '.join(f'{np.percentile(seconds, q):.2f} ({q} %)' for q in (50, 90, 95, 99))
        print(f'  {what} after {shares}, {max(seconds):.2f} s (all)')
    if SOAK:
        assert max(noticed) <= 1.0
        assert max(restored) <= 3.0
