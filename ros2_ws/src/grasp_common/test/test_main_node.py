# SPDX-License-Identifier: Apache-2.0
"""A node of a table: started, told apart by namespace, ended by one signal without a traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from type_description_interfaces.srv import GetTypeDescription

from grasp_common import main_node

PROGRAM = Path(__file__).with_name('small_node.py')


def running(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(PROGRAM), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def started(*arguments: str) -> tuple[subprocess.Popen[str], list[str]]:
    process = running(*arguments)
    assert process.stdout is not None
    lines: list[str] = []
    for line in process.stdout:
        lines.append(line)
        if 'ready' in line:
            return process, lines
    pytest.fail(''.join(lines))


def ended(*arguments: str) -> tuple[int, str]:
    process = running(*arguments)
    text = process.communicate(timeout=600)[0]
    return process.returncode, text


@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM', 'SIGHUP'])
def test_every_signal_ends_it_cleanly(domain_id: int, name: str) -> None:
    process, _ = started()
    process.send_signal(getattr(signal, name))
    text = process.communicate(timeout=600)[0]
    assert (process.returncode, text) == (0, 'closed\n')


def test_a_terminal_that_hangs_up_on_nohup_is_ignored(domain_id: int) -> None:
    old = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        process, _ = started()
    finally:
        signal.signal(signal.SIGHUP, old)
    process.send_signal(signal.SIGHUP)
    time.sleep(1.5)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=600) and process.returncode == 0


def test_the_status_name_carries_the_namespace(domain_id: int) -> None:
    process, lines = started('--ros-args', '-r', '__ns:=/left')
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=600)
    assert 'status left/small: part\n' in lines


def test_an_unknown_parameter_is_named_with_the_nearest(domain_id: int) -> None:
    process, lines = started('--ros-args', '-p', 'spede:=2.0', '-p', 'use_sim_time:=true')
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=600)
    told = ''.join(lines)
    assert "there is no parameter 'spede'; did you mean speed?" in told
    assert 'use_sim_time' not in told


@pytest.mark.parametrize(
    ('arguments', 'code', 'complaint'),
    [
        (('--nonsense',), 2, "small: unknown argument '--nonsense'; see --help"),
        (('--ros-args', '-r', '__node:=a b'), 2, 'small: '),
        (('--ros-args', '-p', 'speed:=fast'), 1, "small: speed is 'fast', of type STRING; it"),
        (('--ros-args', '-p', 'speed:=1'), 1, 'must be of the type of 1.0: how fast (m/s)'),
        (('--ros-args', '--params-file'), 2, 'No file path provided'),
        (('--ros-args', '-p', 'speed:=-1.0'), 1, 'speed'),
    ],
)
def test_wrong_arguments_are_one_sentence(
    domain_id: int, arguments: tuple[str, ...], code: int, complaint: str
) -> None:
    got, text = ended(*arguments)
    assert got == code and complaint in text and 'Traceback' not in text
    assert '/src/' not in text and text.count('\n') == 1


def test_a_file_of_parameters_that_is_none_is_refused_by_name(domain_id: int, tmp_path: Path):
    file = tmp_path / 'parameters.yaml'
    file.write_text('only words\n')
    code, text = ended('--ros-args', '--params-file', str(file))
    assert code == 1 and text.startswith(f'small: --params-file {file} is no file of parameters')
    assert text.count('\n') == 1


def test_a_file_of_parameters_for_others_is_told(domain_id: int, tmp_path: Path):
    file = tmp_path / 'parameters.yaml'
    file.write_text('large: {ros__parameters: {speed: 2.0}}\n')
    process, lines = started('--ros-args', '--params-file', str(file))
    process.send_signal(signal.SIGINT)
    told = ''.join([*lines, process.communicate(timeout=600)[0]])
    assert f'{file} holds no parameters for /small, but for /large' in told


@pytest.mark.parametrize(
    ('environment', 'complaint'),
    [
        ({'ROS_DOMAIN_ID': 'abc'}, 'ROS_DOMAIN_ID'),
        ({'ROS_LOG_DIR': '/proc/none'}, "log directory '/proc/none'"),
        ({'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}, 'KEYSTORE'),
    ],
)
def test_a_ros_that_does_not_start_is_one_sentence(
    domain_id: int, monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], complaint: str
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    code, text = ended()
    told = [line for line in text.splitlines() if line.startswith('small: ')]
    assert code == 1 and len(told) == 1 and complaint in told[0]
    assert 'Traceback' not in text and '/src/' not in told[0]


def test_help_needs_no_ros_graph() -> None:
    code, text = ended('--help')
    assert code == 0 and 'speed (default 1.0)' in text


def test_an_executor_whose_making_a_signal_broke_off_goes_without_a_word(
    domain_id: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    complaints: list[object] = []
    monkeypatch.setattr(sys, 'unraisablehook', complaints.append)
    context = rclpy.Context()
    rclpy.init(context=context)
    rclpy.shutdown(context=context)
    # rclpy raises whatever comes to it in a context that has ended.
    with pytest.raises((TypeError, RuntimeError)):
        main_node.QuietExecutor(context=context)
    assert complaints == []


def test_a_second_publisher_of_a_topic_is_a_warning(domain_id: int, wait_until):
    rclpy.init()
    nodes = [Node('twin'), Node('twin')]
    try:
        nodes[0].create_publisher(Parameter, 'told', 1)
        told = partial(main_node.beside_others, nodes[0], ('ok', 'serving'), 'told')
        wait_until(lambda: told() == ('ok', 'serving') and nodes[0].count_publishers('told'))
        nodes[1].create_publisher(Parameter, 'told', 1)
        warning = ('warn', '2 nodes publish told: end all but one, or use namespaces')
        wait_until(lambda: told() == warning)
        judged = main_node.beside_others(nodes[0], ('error', 'no hand'), 'told')
        assert judged == ('error', 'no hand')
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.parametrize('from_the_start', [True, False])
def test_a_clock_that_no_stamp_can_hold_is_left_out(domain_id: int, from_the_start: bool):
    rclpy.init()
    simulated = rclpy.Parameter('use_sim_time', value=True)
    given = [simulated] if from_the_start else []
    node = main_node.made(lambda: Node('guarded', parameter_overrides=given))
    try:
        node.set_parameters([simulated])
        (clock,) = [one for one in node.subscriptions if one.topic_name == '/clock']
        for seconds, rest in ((5, 0), (-5, 0), (2**31 - 1, 2**32 - 1)):
            clock.callback(Clock(clock=Time(sec=seconds, nanosec=rest)))
        assert node.get_clock().now().nanoseconds == 5 * 10**9
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_a_request_that_cannot_be_is_refused(domain_id: int) -> None:
    rclpy.init()
    node = main_node.made(lambda: Node('guarded'))
    try:
        asked = {service.srv_name.rpartition('/')[2]: service for service in node.services}
        odd = [Parameter(name='speed', value=ParameterValue(type=39))]
        told = asked['set_parameters'].callback(
            SetParameters.Request(parameters=odd), SetParameters.Response()
        )
        assert [one.successful for one in told.results] == [False]
        together = asked['set_parameters_atomically'].callback(
            SetParametersAtomically.Request(parameters=odd), SetParametersAtomically.Response()
        )
        assert not together.result.successful and '39' in together.result.reason
        # rcl would log what it cannot read as it came.
        described = asked['get_type_description'].callback(
            GetTypeDescription.Request(type_hash='\x1b]0;owned\x07'),
            GetTypeDescription.Response(),
        )
        assert described.failure_reason == r"'\x1b]0;owned\x07' names nothing"
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
