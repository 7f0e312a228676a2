# SPDX-License-Identifier: Apache-2.0
"""The node as a process, on an emulated hand as another: topics, services, losses, exit codes."""

import contextlib
import importlib.util
import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger
from tests.service_calls import answer
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from barrett_hand_bridge.arm_pose_node import ArmPose
from barrett_hand_bridge.calibration import read_calibration
from barrett_hand_bridge.commands import hand_calibrate
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.pty_port import PtyPort
from barrett_hand_bridge.emulator.serial_hand import SerialHand
from barrett_hand_bridge.emulator.weighing import weighing_table
from barrett_hand_bridge.messages import CONTACT_TYPE
from barrett_hand_bridge.parameters import PARAMETERS

BALL = """
displacement_m: [0.0, 0.00256, 0.00605, 0.00912, 0.01027]
force_n: [0.0, 10.631, 16.503, 20.373, 21.485]
pinched: {fingers: [1, 2], width_m: 0.065}
"""


class Listener:
    """A node of the test that hears everything the bridge says."""

    def __init__(self, wait_until):
        rclpy.init()
        self.node = rclpy.create_node('listener')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.wait_until = wait_until
        self.contacts = []
        self.diagnostics = []
        self.heard = {}
        self.node.create_subscription(
            PointCloud2, 'hand/contacts', self._on_contacts, qos_profile_sensor_data
        )
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, QoSProfile(depth=10)
        )

    def _on_diagnostics(self, message):
        if message.status[0].name == 'hand_bridge: hand':
            self.diagnostics.append(message)

    def _on_contacts(self, message):
        self.contacts.append(np.frombuffer(bytes(message.data), CONTACT_TYPE))

    def listen(self, kind, topic):
        self.heard[topic] = []
        self.node.create_subscription(
            kind, topic, self.heard[topic].append, qos_profile_sensor_data
        )

    def until(self, condition, timeout=40.0):
        def turn():
            self.executor.spin_once(timeout_sec=0.05)
            return condition()

        self.wait_until(turn, timeout, lambda: str(self.status()))

    def status(self):
        if not self.diagnostics:
            return None
        status = self.diagnostics[-1].status[0]
        return status.level, status.message, {v.key: v.value for v in status.values}

    def call(self, service, timeout=40.0):
        client = self.node.create_client(Trigger, service)
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done, timeout)
        return future.result()

    def next_contacts(self):
        self.contacts.clear()
        self.until(lambda: self.contacts)
        return self.contacts[-1]

    def end(self):
        self.executor.remove_node(self.node)
        self.node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def listener(domain_id, wait_until):
    listener = Listener(wait_until)
    yield listener
    listener.end()


def children(pid, word):
    """Living children of a process whose command line holds a word."""
    found = []
    tasks = Path(f'/proc/{pid}/task').glob('*/children')
    for child in ' '.join(task.read_text() for task in tasks).split():
        with contextlib.suppress(OSError):
            if word in Path(f'/proc/{child}/cmdline').read_text():
                found.append(int(child))
    return found


def bridge(start, *parameters):
    arguments = ['--ros-args']
    for parameter in parameters:
        arguments += ['-p', parameter]
    return start('hand_bridge', *arguments)


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / 'ball.yaml'
    path.write_text(BALL)
    return path


@pytest.fixture
def calibration(tmp_path):
    table = tmp_path / 'weights.csv'
    table.write_text('\n'.join(weighing_table(HandMechanics(HandBody(), 1), 1)))
    path = tmp_path / 'calibration.yaml'
    hand_calibrate.main([str(table), '--calibration', str(path), '--serial-number', '1'])
    return path


def moved(listener):
    return listener.heard['hand/joint_states'][-1].position[1] > 0.005


def emulated(start, *options):
    emulator = start('hand_emulator', '--json', *options)
    emulator.wait_for('}')
    return json.loads(emulator.text.splitlines()[0])['port'], emulator


def test_a_ball_is_grasped_from_start_to_force(start, listener, ball):
    node = bridge(
        start, 'backend:=emulator', f'emulator_object:={ball}', 'initialize_on_start:=true',
        'close_force:=6.0', 'approach_speed:=0.03',
    )  # fmt: skip
    listener.listen(JointState, 'hand/joint_states')
    listener.listen(WrenchStamped, 'hand/finger_1/wrench')
    listener.listen(Float64, 'hand/finger_2/gauge_counts')
    listener.listen(JointState, 'hand/numbers')
    rows = listener.next_contacts()
    assert all(rows['flags'] & 8)
    refused = listener.call('hand/close')
    assert not refused.success and 'tare' in refused.message
    assert listener.call('hand/tare').success
    assert not any(listener.next_contacts()['flags'] & 8)

    publisher = listener.node.create_publisher(JointTrajectory, 'hand/joint_trajectory', 10)
    listener.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(
        JointTrajectory(
            joint_names=['spread', 'finger_1_inner', 'finger_2_inner'],
            points=[
                JointTrajectoryPoint(
                    positions=[np.pi / 2, 0.75, 0.75], time_from_start=Duration(sec=3)
                )
            ],
        )
    )
    node.wait_for('trajectory followed', 40.0)
    publisher.publish(
        JointTrajectory(
            joint_names=['finger_1_inner'],
            points=[JointTrajectoryPoint(positions=[0.9], time_from_start=Duration(sec=30))],
        )
    )
    # Beyond where the first one leaves it, or the stop may overtake the second on its way.
    listener.until(lambda: listener.heard['hand/joint_states'][-1].position[1] > 0.77)
    assert listener.call('hand/stop').success
    # A second end, of another severity than the first: the node must outlive what it says.
    node.wait_for('hand/joint_trajectory: stopped', 40.0)

    closed = listener.call('hand/close').message
    assert '6 N were asked for' in closed
    rows = listener.next_contacts()
    told = [float(force) for force in re.findall(r'finger \d (\S+) N', closed)]
    assert told == pytest.approx(
        np.hypot.reduce([rows[f][:2] for f in ('fx', 'fy', 'fz')]), abs=0.4
    )
    assert rows['finger'].tolist() == [1, 2, 3]
    for row in rows[:2]:
        force = np.array([row['fx'], row['fy'], row['fz']])
        normal = np.array([row['nx'], row['ny'], row['nz']])
        assert row['flags'] == 1
        assert force @ normal == pytest.approx(6.5, abs=2.0)
        assert 0.0005 < row['travel'] < 0.004
        assert np.isinf(row['sigma_t'])
    assert rows['nx'][0] == pytest.approx(1.0, abs=0.01)
    assert rows['flags'][2] == 0
    assert listener.heard['hand/finger_1/wrench'][-1].header.frame_id == 'finger_1_tip'
    assert listener.heard['hand/joint_states'][-1].effort[2] > 0.2
    assert 130 < listener.heard['hand/finger_2/gauge_counts'][-1].data < 200
    numbers = listener.heard['hand/numbers'][-1]
    assert (
        130 < dict(zip(numbers.name, numbers.position, strict=True))['finger_2_gauge_counts'] < 200
    )
    assert numbers.header.stamp.sec > 0

    refused = listener.call('hand/tare')
    assert not refused.success
    assert listener.call('hand/open').message == 'open'
    listener.until(lambda: listener.status()[1] == 'free')
    listener.contacts.clear()
    assert listener.call('hand/initialize').success
    # While the hand looks for its zeros nothing is heard of the contacts: they are stale.
    listener.until(lambda: any(rows['flags'][0] & 4 for rows in listener.contacts))
    listener.until(lambda: not listener.contacts[-1]['flags'][0] & 4)
    assert node.stop(signal.SIGINT) == 0
    assert 'Traceback' not in node.text


def test_a_lost_hand_is_stale_at_once_and_wants_a_tare_when_it_is_back(
    start, listener, tmp_path, calibration
):
    link = tmp_path / 'hand'
    _, emulator = emulated(start, '--link', link, '--fault', 'unplug@signal:2')
    node = bridge(
        start, f'port:={link}', f'calibration:={calibration}', 'initialize_on_start:=true',
        'tare_on_start:=true',
    )  # fmt: skip
    node.wait_for('tare: zero in counts', 60.0)
    emulator.process.send_signal(signal.SIGUSR1)
    listener.until(lambda: any(rows['flags'][0] & 4 for rows in listener.contacts[-200:]))
    listener.until(lambda: listener.status() and listener.status()[2]['state'] == 'lost')
    node.wait_for('again connected', 60.0)
    listener.until(lambda: listener.next_contacts()['flags'][0] == 8)
    assert node.stop(signal.SIGTERM) == 0


def test_stop_interrupts_a_slow_close(start, listener, ball):
    bridge(
        start, 'backend:=emulator', f'emulator_object:={ball}', 'initialize_on_start:=true',
        'tare_on_start:=true', 'approach_speed:=0.02',
    ).wait_for('tare: zero', 60.0)  # fmt: skip
    listener.listen(JointState, 'hand/joint_states')
    client = listener.node.create_client(Trigger, 'hand/close')
    listener.until(client.service_is_ready)
    listener.next_contacts()
    closing = client.call_async(Trigger.Request())
    # The finger moves: the request has arrived, which a client cannot know otherwise.
    listener.until(lambda: listener.heard['hand/joint_states'][-1:] and moved(listener))
    assert listener.call('hand/stop').success
    listener.until(closing.done)
    assert closing.result().message == 'stopped'


def test_a_can_hand_publishes_pins_and_touch_cells(start, listener, tmp_path):
    port = '24801'
    emulator = start(
        'hand_emulator', '--hand', '280', '--json', '--can-port', port,
        '--press', '2:7:3.5', '--press', '4:0:1.0', '--fault', 'press@signal',
    )  # fmt: skip
    emulator.wait_for('}')
    calibration = tmp_path / 'hand_280.yaml'
    cubic = {
        'kind': 'cubic', 'coefficients_nm': [-2.85, 3.764e-3, -1.708e-6, 2.754e-10],
        'zero': 'difference', 'reference_counts': 1809.0, 'no_load_counts': [1700.0, 2150.0],
        'noise_counts': 3.0, 'residual_nm': 0.003, 'relative_sigma': 0.1, 'valid_torque_nm': 1.1,
    }  # fmt: skip
    calibration.write_text(
        json.dumps(
            {
                'format': 'barrett_hand_calibration/1',
                'hand': 'BH8-280',
                'serial_number': '0',
                'fingers': {1: cubic, 2: cubic, 3: cubic},
            }
        ).replace('"1":', '1:').replace('"2":', '2:').replace('"3":', '3:')
    )  # fmt: skip
    assert read_calibration(calibration).hand == 'BH8-280'
    bridge(
        start, 'backend:=can', 'interface:=udp_multicast', "channel:='239.74.163.2'",
        f'can_port:={port}', f'calibration:={calibration}', 'initialize_on_start:=true',
        'touch:=full',
    )  # fmt: skip
    listener.until(lambda: listener.contacts, 60.0)
    emulator.process.send_signal(signal.SIGUSR1)
    listener.until(lambda: len(listener.contacts[-1]) == 5)
    cell, palm = listener.contacts[-1][3:]
    assert (cell['finger'], cell['flags']) == (2, 1)
    assert cell['radius'] == pytest.approx(0.003, abs=0.0005)
    # 1 N/cm2 on the palm's corner cell beside finger 1.
    assert (palm['finger'], palm['flags']) == (4, 1)
    assert [palm[name] for name in 'xyz'] == pytest.approx([-0.022, -0.0159, 0.0813], abs=1e-5)
    assert palm['fz'] == pytest.approx(0.97, abs=1e-5)


def test_simulated_time_gives_one_cycle_per_tick_with_its_stamp(start, listener, calibration):
    hand = SerialHand(HandMechanics(HandBody(), 1), serial_number=1)
    port = PtyPort(hand, paced=False, real_time=False)
    port.start()
    clock = listener.node.create_publisher(Clock, '/clock', 10)
    stamps = []
    listener.node.create_subscription(
        PointCloud2,
        'hand/contacts',
        lambda m: stamps.append(m.header.stamp.sec * 100 + m.header.stamp.nanosec // 10_000_000),
        QoSProfile(depth=500),
    )
    bridge(
        start, f'port:={port.path}', f'calibration:={calibration}', 'use_sim_time:=true',
        'poll_period:=0.01', 'initialize_on_start:=true',
    )  # fmt: skip
    listener.until(lambda: clock.get_subscription_count() >= 1)
    now = [100]

    def tick():
        now[0] += 1
        port.advance(0.01)
        time = Time(sec=now[0] // 100, nanosec=now[0] % 100 * 10_000_000)
        clock.publish(Clock(clock=time))

    def cycling():
        tick()
        return stamps

    listener.until(cycling, 60.0)
    for _ in range(20):
        tick()
        expected = now[0]
        listener.until(lambda at=expected: stamps[-1] == at)
    assert stamps[-20:] == list(range(now[0] - 19, now[0] + 1))
    port.stop()


def test_the_life_cycle_is_managed_when_autostart_is_off(start, listener):
    node = bridge(start, 'backend:=emulator', 'autostart:=false', 'initialize_on_start:=true')
    client = listener.node.create_client(ChangeState, 'hand_bridge/change_state')
    listener.until(client.service_is_ready)

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        future = client.call_async(request)
        listener.until(future.done)
        return future.result().success

    assert change(Transition.TRANSITION_CONFIGURE)
    node.wait_for('connected', 60.0)
    assert not listener.call('hand/open').success
    assert change(Transition.TRANSITION_ACTIVATE)
    listener.next_contacts()
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert change(Transition.TRANSITION_CLEANUP)
    listener.until(lambda: not listener.node.get_publishers_info_by_topic('hand/contacts'))
    assert change(Transition.TRANSITION_CONFIGURE)
    assert change(Transition.TRANSITION_ACTIVATE)
    listener.next_contacts()
    assert node.stop(signal.SIGINT) == 0


def test_parameters_are_checked_while_the_node_runs(start, listener):
    bridge(start, 'backend:=emulator').wait_for('connected', 60.0)
    client = listener.node.create_client(SetParameters, 'hand_bridge/set_parameters')

    def change(name, value):
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        return answer(client, request, listener.until).results[0]

    assert change('close_force', 7.5).successful
    assert not change('close_force', 70.0).successful
    refused = change('calibration', 'other.yaml')
    assert not refused.successful and 'takes effect at configure' in refused.reason


def test_a_pose_of_the_arm_in_a_frame_of_the_hand_itself_is_not_used(domain_id):
    rclpy.init()
    node, used = LifecycleNode('bridge'), []
    values = {parameter.name: parameter.default for parameter in PARAMETERS} | {'arm': 'pose'}
    try:
        arm = ArmPose(node, values, lambda _: None, lambda frame, *_: used.append(frame))
        for frame in ('base', 'hand_base', '', 'finger_2_tip', 'world'):
            message = PoseStamped()
            message.header.frame_id, message.pose.orientation.w = frame, 1.0
            arm._on_pose(message)
        assert used == ['base', 'world']
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_the_hand_pose_follows_the_arm(start, listener):
    bridge(start, 'backend:=emulator', 'arm:=cobra_600').wait_for('not initialised', 60.0)
    listener.listen(PoseStamped, 'hand_pose')
    publisher = listener.node.create_publisher(JointState, 'arm/joint_states', 10)
    listener.until(lambda: publisher.get_subscription_count() == 1)
    names = ['joint_1', 'joint_2', 'joint_3', 'joint_4']

    def posed():
        publisher.publish(JointState(name=names, position=[0.0, 0.0, 0.1, 0.0]))
        return listener.heard['hand_pose']

    listener.until(posed)
    position = listener.heard['hand_pose'][-1].pose.position
    assert (position.x, position.y, position.z) == pytest.approx((0.6, 0.0, 0.287))


@pytest.mark.parametrize(
    ('parameters', 'complaint'),
    [
        (('port:=/dev/ttyNOT', 'calibration:={calibration}'), '/dev/ttyNOT'),
        (('port:=/dev/null',), 'parameter calibration is empty'),
        (('calibration:=none.yaml',), 'none.yaml'),
        (('backend:=telepathy',), "backend is 'telepathy'"),
        (('baud:=fast',), "baud is 'fast', of type STRING; it must be of the type of 38400"),
        (('close_force:=100.0',), 'close_force out of range'),
        (('backend:=emulator', 'emulator_object:=no.yaml'), 'no.yaml'),
    ],
)
def test_a_bridge_that_cannot_work_ends_with_one_sentence(
    start, calibration, parameters, complaint
):
    node = bridge(start, *(text.format(calibration=calibration) for text in parameters))
    assert node.ended() == 1
    assert complaint in node.text
    assert 'Traceback' not in node.text


def test_the_calibration_of_another_hand_is_refused(start, calibration):
    port, _ = emulated(start, '--unpaced', '--seed', '99')
    node = bridge(start, f'port:={port}', f'calibration:={calibration}')
    assert node.ended() == 1
    assert 'is for hand number 1, this hand says 99' in node.text


@pytest.mark.parametrize('how', [signal.SIGKILL, signal.SIGSTOP])
def test_a_stop_guard_that_dies_or_hangs_is_replaced_and_told_of(
    start, listener, calibration, how
):
    port, _ = emulated(start, '--unpaced')
    node = bridge(
        start, f'port:={port}', f'calibration:={calibration}', 'initialize_on_start:=true'
    )
    listener.until(lambda: listener.contacts)
    # What it is about to do by itself is no reason to warn.
    assert 'call hand/initialize' not in node.text
    first = children(node.process.pid, 'stop_guard')
    assert len(first) == 1
    os.kill(first[0], how)

    def restarted():
        status = listener.status()
        return status and status[2]['stop guard restarted (times)'] == '1'

    listener.until(restarted, 10.0)
    second = children(node.process.pid, 'stop_guard')
    assert len(second) == 1 and second != first


def installed(package):
    return importlib.util.find_spec(package) is not None


def test_the_hand_describes_itself_and_says_what_it_does_not_offer(start, listener, calibration):
    port, _ = emulated(start, '--unpaced')
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    described = []
    listener.node.create_subscription(String, 'robot_description', described.append, latched)
    node = bridge(
        start, f'port:={port}', f'calibration:={calibration}', 'link_prefix:=left_',
        'initialize_on_start:=true',
    )  # fmt: skip
    listener.until(lambda: described and listener.contacts)
    assert '<link name="left_finger_1_knuckle">' in described[0].data
    assert ('no TF' in node.text) is not installed('tf2_msgs')
    assert ('no actions' in node.text) is not installed('control_msgs')
    if not installed('tf2_msgs'):
        return
    from tf2_msgs.msg import TFMessage

    transforms = []
    listener.node.create_subscription(
        TFMessage, '/tf', lambda message: transforms.append(message.transforms), 10
    )
    listener.until(lambda: transforms)
    pairs = {one.child_frame_id: one.header.frame_id for one in transforms[0]}
    for finger in (1, 2, 3):
        frame = f'finger_{finger}_tip'
        while frame != 'hand_base':
            frame = pairs[frame]


def test_actions_move_the_hand_with_feedback_and_can_be_cancelled(
    start, listener, ball, calibration
):
    if not installed('control_msgs'):
        # That the node says so is the test above.
        return
    from control_msgs.action import FollowJointTrajectory, GripperCommand
    from control_msgs.msg import JointTolerance
    from rclpy.action import ActionClient

    port, _ = emulated(start, '--squeezed', ball)
    bridge(start, f'port:={port}', f'calibration:={calibration}', 'initialize_on_start:=true')
    listener.until(lambda: listener.contacts)
    assert listener.call('hand/tare').success
    follow = ActionClient(listener.node, FollowJointTrajectory, 'hand/follow_joint_trajectory')
    grip = ActionClient(listener.node, GripperCommand, 'hand/gripper_command')
    listener.until(lambda: follow.server_is_ready() and grip.server_is_ready())
    feedback = []

    def asked(client, goal):
        sent = client.send_goal_async(goal, feedback_callback=feedback.append)
        listener.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    def ended(handle):
        result = handle.get_result_async()
        listener.until(result.done, 60.0)
        return result.result()

    def trajectory(seconds, *positions):
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = ['spread', 'finger_1_inner', 'finger_2_inner']
        goal.trajectory.points = [
            JointTrajectoryPoint(positions=positions, time_from_start=Duration(sec=seconds))
        ]
        return goal

    done = ended(asked(follow, trajectory(3, np.pi / 2, 0.75, 0.75)))
    assert (done.status, done.result.error_code) == (GoalStatus.STATUS_SUCCEEDED, 0)
    assert done.result.error_string == 'trajectory followed'
    assert feedback[-1].feedback.joint_names == ['finger_1_inner', 'finger_2_inner', 'spread']
    assert feedback[-1].feedback.actual.positions[0] == pytest.approx(0.75, abs=0.1)

    handle = asked(follow, trajectory(30, np.pi / 2, 1.5, 1.5))
    cancelled = handle.cancel_goal_async()
    listener.until(cancelled.done)
    done = ended(handle)
    assert done.status == GoalStatus.STATUS_CANCELED
    assert done.result.error_string == 'stopped'

    strict = trajectory(3, np.pi / 2, 0.9, 0.9)
    strict.path_tolerance = [JointTolerance(name='finger_1_inner', position=1e-6)]
    done = ended(asked(follow, strict))
    assert done.status == GoalStatus.STATUS_ABORTED
    assert done.result.error_code == FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED
    assert 'off its path' in done.result.error_string

    wrong = ended(asked(follow, trajectory(3, np.nan, 0.75, 0.75)))
    assert wrong.result.error_code == FollowJointTrajectory.Result.INVALID_GOAL

    goal = GripperCommand.Goal()
    goal.command.max_effort = 6.0
    held = ended(asked(grip, goal)).result
    assert held.stalled and not held.reached_goal
    assert held.effort >= 5.0
    assert 0.05 < held.position < 0.066
    goal.command.position = 0.08
    freed = ended(asked(grip, goal)).result
    assert freed.reached_goal and freed.position >= 0.08
    goal.command.position = np.nan
    assert ended(asked(grip, goal)).status == GoalStatus.STATUS_ABORTED
