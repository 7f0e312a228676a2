# SPDX-License-Identifier: Apache-2.0
"""The hand under ros2_control: its files agree with each other and with the node.

ros2_control itself is C++ from apt and not here. Its topic system is documented: it streams the
positions of the joints in its file, not a number as long as nobody commands, and reads the joint
states by name. The last test streams so to the real node.
"""

import math
from xml.etree import ElementTree

import pytest
import rclpy
import yaml
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from barrett_hand_bridge import messages
from barrett_hand_bridge.description import urdf
from barrett_hand_bridge.description.names import Names
from barrett_hand_bridge.motion import MotionError

NAMES = Names().joint_names
HERE = urdf.MACRO.parent
MOTORS = ('spread', 'finger_1_inner', 'finger_2_inner', 'finger_3_inner')


def expanded(**arguments):
    xacro = pytest.importorskip('xacro')
    text = xacro.process_file(str(HERE / 'barrett_hand_alone.urdf.xacro'), mappings=arguments)
    return ElementTree.fromstring(text.toxml())


@pytest.mark.parametrize('prefix', ['', 'left_'])
def test_the_macro_is_the_description_of_the_node_with_a_prefix(prefix):
    found = expanded(prefix=prefix)
    called = Names(
        f'{prefix}hand_base',
        tuple(f'{prefix}finger_{finger}_tip' for finger in (1, 2, 3)),
        tuple(f'{prefix}{joint}' for joint in NAMES),
        prefix,
    )
    described = ElementTree.fromstring(urdf.urdf(urdf.HandGeometry(), called))
    for kind in ('link', 'joint'):
        ours = {ElementTree.canonicalize(ElementTree.tostring(one), strip_text=True)
                for one in described.findall(kind)}  # fmt: skip
        theirs = {ElementTree.canonicalize(ElementTree.tostring(one), strip_text=True)
                  for one in found.findall(kind)}  # fmt: skip
        assert ours < theirs
        more = {ElementTree.fromstring(one).get('name') for one in theirs - ours}
        assert more == ({'world'} if kind == 'link' else {f'{prefix}hand_mount'})


def test_the_joints_of_ros2_control_are_those_that_the_node_takes():
    system = expanded(prefix='left_', namespace='/left').find('ros2_control')
    joints = [joint.get('name') for joint in system.findall('joint')]
    assert joints == [f'left_{joint}' for joint in MOTORS]
    for joint in system.findall('joint'):
        assert [one.get('name') for one in joint.findall('command_interface')] == ['position']
    told = {one.get('name'): one.text for one in system.find('hardware').findall('param')}
    assert told == {
        'joint_commands_topic': '/left/hand/joint_commands',
        'joint_states_topic': '/left/hand/joint_states',
    }
    names = [f'left_{joint}' for joint in NAMES]
    command = JointState(name=joints, position=[0.1, 0.2, 0.3, math.nan])
    assert messages.commanded_positions(command, names) == {4: 0.1, 1: 0.2, 2: 0.3}


def test_the_controller_commands_these_joints_and_the_launch_file_starts_it():
    package = HERE.parent.parent
    given = yaml.safe_load((package / 'config' / 'ros2_control.yaml').read_text())['/**']
    assert given['hand_controller']['ros__parameters']['joints'] == list(MOTORS)
    launch = ElementTree.parse(package / 'launch' / 'ros2_control.launch.xml').getroot()
    started = [node.get('exec') for node in launch.iter('node')]
    assert started == ['hand_bridge', 'robot_state_publisher', 'ros2_control_node', 'spawner']
    controllers = given['controller_manager']['ros__parameters']
    assert launch.findall('node')[3].get('args') in controllers


@pytest.mark.parametrize(
    ('names', 'positions', 'complaint'),
    [
        (['finger_1_outer'], [0.1], 'can be commanded, once'),
        (['spread', 'spread'], [0.1, 0.1], 'can be commanded, once'),
        (['nose\x1b[31m'], [0.1], r'\\x1b'),
        (['spread'], [], '0 positions for 1 joints'),
        (['spread'], [math.inf], 'must be 0 to'),
        (['finger_1_inner'], [-1.0], 'must be 0 to'),
    ],
)
def test_an_impossible_command_is_refused(names, positions, complaint):
    with pytest.raises(MotionError, match=complaint):
        messages.commanded_positions(JointState(name=names, position=positions), NAMES)


class Controller:
    """Streams as the topic system of ros2_control does, 50 times a second."""

    def __init__(self, wait_until):
        rclpy.init()
        self.node = rclpy.create_node('controller')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.wait_until = wait_until
        self.positions = {}
        self.wanted = dict.fromkeys(MOTORS, math.nan)
        self.node.create_subscription(
            JointState, 'hand/joint_states', self._states, qos_profile_sensor_data
        )
        self.commands = self.node.create_publisher(JointState, 'hand/joint_commands', 1)
        self.node.create_timer(0.02, self._write)

    def _states(self, message):
        self.positions = dict(zip(message.name, message.position, strict=True))

    def _write(self):
        command = JointState(name=list(self.wanted), position=list(self.wanted.values()))
        command.header.stamp = self.node.get_clock().now().to_msg()
        self.commands.publish(command)

    def until(self, condition, timeout=40.0):
        def turn():
            self.executor.spin_once(timeout_sec=0.05)
            return condition()

        self.wait_until(turn, timeout, lambda: f'{self.wanted} {self.positions}')

    def go(self, joint, way, steps=20):
        begin = self.positions[joint]
        for step in range(1, steps + 1):
            self.wanted[joint] = begin + way * step / steps
            self._write()
            self.executor.spin_once(timeout_sec=0.02)
        return begin + way

    def creep(self, joint):
        """Go on a little; always true."""
        self.wanted[joint] += 0.005
        return True

    def end(self):
        self.executor.remove_node(self.node)
        self.node.destroy_node()
        rclpy.try_shutdown()


def test_the_node_follows_what_a_controller_streams_and_a_stop_holds(domain_id, wait_until, start):
    running = start(
        'hand_bridge', '--ros-args', '-p', 'backend:=emulator', '-p', 'initialize_on_start:=true'
    )
    controller = Controller(wait_until)
    try:
        controller.until(lambda: controller.positions)
        controller.wanted = {joint: controller.positions[joint] for joint in MOTORS}
        goal = controller.go('finger_1_inner', 0.3)
        controller.until(lambda: abs(controller.positions['finger_1_inner'] - goal) < 0.01)
        assert controller.positions['finger_2_inner'] == pytest.approx(0.0, abs=0.01)
        stop = controller.node.create_client(Trigger, 'hand/stop')
        controller.until(stop.service_is_ready)
        # On its way somebody stops it: what the controller goes on to say moves nothing.
        controller.go('finger_1_inner', 0.05, steps=3)
        answered = stop.call_async(Trigger.Request())
        controller.until(lambda: controller.creep('finger_1_inner') and answered.done())
        stood = controller.positions['finger_1_inner']
        for _ in range(50):
            controller.until(lambda: controller.creep('finger_1_inner'))
        assert controller.positions['finger_1_inner'] == pytest.approx(stood, abs=0.03)
        assert running.process.poll() is None, running.text
        assert 'Traceback' not in running.text
    finally:
        controller.end()
