# SPDX-License-Identifier: Apache-2.0
"""The course of a replay: wait for listeners, send each message at its time, give account.

It speaks to ROS only through `Stage`, so that it runs in tests without any.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

from grasp_replay.bag import Bag, Message
from grasp_replay.cdr import has_header
from grasp_replay.errors import BagError
from grasp_replay.lockstep import Lockstep
from grasp_replay.read_ahead import ReadAhead
from grasp_replay.replay_core import Control, Tally, Verdict, latched_before
from grasp_replay.replay_options import ReplayOptions
from grasp_replay.topic_selection import listed

# A wait longer than this is interrupted by services; the rest is slept through.
SHORT_WAIT = 0.002
# Fast DDS drops what is sent before both sides know each other, even on reliable topics.
SETTLE_SECONDS = 1.0


class Outlet(Protocol):
    """Sends messages; `names` are those of the topics in the bag, and those they get."""

    names: dict[str, str]

    def unmatched(self) -> set[str]:
        """Those of them that nobody listens to."""

    def send(self, message: Message) -> bool:
        """Send stored bytes; False when they were refused."""

    def unacknowledged(self, seconds: float) -> list[str]:
        """Topics whose messages were not all received within `seconds`."""


class Stage(Protocol):
    """What a player needs of its surroundings; `changed` guards `control`."""

    control: Control
    changed: threading.Condition

    @property
    def senders(self) -> Outlet:
        """What the messages go through."""

    def send_clock(self, nanoseconds: int) -> None:
        """Send `/clock`."""

    def alive(self) -> bool:
        """False when everything is to end."""


class Player:
    """Sends one bag; use `wait_for_listeners`, `run` and `finish` in this order."""

    def __init__(
        self, stage: Stage, bag: Bag, options: ReplayOptions, lockstep: Lockstep | None = None
    ) -> None:
        self.stage = stage
        self.bag = bag
        self.options = options
        self.tally = Tally(options.late_after)
        self.unacknowledged: list[str] = []
        self.lockstep = lockstep
        self._names = stage.senders.names
        self._stamped = {name: has_header(bag.topics[name].type_name) for name in self._names}
        self._last_clock = -1
        self._next_show = 0.0

    def wait_for_listeners(self) -> list[str]:
        """Wait until the topics have listeners; returns those without, by their sent names.

        Raises BagError when one of `options.wait_for` has none in time.
        """
        required = set(self.options.wait_for)
        unknown = required - set(self._names.values())
        if unknown:
            raise BagError(f'--wait-for {listed(unknown)} is not among the topics sent')
        deadline = time.monotonic() + self.options.wait
        missing: set[str] = set()
        while self.stage.alive():
            missing = {self._names[name] for name in self.stage.senders.unmatched()}
            if not (missing & required if required else missing):
                break
            if time.monotonic() >= deadline:
                if required:
                    raise BagError(
                        f'nobody listened to {listed(missing & required)} within '
                        f'{self.options.wait:g} s'
                    )
                break
            time.sleep(0.01)
        if self.options.wait > 0 and len(missing) < len(self._names):
            time.sleep(SETTLE_SECONDS)
        return sorted(missing)

    def run(self, show: Callable[[float, str], None]) -> None:
        """Send everything; `show` is told the share done. Raises BagError on damage."""
        start, _ = self.options.choice.span(self.bag)
        place = start
        while True:
            with self.stage.changed:
                if self.stage.control.target is not None:
                    place, self.stage.control.target = self.stage.control.target, None
            verdict = self._run_from(place, show)
            if verdict is Verdict.STOP:
                return
            if verdict is None:
                if not (self.options.loop and self.tally.total > 0):
                    return
                place = start

    def _run_from(self, place: int, show: Callable[[float, str], None]) -> Verdict | None:
        """Go on from the log time `place`, where listeners first get what is latched there.

        Returns SEEK or STOP where that was asked for, None at the end of the bag.
        """
        start, stop = self.options.choice.span(self.bag)
        latched = latched_before(self.bag, self._names, place)
        source = ReadAhead(self.bag.messages(self._names, place, stop))
        with self.stage.changed:
            self.stage.control.pace.jump(place, time.monotonic())
        if self.options.clock:
            self._send_clock(place)
        try:
            for message in latched:
                self._send(message, place, None)
            for message in source:
                self._show(show, message.log_time - start, stop - start)
                verdict = self._wait_and_send(message)
                if verdict is not Verdict.SEND:
                    return verdict
        finally:
            source.close()
        with self.stage.changed:
            return None if self.stage.control.target is None else Verdict.SEEK

    def finish(self) -> None:
        """Wait for acknowledgements and note what did not arrive."""
        self.unacknowledged = self.stage.senders.unacknowledged(self.options.acknowledge_seconds)
        if self.lockstep is not None:
            self.tally.lost += len(self.lockstep.unanswered)

    def _show(self, show: Callable[[float, str], None], passed: int, total: int) -> None:
        now = time.monotonic()
        if now >= self._next_show:
            self._next_show = now + 0.25
            state = 'paused' if self.stage.control.pace.paused else ''
            show(passed / total, f'{passed * 1e-9:.1f} of {total * 1e-9:.1f} s {state}')

    def _wait_and_send(self, message: Message) -> Verdict:
        """Send one message at its time; SEEK or STOP when that was asked for before."""
        control, changed = self.stage.control, self.stage.changed
        while self.stage.alive():
            with changed:
                now = time.monotonic()
                stepped = control.pace.paused
                if self.lockstep is not None and not stepped:
                    control.pace.jump(message.log_time, now)
                verdict, wait = control.judge(message.log_time, now)
                if verdict in (Verdict.STOP, Verdict.SEEK):
                    return verdict
                if verdict is Verdict.WAIT and wait > SHORT_WAIT:
                    self._tick_clock(control, now)
                    changed.wait(min(wait - SHORT_WAIT / 2, 1.0 / (self.options.clock or 4.0)))
                    continue
            if verdict is Verdict.SEND:
                lateness = None if stepped or self.lockstep else -wait
                self._send(message, message.log_time, lateness)
                return verdict
            time.sleep(wait)
        return Verdict.STOP

    def _tick_clock(self, control: Control, now: float) -> None:
        bag_time = control.pace.bag_time(now)
        if self.options.clock and not control.pace.paused and bag_time > self._last_clock:
            self._send_clock(bag_time)

    def _send_clock(self, bag_time: int) -> None:
        self._last_clock = bag_time
        self.stage.send_clock(bag_time)

    def _send(self, message: Message, bag_time: int, lateness: float | None) -> None:
        if self.options.clock and bag_time != self._last_clock:
            self._send_clock(bag_time)
        if self.lockstep is not None:
            name = self._names[message.topic]
            self.lockstep.ask(name, message.data, self._stamped[message.topic])
        if not self.stage.senders.send(message):
            self.tally.lost += 1
            return
        self.tally.add(message.topic, lateness)
        if self.lockstep is not None:
            self.lockstep.wait()
