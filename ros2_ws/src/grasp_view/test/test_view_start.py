# SPDX-License-Identifier: Apache-2.0
"""The page as a process: it serves, it ends cleanly, and it says why it cannot."""

from __future__ import annotations

import signal
import socket
import urllib.request


def test_the_page_answers_before_anybody_publishes(view, port: int) -> None:
    running = view()
    with urllib.request.urlopen(f'http://127.0.0.1:{port}', timeout=10) as answer:
        assert answer.status == 200 and b'<html' in answer.read()
    assert running.stop(signal.SIGINT) == 0


def test_a_termination_signal_ends_it_cleanly(view, port: int) -> None:
    running = view()
    assert running.stop(signal.SIGTERM) == 0, running.text
    assert 'Traceback' not in running.text


def test_a_port_in_use_is_one_sentence_and_exit_code_1(start, port: int) -> None:
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', port))
        taken.listen()
        running = start('grasp_view', '--ros-args', '-p', f'port:={port}')
        assert running.ended() == 1
    assert f'port {port}' in running.text and 'Traceback' not in running.text


def test_a_pose_that_is_none_is_refused_at_start(start, port: int) -> None:
    pose = 'object_pose:=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]'
    running = start('grasp_view', '--ros-args', '-p', f'port:={port}', '-p', pose)
    assert running.ended() == 1
    assert 'has no direction' in running.text and 'Traceback' not in running.text
