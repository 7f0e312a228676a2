# SPDX-License-Identifier: Apache-2.0
"""The background solver takes the idle class while it gets on there, and only then."""

import os

import pytest

from shell_deform.live.background.courtesy import CAUTION, PATIENCE_S, Courtesy, share_of


class Machine:
    """A clock and a processor of which work gets `share`."""

    def __init__(self):
        self.now, self.share, self.policies = 0.0, 1.0, []

    def measure(self, work):
        work()
        self.policies.append(os.sched_getscheduler(0))
        self.now += 0.05
        return self.share

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
    machine.work(courtesy, 2 * PATIENCE_S)
    assert machine.policies[0] == os.SCHED_OTHER
    assert machine.policies[-1] == os.SCHED_IDLE


def test_where_all_processors_are_wanted_it_stays_a_nice_thread(machine, courtesy):
    machine.share = 0.15
    machine.work(courtesy, 5 * PATIENCE_S)
    assert set(machine.policies) == {os.SCHED_OTHER}


def test_starved_in_the_idle_class_it_comes_back_at_once(machine, courtesy):
    machine.work(courtesy, 2 * PATIENCE_S)
    machine.share = 0.05
    courtesy.run(lambda: None)
    courtesy.run(lambda: None)
    assert machine.policies[-2:] == [os.SCHED_IDLE, os.SCHED_OTHER]


def test_each_starvation_makes_it_wait_longer_before_the_next_try(machine, courtesy):
    waits = []
    for _ in range(3):
        before = len(machine.policies)
        machine.share = 1.0
        while not courtesy.in_idle_class:
            courtesy.run(lambda: None)
        waits.append(0.05 * (len(machine.policies) - before))
        machine.share = 0.05
        courtesy.run(lambda: None)
    assert waits == pytest.approx([PATIENCE_S, CAUTION * PATIENCE_S, CAUTION**2 * PATIENCE_S], 0.1)


def test_what_the_work_raises_is_raised_to_its_caller():
    def fail():
        raise ValueError('no equilibrium')

    with pytest.raises(ValueError, match='no equilibrium'):
        Courtesy().run(fail)


def test_work_that_computes_has_a_processor_and_work_that_waits_has_none():
    import time

    assert share_of(lambda: time.sleep(0.05)) < 0.3
    assert share_of(lambda: sum(range(10**6))) > 0.02
