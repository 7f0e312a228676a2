# SPDX-License-Identifier: Apache-2.0
"""What a replay sends and when: choice, order, pace and accounts, without ROS and without clocks.

Every function that depends on time takes it as an argument, so that tests decide what time it is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field
from enum import Enum
from itertools import chain

from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.errors import BagError
from grasp_replay.qos import common_offer, parse_qos_text
from grasp_replay.topic_selection import TopicSelection, absolute

HIGHEST_RATE = 1000.0
SERVICE_EVENT = '/_service_event'
# Fast DDS sends what is longer in pieces of 64 KB, and its shared memory holds eight of them.
LARGE_MESSAGE = 2**16
PEEK_BYTES = 64 * 2**20


@dataclass(frozen=True)
class Choice:
    """Which part of a bag is sent, under which names; times in s from the start of the bag."""

    selection: TopicSelection = field(default_factory=lambda: TopicSelection(everything=True))
    remap: dict[str, str] = field(default_factory=dict)
    start_offset: float = 0.0
    duration: float | None = None
    until: float | None = None

    def span(self, bag: Bag) -> tuple[int, int]:
        """First and one-past-last log time (ns) to send; raises BagError when none is left."""
        start = bag.start + round(self.start_offset * 1e9)
        stop = bag.end + 1
        if self.duration is not None:
            stop = min(stop, start + round(self.duration * 1e9) + 1)
        if self.until is not None:
            stop = min(stop, bag.start + round(self.until * 1e9) + 1)
        if start >= stop:
            raise BagError(
                f'{bag.path} has nothing between {self.start_offset} s and the chosen end; it '
                f'lasts {bag.duration:.3f} s'
            )
        return start, stop

    def topics(self, bag: Bag) -> dict[str, Topic]:
        """The topics to send by their name in the bag."""
        return {
            name: topic
            for name, topic in bag.topics.items()
            if self.selection.accepts(absolute(name))
        }

    def published_name(self, topic: str) -> str:
        """The name under which a topic of the bag is sent."""
        name = absolute(topic)
        return self.remap.get(name, name)


def parse_remap(rules: list[str]) -> dict[str, str]:
    """Rules `old:=new` as a table of absolute names; raises BagError."""
    table = {}
    for rule in rules:
        old, separator, new = rule.partition(':=')
        if not (old and separator and new):
            raise BagError(f'the remapping {rule!r} is not of the form old:=new')
        table[absolute(old)] = absolute(new)
    return table


def refusal(topic: Topic) -> str | None:
    """Why a topic cannot be replayed at all, None when nothing speaks against it."""
    if topic.encoding != 'cdr':
        return f'it is serialised as {topic.encoding!r}, not cdr'
    if not topic.type_name:
        return 'the recording does not name its type'
    if topic.name.endswith(SERVICE_EVENT):
        return 'it holds the events of a service, which only its server may send'
    return None


class Pace:
    """The bag's own time: it runs `rate` times as fast as the given clock, or stands still.

    `now` is always in s of a steady clock, bag time in ns.
    """

    def __init__(self, start: int, now: float, rate: float = 1.0, paused: bool = False) -> None:
        self._bag = start
        self._since = now
        self.rate = check_rate(rate)
        self.paused = paused

    def bag_time(self, now: float) -> int:
        """The bag time at `now`."""
        if self.paused:
            return self._bag
        return self._bag + round((now - self._since) * self.rate * 1e9)

    def wait(self, log_time: int, now: float) -> float:
        """Seconds until a message is due; negative when it is late, infinite while paused."""
        if self.paused:
            return math.inf
        return self._since + (log_time - self._bag) * 1e-9 / self.rate - now

    def set_rate(self, rate: float, now: float) -> None:
        """Go on at another rate from here; raises BagError."""
        rate = check_rate(rate)
        self._settle(now)
        self.rate = rate

    def pause(self, now: float) -> None:
        """Stand still."""
        self._settle(now)
        self.paused = True

    def resume(self, now: float) -> None:
        """Go on from where it stands."""
        self._settle(now)
        self.paused = False

    def jump(self, log_time: int, now: float) -> None:
        """Stand at another bag time."""
        self._bag, self._since = log_time, now

    def _settle(self, now: float) -> None:
        self._bag, self._since = self.bag_time(now), now


def check_rate(rate: float) -> float:
    """The rate if it can be played; raises BagError."""
    if not 0.0 < rate <= HIGHEST_RATE:
        raise BagError(f'the rate {rate} is not in (0, {HIGHEST_RATE:g}]')
    return float(rate)


class Verdict(Enum):
    """What to do about the next message."""

    SEND = 'send'
    WAIT = 'wait'
    SEEK = 'seek'
    STOP = 'stop'


class Control:
    """Pause, step, seek and stop as commanded from outside; one message is asked about at a time.

    `target` is the log time (ns) to go on from, None while there is no wish to jump.
    """

    def __init__(self, pace: Pace) -> None:
        self.pace = pace
        self.steps = 0
        self.stopped = False
        self.target: int | None = None

    def place(self, now: float) -> int:
        """Where the replay stands, or is about to: log time in ns."""
        return self.pace.bag_time(now) if self.target is None else self.target

    def step(self) -> bool:
        """Let one message pass while paused; False when not paused."""
        if not self.pace.paused:
            return False
        self.steps += 1
        return True

    def judge(self, log_time: int, now: float) -> tuple[Verdict, float]:
        """What to do with the message of `log_time` at `now`, and for how long (s) to wait."""
        if self.stopped:
            return Verdict.STOP, 0.0
        if self.target is not None:
            return Verdict.SEEK, 0.0
        if self.pace.paused and self.steps:
            self.steps -= 1
            self.pace.jump(log_time, now)
            return Verdict.SEND, 0.0
        wait = self.pace.wait(log_time, now)
        return (Verdict.WAIT, wait) if wait > 0 else (Verdict.SEND, wait)


class Tally:
    """Accounts of a replay: messages sent, late and lost, and how late, in constant memory.

    Lateness is kept in bins 2 % wide from 1 microsecond to some 500 s.
    """

    BINS = 1000
    FINEST = 1e-6
    STEP = math.log(1.02)

    def __init__(self, late_after: float) -> None:
        self.late_after = late_after
        self.sent: dict[str, int] = {}
        self.late = 0
        self.lost = 0
        self._bins = [0] * (self.BINS + 1)
        self._timed = 0
        self.worst = 0.0

    @property
    def total(self) -> int:
        """Messages sent on all topics."""
        return sum(self.sent.values())

    def add(self, topic: str, lateness: float | None) -> None:
        """Count a message sent `lateness` seconds after it was due (None: no due time)."""
        self.sent[topic] = self.sent.get(topic, 0) + 1
        if lateness is None:
            return
        self.late += lateness > self.late_after
        self.worst = max(self.worst, lateness)
        place = math.log(max(lateness, self.FINEST) / self.FINEST) / self.STEP
        self._bins[min(int(place), self.BINS)] += 1
        self._timed += 1

    def quantile(self, fraction: float) -> float:
        """The lateness (s) that `fraction` of the messages stay under, within 2 %."""
        passed, limit = 0, fraction * self._timed
        for place, count in enumerate(self._bins):
            passed += count
            if count and passed >= limit:
                return min(self.FINEST * math.exp((place + 1) * self.STEP), self.worst)
        return 0.0

    def report(self) -> dict[str, object]:
        """The summary that `replay --json` prints; times in s."""
        return {
            'sent': self.total,
            'late': self.late,
            'lost': self.lost,
            'late_after_s': self.late_after,
            'lateness_median_s': self.quantile(0.5),
            'lateness_p99_s': self.quantile(0.99),
            'lateness_max_s': self.worst,
            'topics': dict(sorted(self.sent.items())),
        }


def latched_before(bag: Bag, names: Collection[str], place: int) -> list[Message]:
    """What a late listener of the latched topics among `names` would know at the log time `place`.

    Of each latched topic the last messages before `place`, one for each publisher it had.
    """
    kept: dict[str, deque[Message]] = {}
    for name in names:
        profiles = parse_qos_text(bag.topics[name].qos)
        if profiles and common_offer(profiles).durability == 'transient_local':
            kept[name] = deque(maxlen=len(profiles))
    if not kept or place <= bag.start:
        return []
    for message in bag.messages(kept, bag.start, place):
        kept[message.topic].append(message)
    return sorted(chain.from_iterable(kept.values()), key=lambda message: message.log_time)


def large_topics(bag: Bag, names: Collection[str]) -> set[str]:
    """Those of the topics `names` whose first message the transport sends in pieces.

    A topic that has not begun after `PEEK_BYTES` of messages counts as large.
    """
    unseen = {name for name in names if bag.topics[name].count}
    large: set[str] = set()
    passed = 0
    try:
        for message in bag.messages(unseen):
            passed += len(message.data)
            if message.topic in unseen:
                unseen.discard(message.topic)
                if len(message.data) > LARGE_MESSAGE:
                    large.add(message.topic)
            if not unseen or passed > PEEK_BYTES:
                break
    except BagError:
        # The replay itself comes here and tells.
        pass
    return large | unseen
