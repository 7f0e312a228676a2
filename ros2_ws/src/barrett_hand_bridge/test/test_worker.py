# SPDX-License-Identifier: Apache-2.0
"""The worker thread: connects, cycles, obeys, comes back, and always stops the hand."""

import time

import pytest
from tests.patience import Patience

from barrett_hand_bridge import worker as worker_module
from barrett_hand_bridge.calibration import GaugeCalibration
from barrett_hand_bridge.hand import (
    ENCODER_262,
    HandDisturbedError,
    HandError,
    HandFacts,
    HandNotInitialisedError,
    HandSample,
)
from barrett_hand_bridge.motion import Opening
from barrett_hand_bridge.observer import HandObserver, ObserverSettings
from barrett_hand_bridge.worker import (
    Connected,
    Disturbed,
    GuardRestarted,
    HandWorker,
    Lost,
    NotReady,
    Observed,
)

GAUGE = GaugeCalibration(
    'cubic', coefficients_nm=(0.0, 0.01), no_load_counts=(100, 140), noise_counts=0.5
)
FACTS = HandFacts('BH8-262', '4.4', '1', ENCODER_262, 255, 295.0)


class ScriptedHand:
    """A hand that does as it is told, and remembers what it was told."""

    def __init__(self):
        self.late = lambda: None
        self.trouble = []
        self.connect_trouble = []
        self.initialised = True
        self.log = []
        self.position = 8000
        self.aborted = False
        self.stamp_ns = 0

    def connect(self):
        if self.connect_trouble:
            raise self.connect_trouble.pop(0)
        self.log.append('connect')
        return FACTS

    def initialize(self):
        self.log.append('initialize')
        while self.slow and not self.aborted:
            time.sleep(0.001)
        if self.aborted:
            raise HandError('interrupted')
        self.initialised = True

    slow = False

    def sample(self, velocities):
        time.sleep(0.001)
        self.stamp_ns += 3_400_000
        if not self.initialised:
            raise HandNotInitialisedError('call hand/initialize')
        if self.trouble:
            raise self.trouble.pop(0)
        if velocities is not None:
            self.log.append(dict(velocities))
            if self.moves and velocities.get(1):
                self.position = max(self.position - 500, 0)
        elif self.log and self.log[-1] == 'open' and self.opens_by_itself:
            self.position = max(self.position - 500, 0)
        return HandSample(
            self.stamp_ns,
            (self.position, 0, 0),
            0,
            (120, 120, 120),
            temperature_c=self.temperature_c,
        )

    moves = True

    def limit_force(self, counts):
        self.log.append('limit')

    def open_by_itself(self, speeds):
        self.log.append('open')
        return self.opens_by_itself

    opens_by_itself = False

    def tare_touch(self):
        self.log.append('tare touch')

    def watch_guard(self):
        died, self.guard_died = self.guard_died, False
        return died

    guard_died = False
    temperature_c = None

    def stop(self):
        self.log.append('stop')

    def abort(self):
        self.aborted = True

    def close(self):
        self.log.append('close')


@pytest.fixture
def bench():
    hand = ScriptedHand()
    events = []
    workers = []

    def start(**options):
        worker = HandWorker(
            hand,
            lambda facts: HandObserver(ObserverSettings(dict.fromkeys((1, 2, 3), GAUGE))),
            events.append,
            **options,
        )
        worker.start()
        workers.append(worker)
        return worker, hand, events

    yield start
    for worker in workers:
        worker.end()


def seen(events, kind, wait_until, number=1):
    wait_until(lambda: sum(isinstance(e, kind) for e in events) >= number, 10.0)
    return [e for e in events if isinstance(e, kind)]


def test_it_connects_and_observes(bench, wait_until):
    _, _, events = bench()
    seen(events, Observed, wait_until, 5)
    assert isinstance(events[0], Connected) and not events[0].again


def test_it_comes_back_after_a_loss_and_demands_a_tare(bench, wait_until):
    worker, hand, events = bench()
    assert worker.submit('tare').result(10.0).success
    hand.trouble = [HandError('the serial line is gone')]
    hand.connect_trouble = [HandError('no port'), HandError('no port')]
    lost = seen(events, Lost, wait_until, 3)
    assert 'gone' in lost[0].reason
    assert seen(events, Connected, wait_until, 2)[1].again
    assert not worker.observer.zeros[1].tared


def test_a_resynchronised_cycle_keeps_the_zero(bench, wait_until):
    worker, hand, events = bench()
    worker.submit('tare').result(10.0)
    hand.trouble = [HandDisturbedError('resynchronised with the hand after: garbage')]
    seen(events, Disturbed, wait_until)
    assert worker.observer.zeros[1].tared
    assert hand.log.count('connect') == 1


def test_a_motion_commands_velocities_and_ends_at_rest(bench, wait_until):
    worker, hand, events = bench()
    seen(events, Observed, wait_until)
    outcome = worker.submit('move', Opening((1,), 0.5)).result(10.0)
    assert outcome.message == 'open'
    wait_until(lambda: hand.log[-1] == {}, 10.0)
    assert {1: -0.5} in hand.log
    assert hand.log.index('limit') < hand.log.index({1: -0.5})


def test_stop_ends_a_motion_at_once(bench, wait_until):
    worker, hand, events = bench()
    hand.moves = False
    seen(events, Observed, wait_until)
    move = worker.submit('move', Opening((1,), 0.5))
    wait_until(lambda: {1: -0.5} in hand.log, 10.0)
    assert worker.submit('stop').result(10.0).success
    assert move.result(10.0).message == 'stopped'
    assert 'stop' in hand.log


def test_stop_interrupts_the_initialisation(bench, wait_until):
    worker, hand, events = bench()
    hand.slow = True
    seen(events, Observed, wait_until)
    initialise = worker.submit('initialize')
    wait_until(lambda: 'initialize' in hand.log, 10.0)
    worker.submit('stop')
    assert not initialise.result(10.0).success


def test_of_a_thousand_initialisations_at_once_the_fingers_make_one(bench, wait_until):
    worker, hand, events = bench()
    hand.slow = True
    seen(events, Observed, wait_until)
    asked = [worker.submit('initialize') for _ in range(1000)]
    hand.slow = False
    assert all(one.result(10.0).success for one in asked)
    assert hand.log.count('initialize') == 1
    assert worker.submit('initialize').result(10.0).success
    assert hand.log.count('initialize') == 2


def test_of_a_hundred_motions_at_once_only_the_last_is_begun(bench, wait_until):
    worker, hand, events = bench()
    hand.slow = True
    seen(events, Observed, wait_until)
    worker.submit('initialize')
    wait_until(lambda: 'initialize' in hand.log, 10.0)
    asked = [worker.submit('move', Opening((1,), 0.5)) for _ in range(100)]
    hand.slow = False
    told = [one.result(10.0) for one in asked]
    assert {one.message for one in told[:-1]} == {'another motion was asked for'}
    assert told[-1].success
    assert hand.log.count('limit') == 1


def test_a_failing_link_ends_the_motion_and_says_why(bench, wait_until):
    worker, hand, events = bench()
    hand.moves = False
    seen(events, Observed, wait_until)
    move = worker.submit('move', Opening((1,), 0.5))
    wait_until(lambda: {1: -0.5} in hand.log, 10.0)
    hand.trouble = [HandError('the serial line is gone')]
    assert 'the link failed' in move.result(10.0).message


def test_an_uninitialised_hand_waits_for_its_command(bench, wait_until):
    worker, hand, events = bench()
    hand.initialised = False
    seen(events, NotReady, wait_until)
    assert worker.submit('initialize').result(10.0).success
    seen(events, Observed, wait_until)


def test_commands_without_a_hand_are_answered(bench):
    worker, hand, _ = bench()
    hand.connect_trouble = [HandError('no port')] * 100
    hand.trouble = [HandError('the serial line is gone')]
    patience = Patience(10.0)
    while not patience.over:
        outcome = worker.submit('tare').result(10.0)
        if 'no hand' in outcome.message:
            return
    pytest.fail(outcome.message)


def test_the_end_closes_the_hand_and_answers_what_was_asked(bench, wait_until):
    worker, hand, events = bench()
    hand.moves = False
    seen(events, Observed, wait_until)
    move = worker.submit('move', Opening((1,), 0.5))
    wait_until(lambda: {1: -0.5} in hand.log, 10.0)
    worker.end()
    assert move.done() and not move.result().success
    assert hand.log[-1] == 'close'
    # Also what is asked for later still.
    assert 'shutting down' in worker.submit('tare').result(10.0).message


def test_a_stop_guard_that_died_is_told_of(bench, wait_until, monkeypatch):
    monkeypatch.setattr(worker_module, 'GUARD_PERIOD_S', 0.01)
    _, hand, events = bench()
    seen(events, Observed, wait_until)
    hand.guard_died = True
    seen(events, GuardRestarted, wait_until)


def test_a_motor_that_gets_too_hot_ends_the_motion_and_lets_go(bench, wait_until):
    worker, hand, events = bench(hottest_c=65.0)
    hand.moves = False
    seen(events, Observed, wait_until)
    move = worker.submit('move', Opening((1,), 0.5))
    wait_until(lambda: {1: -0.5} in hand.log, 10.0)
    hand.temperature_c = 66.0
    assert 'too hot at 66 degrees' in move.result(10.0).message
    wait_until(lambda: 'stop' in hand.log, 10.0)
    assert 'too hot' in worker.submit('move', Opening((1,), 0.5)).result(10.0).message
    hand.temperature_c, hand.moves = 59.0, True
    seen(events, Observed, wait_until, len(events) + 2)
    assert worker.submit('move', Opening((1,), 0.5)).result(10.0).success


def test_a_fault_of_the_driver_itself_stops_the_hand_and_looks_for_it_again(bench, wait_until):
    _, hand, events = bench()
    seen(events, Observed, wait_until)
    hand.trouble = [ZeroDivisionError('a mistake of ours')]
    assert 'a mistake of ours' in seen(events, Lost, wait_until)[0].reason
    seen(events, Connected, wait_until, 2)
    assert 'close' in hand.log


def test_ticks_pace_the_cycles(bench, wait_until):
    worker, hand, events = bench(paced_by_ticks=True)
    seen(events, Connected, wait_until)
    for number in range(1, 5):
        worker.tick()
        assert len(seen(events, Observed, wait_until, number)) == number


def test_a_hand_that_opens_by_itself_gets_no_velocities_while_it_does(bench, wait_until):
    worker, hand, events = bench()
    hand.opens_by_itself = True
    seen(events, Observed, wait_until)
    assert worker.submit('move', Opening([1], 0.8)).result(10.0).message == 'open'
    after = hand.log[hand.log.index('open') + 1 :]
    wait_until(lambda: {} in hand.log, 10.0)
    assert [entry for entry in after if entry] == []


def test_stopping_a_hand_that_opens_by_itself_stops_it(bench, wait_until):
    worker, hand, events = bench()
    hand.opens_by_itself = True
    hand.position = 10**6
    seen(events, Observed, wait_until)
    moving = worker.submit('move', Opening([1], 0.8))
    wait_until(lambda: 'open' in hand.log, 10.0)
    assert worker.submit('stop').result(10.0).success
    assert moving.result(10.0).message == 'stopped'
    assert 'stop' in hand.log[hand.log.index('open') :]
