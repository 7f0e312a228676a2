# SPDX-License-Identifier: Apache-2.0
"""Which topics a command means: names, patterns and exceptions, with rosbag2's rules."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class TopicSelection:
    """A choice of topics; raises re.error for a bad pattern.

    A topic is accepted when it is named, or matches `regex` as a whole, or `everything` is set
    (hidden topics, with a part that begins with an underscore, then left out), and is neither
    in `exclude_topics` nor matched by `exclude_regex`.
    """

    topics: tuple[str, ...] = ()
    everything: bool = False
    regex: str | None = None
    exclude_topics: tuple[str, ...] = ()
    exclude_regex: str | None = None

    def __post_init__(self) -> None:
        for pattern in (self.regex, self.exclude_regex):
            if pattern is not None:
                re.compile(pattern)

    def accepts(self, topic: str) -> bool:
        """Is `topic` (an absolute name) part of the choice?"""
        if topic in map(absolute, self.exclude_topics):
            return False
        if self.exclude_regex is not None and re.fullmatch(self.exclude_regex, topic):
            return False
        if topic in map(absolute, self.topics):
            return True
        if self.regex is not None and re.fullmatch(self.regex, topic):
            return True
        return self.everything and not any(part.startswith('_') for part in topic.split('/'))


def absolute(topic: str) -> str:
    """The topic name with its leading slash."""
    return topic if topic.startswith('/') else f'/{topic}'


def listed(topics: Iterable[str], most: int = 12) -> str:
    """Topic names in their order for a sentence, `most` of them and the number of the others."""
    names = sorted(topics)
    more = f' and {len(names) - most} more' if len(names) > most else ''
    return ', '.join(names[:most]) + more
