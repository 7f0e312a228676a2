# SPDX-License-Identifier: Apache-2.0
"""Bags in SQLite files (rosbag2's storage before MCAP), through the rosbags library."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from heapq import merge
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import dump_qos_v9

from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.errors import BagError

SAVE = 'save what is sound of a damaged file with `sqlite3 FILE .recover`'


class SqliteBag(Bag):
    """SQLite files, read through the rosbags library, merged by time."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        super().__init__(path)
        self.storage = 'sqlite3'
        self.files = files
        self._readers: list[Any] = []
        spans: list[tuple[int, int]] = []
        try:
            for file in files:
                self._open(file)
                reader = self._readers[-1]
                if reader.message_count:
                    spans.append((reader.start_time, reader.end_time - 1))
        except BaseException:
            self.close()
            raise
        self.start = min((start for start, _ in spans), default=0)
        self.end = max((end for _, end in spans), default=0)

    def _open(self, file: Path) -> None:
        _refuse_unclosed(file)
        reader = self._guard(lambda: Reader(file))
        self._guard(reader.open)
        self._readers.append(reader)
        orphans = self._guard(lambda: _orphans(file))
        if orphans:
            self.notes.append(
                f'{orphans} messages of {file.name} belong to no topic of it and are left out'
            )
        for item in reader.connections:
            self._add_topic(
                Topic(
                    item.topic,
                    item.msgtype,
                    item.msgcount,
                    item.ext.serialization_format,
                    _qos_text(item.ext.offered_qos_profiles),
                    item.digest,
                    item.msgdef.data,
                    f'ros2{item.msgdef.format.name.lower()}' if item.msgdef.data else '',
                )
            )

    def _guard(self, action: Callable[[], Any]) -> Any:
        try:
            return action()
        except Exception as error:  # rosbags and apsw errors share no base class
            way_out = f'; {SAVE}' if 'malformed' in str(error) else ''
            raise BagError(f'{self.path} cannot be read: {error}{way_out}') from error

    def _stored(
        self, topics: Collection[str] | None, start: int | None, stop: int | None
    ) -> Iterator[Message]:
        wanted = set(self.topics if topics is None else topics)
        sources = []
        for reader in self._readers:
            connections = [item for item in reader.connections if item.topic in wanted]
            if connections:
                sources.append(self._read(reader.messages(connections, start=start, stop=stop)))
        # Files may overlap in time; equal times keep the order of the files.
        yield from merge(*sources, key=lambda message: message.log_time)

    def _read(self, source: Iterator[Any]) -> Iterator[Message]:
        end = object()
        while (item := self._guard(lambda: next(source, end))) is not end:
            connection, time, data = item
            if not isinstance(data, bytes):
                raise BagError(
                    f'{self.path}: topic {connection.topic} at {time} ns: the database holds '
                    f'{"nothing" if data is None else type(data).__name__} in place of the bytes '
                    f'of a message; {SAVE}'
                )
            yield Message(connection.topic, data, time, time, 0)

    def close(self) -> None:
        """Close the files."""
        for reader in self._readers:
            reader.close()


def _refuse_unclosed(file: Path) -> None:
    """Raise BagError where messages stand beside the file, in the log of a recorder that died."""
    for ending in ('-wal', '-journal'):
        log = file.with_name(file.name + ending)
        if log.is_file() and log.stat().st_size:
            raise BagError(
                f'{file} was not closed: {log.name} holds messages that are not in it yet; merge '
                f'them (on a copy of both): `sqlite3 {file.name} "PRAGMA journal_mode=DELETE"`'
            )


def _orphans(file: Path) -> int:
    """How many messages name a topic that the file does not have."""
    with closing(sqlite3.connect(f'{file.resolve().as_uri()}?immutable=1', uri=True)) as base:
        query = 'SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics)'
        return int(base.execute(query).fetchone()[0])


def _qos_text(profiles: list[Any]) -> str:
    return yaml.safe_dump(dump_qos_v9(profiles), sort_keys=False) if profiles else ''
