# SPDX-License-Identifier: Apache-2.0
"""Damages bags in the ways that disks, cables and cosmic rays do, and knows what must survive."""

from __future__ import annotations

import io
import random
from dataclasses import dataclass

from grasp_replay.mcap_blocks import block_messages, load_block
from grasp_replay.mcap_scan import Scan, scan_file

Key = tuple[str, int, bytes]


@dataclass(frozen=True)
class Original:
    """A sound file, its chunks as (first byte, end byte), and the messages of each."""

    content: bytes
    chunks: list[tuple[int, int]]
    messages: list[set[Key]]


def original(content: bytes) -> Original:
    """Take a sound file apart."""
    stream = io.BytesIO(content)
    scan = scan_file(stream)
    assert scan.sound
    chunks = [
        (checked.block.record_start, checked.block.offset + checked.block.length)
        for checked in scan.blocks
    ]
    return Original(content, chunks, [_keys(stream, scan, i) for i in range(len(chunks))])


def recovered(content: bytes) -> tuple[Scan, set[Key]]:
    """What a scan of `content` finds: messages by topic, log time and bytes."""
    stream = io.BytesIO(content)
    scan = scan_file(stream)
    found: set[Key] = set()
    for index in range(len(scan.blocks)):
        found |= _keys(stream, scan, index)
    return scan, found


def _keys(stream: io.BytesIO, scan: Scan, index: int) -> set[Key]:
    channels = scan.definitions.channels
    return {
        (channels[message.channel_id].topic, message.log_time, bytes(message.data))
        for message in block_messages(load_block(stream, scan.blocks[index].block), None)
        if message.channel_id in channels
    }


def damage(content: bytes, generator: random.Random) -> tuple[bytes, int, int]:
    """A damaged copy and the range [start, end) of the original that was touched."""
    size = len(content)
    start = generator.randrange(size)
    length = min(generator.choice((1, 1, 1, 2, 8, 64, 512)), size - start)
    end = start + length
    kind = generator.randrange(6)
    if kind == 0:
        middle = bytes([content[start] ^ (1 << generator.randrange(8))])
        return content[:start] + middle + content[start + 1 :], start, start + 1
    if kind == 1:
        return content[:start] + generator.randbytes(length) + content[end:], start, end
    if kind == 2:
        return content[:start] + bytes(length) + content[end:], start, end
    if kind == 3:
        return content[:start] + content[end:], start, end
    if kind == 4:
        return content[:start] + generator.randbytes(length) + content[start:], start, start
    return content[:start], start, size


def untouched(source: Original, start: int, end: int) -> set[Key]:
    """The messages of the chunks that a change of [start, end) leaves whole."""
    safe: set[Key] = set()
    for (first, last), messages in zip(source.chunks, source.messages, strict=True):
        inside = start == end and first < start < last
        if not inside and (end <= first or start >= last):
            safe |= messages
    return safe
