# SPDX-License-Identifier: Apache-2.0
"""The whole job as processes on their own ROS domain: a recorded grasp through the live nodes."""

from pathlib import Path

import pytest
import rclpy
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import Float64, String
from tests.patience import Patience

BAG = Path(__file__).resolve().parent.parent / 'bags' / 'tennis_ball_two_finger'
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Listener:
    """What the nodes say, kept by topic."""

    def __init__(self):
        self.node = rclpy.create_node('whole_job_listener')
        self.asked, self.answered, self.states = [], [], []
        self.meshes, self.largest, self.mean_errors = [], [], []
        many = QoSProfile(depth=5000)
        listen = self.node.create_subscription
        listen(PointCloud2, 'hand/contacts', lambda m: self.asked.append(_stamp(m)), many)
        listen(PointCloud2, 'deformation/surface', self._surface, many)
        listen(Mesh, 'deformation/mesh', self.meshes.append, LATCHED)
        listen(String, 'deformation/state', lambda m: self.states.append(m.data), LATCHED)
        listen(Float64, 'deformation/max_displacement', lambda m: self.largest.append(m.data), 10)
        listen(Float64, 'scan/mean_error', lambda m: self.mean_errors.append(m.data), 10)

    def _surface(self, message):
        self.answered.append(_stamp(message))
        self.fields = [field.name for field in message.fields]

    def missing(self):
        """Samples heard without the surface that answers them."""
        return sorted(set(self.asked) - set(self.answered))

    def spin_until(self, condition, timeout):
        patience = Patience(timeout)
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.05)
            assert not patience.over, (
                f'{len(self.asked)} samples, {len(self.answered)} answers, {len(self.missing())} '
                f'missing, {len(self.mean_errors)} comparisons, states {set(self.states)}'
            )


def _stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@pytest.fixture
def listener(domain_id):
    rclpy.init(domain_id=domain_id)
    listener = Listener()
    yield listener
    listener.node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def nodes(listener, start):
    """Deformation and scan comparison, ready to answer."""
    pose = yaml.safe_load((BAG / 'experiment.yaml').read_text())['object_pose']
    parameters = ['--ros-args', '-p', 'object:=tennis_ball', '-p', f'object_pose:={pose}']
    thin = ('-p', 'theory:=koiter')
    nodes = [start('deformation', *parameters, *thin), start('scan_compare', *parameters)]
    listener.spin_until(lambda: listener.meshes, 150)
    return nodes


@pytest.fixture
def play(listener, start):
    """Play what concerns these nodes, until the end."""

    def run(*options):
        topics = ('/hand/contacts', '/scan/points', '/object_pose')
        player = start('replay', BAG, '--wait', '30', '--topics', *topics, *options)
        listener.spin_until(lambda: player.process.poll() is not None, 200)
        assert player.process.returncode == 0, player.text

    return run


def test_every_recorded_sample_is_answered_and_every_scan_judged(listener, nodes, play):
    play(
        '--lockstep', '/hand/contacts:=/deformation/surface', '/scan/points:=/scan/error',
        '--lockstep-timeout', '30',
    )  # fmt: skip
    listener.spin_until(lambda: not listener.missing(), 20)
    listener.spin_until(lambda: len(listener.mean_errors) >= 5, 40)

    assert len(set(listener.answered)) == 2660
    assert listener.answered == sorted(listener.answered)
    assert listener.fields == ['x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma']
    assert 'CONTACT' in listener.states
    assert 8.5e-3 < max(listener.largest) < 11.5e-3
    assert listener.mean_errors[0] < 0.2e-3
    assert max(listener.mean_errors) < 0.6e-3
    assert [node.stop() for node in nodes] == [0, 0]


def test_at_the_pace_of_the_recording_no_sample_is_lost_while_scans_cross(listener, nodes, play):
    # the player waits for the nodes, not for this observer, which may hear it some samples late:
    # the answers, one per sample and stamped like it, are the count
    play('--playback-until-sec', '7.0')
    listener.spin_until(lambda: len(set(listener.answered)) >= 701, 20)
    listener.spin_until(lambda: len(listener.mean_errors) >= 2, 40)
    assert len(set(listener.answered)) == 701


def test_a_player_that_is_not_ours_drives_the_same_nodes(listener, nodes):
    """What `ros2 bag play` does: stored bytes on their topic, with its QoS, at their times."""
    publisher = listener.node.create_publisher(PointCloud2, 'hand/contacts', 100)
    listener.spin_until(lambda: publisher.get_subscription_count() >= 2, 20)
    clock = listener.node.get_clock()
    with Reader(BAG) as bag:
        connections = [c for c in bag.connections if c.topic == '/hand/contacts']
        start, begin, sent = bag.start_time, clock.now().nanoseconds, 0
        for _, stamp, stored in bag.messages(connections, stop=start + 7_000_000_000):
            listener.spin_until(
                lambda due=begin + stamp - start: clock.now().nanoseconds >= due, 9
            )
            publisher.publish(bytes(stored))
            sent += 1
    listener.spin_until(lambda: len(set(listener.answered)) == sent, 20)
    assert 1e-3 < max(listener.largest) < 11.5e-3
