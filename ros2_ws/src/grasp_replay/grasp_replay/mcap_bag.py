# SPDX-License-Identifier: Apache-2.0
"""Bags in MCAP files: sound ones by their index, ones without index after one pass over them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from grasp_replay.bag import Bag, Message, Topic, damaged
from grasp_replay.errors import BagError
from grasp_replay.mcap_blocks import (
    Block,
    Damage,
    Definitions,
    StoredMessage,
    Summary,
    block_messages,
    file_size,
    load_block,
    read_summary,
)
from grasp_replay.mcap_scan import scan_file


@dataclass(frozen=True)
class _FileBlock:
    """A block with the file it is in."""

    stream: BinaryIO
    file: Path
    block: Block
    definitions: Definitions
    start: int
    end: int


class McapBag(Bag):
    """MCAP files, read block by block: memory holds only blocks that overlap in time."""

    def __init__(self, path: Path, files: list[Path]) -> None:
        super().__init__(path)
        self.files = files
        self._blocks: list[_FileBlock] = []
        self._stack = ExitStack()
        try:
            for file in files:
                self._open(file)
        except BaseException:
            self.close()
            raise
        self.start = min((block.start for block in self._blocks), default=0)
        self.end = max((block.end for block in self._blocks), default=0)

    def _open(self, file: Path) -> None:
        try:
            stream = self._stack.enter_context(file.open('rb'))
            size = file_size(stream)
            summary = read_summary(stream, size)
        except OSError as error:
            raise BagError(f'{file} cannot be read: {error.strerror}') from error
        except Damage as damage:
            raise damaged(file, str(damage)) from damage
        if summary is not None:
            counts = summary.counts or {}
            definitions = summary.definitions
            try:
                self._find_schemas(stream, summary)
                spans = [
                    (block, block.start, block.end)
                    for block in summary.blocks
                    if block.end or _holds_messages(stream, block)
                ]
            except Damage as damage:
                raise damaged(file, str(damage)) from damage
        else:
            self.notes.append(f'{file.name} has no whole index; it was read once to make one')
            scan = scan_file(stream)
            if scan.loose_messages:
                self.notes.append(
                    f'{file.name} holds {scan.loose_messages} messages outside its chunks, which '
                    'some players pass over; `bag_check --recover` writes a bag without'
                )
            if not scan.sound:
                raise damaged(file, scan.lost[0].reason)
            definitions, counts = scan.definitions, {}
            for checked in scan.blocks:
                for channel_id, count in checked.counts.items():
                    counts[channel_id] = counts.get(channel_id, 0) + count
            spans = [(checked.block, checked.start, checked.end) for checked in scan.blocks]
        self._add_topics(file, definitions, counts)
        self._blocks += [
            _FileBlock(stream, file, block, definitions, start, end) for block, start, end in spans
        ]

    @staticmethod
    def _find_schemas(stream: BinaryIO, summary: Summary) -> None:
        """Take from the chunks the types that a summary does not repeat."""
        for block in summary.blocks:
            if not summary.definitions.untyped_topics:
                return
            found = Definitions()
            block_messages(load_block(stream, block), found)
            contradiction = summary.definitions.fill(found)
            if contradiction:
                raise Damage(contradiction)

    def _add_topics(self, file: Path, definitions: Definitions, counts: dict[int, int]) -> None:
        for channel_id in counts:
            if channel_id not in definitions.channels:
                raise damaged(file, f'{counts[channel_id]} messages belong to no channel')
        for channel in definitions.channels.values():
            schema = definitions.schemas.get(channel.schema_id)
            self._add_topic(
                Topic(
                    channel.topic,
                    schema.name if schema else '',
                    counts.get(channel.id, 0),
                    channel.encoding,
                    channel.metadata.get('offered_qos_profiles', ''),
                    channel.metadata.get('topic_type_hash', ''),
                    schema.text.decode('utf-8', 'replace') if schema else '',
                    schema.encoding if schema else '',
                )
            )

    def _stored(
        self, topics: Collection[str] | None, start: int | None, stop: int | None
    ) -> Iterator[Message]:
        wanted = set(self.topics if topics is None else topics)
        first = 0 if start is None else start
        last = 2**64 if stop is None else stop
        blocks = [
            (block, order)
            for order, block in enumerate(self._blocks)
            if block.end >= first and block.start < last
        ]
        blocks.sort(key=lambda entry: entry[0].start)
        # By time, then by place in the file: a later chunk may begin earlier.
        pending: list[tuple[int, int, int, Message]] = []
        for block, order in blocks:
            ready = 0
            while ready < len(pending) and pending[ready][0] < block.start:
                ready += 1
            for entry in pending[:ready]:
                yield entry[-1]
            del pending[:ready]
            loaded = self._load(block, wanted, first, last)
            pending += [(m.log_time, order, place, m) for place, m in enumerate(loaded)]
            pending.sort()
        for entry in pending:
            yield entry[-1]

    def _load(self, place: _FileBlock, wanted: set[str], first: int, last: int) -> list[Message]:
        try:
            found = Definitions()
            stored = block_messages(load_block(place.stream, place.block), found)
            contradiction = place.definitions.fill(found)
            if contradiction:
                raise Damage(contradiction)
        except OSError as error:
            raise BagError(f'{place.file} cannot be read: {error.strerror}') from error
        except Damage as damage:
            raise damaged(place.file, str(damage)) from damage
        names = {
            channel_id: channel.topic
            for channel_id, channel in place.definitions.channels.items()
            if channel.topic in wanted
        }
        self._check_times(place, stored)
        return [
            Message(names[channel_id], bytes(data), log_time, publish_time, sequence)
            for channel_id, sequence, log_time, publish_time, data in stored
            if channel_id in names and first <= log_time < last
        ]

    @staticmethod
    def _check_times(place: _FileBlock, stored: list[StoredMessage]) -> None:
        # The order of reading rests on the declared times: a false one would reorder silently.
        for message in stored:
            if not place.start <= message.log_time <= place.end:
                raise damaged(
                    place.file,
                    f'the chunk at byte {place.block.record_start} holds a message outside the '
                    'times it declares',
                )

    def close(self) -> None:
        """Close the files."""
        self._stack.close()


def _holds_messages(stream: BinaryIO, block: Block) -> bool:
    """Is a chunk that ends at time zero, as an empty one does, not empty?"""
    return bool(block_messages(load_block(stream, block), None))
