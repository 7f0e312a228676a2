# SPDX-License-Identifier: Apache-2.0
"""Bags in SQLite files (rosbag2's storage before MCAP), through the rosbags library."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from heapq import merge
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.metadata import dump_qos_v9

from grasp_replay.bag import Bag, Message, Topic
from grasp_replay.errors import BagError


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
        reader = self._guard(lambda: Reader(file))
        self._guard(reader.open)
        self._readers.append(reader)
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
            raise BagError(f'{self.path} cannot be read: {error}') from error

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
            yield Message(connection.topic, bytes(data), time, time, 0)

    def close(self) -> None:
        """Close the files."""
        for reader in self._readers:
            reader.close()


def _qos_text(profiles: list[Any]) -> str:
    return yaml.safe_dump(dump_qos_v9(profiles), sort_keys=False) if profiles else ''
