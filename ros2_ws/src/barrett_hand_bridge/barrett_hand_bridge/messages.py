# SPDX-License-Identifier: Apache-2.0
"""All ROS messages of the bridge: built and read here and nowhere else."""

from __future__ import annotations

import array
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from sensor_msgs.msg import JointState, PointCloud2
from trajectory_msgs.msg import JointTrajectory

from barrett_hand_bridge.arm import quaternion_of
from barrett_hand_bridge.contacts import Contact
from barrett_hand_bridge.hand import FINGERS, SPREAD
from barrett_hand_bridge.kinematics import Array, JointAngles, cross
from barrett_hand_bridge.motion import (
    Following,
    MotionError,
    TrajectoryPoint,
    joint_position,
    out_of_reach,
)
from barrett_hand_bridge.observer import FingerReading, Observation
from grasp_common.messages import cloud, header, point_fields
from grasp_common.terminal import printable

CONTACT_TYPE = np.dtype(
    [
        *((name, '<f4') for name in ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz')),
        ('sigma_n', '<f4'),
        ('radius', '<f4'),
        ('finger', 'u1'),
        ('flags', 'u1'),
        ('_unused', '<u2'),
        ('sigma_t', '<f4'),
        ('travel', '<f4'),
        ('sigma_travel', '<f4'),
        ('sigma_point', '<f4'),
        ('sigma_normal', '<f4'),
        *((name, '<f4') for name in ('ax', 'ay', 'az')),
    ]
)
# What parameter close_force allows.
MOST_FORCE_N = 25.0
# A minute at 100 Hz and more; to check them holds the node up.
MOST_POINTS = 10_000
_CONTACT_FIELDS = point_fields(CONTACT_TYPE)


def contacts_message(
    contacts: Sequence[Contact], stamp_ns: int, frame: str, more_flags: int = 0
) -> PointCloud2:
    """`hand/contacts`: one point per contact; `more_flags` are set on every one."""
    rows = np.zeros(len(contacts), CONTACT_TYPE)
    for row, contact in zip(rows, contacts, strict=True):
        row['x'], row['y'], row['z'] = contact.point
        row['nx'], row['ny'], row['nz'] = contact.normal
        row['fx'], row['fy'], row['fz'] = contact.force
        row['sigma_n'] = contact.sigma_normal_n
        row['radius'] = contact.radius_m
        row['finger'] = contact.finger
        row['flags'] = contact.flags | more_flags
        row['sigma_t'] = contact.sigma_tangential_n
        row['travel'] = contact.travel_m
        row['sigma_travel'] = contact.sigma_travel_m
        row['sigma_point'] = contact.sigma_point_m
        row['sigma_normal'] = contact.sigma_direction_rad
        row['ax'], row['ay'], row['az'] = contact.along
    return cloud(rows, stamp_ns, frame, _CONTACT_FIELDS, dense=False)


def joint_states_message(
    angles: JointAngles, torques_nm: Mapping[int, float], names: Sequence[str], stamp_ns: int
) -> JointState:
    """`hand/joint_states`: effort is the gauge torque of the outer joints, NaN elsewhere."""
    positions = [float(angles.spread)]
    efforts = [math.nan]
    for finger in FINGERS:
        positions += [float(angles.inner[finger]), float(angles.outer[finger])]
        efforts += [math.nan, float(torques_nm[finger])]
    return JointState(
        header=header(stamp_ns),
        name=list(names),
        position=array.array('d', positions),
        velocity=array.array('d'),
        effort=array.array('d', efforts),
    )


def wrench_message(reading: FingerReading, stamp_ns: int, frame: str) -> WrenchStamped:
    """`hand/finger_N/wrench`: force and torque on the object about the fingertip frame."""
    contact = reading.contact
    rotation, origin = reading.frames.tip[:3, :3], reading.frames.tip[:3, 3]
    force = rotation.T @ contact.force
    torque = cross(rotation.T @ (contact.point - origin), force)
    message = WrenchStamped(header=header(stamp_ns, frame))
    message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = map(float, force)
    message.wrench.torque.x, message.wrench.torque.y, message.wrench.torque.z = map(float, torque)
    return message


def transform_message(place: Array, parent: str, child: str, stamp_ns: int) -> TransformStamped:
    """A transform (4, 4) from one frame to the one it hangs on."""
    message = TransformStamped(header=header(stamp_ns, parent), child_frame_id=child)
    t, q = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = map(float, place[:3, 3])
    q.x, q.y, q.z, q.w = map(float, quaternion_of(place[:3, :3]))
    return message


def tolerances(request: Any, names: Sequence[str]) -> tuple[dict[int, float], float, float]:
    """Path tolerance per motor, one goal tolerance for all (rad), and the time after the end (s).

    Zeros and missing ones stand for the defaults, as control_msgs has it.

    Raises:
        MotionError: a joint that cannot be commanded, or a tolerance below zero.
    """
    motors = _motors(names)
    for one in (*request.path_tolerance, *request.goal_tolerance):
        if one.name not in motors or not 0.0 <= one.position < math.inf:
            raise MotionError(
                f"tolerance {one.position} of joint '{printable(one.name, 80)}' cannot be used"
            )
    path = {motors[one.name]: float(one.position) for one in request.path_tolerance}
    goal = [float(one.position) for one in request.goal_tolerance if one.position > 0.0]
    after = request.goal_time_tolerance
    seconds = float(after.sec) + 1e-9 * float(after.nanosec)
    if seconds < 0.0:
        raise MotionError(f'goal_time_tolerance is {seconds} s')
    return {motor: one for motor, one in path.items() if one}, min(goal, default=0.0), seconds


def trajectory_feedback(observation: Observation, motion: Following, names: Sequence[str]) -> Any:
    """Where each joint of a trajectory should be, where it is, and the difference."""
    from control_msgs.action import FollowJointTrajectory

    joints = {motor: name for name, motor in _motors(names).items()}
    feedback = FollowJointTrajectory.Feedback(header=header(observation.stamp_ns))
    actual = {motor: joint_position(observation, motor) for motor in motion.motors}
    desired = motion.desired or actual
    feedback.joint_names = [joints[motor] for motor in motion.motors]
    feedback.desired.positions = array.array('d', [desired[m] for m in motion.motors])
    feedback.actual.positions = array.array('d', [actual[m] for m in motion.motors])
    feedback.error.positions = array.array('d', [desired[m] - actual[m] for m in motion.motors])
    return feedback


def wanted_force(command: Any) -> float | None:
    """The force of a gripper command in N; None where it leaves it open (0).

    Raises:
        MotionError: a force that no finger makes.
    """
    force = float(command.max_effort)
    if not 0.0 <= force <= MOST_FORCE_N:
        raise MotionError(f'max_effort is {force} N, must be 0 to {MOST_FORCE_N:g}')
    return force or None


def _motors(names: Sequence[str]) -> dict[str, int]:
    """Motors by the names of the joints that can be commanded."""
    return {names[0]: SPREAD, names[1]: 1, names[3]: 2, names[5]: 3}


def pose_message(position: Array, quaternion: Array, stamp_ns: int, frame: str) -> PoseStamped:
    """A pose from a position in m (3,) and a quaternion x y z w (4,)."""
    message = PoseStamped(header=header(stamp_ns, frame))
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = map(float, position)
    q.x, q.y, q.z, q.w = map(float, quaternion)
    return message


def pose_numbers(message: PoseStamped) -> tuple[float, ...]:
    """A pose as x y z and quaternion x y z w."""
    p, q = message.pose.position, message.pose.orientation
    return tuple(float(value) for value in (p.x, p.y, p.z, q.x, q.y, q.z, q.w))


def joint_positions(message: JointState) -> dict[str, float]:
    """Positions by joint name; empty where names and positions do not match."""
    if len(message.name) != len(message.position):
        return {}
    return {name: float(value) for name, value in zip(message.name, message.position, strict=True)}


def commanded_positions(message: JointState, names: Sequence[str]) -> dict[int, float]:
    """`hand/joint_commands`: rad by motor, `names` as in hand/joint_states.

    A position that is not a number is none: so a controller manager says that nobody commands.

    Raises:
        MotionError: a joint that cannot be commanded or is named twice, another number of
            positions than names, or a position out of reach.
    """
    motors = _motors(names)
    unknown = [name for name in message.name if name not in motors]
    if unknown or len(set(message.name)) != len(message.name):
        allowed = ', '.join(motors)
        raise MotionError(
            f'commands for {printable(", ".join(message.name), 80)}: each of {allowed} can be '
            'commanded, once'
        )
    if len(message.position) != len(message.name):
        raise MotionError(
            f'{len(message.position)} positions for {len(message.name)} joints: only positions '
            'can be commanded'
        )
    wanted = {
        motors[name]: float(position)
        for name, position in zip(message.name, message.position, strict=True)
        if not math.isnan(position)
    }
    for motor, position in wanted.items():
        refusal = out_of_reach(motor, position)
        if refusal:
            raise MotionError(refusal)
    return wanted


def trajectory_points(message: JointTrajectory, names: Sequence[str]) -> list[TrajectoryPoint]:
    """Read a trajectory of the spread and inner joints, `names` as in hand/joint_states.

    Raises:
        MotionError: an unknown joint, an outer joint (it follows the inner one), or a point with
            another number of positions than joints.
    """
    motors = _motors(names)
    unknown = [name for name in message.joint_names if name not in motors]
    if unknown or not message.joint_names:
        allowed = ', '.join(motors)
        named = unknown[0] if unknown else '(none)'
        raise MotionError(
            f"trajectory for joint '{printable(named, 80)}': only {allowed} can be commanded"
        )
    if len(message.points) > MOST_POINTS:
        raise MotionError(
            f'the trajectory has {len(message.points)} points; {MOST_POINTS} are followed at most'
        )
    points = []
    for number, point in enumerate(message.points, start=1):
        if len(point.positions) != len(message.joint_names):
            raise MotionError(
                f'trajectory point {number}: {len(point.positions)} positions for '
                f'{len(message.joint_names)} joints'
            )
        seconds = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
        positions = {
            motors[name]: float(value)
            for name, value in zip(message.joint_names, point.positions, strict=True)
        }
        points.append(TrajectoryPoint(float(seconds), positions))
    return points
