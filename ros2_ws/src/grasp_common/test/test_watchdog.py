# SPDX-License-Identifier: Apache-2.0
"""Whether a process that counts beats gets on, as the kernel and its beats tell."""

import os
import signal
import subprocess
import sys
import time

import pytest

from grasp_common.watchdog import (
    LOOPS_S,
    NOTICED_S,
    STARVED_S,
    WAITS_S,
    Threads,
    Watchdog,
    threads_of,
)

STEP = 0.02


def watched(states, processor_per_second, seconds):
    """A watchdog after `seconds` without a beat, its process in `states`."""
    clock = [0.0]
    dog = Watchdog(0, lambda _: Threads(frozenset(states), processor_per_second * clock[0]))
    dog.look(1, 0.0)
    while clock[0] < seconds:
        clock[0] += STEP
        dog.look(1, clock[0])
    return dog


def test_a_process_whose_beats_go_on_has_no_trouble():
    dog = Watchdog(0, lambda _: Threads(frozenset('S'), 0.0))
    for i in range(500):
        assert dog.look(i, STEP * i) == ''
    assert not dog.hopeless


def test_a_stopped_process_is_noticed_within_half_a_second_and_replaced_at_once():
    dog = watched('T', 0.0, NOTICED_S + 2 * STEP)
    assert dog.trouble == 'is stopped' and dog.hopeless
    assert NOTICED_S + 2 * STEP < 0.5


def test_a_process_that_sleeps_without_a_beat_hangs():
    assert watched('S', 0.0, 0.5).trouble == 'hangs'
    assert not watched('S', 0.0, 0.5).hopeless
    assert watched('S', 0.0, WAITS_S + 0.1).hopeless


def test_a_process_that_computes_without_a_beat_runs_in_a_circle():
    dog = watched('RS', 1.0, LOOPS_S + 0.5)
    assert dog.trouble == 'runs in a circle' and dog.hopeless


def test_a_process_without_a_processor_is_told_and_left_alone():
    dog = watched('RS', 0.01, 5.0)
    assert dog.trouble == 'finds no processor' and not dog.hopeless
    assert watched('RS', 0.01, STARVED_S + 1.0).hopeless


def test_a_watcher_that_was_away_itself_blames_nobody():
    dog = Watchdog(0, lambda _: Threads(frozenset('T'), 0.0))
    dog.look(1, 0.0)
    assert dog.look(1, 20.0) == ''


def test_the_kernel_tells_a_stopped_process_from_a_running_one():
    process = subprocess.Popen([sys.executable, '-c', 'while True: pass'])
    try:
        deadline = time.monotonic() + 20.0
        while threads_of(process.pid).processor < 0.05:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert threads_of(process.pid).states <= {'R'}
        os.kill(process.pid, signal.SIGSTOP)
        while threads_of(process.pid).states != {'T'}:
            assert time.monotonic() < deadline
            time.sleep(0.01)
    finally:
        process.kill()
        process.wait()
    assert threads_of(process.pid).states == frozenset()


@pytest.mark.parametrize('pid', [2**22 + 1])
def test_a_process_that_is_gone_has_no_states(pid):
    assert threads_of(pid) == Threads(frozenset(), 0.0)
