# SPDX-License-Identifier: Apache-2.0
"""Lockstep: the next input is sent when the nodes have answered the last one."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

from grasp_replay.cdr import header_stamp
from grasp_replay.errors import BagError
from grasp_replay.topic_selection import absolute


@dataclass(frozen=True)
class LockstepRule:
    """After each message on the topic `question` one is awaited on each of `answers`."""

    question: str
    answers: tuple[str, ...]


def parse_rule(text: str) -> LockstepRule:
    """A rule `input:=answer[,answer...]`; raises BagError."""
    question, separator, answers = text.partition(':=')
    names = [name for name in answers.split(',') if name]
    if not (question and separator and names):
        raise BagError(f'the lockstep rule {text!r} is not of the form input:=answer[,answer...]')
    return LockstepRule(absolute(question), tuple(map(absolute, names)))


@dataclass
class _Open:
    """A question on its way: its stamp (None if it has no header) and who has not answered."""

    question: str
    stamp: int | None
    missing: set[str] = field(default_factory=set)

    def clause(self) -> str:
        """Who owes what answer."""
        when = '' if self.stamp is None else f' of {self.stamp * 1e-9:.3f} s'
        return f'nothing on {", ".join(sorted(self.missing))} for {self.question}{when}'


class Lockstep:
    """Keeps the accounts of questions and answers, by the stamps they carry.

    An answer counts when it carries the stamp of the question; where either has no header, any
    message counts. `ask` is called before sending, `wait` after, `answer` by any thread.
    `unanswered` has a clause for each question whose time ran out.
    """

    def __init__(self, rules: list[LockstepRule], timeout: float) -> None:
        self.rules = {rule.question: rule for rule in rules}
        self.timeout = timeout
        self.unanswered: list[str] = []
        self._open: _Open | None = None
        self._change = threading.Condition()

    @property
    def answer_topics(self) -> set[str]:
        """All topics on which answers are awaited."""
        return {name for rule in self.rules.values() for name in rule.answers}

    def ask(self, topic: str, data: bytes, stamped: bool) -> None:
        """A message is about to be sent on `topic` (the name it is published under)."""
        rule = self.rules.get(topic)
        with self._change:
            self._open = (
                None
                if rule is None
                else _Open(topic, header_stamp(data) if stamped else None, set(rule.answers))
            )

    def answer(self, topic: str, data: bytes, stamped: bool) -> None:
        """A message came on an answer topic."""
        with self._change:
            if self._open is None or topic not in self._open.missing:
                return
            if stamped and self._open.stamp not in (None, header_stamp(data)):
                return
            self._open.missing.discard(topic)
            self._change.notify_all()

    def wait(self) -> None:
        """Wait until the last question is answered, or count it as unanswered."""
        deadline = time.monotonic() + self.timeout
        with self._change:
            while self._open is not None and self._open.missing:
                left = deadline - time.monotonic()
                if left <= 0:
                    self.unanswered.append(self._open.clause())
                    break
                self._change.wait(left)
            self._open = None
