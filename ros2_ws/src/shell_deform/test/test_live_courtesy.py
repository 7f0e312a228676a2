# SPDX-License-Identifier: Apache-2.0
"""The background solver is as courteous as it can be without starving."""

import os
import subprocess
import sys
import time

import pytest

from shell_deform.live.background.courtesy import (
    CAUTION,
    IDLE,
    NICE,
    PATIENCE_S,
    PLAIN,
    TELLING_S,
    Courtesy,
    busy_for,
)


class Machine:
    """A clock and a processor of which work of 20 ms gets `share`."""

    def __init__(self):
        self.now, self.share, self.busy, self.policies = 0.0, 1.0, 0.02, []

    def measure(self, work):
        work()
        self.policies.append(os.sched_getscheduler(0))
        self.now += self.busy / self.share
        return self.busy

    def work(self, courtesy, seconds):
        end = self.now + seconds
        while self.now < end:
            courtesy.run(lambda: None)


@pytest.fixture
def machine():
    return Machine()


@pytest.fixture
def courtesy(machine):
    return Courtesy(lambda: machine.now, machine.measure)


def test_where_there_is_room_the_work_moves_to_the_idle_class(machine, courtesy):
    machine.work(courtesy, 3 * PATIENCE_S)
    assert machine.policies[0] == os.SCHED_OTHER
    assert machine.policies[-1] == os.SCHED_IDLE


def test_where_most_of_a_processor_is_wanted_by_others_it_stays_as_it_is(machine, courtesy):
    courtesy.courtesy = NICE
    machine.share = 0.15
    machine.work(courtesy, 5 * PATIENCE_S)
    assert courtesy.courtesy == NICE


def test_a_nice_thread_that_starves_is_as_any_other_until_there_is_room_again(machine, courtesy):
    courtesy.courtesy = NICE
    machine.share = 0.05
    machine.work(courtesy, 5 * PATIENCE_S)
    assert courtesy.courtesy == PLAIN
    machine.share = 1.0
    machine.work(courtesy, 3 * CAUTION * PATIENCE_S)
    assert courtesy.courtesy == IDLE


def test_work_of_microseconds_says_nothing_about_room(machine, courtesy):
    machine.busy = 0.5 * TELLING_S
    machine.work(courtesy, 5 * PATIENCE_S)
    assert courtesy.courtesy == PLAIN


def test_room_must_last(machine, courtesy):
    for _ in range(5):
        machine.share = 1.0
        machine.work(courtesy, 0.7 * PATIENCE_S)
        machine.share = 0.5
        courtesy.run(lambda: None)
    assert courtesy.courtesy == PLAIN


def test_the_plain_thread_keeps_the_niceness_from_before_the_process_became_nice():
    code = (
        'import os\n'
        'from shell_deform.live.background.courtesy import PLAIN, Courtesy\n'
        'courtesy = Courtesy()\n'
        'os.nice(7)\n'
        'courtesy.courtesy = PLAIN\n'
        'courtesy.run(lambda: print(os.getpriority(os.PRIO_PROCESS, 0)))\n'
        'print(os.getpriority(os.PRIO_PROCESS, 0))\n'
    )
    told = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    plain, process = map(int, told.stdout.split())
    assert process == min(plain + 7, 19)


def test_starved_in_the_idle_class_it_comes_back_at_once(machine, courtesy):
    machine.work(courtesy, 3 * PATIENCE_S)
    machine.share = 0.05
    courtesy.run(lambda: None)
    courtesy.run(lambda: None)
    assert machine.policies[-2:] == [os.SCHED_IDLE, os.SCHED_OTHER]


def test_each_starvation_makes_it_wait_longer_before_the_next_try(machine, courtesy):
    waits = []
    machine.work(courtesy, 3 * PATIENCE_S)
    for _ in range(2):
        machine.share = 0.05
        courtesy.run(lambda: None)
        machine.share, before = 1.0, machine.now
        while courtesy.courtesy != IDLE:
            courtesy.run(lambda: None)
        waits.append(machine.now - before)
    assert waits == pytest.approx([CAUTION * PATIENCE_S, CAUTION**2 * PATIENCE_S], 0.1)


def test_what_the_work_raises_is_raised_to_its_caller():
    def fail():
        raise ValueError('no equilibrium')

    with pytest.raises(ValueError, match='no equilibrium'):
        Courtesy().run(fail)


def test_work_that_computes_has_a_processor_and_work_that_waits_has_none():
    assert busy_for(lambda: time.sleep(0.05)) < 0.02
    assert busy_for(lambda: sum(range(10**6))) > 0.002
