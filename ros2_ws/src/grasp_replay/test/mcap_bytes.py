# SPDX-License-Identifier: Apache-2.0
"""MCAP records byte by byte, without the library: files that it would not write."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

MAGIC = b'\x89MCAP0\r\n'
SECOND = 10**9
STRING = 'std_msgs/msg/String'


def number(size: int, value: int) -> bytes:
    """An unsigned little-endian integer of `size` bytes."""
    return value.to_bytes(size, 'little')


def text(value: str) -> bytes:
    """UTF-8 after its length."""
    return block(value.encode())


def block(data: bytes) -> bytes:
    """Bytes after their length."""
    return number(4, len(data)) + data


def string_map(table: Mapping[str, str]) -> bytes:
    """A map of strings after its length."""
    return block(b''.join(text(key) + text(value) for key, value in table.items()))


def record(opcode: int, body: bytes) -> bytes:
    """A record: opcode, length, fields."""
    return bytes([opcode]) + number(8, len(body)) + body


def cdr(value: str) -> bytes:
    """A std_msgs/String as CDR."""
    data = value.encode() + b'\0'
    return b'\0\1\0\0' + number(4, len(data)) + data


def header(profile: str = 'ros2', library: str = 'test') -> bytes:
    """The first record of a file."""
    return record(1, text(profile) + text(library))


def schema(
    identity: int = 1,
    name: str = STRING,
    definition: bytes = b'string data\n',
    encoding: str = 'ros2msg',
) -> bytes:
    """A type."""
    return record(3, number(2, identity) + text(name) + text(encoding) + block(definition))


def channel(
    identity: int = 1,
    topic: str = '/a',
    schema_id: int = 1,
    encoding: str = 'cdr',
    metadata: Mapping[str, str] | None = None,
) -> bytes:
    """A topic."""
    fields = number(2, identity) + number(2, schema_id) + text(topic) + text(encoding)
    return record(4, fields + string_map(metadata or {}))


def message(
    time: int,
    data: bytes,
    identity: int = 1,
    sequence: int = 0,
    publish_time: int | None = None,
) -> bytes:
    """A message; times in ns."""
    published = time if publish_time is None else publish_time
    fields = number(2, identity) + number(4, sequence) + number(8, time) + number(8, published)
    return record(5, fields + data)


def chunk(
    body: bytes, start: int, end: int, compression: str = '', stored: bytes | None = None
) -> bytes:
    """Records in a chunk, with its checksum; `stored`: their compressed form."""
    stored = body if stored is None else stored
    fields = number(8, start) + number(8, end) + number(8, len(body))
    fields += number(4, zlib.crc32(body)) + text(compression)
    return record(6, fields + number(8, len(stored)) + stored)


def chunk_index(place: int, stored: bytes, start: int, end: int) -> bytes:
    """The index entry of an uncompressed chunk without message index, `stored` at byte `place`."""
    fields = number(8, start) + number(8, end) + number(8, place) + number(8, len(stored))
    return record(8, fields + number(4, 0) + number(8, 0) + text('') + number(8, 0) * 2)


def attachment(name: str, data: bytes, log_time: int = 1, create_time: int = 1) -> bytes:
    """A file inside the file, with its checksum."""
    fields = number(8, log_time) + number(8, create_time) + text(name) + text('text/plain')
    fields += number(8, len(data)) + data
    return record(9, fields + number(4, zlib.crc32(fields)))


def metadata(name: str, table: Mapping[str, str]) -> bytes:
    """Named strings."""
    return record(12, text(name) + string_map(table))


def statistics(counts: Mapping[int, int], chunks: int, start: int, end: int) -> bytes:
    """What the summary says of the whole; `counts` by channel."""
    fields = number(8, sum(counts.values())) + number(2, 1) + number(4, len(counts))
    fields += number(4, 0) * 2 + number(4, chunks) + number(8, start) + number(8, end)
    return record(
        11, fields + block(b''.join(number(2, k) + number(8, n) for k, n in counts.items()))
    )


def whole(data: bytes, summary: bytes = b'') -> bytes:
    """A complete file around the records `data`, with the checksums of data and summary."""
    front = MAGIC + data
    front += record(15, number(4, zlib.crc32(front)))
    start = len(front) if summary else 0
    foot = record(2, number(8, start) + number(8, 0) + number(4, 0))[:-4]
    total = zlib.crc32(summary + foot) if summary else 0
    return front + summary + foot + number(4, total) + MAGIC
