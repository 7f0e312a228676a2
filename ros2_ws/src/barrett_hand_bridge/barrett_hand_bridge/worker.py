# SPDX-License-Identifier: Apache-2.0
"""The thread that lives with the hand: connects, cycles, obeys commands, comes back after a loss.

Everything that happens is told to `tell` as an event, from this thread. Motors stand still unless
a motion runs; a lost link, a refused cycle, `stop` and the end of the thread end every motion.
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass

from barrett_hand_bridge.hand import (
    Hand,
    HandDisturbedError,
    HandError,
    HandFacts,
    HandNotInitialisedError,
    HandSample,
)
from barrett_hand_bridge.motion import Motion, MotionResult, Opening, slower_than_hand
from barrett_hand_bridge.observer import HandObserver, Observation
from barrett_hand_bridge.tare import TARE_SAMPLES

FIRST_WAIT_S = 0.1
LONGEST_WAIT_S = 5.0
NOT_READY_PERIOD_S = 0.25
COMMAND_PERIOD_S = 0.02
# So many cycles in a row may be disturbed before the link counts as lost.
MOST_DISTURBANCES = 3
# How often the stop guard is looked after, and how much cooler a hot hand must get.
GUARD_PERIOD_S = 0.1
COOLER_C = 5.0
SHUTTING_DOWN = 'the bridge is shutting down'


@dataclass(frozen=True)
class Connected:
    """The hand answers; `again` after a loss."""

    facts: HandFacts
    again: bool


@dataclass(frozen=True)
class Observed:
    """One cycle, digested; `complete_ns`: monotonic time at which its last byte was read."""

    observation: Observation
    sample: HandSample
    complete_ns: int


@dataclass(frozen=True)
class Late:
    """No answer within three periods; the last observation is stale."""


@dataclass(frozen=True)
class Lost:
    """The link is gone; the reason in words."""

    reason: str


@dataclass(frozen=True)
class NotReady:
    """The hand answers but cannot cycle; the reason in words."""

    reason: str


@dataclass(frozen=True)
class Disturbed:
    """A cycle failed, the hand was found again without loss of its state."""

    reason: str


@dataclass(frozen=True)
class GuardRestarted:
    """The process that stops the hand when the bridge dies had died itself."""


Event = Connected | Observed | Late | Lost | NotReady | Disturbed | GuardRestarted


@dataclass(frozen=True)
class Outcome:
    """Answer to a command."""

    success: bool
    message: str


@dataclass
class _Command:
    kind: str
    future: Future[Outcome]
    motion: Motion | None = None


class HandWorker:
    """Runs a hand in a thread of its own."""

    def __init__(
        self,
        hand: Hand,
        make_observer: Callable[[HandFacts], HandObserver],
        tell: Callable[[Event], None],
        *,
        paced_by_ticks: bool = False,
        hottest_c: float = math.inf,
    ) -> None:
        """With `paced_by_ticks` each cycle waits for a call of `tick`; otherwise it runs free.

        From `hottest_c` on nothing moves and nothing is held: the motors go idle, and the worm
        gears of the fingers keep their position.
        """
        self._hand = hand
        self._make_observer = make_observer
        self._tell = tell
        # One tick at most waits: those that come during an initialisation are no backlog.
        self._ticks = threading.Event() if paced_by_ticks else None
        self._commands: queue.SimpleQueue[_Command] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._ended = threading.Event()
        self._stop_motion = threading.Event()
        self._in_initialise = False
        self._initialising: Future[Outcome] | None = None
        self._newest: _Command | None = None
        self._thread = threading.Thread(target=self._run, name='hand_worker', daemon=True)
        self._observer: HandObserver | None = None
        self._facts: HandFacts | None = None
        self._connected_once = False
        self._wait_s = FIRST_WAIT_S
        self._motion: _Command | None = None
        self._by_itself = False
        self._tare: _Command | None = None
        self._tare_samples: list[HandSample] = []
        self._failures = 0
        self._latest: Observation | None = None
        self._hottest_c = hottest_c
        self._hot = False
        self._guard_seen_s = 0.0
        hand.late = self._on_late

    @property
    def observer(self) -> HandObserver | None:
        """The observer in use (made when the hand was first found)."""
        return self._observer

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def tick(self) -> None:
        """Allow one more cycle."""
        if self._ticks is not None:
            self._ticks.set()

    def submit(self, kind: str, motion: Motion | None = None) -> Future[Outcome]:
        """Ask for `initialize`, `tare`, `stop` or `move` (with a motion).

        Whoever asks for `initialize` while it is asked for already gets the same answer.
        """
        future: Future[Outcome] = Future()
        if kind == 'initialize':
            asked = self._initialising
            if asked is not None and not asked.done():
                return asked
            self._initialising = future
        if kind == 'stop':
            self._initialising = None
            self._stop_motion.set()
            if self._in_initialise:
                self._hand.abort()
        command = _Command(kind, future, motion)
        if kind == 'move':
            self._newest = command
        self._commands.put(command)
        if self._ended.is_set():
            # Nobody else would answer any more.
            self._refuse_all(SHUTTING_DOWN)
        return future

    def end(self) -> None:
        """Stop the hand and the thread."""
        self._stopping.set()
        self._stop_motion.set()
        if self._in_initialise:
            self._hand.abort()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)

    def _on_late(self) -> None:
        self._tell(Late())

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                try:
                    if self._facts is None:
                        self._connect()
                    else:
                        self._turn()
                except Exception as error:
                    # Nothing may leave a hand without its driver: stop, tell, look for it again.
                    self._failed(HandError(f'internal error of the driver: {error!r}'))
                    self._stopping.wait(LONGEST_WAIT_S if self._facts is None else FIRST_WAIT_S)
        finally:
            self._end_motion(False, SHUTTING_DOWN)
            with contextlib.suppress(HandError):
                self._hand.close()
            self._ended.set()
            self._refuse_all(SHUTTING_DOWN)

    def _connect(self) -> None:
        try:
            facts = self._hand.connect()
        except HandError as error:
            self._tell(Lost(str(error)))
            self._refuse_all(f'no hand: {error}')
            self._stopping.wait(self._wait_s)
            self._wait_s = min(2.0 * self._wait_s, LONGEST_WAIT_S)
            return
        self._wait_s = FIRST_WAIT_S
        self._failures = 0
        self._facts = facts
        if self._observer is None:
            self._observer = self._make_observer(facts)
        else:
            self._observer.forget_zeros()
        again, self._connected_once = self._connected_once, True
        self._tell(Connected(facts, again))

    def _turn(self) -> None:
        self._watch_guard()
        self._obey()
        if self._ticks is not None:
            if not self._ticks.wait(COMMAND_PERIOD_S):
                return
            self._ticks.clear()
        if self._stop_motion.is_set() and self._motion is None:
            self._stop_motion.clear()
        try:
            sample = self._hand.sample(self._velocities())
            complete_ns = time.monotonic_ns()
        except HandNotInitialisedError as error:
            self._end_motion(False, str(error))
            self._tell(NotReady(str(error)))
            self._next_command(NOT_READY_PERIOD_S)
            return
        except HandError as error:
            self._failed(error)
            return
        self._failures = 0
        self._watch_temperature(sample)
        assert self._observer is not None
        self._latest = self._observer.observe(sample)
        self._tell(Observed(self._latest, sample, complete_ns))
        self._collect_tare(sample)

    def _watch_guard(self) -> None:
        now_s = time.monotonic()
        if now_s - self._guard_seen_s > GUARD_PERIOD_S:
            self._guard_seen_s = now_s
            if self._hand.watch_guard():
                self._tell(GuardRestarted())

    def _watch_temperature(self, sample: HandSample) -> None:
        """Let go at once when a motor gets too hot; nothing moves before it is cooler again."""
        degrees = sample.temperature_c
        if degrees is None:
            return
        if not self._hot and degrees >= self._hottest_c:
            self._hot = True
            self._end_motion(False, self._too_hot(degrees))
            with contextlib.suppress(HandError):
                # A lost link is found out by the next cycle.
                self._hand.stop()
        elif degrees < self._hottest_c - COOLER_C:
            self._hot = False

    def _too_hot(self, degrees: float | None) -> str:
        now = '' if degrees is None else f' at {degrees:.0f} degrees C'
        return (
            f'stopped, a motor is too hot{now}: holding ends at {self._hottest_c:g} (parameter '
            f'hottest), and nothing moves before it is {COOLER_C:g} degrees cooler'
        )

    def _velocities(self) -> dict[int, float] | None:
        """Velocities for the next cycle; None when nothing is to be commanded."""
        command = self._motion
        if command is None or command.motion is None or self._latest is None:
            return None
        if self._stop_motion.is_set() or self._stopping.is_set():
            self._end_motion(False, 'stopped')
            return {}
        step = command.motion.step(self._latest, self._latest.stamp_ns * 1e-9)
        if isinstance(step, MotionResult):
            self._end_motion(step.done, step.message)
            return {}
        return None if self._by_itself else dict(step)

    def _failed(self, error: HandError) -> None:
        self._end_motion(False, f'stopped, the link failed: {error}')
        self._tare_samples.clear()
        self._latest = None
        self._failures += 1
        if isinstance(error, HandDisturbedError) and self._failures < MOST_DISTURBANCES:
            self._tell(Disturbed(str(error)))
            return
        self._facts = None
        self._end_tare(Outcome(False, f'the link failed: {error}'))
        self._tell(Lost(str(error)))
        with contextlib.suppress(HandError):
            self._hand.close()

    def _next_command(self, timeout_s: float) -> None:
        with contextlib.suppress(queue.Empty):
            self._execute(self._commands.get(timeout=timeout_s))

    def _obey(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._execute(self._commands.get_nowait())

    def _refuse_all(self, reason: str) -> None:
        self._end_tare(Outcome(False, reason))
        with contextlib.suppress(queue.Empty):
            while True:
                self._commands.get_nowait().future.set_result(Outcome(False, reason))

    def _execute(self, command: _Command) -> None:
        try:
            if command.kind == 'stop':
                self._end_motion(False, 'stopped')
                self._hand.stop()
                self._stop_motion.clear()
                command.future.set_result(Outcome(True, 'stopped'))
            elif command.kind == 'initialize':
                self._end_motion(False, 'the hand is being initialised')
                self._initialise(command)
            elif command.kind == 'tare':
                self._end_tare(Outcome(False, 'another tare was asked for'))
                self._tare, self._tare_samples = command, []
            elif command is not self._newest:
                # Of many motions at once only the last is begun: that takes time on the wire.
                command.future.set_result(Outcome(False, 'another motion was asked for'))
            else:
                self._end_motion(False, 'another motion was asked for')
                self._begin(command)
        except HandError as error:
            if not command.future.done():
                command.future.set_result(Outcome(False, str(error)))

    def _initialise(self, command: _Command) -> None:
        self._tell(NotReady('the hand is being initialised'))
        self._in_initialise = True
        try:
            if self._stop_motion.is_set() or self._stopping.is_set():
                raise HandError('stopped before it began')
            self._hand.initialize()
        finally:
            self._in_initialise = False
        if self._observer is not None:
            for touch in self._observer.touches.values():
                touch.reset()
        command.future.set_result(Outcome(True, 'initialised'))

    def _begin(self, command: _Command) -> None:
        if self._latest is None:
            command.future.set_result(Outcome(False, 'the hand does not cycle: initialise it'))
            return
        assert self._observer is not None
        assert command.motion is not None
        assert self._facts is not None
        refusal = slower_than_hand(command.motion.speeds(), self._facts.speed_step_rad_s)
        if self._hot:
            refusal = self._too_hot(None)
        if refusal:
            command.future.set_result(Outcome(False, refusal))
            return
        limit_nm = command.motion.limit_nm(self._latest)
        self._hand.limit_force(self._observer.strain_limits(limit_nm))
        motion = command.motion
        # What the hand does by itself ends by itself, also when this process dies.
        self._by_itself = isinstance(motion, Opening) and self._hand.open_by_itself(
            motion.by_finger()
        )
        self._motion = command

    def _end_motion(self, success: bool, message: str) -> None:
        command, self._motion = self._motion, None
        if command is not None:
            command.future.set_result(Outcome(success, message))

    def _end_tare(self, outcome: Outcome) -> None:
        command, self._tare = self._tare, None
        if command is not None:
            command.future.set_result(outcome)

    def _collect_tare(self, sample: HandSample) -> None:
        if self._tare is None:
            return
        self._tare_samples.append(sample)
        if len(self._tare_samples) < TARE_SAMPLES:
            return
        assert self._observer is not None
        outcome = self._observer.tare(self._tare_samples)
        if outcome.refusal:
            self._end_tare(Outcome(False, outcome.refusal))
            return
        text = ', '.join(
            f'finger {finger} {zero.counts:.2f}' for finger, zero in outcome.zeros.items()
        )
        self._hand.tare_touch()
        self._end_tare(Outcome(True, f'zero in counts: {text}'))
