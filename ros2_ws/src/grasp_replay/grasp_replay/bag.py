# SPDX-License-Identifier: Apache-2.0
"""What an open bag is: topics, and stored messages in time order, undecoded."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from grasp_replay.errors import BagError
from grasp_replay.mcap_blocks import Damage
from grasp_replay.packed import is_packed, unpacked
from grasp_replay.ros_types import Decoder, TypeRecord, same_type


@dataclass(frozen=True)
class Topic:
    """A topic as recorded.

    `encoding` is the serialisation (`cdr`), `qos` the offered profiles as rosbag2's YAML text,
    `definition` the message definition in the language `definition_encoding`.
    """

    name: str
    type_name: str
    count: int
    encoding: str
    qos: str
    type_hash: str
    definition: str
    definition_encoding: str

    @property
    def type_record(self) -> TypeRecord:
        """What the recording says of the topic's type."""
        return TypeRecord(
            self.type_name, self.type_hash, self.definition, self.definition_encoding
        )


class Message(NamedTuple):
    """A stored message: topic name, bytes as on the wire, and times in ns."""

    topic: str
    data: bytes
    log_time: int
    publish_time: int
    sequence: int


class Bag(ABC):
    """An open bag; use as a context manager.

    `topics` by name; `start` and `end` are the first and last log time (ns; both 0 when the bag
    is empty); `notes` are sentences about what is unusual but harmless; `packed` says that every
    message was compressed by rosbag2, and those of CDR topics show it themselves.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, Topic] = {}
        self.start = 0
        self.end = 0
        self.notes: list[str] = []
        self.storage = 'mcap'
        self.packed = False
        self.files: list[Path] = []
        self._decoder = Decoder()

    @property
    def message_count(self) -> int:
        """Messages on all topics."""
        return sum(topic.count for topic in self.topics.values())

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message."""
        return (self.end - self.start) * 1e-9

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[Message]:
        """Messages of `topics` (all when None) with start <= log time < stop (ns), in time order.

        Messages of equal time keep their order in the file; those that rosbag2 compressed one by
        one are unpacked. Raises BagError where the bag is damaged.
        """
        for message in self._stored(topics, start, stop):
            shows = is_packed(message.data) and self.topics[message.topic].encoding == 'cdr'
            yield self._unpacked(message) if shows or self.packed else message

    @abstractmethod
    def _stored(
        self, topics: Collection[str] | None, start: int | None, stop: int | None
    ) -> Iterator[Message]:
        """Messages as `messages` gives them, with the bytes that are in the file."""

    def _unpacked(self, message: Message) -> Message:
        note = 'its messages are compressed one by one; they are unpacked as they are read'
        if note not in self.notes:
            self.notes.append(note)
        try:
            return message._replace(data=unpacked(message.data))
        except Damage as damage:
            raise BagError(f'{self.path}: topic {message.topic}: {damage}') from damage

    def decode(self, message: Message) -> Any:
        """The message as an object with the fields of its type; raises BagError."""
        topic = self.topics[message.topic]
        if topic.encoding != 'cdr':
            raise BagError(
                f'{self.path}: topic {topic.name} is serialised as {topic.encoding!r}; '
                'only cdr can be decoded'
            )
        try:
            return self._decoder.decode(
                message.data, topic.type_name, topic.definition, topic.definition_encoding
            )
        except BagError as error:
            raise BagError(f'{self.path}: topic {topic.name}: {error}') from error

    @abstractmethod
    def close(self) -> None:
        """Close the files."""

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def _add_topic(self, topic: Topic) -> None:
        known = self.topics.get(topic.name)
        if known is None:
            self.topics[topic.name] = topic
            return
        if (known.type_name, known.encoding) != (topic.type_name, topic.encoding):
            raise BagError(
                f'{self.path}: topic {topic.name} holds both {known.type_name} and '
                f'{topic.type_name}; record them under two names'
            )
        if not same_type(known.type_record, topic.type_record):
            raise BagError(
                f'{self.path}: topic {topic.name} holds {topic.type_name} by two definitions that '
                'differ, as two versions of its package write; record them under two names'
            )
        self.topics[topic.name] = replace(known, count=known.count + topic.count)


def damaged(file: Path, reason: str) -> BagError:
    """The error for a bag that can perhaps be recovered."""
    return BagError(
        f'{file} is damaged: {reason}; save what is sound with '
        f'`bag_check {file.name} --recover NEW_DIRECTORY`'
    )
