# SPDX-License-Identifier: Apache-2.0
"""MCAP at the level of blocks: where the messages of a file are, and if their bytes are sound.

A *block* is a chunk, or a run of messages that stand outside chunks. This module is our own
although the `mcap` library reads sound files: recovery needs every length checked against the
bytes that exist, declared sizes never trusted with memory, checksums always verified, and a way
to find the next chunk after damage, and the library offers none of these. Writing is the
library's. Format: MCAP specification version 0, https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, BinaryIO, NamedTuple

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS = 7, 8, 9, 10, 11
METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 12, 13, 14, 15

RECORD_PREFIX = struct.Struct('<BQ')
MESSAGE_PREFIX = struct.Struct('<HIQQ')
CHUNK_PREFIX = struct.Struct('<QQQI')
CHUNK_INDEX_PREFIX = struct.Struct('<QQQQ')

# A chunk may ask for this much memory whatever the file size: large clouds compress well.
DECOMPRESSION_FLOOR = 32 * 2**20
MOST_FRAMES = 4096
"""A stream of more frames than that is taken for damage: each one costs a copy of the rest."""

COMPRESSION_ERRORS = (zstd.ZstdError, RuntimeError, EOFError, MemoryError)


class Damage(ValueError):
    """Bytes that are not what the format demands; the text says what and where."""


class Schema(NamedTuple):
    """A message type: `encoding` is ros2msg or ros2idl, `text` the full definition."""

    id: int
    name: str
    encoding: str
    text: bytes


class Channel(NamedTuple):
    """A stream of messages of one topic, one type and one set of QoS profiles."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: dict[str, str]


class StoredMessage(NamedTuple):
    """One message as stored; times in ns; `data` is a view into its block."""

    channel_id: int
    sequence: int
    log_time: int
    publish_time: int
    data: memoryview


@dataclass(frozen=True)
class Block:
    """A stretch of messages in a file; offset and length in bytes, of the stored payload.

    `start` and `end` are log times in ns as declared (zero for runs: unknown until loaded);
    `record_start` is where the whole record begins. `compression` is None for a run.
    """

    record_start: int
    offset: int
    length: int
    uncompressed: int
    crc: int
    compression: str | None
    start: int = 0
    end: int = 0


@dataclass(frozen=True)
class Attachment:
    """A sound attachment: its names, times in ns, and where its `size` bytes begin."""

    name: str
    media_type: str
    log_time: int
    create_time: int
    offset: int
    size: int


@dataclass
class Definitions:
    """The schemas and channels of a file, by id."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def add(self, opcode: int, body: memoryview) -> None:
        """Take over a schema or channel record; raises Damage if its id means another already."""
        if opcode == SCHEMA:
            schema = parse_schema(body)
            other = Definitions({schema.id: schema})
        else:
            channel = parse_channel(body)
            other = Definitions({}, {channel.id: channel})
        contradiction = self.fill(other)
        if contradiction:
            raise Damage(contradiction)

    def fill(self, other: Definitions) -> str:
        """Add what is missing here from `other`; a sentence if both define an id differently."""
        contradiction = ''
        for schema in other.schemas.values():
            known = self.schemas.setdefault(schema.id, schema)
            if known != schema:
                contradiction = contradiction or (
                    f'type {schema.id} is defined twice and differently, as {known.name} and as '
                    f'{schema.name}'
                )
        for channel in other.channels.values():
            standing = self.channels.setdefault(channel.id, channel)
            if standing[:4] != channel[:4]:
                contradiction = contradiction or (
                    f'channel {channel.id} is defined twice and differently, on '
                    f'{standing.topic} and on {channel.topic}'
                )
        return contradiction

    @property
    def untyped_topics(self) -> list[str]:
        """Topics of channels that name a type which is not defined here."""
        return [
            channel.topic
            for channel in self.channels.values()
            if channel.schema_id and channel.schema_id not in self.schemas
        ]


class Fields:
    """Reads the fields of one record; every length is checked against the bytes that are left."""

    def __init__(self, body: memoryview) -> None:
        self.body = body
        self.position = 0

    def take(self, count: int) -> memoryview:
        """The next `count` bytes; raises Damage when the record ends before."""
        if count > len(self.body) - self.position:
            raise Damage(
                f'a field of {count} bytes in a record with {len(self.body) - self.position} left'
            )
        self.position += count
        return self.body[self.position - count : self.position]

    def integer(self, size: int) -> int:
        """An unsigned little-endian integer of `size` bytes."""
        return int.from_bytes(self.take(size), 'little')

    def text(self) -> str:
        """A UTF-8 string after its 4-byte length."""
        try:
            return str(self.take(self.integer(4)), 'utf-8')
        except UnicodeDecodeError as error:
            raise Damage('a name that is not UTF-8') from error

    def string_map(self) -> dict[str, str]:
        """A map of strings after its length in bytes."""
        inner = Fields(self.take(self.integer(4)))
        result = {}
        while inner.position < len(inner.body):
            key = inner.text()
            result[key] = inner.text()
        return result


def parse_schema(body: memoryview) -> Schema:
    """A schema record; raises Damage."""
    fields = Fields(body)
    return Schema(
        fields.integer(2), fields.text(), fields.text(), bytes(fields.take(fields.integer(4)))
    )


def parse_channel(body: memoryview) -> Channel:
    """A channel record; raises Damage."""
    fields = Fields(body)
    return Channel(
        fields.integer(2), fields.integer(2), fields.text(), fields.text(), fields.string_map()
    )


def parse_chunk_header(body: bytes, offset: int, length: int, size: int) -> Block:
    """The block of a chunk record at `offset` with a payload of `length` bytes.

    `body` holds the first bytes of that payload (at least 48 where they exist), `size` is the
    length of the file. Raises Damage when the record contradicts itself.
    """
    fields = Fields(memoryview(body))
    start, end, uncompressed, crc = CHUNK_PREFIX.unpack(fields.take(CHUNK_PREFIX.size))
    compression = fields.text()
    stored = fields.integer(8)
    if compression not in ('', 'lz4', 'zstd'):
        raise Damage(f'a chunk with unknown compression {compression!r}')
    if fields.position + stored != length:
        raise Damage(f'a chunk of {length} bytes that declares {stored} bytes of data')
    if uncompressed > DECOMPRESSION_FLOOR + 2 * size:
        raise Damage(f'a chunk that declares {uncompressed} bytes in a file of {size}')
    if not compression and uncompressed != stored:
        raise Damage(f'an uncompressed chunk of {stored} bytes that declares {uncompressed}')
    data = offset + RECORD_PREFIX.size + fields.position
    return Block(offset, data, stored, uncompressed, crc, compression, start, end)


def load_block(stream: BinaryIO, block: Block) -> memoryview:
    """The records of a block, decompressed and checked against its checksum; raises Damage."""
    stream.seek(block.offset)
    stored = stream.read(block.length)
    if len(stored) != block.length:
        raise Damage(f'the file ends inside the chunk at byte {block.record_start}')
    if block.compression == 'zstd':
        data = _decompressed(zstd.ZstdDecompressor, stored, block)
    elif block.compression == 'lz4':
        data = _decompressed(lz4.frame.LZ4FrameDecompressor, stored, block)
    else:
        data = stored
    if block.crc and zlib.crc32(data) != block.crc:
        raise Damage(f'the chunk at byte {block.record_start} does not match its checksum')
    return memoryview(data)


def _decompressed(decompressor: Callable[[], Any], stored: bytes, block: Block) -> bytes:
    try:
        data = unpack_frames(decompressor, stored, block.uncompressed)
    except COMPRESSION_ERRORS as error:
        raise Damage(
            f'the chunk at byte {block.record_start} does not decompress ({error})'
        ) from error
    if len(data) != block.uncompressed:
        more = ' or more' if len(data) > block.uncompressed else ''
        raise Damage(
            f'the chunk at byte {block.record_start} holds {len(data)} bytes{more}, '
            f'not {block.uncompressed}'
        )
    return data


def unpack_frames(decompressor: Callable[[], Any], stored: bytes, most: int) -> bytes:
    """Unpack all frames of a zstd or lz4 stream, of which skippable ones hold nothing.

    Stops after one byte more than `most`, so that a longer stream shows. Raises one of
    COMPRESSION_ERRORS.
    """
    pieces: list[bytes] = []
    size = 0
    for _ in range(MOST_FRAMES):
        frame = decompressor()
        pieces.append(frame.decompress(stored, max_length=most + 1 - size))
        size += len(pieces[-1])
        if size > most:
            break
        if not frame.eof:
            raise EOFError('it ends within a compressed frame')
        stored = frame.unused_data or b''
        if not stored:
            break
    else:
        raise EOFError(f'it has more than {MOST_FRAMES} frames')
    return pieces[0] if len(pieces) == 1 else b''.join(pieces)


def block_records(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Opcode and body of each record in a loaded block; raises Damage."""
    position, end = 0, len(data)
    unpack = RECORD_PREFIX.unpack_from
    while position < end:
        if end - position < RECORD_PREFIX.size:
            raise Damage('a chunk that ends inside a record')
        opcode, length = unpack(data, position)
        position += RECORD_PREFIX.size
        if length > end - position:
            raise Damage(f'a record of {length} bytes in a chunk with {end - position} left')
        yield opcode, data[position : position + length]
        position += length


def block_messages(data: memoryview, definitions: Definitions | None) -> list[StoredMessage]:
    """The messages of a loaded block in stored order; raises Damage.

    Schemas and channels on the way are added to `definitions` when it is given.
    """
    messages = []
    unpack = MESSAGE_PREFIX.unpack_from
    prefix = MESSAGE_PREFIX.size
    for opcode, body in block_records(data):
        if opcode == MESSAGE:
            if len(body) < prefix:
                raise Damage(f'a message record of {len(body)} bytes')
            channel_id, sequence, log_time, publish_time = unpack(body)
            messages.append(
                StoredMessage(channel_id, sequence, log_time, publish_time, body[prefix:])
            )
        elif definitions is not None and opcode in (SCHEMA, CHANNEL):
            definitions.add(opcode, body)
    return messages


@dataclass
class Summary:
    """What a sound file says about itself at its end; `counts` by channel id, None if absent."""

    definitions: Definitions
    blocks: list[Block]
    counts: dict[int, int] | None
    message_count: int
    chunk_count: int
    start: int
    end: int


def read_summary(stream: BinaryIO, size: int) -> Summary | None:
    """The summary of a complete file; None when it has none that tells where all messages are.

    Raises Damage when the file is not an MCAP file, has no end, or its summary is damaged.
    """
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        raise Damage('it does not begin as an MCAP file')
    tail = 8 + 9 + 20
    if size < 8 + tail:
        raise Damage('it ends before its end mark')
    stream.seek(size - tail)
    opcode, length, start, _offsets, crc = struct.unpack('<BQQQI', stream.read(29))
    if stream.read(8) != MAGIC or opcode != FOOTER or length != 20:
        raise Damage('it ends before its end mark')
    if start == 0:
        return None
    if not 8 <= start <= size - tail:
        raise Damage(f'its footer points to byte {start} of {size}')
    stream.seek(start)
    data = stream.read(size - tail - start + 25)
    if crc and zlib.crc32(data) != crc:
        raise Damage('its summary does not match its checksum')
    return _parse_summary(memoryview(data)[:-25], stream, size, start)


def _parse_summary(data: memoryview, stream: BinaryIO, size: int, end: int) -> Summary | None:
    summary = Summary(Definitions(), [], None, 0, 0, 0, 0)
    covered: list[tuple[int, int]] = []
    for opcode, body in block_records(data):
        fields = Fields(body)
        if opcode in (SCHEMA, CHANNEL):
            summary.definitions.add(opcode, body)
        elif opcode == CHUNK_INDEX:
            first, last, offset, length = CHUNK_INDEX_PREFIX.unpack(fields.take(32))
            fields.take(fields.integer(4))
            covered.append((offset, offset + length + fields.integer(8)))
            if length < RECORD_PREFIX.size or offset + length > size:
                raise Damage(f'its index names a chunk at byte {offset} beyond its {size} bytes')
            stream.seek(offset)
            head = stream.read(RECORD_PREFIX.size + 64)
            if len(head) < RECORD_PREFIX.size or head[0] != CHUNK:
                raise Damage(f'its index names a chunk at byte {offset}, where none is')
            payload = RECORD_PREFIX.unpack_from(head)[1]
            block = parse_chunk_header(head[RECORD_PREFIX.size :], offset, payload, size)
            if (block.start, block.end) != (first, last):
                raise Damage(f'the chunk at byte {offset} and its index differ in time')
            summary.blocks.append(block)
        elif opcode == STATISTICS:
            summary.message_count = fields.integer(8)
            fields.take(2 + 4 + 4 + 4)
            summary.chunk_count = fields.integer(4)
            summary.start, summary.end = fields.integer(8), fields.integer(8)
            counts = Fields(fields.take(fields.integer(4)))
            summary.counts = {}
            while counts.position < len(counts.body):
                channel_id = counts.integer(2)
                summary.counts[channel_id] = counts.integer(8)
    if summary.counts is None or summary.chunk_count != len(summary.blocks):
        return None
    if summary.message_count and not summary.blocks:
        return None
    if sum(summary.counts.values()) != summary.message_count:
        return None
    known = summary.definitions.channels
    if any(channel_id not in known for channel_id in summary.counts):
        return None
    return summary if _covers_all(stream, covered, end) else None


def _covers_all(stream: BinaryIO, covered: list[tuple[int, int]], end: int) -> bool:
    """Does the index name every chunk before byte `end` once, and no message stand outside them?

    The format does not allow loose messages in a file with chunks; where they are, no index names
    them. A chunk named twice would give its messages twice, one left out would lose them.
    """
    position = len(MAGIC)
    for start, stop in [*sorted(covered), (end, end)]:
        if position > start:
            return False
        while position < start:
            stream.seek(position)
            head = stream.read(RECORD_PREFIX.size)
            if len(head) < RECORD_PREFIX.size or head[0] in (MESSAGE, CHUNK):
                return False
            position += RECORD_PREFIX.size + RECORD_PREFIX.unpack(head)[1]
        position = stop
    return True


def file_size(stream: BinaryIO) -> int:
    """The length of an open file in bytes."""
    return stream.seek(0, io.SEEK_END)
