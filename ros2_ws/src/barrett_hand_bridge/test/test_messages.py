# SPDX-License-Identifier: Apache-2.0
"""Messages: every field right, every scalar checked."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from barrett_hand_bridge import messages
from barrett_hand_bridge.calibration import GaugeCalibration
from barrett_hand_bridge.hand import HandSample
from barrett_hand_bridge.motion import MotionError
from barrett_hand_bridge.observer import HandObserver, ObserverSettings

GAUGE = GaugeCalibration('cubic', coefficients_nm=(0.0, 0.01), reference_counts=120.0)
NAMES = ['spread', 'f1_2', 'f1_3', 'f2_2', 'f2_3', 'f3_2', 'f3_3']


@pytest.fixture
def observation():
    observer = HandObserver(ObserverSettings(dict.fromkeys((1, 2, 3), GAUGE)))
    return observer.observe(HandSample(5_000_000_007, (6000, 6000, 0), 1575, (150, 151, None)))


def test_contacts_carry_the_fields_of_the_contract(observation):
    contacts = [observation.fingers[finger].contact for finger in (1, 2, 3)]
    cloud = messages.contacts_message(contacts, observation.stamp_ns, 'hand_base', 4)
    cloud = deserialize_message(serialize_message(cloud), PointCloud2)
    names = [field.name for field in cloud.fields]
    assert names[:13] == (
        ['x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius', 'finger', 'flags']
    )
    assert {'sigma_t', 'travel', 'sigma_travel'} < set(names)
    rows = np.frombuffer(bytes(cloud.data), messages.CONTACT_TYPE)
    assert rows['finger'].tolist() == [1, 2, 3]
    assert rows['flags'].tolist() == [12, 12, 36]
    assert np.isinf(rows['sigma_t']).all()
    assert rows['x'][0] == np.float32(contacts[0].point[0])
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (5, 7)
    assert cloud.width * cloud.point_step == len(cloud.data)


def test_joint_states_have_gauge_torque_as_effort_of_outer_joints(observation):
    message = messages.joint_states_message(
        observation.angles, {1: 0.3, 2: 0.31, 3: 0.0}, NAMES, 1
    )
    assert list(message.name) == NAMES
    assert message.position[0] == pytest.approx(math.pi / 2)
    assert message.effort[2] == 0.3 and math.isnan(message.effort[1])


def test_wrench_turns_the_contact_force_into_the_fingertip_frame(observation):
    reading = observation.fingers[1]
    wrench = messages.wrench_message(reading, 1, 'finger_1_tip').wrench
    force = np.array([wrench.force.x, wrench.force.y, wrench.force.z])
    assert np.linalg.norm(force) == pytest.approx(np.linalg.norm(reading.contact.force))
    assert reading.frames.tip[:3, :3] @ force == pytest.approx(reading.contact.force)
    assert wrench.force.z > 0


def trajectory(names, positions, seconds=1):
    point = JointTrajectoryPoint(positions=positions, time_from_start=Duration(sec=seconds))
    return JointTrajectory(joint_names=names, points=[point])


def test_trajectories_name_spread_and_inner_joints():
    points = messages.trajectory_points(trajectory(['f2_2', 'spread'], [0.5, 1.5]), NAMES)
    assert points[0].time_s == 1.0
    assert points[0].positions == {2: 0.5, 4: 1.5}


@pytest.mark.parametrize(
    ('names', 'positions', 'complaint'),
    [
        (['f1_3'], [0.5], "joint 'f1_3'"),
        ([], [], 'only spread'),
        (['f1_2'], [0.5, 0.6], '2 positions for 1 joints'),
    ],
)
def test_other_trajectories_are_refused(names, positions, complaint):
    with pytest.raises(MotionError, match=complaint):
        messages.trajectory_points(trajectory(names, positions), NAMES)


def test_a_trajectory_without_end_is_refused():
    endless = trajectory(['f1_2'], [0.5])
    endless.points = endless.points * 10_001
    with pytest.raises(MotionError, match='10001 points; 10000 are followed at most'):
        messages.trajectory_points(endless, NAMES)


def test_poses_come_back_as_seven_numbers():
    pose = messages.pose_message(np.array([1.0, 2, 3]), np.array([0, 0, 0, 1.0]), 9, 'world')
    assert messages.pose_numbers(pose) == (1, 2, 3, 0, 0, 0, 1)
