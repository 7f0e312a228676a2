# SPDX-License-Identifier: Apache-2.0
"""Which clock the messages of a recording are told apart by: their headers', or the recorder's.

Drivers leave header stamps at zero, repeat them, or a recording holds a message twice. A scan that
cannot be told from another by its stamp would be compared under another's load without a word.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from grasp_replay.errors import BagError

T = TypeVar('T')


@dataclass(frozen=True)
class Recorded(Generic[T]):
    """A message as it was recorded: its header's stamp, the recorder's time (both ns), its frame.

    `fingerprint` is a digest of its bytes; `repeats` says that it is meant to carry the stamp of
    another one, as a stale copy of contacts does; `header` keeps the header's stamp.
    """

    stamp: int
    log_time: int
    frame: str
    fingerprint: bytes
    value: T
    repeats: bool = False
    header: int = 0


def without_copies(messages: Sequence[Recorded[T]]) -> list[Recorded[T]]:
    """Leave out messages that are another one of the same stamp, byte for byte."""
    seen: set[tuple[int, bytes]] = set()
    kept = []
    for message in messages:
        key = message.stamp, message.fingerprint
        if message.stamp and key in seen:
            continue
        seen.add(key)
        kept.append(message)
    return kept


def fault_of_stamps(what: str, messages: Sequence[Recorded[T]]) -> str:
    """Why the stamps of one topic cannot tell its messages apart; empty when they can."""
    own = [message.stamp for message in messages if not message.repeats]
    if not own:
        return ''
    zeros = own.count(0)
    if zeros:
        return f'{zeros} {what} carry the stamp 0'
    stamp, times = Counter(own).most_common(1)[0]
    return f'{times} {what} carry the stamp {stamp} ns' if times > 1 else ''


def by_log_time(what: str, messages: Sequence[Recorded[T]], fault: str) -> list[Recorded[T]]:
    """The messages stamped with the recorder's time; raises BagError if that cannot be, either."""
    times = Counter(message.log_time for message in messages if not message.repeats)
    time, most = max(times.items(), key=lambda item: item[1], default=(1, 1))
    if most > 1 or 0 in times:
        raise BagError(
            f'{fault} and {most} {what} were recorded at {time} ns: what belongs together cannot '
            'be told; let the drivers fill header.stamp and record again'
        )
    return [replace(message, stamp=message.log_time) for message in messages]


def frame_of(what: str, messages: Sequence[Recorded[T]]) -> str:
    """The one frame of a topic's messages, empty if none says; raises BagError for several."""
    frames = sorted({message.frame for message in messages if message.frame})
    if len(frames) > 1:
        raise BagError(
            f'{what} are in the frames {" and ".join(frames)}; record each frame under '
            'a topic of its own'
        )
    return frames[0] if frames else ''
