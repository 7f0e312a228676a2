# SPDX-License-Identifier: Apache-2.0
"""How every kind of MCAP record proves its own length: what its fields say must fill its bytes."""

from __future__ import annotations

import re
from collections.abc import Callable

from grasp_replay.mcap_blocks import (
    ATTACHMENT_INDEX,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MESSAGE_INDEX,
    METADATA,
    METADATA_INDEX,
    STATISTICS,
    SUMMARY_OFFSET,
    Damage,
    Fields,
    parse_chunk_header,
)

# Record prefix, start, end, uncompressed size, checksum, compression name.
CHUNK_SIGNATURE = re.compile(
    rb'\x06(?=.{8}.{28}(?:\x00\x00\x00\x00|\x03\x00\x00\x00lz4|\x04\x00\x00\x00zstd))', re.DOTALL
)
SIGNATURE_BYTES = 9 + 28 + 8
# How each record with variable or fixed fields proves its own length.
SMALL_RECORDS: dict[int, Callable[[Fields], object]] = {
    HEADER: lambda fields: (fields.text(), fields.text()),
    MESSAGE_INDEX: lambda fields: (fields.take(2), fields.take(fields.integer(4))),
    CHUNK_INDEX: lambda fields: (
        fields.take(32),
        fields.take(fields.integer(4)),
        fields.take(8),
        fields.text(),
        fields.take(16),
    ),
    ATTACHMENT_INDEX: lambda fields: (fields.take(40), fields.text(), fields.text()),
    STATISTICS: lambda fields: (fields.take(42), fields.take(fields.integer(4))),
    METADATA: lambda fields: (fields.text(), fields.string_map()),
    METADATA_INDEX: lambda fields: (fields.take(16), fields.text()),
    SUMMARY_OFFSET: lambda fields: fields.take(17),
    DATA_END: lambda fields: fields.take(4),
    FOOTER: lambda fields: fields.take(20),
}
# Those that are read elsewhere, for holding bytes against them.
OTHER_RECORDS: tuple[Callable[[Fields], object], ...] = (
    lambda fields: (fields.take(2), fields.text(), fields.text(), fields.take(fields.integer(4))),
    lambda fields: (fields.take(4), fields.text(), fields.text(), fields.string_map()),
    lambda fields: (
        fields.take(16),
        fields.text(),
        fields.text(),
        fields.take(fields.integer(8)),
        fields.take(4),
    ),
)


def is_whole(opcode: int, data: memoryview) -> bool:
    """Do the fields of a small record fill its bytes exactly?"""
    return _fills(SMALL_RECORDS[opcode], data, len(data))


def reads_as_another(data: memoryview, length: int, size: int) -> bool:
    """Do bytes that pass for a message of `length` bytes make a record of another kind?

    `data` holds the first of them, `size` is the length of the file.
    """
    try:
        parse_chunk_header(bytes(data[:64]), 0, length, size)
        return True
    except Damage:
        pass
    readers = (*SMALL_RECORDS.values(), *OTHER_RECORDS)
    return any(_fills(reader, data, length) for reader in readers)


def _fills(reader: Callable[[Fields], object], data: memoryview, length: int) -> bool:
    fields = Fields(data)
    try:
        reader(fields)
    except Damage:
        return False
    return fields.position == length
