# SPDX-License-Identifier: Apache-2.0
"""The 416 files of the MCAP conformance suite, made here from what its cases say.

Six contents, written with and without each optional part of the format. The SHA-256 of every file
stands in `data/mcap_conformance.sha256`, as published with the suite (foxglove/mcap, MIT).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import mcap_bytes as m

PAD = b'\x01\xff\xff'
DATA = b'\x01\x02\x03'
EXAMPLE = m.schema(1, 'Example', b'\x04\x05\x06', 'c')
TOPIC = m.channel(1, 'example', 1, 'a', {'foo': 'bar'})
BARE_TOPIC = m.channel(1, 'example', 0, 'text')
TEN_TIMES = (0, 2, 1, 3, 3, 5, 4, 7, 8, 9)


@dataclass(frozen=True)
class Content:
    """What a family of files holds: definitions, messages (time, record), things beside."""

    schema: bytes = b''
    channel: bytes = b''
    messages: tuple[tuple[int, bytes], ...] = ()
    attachment: bytes = b''
    metadata: bytes = b''


def _message(time: int, sequence: int, published: int) -> tuple[int, bytes]:
    return time, m.message(time, DATA, 1, sequence, published)


_FILE = m.number(8, 2) + m.number(8, 1) + m.text('myFile') + m.text('application/octet-stream')
_FILE += m.number(8, len(DATA)) + DATA
CONTENTS = {
    'NoData': Content(),
    'OneMessage': Content(EXAMPLE, TOPIC, (_message(2, 10, 1),)),
    'OneAttachment': Content(attachment=m.record(9, _FILE + m.number(4, zlib.crc32(_FILE)))),
    'OneMetadata': Content(metadata=m.metadata('myMetadata', {'foo': 'bar'})),
    'OneSchemalessMessage': Content(b'', BARE_TOPIC, (_message(2, 10, 1),)),
    'TenMessages': Content(
        EXAMPLE, TOPIC, tuple(_message(time, k, time) for k, time in enumerate(TEN_TIMES))
    ),
}


def cases() -> Iterator[tuple[str, str, frozenset[str]]]:
    """Name, content and optional parts of every file."""
    for content, what in CONTENTS.items():
        free = [
            *(['ch', 'mx', 'chx'] if what.messages else []),
            *(['rsh'] if what.schema else []),
            *(['rch'] if what.channel else []),
            *(['ax'] if what.attachment else []),
            *(['mdx'] if what.metadata else []),
            *('st', 'sum', 'pad'),
        ]
        for chosen in product((False, True), repeat=len(free)):
            parts = frozenset(part for part, there in zip(free, chosen, strict=True) if there)
            if parts & {'mx', 'chx'} and 'ch' not in parts:
                continue
            if 'sum' in parts and not parts & {'st', 'rsh', 'rch', 'ax', 'mdx', 'chx'}:
                continue
            yield '-'.join((content, *sorted(parts))), content, parts


class _File:
    """A file being written."""

    def __init__(self, content: Content, parts: frozenset[str]) -> None:
        self.content, self.parts = content, parts
        self.data = m.MAGIC
        self.index = b''
        self.groups: list[tuple[int, int, int]] = []

    def padded(self, record: bytes) -> bytes:
        """A record with bytes after its fields, which readers must pass over."""
        if 'pad' not in self.parts:
            return record
        return m.record(record[0], record[9:] + PAD)

    def written(self) -> bytes:
        """All bytes."""
        self.data += self.padded(m.header('', ''))
        self._data_section()
        self.data += m.record(15, m.number(4, zlib.crc32(self.data)))
        return self._summary()

    def _data_section(self) -> None:
        what = self.content
        if 'ch' in self.parts:
            self._chunk()
        else:
            self.data += b''.join(self.padded(r) for r in (what.schema, what.channel) if r)
            self.data += b''.join(record for _, record in what.messages)
        for record, opcode in ((what.attachment, 10), (what.metadata, 13)):
            if not record:
                continue
            place, record = len(self.data), self.padded(record)
            self.data += record
            fields = m.number(8, place) + m.number(8, len(record))
            if opcode == 10:
                fields += _FILE[:16] + m.number(8, len(DATA)) + _FILE[16 : -8 - len(DATA)]
            else:
                fields += m.text('myMetadata')
            self.index = m.record(opcode, fields)

    def _chunk(self) -> None:
        what = self.content
        body, entries = what.schema + what.channel, b''
        for time, record in what.messages:
            entries += m.number(8, time) + m.number(8, len(body))
            body += record
        times = [time for time, _ in what.messages]
        place, stored = len(self.data), m.chunk(body, min(times), max(times))
        self.data += stored
        offsets, length = b'', 0
        if 'mx' in self.parts:
            offsets = m.number(2, 1) + m.number(8, len(self.data))
            record = self.padded(m.record(7, m.number(2, 1) + m.block(entries)))
            self.data += record
            length = len(record)
        fields = m.number(8, min(times)) + m.number(8, max(times)) + m.number(8, place)
        fields += m.number(8, len(stored)) + m.block(offsets) + m.number(8, length)
        self.index = m.record(8, fields + m.text('') + m.number(8, len(body)) * 2)

    def _summary(self) -> bytes:
        what = self.content
        times = [time for time, _ in what.messages]
        counts = m.number(2, 1) + m.number(8, len(times)) if times else b''
        totals = m.number(8, len(times)) + m.number(2, bool(what.schema))
        totals += m.number(4, bool(what.channel)) + m.number(4, bool(what.attachment))
        totals += m.number(4, bool(what.metadata)) + m.number(4, 'ch' in self.parts)
        totals += m.number(8, min(times, default=0)) + m.number(8, max(times, default=0))
        start = len(self.data)
        summary, groups = b'', b''
        for part, record in (
            ('rsh', what.schema),
            ('rch', what.channel),
            ('st', m.record(11, totals + m.block(counts))),
            ('chx', self.index),
            ('ax', self.index),
            ('mdx', self.index),
        ):
            if part in self.parts:
                record = self.padded(record)
                fields = record[:1] + m.number(8, start + len(summary)) + m.number(8, len(record))
                groups += self.padded(m.record(14, fields))
                summary += record
        offsets = start + len(summary) if 'sum' in self.parts else 0
        if offsets:
            summary += groups
        foot = m.number(8, start if summary else 0) + m.number(8, offsets)
        foot = m.record(2, foot + m.number(4, 0))[:-4]
        return self.data + summary + foot + m.number(4, zlib.crc32(summary + foot)) + m.MAGIC


def written(content: str, parts: frozenset[str]) -> bytes:
    """The bytes of one file of the suite."""
    return _File(CONTENTS[content], parts).written()
