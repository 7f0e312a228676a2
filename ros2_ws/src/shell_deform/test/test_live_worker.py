# SPDX-License-Identifier: Apache-2.0
"""The background process: building, answering, dying, coming back."""

import os
import signal
import time

import live_hand
import numpy as np
import pytest
from tests.patience import Patience

from shell_deform.live.background.solving import LiveSolver
from shell_deform.live.background.worker import Loop, share
from shell_deform.live.background.worker_link import (
    BACK_OFF_FIRST_S,
    Build,
    WorkerError,
    WorkerLink,
    WorkerProcess,
    empty_request,
)
from shell_deform.live.exchange import REQUEST, Layout, create
from shell_deform.live.pose import IDENTITY
from shell_deform.live.tick.estimator import Estimator, Settings
from shell_deform.live.tick.sample import no_contacts

BALL = Build('tennis_ball_as_printed', 'koiter', 150, niceness=0)


def until(condition, timeout=60.0):
    patience = Patience(timeout)
    while not condition():
        assert not patience.over
        time.sleep(0.005)


@pytest.fixture(scope='module')
def worker():
    process = WorkerProcess(BALL)
    until(process.became_ready)
    yield process
    process.stop()


def ask(worker, depth, stamp, resets=0):
    """Post a squeeze to `depth` [m]."""
    estimator = Estimator(worker.memory.rest, worker.memory.rest_normals, Settings())
    estimator.pose = IDENTITY
    estimator.tick(live_hand.opposed([0.3, 0.3], [depth] * 2, stamp=stamp, radius=4e-3))
    request = empty_request()
    estimator.fill_request(request[0])
    request[0]['resets'] = resets
    worker.post(request)


def answer_to(worker, stamp):
    """Wait for the state that answers the sample of `stamp`."""
    found = []

    def arrived():
        slot = worker.newer_result()
        if slot is not None and int(slot.record['stamp']) == stamp:
            found.append(slot)
        return bool(found)

    until(arrived)
    return found[-1]


def test_the_shell_at_rest_is_shared_when_it_is_built(worker):
    radius = np.linalg.norm(worker.memory.rest, axis=1)
    assert radius == pytest.approx(np.full(len(radius), 31.25e-3), rel=1e-3)
    assert worker.memory.triangles.max() == len(radius) - 1
    assert worker.thickness == pytest.approx(2.5e-3)


def test_a_load_case_is_answered_with_its_stamp(worker):
    ask(worker, 1e-3, 7)
    record = answer_to(worker, 7).record
    assert record['displacement'][:2] == pytest.approx([1e-3, 1e-3], rel=1e-6)
    assert record['share'] == 1.0


def test_overtaken_load_cases_are_dropped_and_counted(worker):
    before = int(worker.memory.take().record['dropped'])
    for stamp in range(100, 200):
        ask(worker, 1e-3 + 1e-7 * stamp, stamp)
    record = answer_to(worker, 199).record
    assert record['displacement'][0] == pytest.approx(1e-3 + 1e-7 * 199, rel=1e-6)
    assert int(record['dropped']) > before


def test_an_answer_that_was_disowned_is_not_taken(worker):
    ask(worker, 2e-3, 300)
    worker.disown()
    until(lambda: int(worker.memory.take().record['stamp']) == 300)
    assert worker.newer_result() is None
    ask(worker, 1e-3, 301)
    assert int(answer_to(worker, 301).record['stamp']) == 301


def test_a_reset_is_obeyed_although_its_load_case_is_overtaken(worker):
    ask(worker, 1e-3, 400)
    grasped = int(answer_to(worker, 400).record['generation'])
    for stamp in range(401, 420):
        ask(worker, 1e-3, stamp, resets=1)
    anew = int(answer_to(worker, 419).record['generation'])
    assert anew > grasped
    ask(worker, 1e-3, 420, resets=1)
    assert int(answer_to(worker, 420).record['generation']) == anew


def test_a_process_that_is_never_told_what_to_build_ends_with_its_owner():
    process = WorkerProcess()
    process.stop(patience_s=60.0)
    assert process.process.returncode == 0


def test_a_process_started_ahead_builds_what_it_is_told():
    link = WorkerLink(BALL, WorkerProcess())
    try:
        until(lambda: link.tend(time.monotonic()))
        assert link.restarts == 0
        assert link.worker.thickness == pytest.approx(2.5e-3)
    finally:
        link.stop()


def test_an_unknown_object_is_reported_in_one_sentence():
    process = WorkerProcess(Build('no_such_object', 'koiter'))
    try:
        with pytest.raises(WorkerError, match='no_such_object'):
            until(process.became_ready)
    finally:
        process.stop()


def test_a_killed_process_is_started_again_after_the_back_off():
    link = WorkerLink(BALL)
    try:
        until(lambda: link.tend(0.0))
        os.kill(link.worker.process.pid, signal.SIGKILL)
        until(lambda: not link.worker.alive)
        assert not link.tend(20.0)
        assert not link.tend(20.0 + 0.5 * BACK_OFF_FIRST_S)
        assert link.restarts == 0
        link.tend(20.0 + 1.1 * BACK_OFF_FIRST_S)
        assert link.restarts == 1
        until(lambda: link.tend(21.0))
        ask(link.worker, 5e-4, 3)
        answer_to(link.worker, 3)
    finally:
        link.stop()


def test_the_process_ends_with_its_owner():
    process = WorkerProcess(BALL)
    until(process.became_ready)
    process.stop()
    assert not process.alive


def test_a_reader_never_sees_half_a_load_case():
    memory, descriptor = create(Layout(12, 20))
    os.close(descriptor)
    assert memory.read_request() is None
    request = np.zeros(1, REQUEST)
    memory.write_request(request, 1)
    memory.request['begin'] = 2
    assert memory.read_request() is None
    memory.request['end'] = 2
    assert memory.read_request() is not None


def test_a_result_being_read_is_not_overwritten():
    memory, descriptor = create(Layout(12, 20))
    os.close(descriptor)
    memory.publish(memory.free_slot(), 1)
    reading = memory.take()
    for sequence in range(2, 20):
        index = memory.free_slot()
        assert memory.slots[index] is not reading
        memory.publish(index, sequence)
    assert int(reading.record['begin']) == 1
    assert int(memory.take().record['begin']) == 19


def loop(model):
    """The loop of a background process over its own shared memory, without the process."""
    solver = LiveSolver(model)
    memory, descriptor = share(solver)
    os.close(descriptor)
    return Loop(solver, memory, -1, None)


def put(served, sample, number, jumps=0):
    """Let the loop answer a sample as load case `number`; returns the result's record."""
    estimator = Estimator(served.memory.rest, served.memory.rest_normals, Settings())
    estimator.pose = IDENTITY
    estimator.tick(sample)
    request = empty_request()
    estimator.fill_request(request[0])
    request[0]['jumps'] = jumps
    served.memory.write_request(request, number)
    served.serve_newest()
    return served.memory.take().record


@pytest.fixture(scope='module')
def coarse(sphere):
    return sphere(31.25e-3, 2.5e-3, subdivisions=2)


def squeeze_of(depth, fingers=(1, 2), **options):
    return live_hand.opposed([0.3] * 2, [depth] * 2, radius=4e-3, fingers=fingers, **options)


def test_contact_sets_in_any_order_never_end_the_loop_and_the_last_one_is_answered(coarse):
    served, random = loop(coarse), np.random.default_rng(4)
    odd = live_hand.sample
    x = np.array([[0.0325, 0, 0]])
    kinds = [
        squeeze_of(1e-3),
        squeeze_of(1e-3, fingers=(2, 1)),
        squeeze_of(1e-3, fingers=(5, 6)),
        odd(x, -x / 0.0325, [0.5], [2e-3], radius=4e-3),
        odd(np.repeat(x, 2, axis=0), -np.repeat(x, 2, axis=0) / 0.0325, [1, 1], radius=4e-3),
        odd([[9.9, 0, 0], [0, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]], [1, 1], radius=4e-3),
        odd(x, -x / 0.0325, [1e5], [0.2], radius=4e-3),
        odd(x, -x / 0.0325, [0.5], [2e-3], radius=0.2),
        odd(np.full((1, 3), np.nan), [[1.0, 0, 0]], [1.0], radius=4e-3),
    ]
    for number, kind in enumerate(random.integers(0, len(kinds), 60), start=1):
        put(served, kinds[kind], number)
    # A finger that has joined one that pressed alone was laid on the shape that this one made.
    put(served, no_contacts(1), 99)
    record = put(served, squeeze_of(1e-3), 100)
    for number in range(101, 104):
        record = put(served, squeeze_of(1e-3), number)
    assert record['share'] == 1.0
    assert record['displacement'][:2] == pytest.approx([1e-3, 1e-3], abs=2e-5)


def test_an_error_is_told_in_the_result_and_gone_with_the_next_good_load_case(coarse):
    served = loop(coarse)
    bad = live_hand.sample(np.full((1, 3), np.nan), [[1.0, 0, 0]], [1.0], radius=4e-3)
    record = put(served, bad, 1)
    assert record['share'] == 0.0
    assert b'started over' in bytes(record['message'])
    record = put(served, squeeze_of(1e-3), 2)
    assert record['share'] == 1.0
    assert bytes(record['message']) == b''


def test_fingers_that_come_back_with_their_travel_have_the_dent_they_had(coarse):
    served = loop(coarse)
    for number in range(1, 5):
        before = put(served, squeeze_of(2e-3), number)['displacement'][:2].copy()
    one = squeeze_of(2e-3).rows(np.array([0]))
    for number, away in enumerate([one, squeeze_of(2e-3, fingers=(5, 6)), one], start=5):
        put(served, away, number)
    for number in range(10, 14):
        record = put(served, squeeze_of(2e-3), number)
    assert record['displacement'][:2] == pytest.approx(before, abs=1e-5)


def test_after_a_jump_of_time_the_last_shape_is_a_start_and_the_answer_is_that_from_rest(coarse):
    served = loop(coarse)
    for number in range(1, 6):
        put(served, squeeze_of(1.5e-3 * number), number)
    jumped = put(served, squeeze_of(3e-3), 6, jumps=1)
    straight = put(loop(coarse), squeeze_of(3e-3), 1)
    assert jumped['share'] == straight['share'] == 1.0
    assert jumped['force'][:2] == pytest.approx(straight['force'][:2], rel=1e-3)
    assert jumped['displacement'][:2] == pytest.approx([3e-3, 3e-3], rel=1e-6)


def test_a_stopped_process_is_replaced_and_the_replacement_answers():
    link = WorkerLink(BALL)
    try:
        until(lambda: link.tend(time.monotonic()))
        until(lambda: link.tend(time.monotonic()) or link.worker.handed_over() is not None)
        os.kill(link.worker.process.pid, signal.SIGSTOP)
        stopped = time.monotonic()
        until(lambda: link.tend(time.monotonic()) or link.trouble != '')
        assert time.monotonic() - stopped < 1.0
        until(lambda: link.tend(time.monotonic()))
        assert link.restarts == 1
        ask(link.worker, 5e-4, 3)
        answer_to(link.worker, 3)
    finally:
        link.stop()
