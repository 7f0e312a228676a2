# SPDX-License-Identifier: Apache-2.0
"""Walks a whole MCAP file from its first byte, past damage, and says what is sound in it.

After a record that contradicts itself the walk looks for the next chunk that is whole: a chunk
declares its length twice, which no stray bytes do. Nothing is read further than needed and
nothing is allocated on the word of a damaged length.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import BinaryIO

from grasp_replay.mcap_blocks import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    MESSAGE_PREFIX,
    METADATA,
    RECORD_PREFIX,
    SCHEMA,
    Attachment,
    Block,
    Damage,
    Definitions,
    Fields,
    block_messages,
    file_size,
    load_block,
    parse_chunk_header,
    read_summary,
)
from grasp_replay.mcap_records import (
    CHUNK_SIGNATURE,
    SIGNATURE_BYTES,
    SMALL_RECORDS,
    is_whole,
    reads_as_another,
)
from grasp_replay.packed import is_packed

# Messages outside chunks are gathered into runs of about this many bytes.
RUN_BYTES = 2**20
# Bytes read at once while looking for the next chunk after damage.
SEARCH_BYTES = 2**20
# Bytes of an attachment or of the whole data section that are summed up at once.
CHECKED_BYTES = 2**20
# A record that claims more than this is not believed before its bytes are there.
LONGEST_RECORD = 2**40


@dataclass(frozen=True)
class Lost:
    """A stretch of bytes [start, end) that cannot be used, and why."""

    start: int
    end: int
    reason: str


@dataclass(frozen=True)
class CheckedBlock:
    """A sound block: its true first and last log time (ns) and messages by channel id."""

    block: Block
    start: int
    end: int
    counts: dict[int, int]


@dataclass
class Scan:
    """What a walk through a file found.

    `complete`: the end mark is in place. `unchecked_blocks` carry no checksum,
    `unindexed_blocks` no message index, `loose_messages` stand outside the chunks of a file that
    has chunks, `packed` are compressed one by one (by channel id). `metadata` are (name, table)
    records. `declared_count` is the number of messages according to a sound summary.
    """

    size: int
    definitions: Definitions = field(default_factory=Definitions)
    blocks: list[CheckedBlock] = field(default_factory=list)
    lost: list[Lost] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    complete: bool = False
    unchecked_blocks: int = 0
    unindexed_blocks: int = 0
    loose_messages: int = 0
    packed: dict[int, int] = field(default_factory=dict)
    declared_count: int | None = None

    @property
    def sound(self) -> bool:
        """True when nothing is missing and nothing is damaged."""
        return self.complete and not self.lost

    @property
    def message_count(self) -> int:
        """Messages in sound blocks."""
        return sum(sum(block.counts.values()) for block in self.blocks)

    @property
    def packed_messages(self) -> int:
        """Messages of ROS topics that are compressed one by one."""
        channels = self.definitions.channels
        return sum(
            count
            for number, count in self.packed.items()
            if number in channels and channels[number].encoding == 'cdr'
        )


def scan_file(stream: BinaryIO, progress: Callable[[int], None] | None = None) -> Scan:
    """Walk an open file; `progress` is told the bytes passed. Never raises for damage."""
    return _Walk(stream, progress or (lambda _position: None)).run()


class _Walk:
    """One pass over one file."""

    def __init__(self, stream: BinaryIO, progress: Callable[[int], None]) -> None:
        self.stream = stream
        self.progress = progress
        self.size = file_size(stream)
        self.result = Scan(self.size)
        self.in_summary = False
        self.loose = Definitions()
        self.loose_places: list[tuple[int, int, Definitions]] = []
        self.weak = Definitions()
        self.summary_fault = ''
        self.data_crc = 0
        self.data_end = 0
        self.chunks_seen = 0
        self.index_seen = True
        self.settled = len(MAGIC)
        self.run_start = 0
        self.run_end = 0

    def run(self) -> Scan:
        position = self._begin()
        while position < self.size and not self.result.complete:
            try:
                position = self._record(position)
            except Damage as damage:
                self._close_run()
                position = self._step_over(position, str(damage))
            self.progress(position)
        self._close_run()
        self._note_missing_index()
        self._settle_definitions()
        self._check_data_section()
        if not self.result.complete and not self.result.lost:
            self._lose(self.size, self.size, 'the file ends before its end mark')
        if self.summary_fault and not self.result.lost:
            self._lose(self.size, self.size, self.summary_fault)
        return self.result

    def _settle_definitions(self) -> None:
        """What the chunks say stands under their checksums: the others fill gaps, or are named."""
        known = self.result.definitions
        for start, end, loose in self.loose_places:
            contradiction = known.fill(loose)
            if contradiction:
                self._lose(start, end, contradiction)
        contradiction = known.fill(self.weak)
        if contradiction and not self.result.lost:
            self._lose(self.size, self.size, f'its summary contradicts its data: {contradiction}')

    def _check_data_section(self) -> None:
        """Hold everything before the data end against its checksum; where it is wrong stays open.

        What no chunk's checksum proves is saved all the same, and the fault is named.
        """
        if not self.data_crc or self.result.lost:
            return
        if self._sum(0, self.data_end) != self.data_crc:
            self._lose(
                self.data_end,
                self.data_end,
                'its data do not match their checksum, which does not tell where; a message '
                'outside the chunks, a type, a topic or an attachment is wrong',
            )

    def _sum(self, start: int, end: int) -> int:
        self.stream.seek(start)
        total = 0
        while start < end:
            piece = self.stream.read(min(CHECKED_BYTES, end - start))
            if not piece:
                break
            total = zlib.crc32(piece, total)
            start += len(piece)
        return total

    def _step_over(self, position: int, reason: str) -> int:
        """Where to go on after damage at `position`.

        A record with a wrong length can have swallowed the front of the next chunk, so the
        search begins where the last thing ended that a checksum or a rejection settled.
        """
        following = self._next_chunk(self.settled)
        self._lose(position if position <= following else self.settled, following, reason)
        return following

    def _begin(self) -> int:
        self.stream.seek(0)
        if self.stream.read(len(MAGIC)) != MAGIC:
            self._lose(0, min(len(MAGIC), self.size), 'the file does not begin as an MCAP file')
        try:
            summary = read_summary(self.stream, self.size)
        except Damage as damage:
            self.summary_fault = str(damage)
            return len(MAGIC)
        if summary is not None:
            self.weak.fill(summary.definitions)
            self.result.declared_count = summary.message_count
        return len(MAGIC)

    def _lose(self, start: int, end: int, reason: str) -> None:
        lost = self.result.lost
        if lost and lost[-1].end == start:
            lost[-1] = Lost(lost[-1].start, end, lost[-1].reason)
        else:
            lost.append(Lost(start, end, reason))

    def _record(self, position: int) -> int:
        """Take one record; returns where the next begins, or raises Damage."""
        self.stream.seek(position)
        head = self.stream.read(RECORD_PREFIX.size + 64)
        if len(head) < RECORD_PREFIX.size:
            raise Damage('the file ends inside a record')
        opcode, length = RECORD_PREFIX.unpack_from(head)
        body = position + RECORD_PREFIX.size
        end = body + length
        if opcode == CHUNK:
            self._take_chunk(parse_chunk_header(head[9:], position, length, self.size), end)
            return end
        if end > self.size:
            if opcode <= DATA_END:
                raise Damage('the file ends inside a record')
            raise Damage('bytes that are no record')
        if opcode == MESSAGE:
            self._extend_run(position, end, head[9:])
        elif opcode == ATTACHMENT:
            self._take_attachment(position, body, end)
        elif opcode > DATA_END:
            self._expect_record_at(end)
        else:
            self._take_small(opcode, body, length)
        if opcode == FOOTER:
            self._take_end(end)
        return end

    def _take_attachment(self, position: int, body: int, end: int) -> None:
        """Hold an attachment against its checksum (zero: none); raises Damage for a wrong length.

        Fields that the format may have gained since follow the checksum.
        """
        self.stream.seek(body)
        fields = Fields(memoryview(self.stream.read(min(end - body, RUN_BYTES))))
        try:
            log_time, create_time = fields.integer(8), fields.integer(8)
            name, media_type, size = fields.text(), fields.text(), fields.integer(8)
        except Damage:
            self._expect_record_at(end)
            self._lose(position, end, 'an attachment whose fields cannot be read')
            return
        start = body + fields.position
        if start + size + 4 > end:
            raise Damage(f'an attachment of {end - body} bytes that declares {size} bytes of data')
        if start + size + 4 < end:
            self._expect_record_at(end)
        self.stream.seek(start + size)
        declared = int.from_bytes(self.stream.read(4), 'little')
        if declared and self._sum(body, start + size) != declared:
            self._lose(position, end, f'attachment {name!r} does not match its checksum')
            return
        found = Attachment(name, media_type, log_time, create_time, start, size)
        self.result.attachments.append(found)

    def _take_chunk(self, block: Block, end: int) -> None:
        self._close_run()
        if end > self.size:
            self.settled = block.record_start + 1
            raise Damage('the file ends inside a chunk')
        self._note_missing_index()
        self.chunks_seen += 1
        self.index_seen = False
        self.settled = block.record_start + 1
        try:
            self._check(block)
            self.settled = end
        except Damage as damage:
            self.index_seen = True
            if not self._proven_record_at(end):
                # Bytes are missing or too many: the next chunk may stand within this one.
                raise
            self.settled = end
            self._lose(block.record_start, end, str(damage))

    def _note_missing_index(self) -> None:
        self.result.unindexed_blocks += not self.index_seen
        self.index_seen = True

    def _take_small(self, opcode: int, body: int, length: int) -> None:
        """Hold a record against its own fields and keep what it defines; raises Damage."""
        self.stream.seek(body)
        data = memoryview(self.stream.read(length))
        if opcode in (SCHEMA, CHANNEL):
            found = Definitions()
            found.add(opcode, data)
            contradiction = (self.weak if self.in_summary else self.loose).fill(found)
            if contradiction:
                raise Damage(contradiction)
            if not self.in_summary:
                self._close_run()
                self.loose_places.append((body - RECORD_PREFIX.size, body + length, found))
            return
        if opcode not in SMALL_RECORDS:
            raise Damage('bytes that are no record')
        fields = Fields(data)
        SMALL_RECORDS[opcode](fields)
        if fields.position != length:
            self._expect_record_at(body + length)
        if opcode == DATA_END:
            self.in_summary = True
            self.data_crc = int.from_bytes(data[:4], 'little')
            self.data_end = body - RECORD_PREFIX.size
        elif opcode == METADATA and not self.in_summary:
            fields = Fields(data)
            self.result.metadata.append((fields.text(), fields.string_map()))
        self.index_seen |= opcode == MESSAGE_INDEX

    def _take_end(self, end: int) -> None:
        self.stream.seek(end)
        if self.stream.read(len(MAGIC)) != MAGIC:
            raise Damage('the file ends before its end mark')
        self.result.complete = True
        if end + len(MAGIC) < self.size:
            self._lose(end + len(MAGIC), self.size, 'bytes after the end mark')

    def _expect_record_at(self, position: int) -> None:
        """A record that cannot prove its length is believed if another follows it."""
        self.stream.seek(position)
        following = self.stream.read(RECORD_PREFIX.size)
        if len(following) == RECORD_PREFIX.size:
            opcode, length = RECORD_PREFIX.unpack(following)
            if not HEADER <= opcode <= DATA_END or length > LONGEST_RECORD:
                raise Damage('a record that no record follows')

    def _proven_record_at(self, position: int) -> bool:
        """Does a record that proves its own length, or the end of the file, stand there?"""
        if position == self.size or self._is_chunk(position):
            return True
        self.stream.seek(position)
        head = self.stream.read(RECORD_PREFIX.size)
        if len(head) < RECORD_PREFIX.size:
            return False
        opcode, length = RECORD_PREFIX.unpack(head)
        if opcode not in SMALL_RECORDS or length > self.size - position:
            return False
        return is_whole(opcode, memoryview(self.stream.read(length)))

    def _check(self, block: Block) -> None:
        """Load a block, verify it and count it; raises Damage."""
        definitions = Definitions()
        counts: dict[int, int] = {}
        packed: list[int] = []
        start, end = 2**64, 0
        for message in block_messages(load_block(self.stream, block), definitions):
            counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
            start, end = min(start, message.log_time), max(end, message.log_time)
            if is_packed(message.data):
                packed.append(message.channel_id)
        contradiction = self.result.definitions.fill(definitions)
        if contradiction:
            raise Damage(contradiction)
        for channel_id in packed:
            self.result.packed[channel_id] = self.result.packed.get(channel_id, 0) + 1
        self.result.unchecked_blocks += not block.crc
        if counts:
            self.result.blocks.append(CheckedBlock(block, start, end, counts))
            if block.compression is not None and not block.start <= start <= end <= block.end:
                place = block.record_start
                self._lose(place, place, 'a chunk holds messages outside the times it declares')

    def _extend_run(self, position: int, end: int, body: bytes) -> None:
        if end - position < RECORD_PREFIX.size + MESSAGE_PREFIX.size or len(body) < 2:
            raise Damage('a message record without its fields')
        channel_id = int.from_bytes(body[:2], 'little')
        if self.in_summary or not self._is_channel(channel_id):
            raise Damage('a message outside the chunks')
        if self.chunks_seen:
            # The format has none here: it may be another record with a bit flipped.
            self.stream.seek(position + RECORD_PREFIX.size)
            data = memoryview(self.stream.read(min(end - self.stream.tell(), RUN_BYTES)))
            if reads_as_another(data, end - position - RECORD_PREFIX.size, self.size):
                raise Damage('a record that is no message')
            self.result.loose_messages += 1
        self._expect_record_at(end)
        if self.run_end and (position != self.run_end or end - self.run_start > RUN_BYTES):
            self._close_run()
        if not self.run_end:
            self.run_start = position
        self.run_end = end

    def _is_channel(self, number: int) -> bool:
        known = (self.result.definitions, self.loose, self.weak)
        return any(number in definitions.channels for definitions in known)

    def _close_run(self) -> None:
        if self.run_end:
            start, end = self.run_start, self.run_end
            self.run_start = self.run_end = 0
            self._check(Block(start, start, end - start, end - start, 0, None))

    def _next_chunk(self, position: int) -> int:
        """Where the next whole chunk stands at or after `position`, or the end of the file."""
        while position < self.size:
            self.stream.seek(position)
            data = self.stream.read(SEARCH_BYTES + SIGNATURE_BYTES)
            for match in CHUNK_SIGNATURE.finditer(data):
                if self._is_chunk(position + match.start()):
                    return position + match.start()
            position += SEARCH_BYTES
        return self.size

    def _is_chunk(self, position: int) -> bool:
        self.stream.seek(position)
        head = self.stream.read(RECORD_PREFIX.size + 64)
        if len(head) < SIGNATURE_BYTES or head[0] != CHUNK:
            return False
        length = RECORD_PREFIX.unpack_from(head)[1]
        try:
            parse_chunk_header(head[RECORD_PREFIX.size :], position, length, self.size)
        except Damage:
            return False
        return position + RECORD_PREFIX.size + length <= self.size
