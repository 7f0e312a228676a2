"""The real node as a process, with a synthetic hand."""

import os
import signal
import time

import live_hand
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

STEP = 10_000_000


@pytest.fixture
def hand(domain_id):
    observer = live_hand.Observer()
    yield observer
    observer.close()


@pytest.fixture
def serve(start, hand):
    """Start the node with parameters and wait until it serves."""

    def run(**parameters):
        arguments = ['--ros-args']
        for name, value in parameters.items():
            arguments += ['-p', f'{name}:={value}']
        node = start('deformation', *arguments)
        node.wait_for('serving', 60.0)
        wait(hand, lambda: hand.contacts.get_subscription_count() > 0)
        wait(hand, lambda: hand.node.count_publishers('deformation/surface') > 0)
        return node

    return run


def wait(hand, condition, timeout=30.0):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, (hand.state, hand.diagnostics, hand.summary)
        hand.spin()


def largest(message):
    return float(live_hand.packed(message)[:, 6].max())


def squeezed(depth, force=10.0):
    """Make samples of a steady squeeze to `depth` [m] per finger."""

    def make(i):
        return live_hand.opposed([force, force], [depth, depth], stamp=(i + 1) * STEP)

    return make


def settled(hand, depth, tolerance=2e-5):
    return lambda: bool(hand.nonlinear) and abs(largest(hand.nonlinear[-1]) - depth) < tolerance


def test_every_sample_is_answered_once_with_its_own_stamp(serve, hand):
    serve()
    sent = hand.stream(squeezed(1e-3, 5.0), lambda: len(hand.surfaces) >= 100)
    hand.spin(0.2)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in hand.surfaces]
    assert len(set(stamps)) == len(stamps)
    assert stamps == sorted(stamps)
    assert set(stamps) <= {(i + 1) * STEP for i in range(sent)}
    assert len(stamps) >= sent - 5


def test_a_steady_squeeze_is_served_as_the_nonlinear_equilibrium(serve, hand):
    serve(drive='motion')
    hand.stream(squeezed(3e-3), settled(hand, 3e-3))
    hand.spin(0.3)
    served = live_hand.packed(hand.surfaces[-1])
    nonlinear = live_hand.packed(hand.nonlinear[-1])
    assert np.linalg.norm(served[:, :3] - nonlinear[:, :3], axis=1).max() < 2e-5
    assert hand.surfaces[-1].header.frame_id == 'hand_base'
    assert 'CONTACT' in hand.states


def test_linear_and_nonlinear_answers_part_at_large_dents(serve, hand):
    serve(drive='motion')
    hand.stream(squeezed(6e-3, 18.0), settled(hand, 6e-3))
    hand.stream(squeezed(6e-3, 18.0), lambda: hand.numbers.get('linearity', 0.0) > 0.2)
    assert largest(hand.linear[-1]) < 0.8 * largest(hand.nonlinear[-1])


def test_silence_is_stale_and_nothing_is_served_meanwhile(serve, hand):
    serve()
    hand.stream(squeezed(1e-3, 5.0), lambda: hand.state == 'CONTACT' and len(hand.surfaces) > 20)
    hand.spin(0.5)
    assert hand.state == 'STALE'
    count = len(hand.surfaces)
    hand.spin(0.3)
    assert len(hand.surfaces) == count
    hand.stream(squeezed(1e-3, 5.0), lambda: hand.state == 'CONTACT')


def test_a_killed_background_process_is_replaced_while_samples_are_answered(serve, hand):
    node = serve(drive='motion')
    hand.stream(squeezed(2e-3, 8.0), settled(hand, 2e-3))
    worker = worker_of(node.process.pid)
    os.kill(worker, signal.SIGKILL)
    hand.surfaces.clear()
    sent = hand.stream(
        squeezed(2e-3, 8.0), lambda: hand.diagnostics.get('background restarts') == '1'
    )
    wait(hand, lambda: len(hand.surfaces) >= sent - 2)
    assert largest(hand.surfaces[-1]) == pytest.approx(2e-3, abs=1e-4)
    hand.nonlinear.clear()
    hand.stream(squeezed(2.5e-3, 9.0), settled(hand, 2.5e-3), timeout=60.0)


def test_a_sample_with_nan_is_a_fault_and_is_not_answered(serve, hand):
    node = serve()
    bad = squeezed(1e-3, float('nan'))
    hand.stream(bad, lambda: hand.state == 'FAULT')
    assert not hand.surfaces
    assert 'force is' in node.text


def test_the_object_is_changed_while_running(serve, hand):
    serve()
    hand.stream(squeezed(1e-3, 5.0), lambda: len(hand.surfaces) > 5)
    result = set_parameter(hand, Parameter('object', value='no_such_object'))
    assert not result.successful
    assert 'no_such_object' in result.reason
    result = set_parameter(hand, Parameter('object', value='tennis_ball_as_printed'))
    assert result.successful
    hand.surfaces.clear()
    hand.nonlinear.clear()
    hand.stream(squeezed(1e-3, 0.5), settled(hand, 1e-3), timeout=60.0)
    assert hand.diagnostics['object'] == 'tennis_ball_as_printed'


def test_a_value_outside_its_range_is_refused_with_the_range(serve, hand):
    serve()
    result = set_parameter(hand, Parameter('modulus_sigma', value=-1.0))
    assert not result.successful
    assert 'modulus_sigma' in result.reason


@pytest.mark.parametrize(
    ('assignment', 'told'),
    [
        ('object:=no_such_object', 'no_such_object'),
        ('drive:=guess', 'force, motion, fused'),
        ('pin_radius:=7.0', 'pin_radius'),
        ('object_pose:=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0]', 'unit quaternion'),
    ],
)
def test_a_wrong_parameter_ends_the_start_with_one_sentence(start, assignment, told):
    node = start('deformation', '--ros-args', '-p', assignment)
    assert node.process.wait(30.0) == 1
    assert told in node.text
    assert 'Traceback' not in node.text


def test_reset_starts_again_from_the_undeformed_shell(serve, hand):
    serve()
    hand.stream(squeezed(1e-3, 5.0), settled(hand, 1e-3, 5e-4))
    client = hand.node.create_client(Trigger, 'deformation/reset')
    assert client.wait_for_service(10.0)
    future = client.call_async(Trigger.Request())
    wait(hand, future.done)
    assert future.result().success


def test_interrupt_ends_node_and_background_process(serve, hand):
    node = serve()
    worker = worker_of(node.process.pid)
    assert node.stop() == 0
    wait(hand, lambda: not os.path.exists(f'/proc/{worker}'))


def worker_of(parent):
    """Process id of the background process of a node."""
    for entry in os.listdir('/proc'):
        if entry.isdigit():
            try:
                with open(f'/proc/{entry}/stat') as stat:
                    fields = stat.read().rsplit(')', 1)[1].split()
                with open(f'/proc/{entry}/cmdline') as line:
                    command = line.read()
            except OSError:
                continue
            if int(fields[1]) == parent and 'shell_deform.live.worker' in command:
                return int(entry)
    raise AssertionError('no background process')


def set_parameter(hand, parameter):
    client = hand.node.create_client(SetParameters, '/deformation/set_parameters')
    assert client.wait_for_service(10.0)
    request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
    future = client.call_async(request)
    wait(hand, future.done)
    return future.result().results[0]
