# SPDX-License-Identifier: Apache-2.0
"""Small bags for tests, made with the `mcap` library directly where ours must not be the judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mcap.writer import CompressionType, IndexType, Writer

from grasp_replay.bag_writer import BagWriter
from grasp_replay.qos import QosProfile, qos_text

DATA = Path(__file__).parent / 'data'
STRING_DEFINITION = b'string data\n'


def string_cdr(text: str) -> bytes:
    """A std_msgs/String as little-endian CDR."""
    data = text.encode() + b'\0'
    return b'\x00\x01\x00\x00' + len(data).to_bytes(4, 'little') + data


def write_strings(
    directory: Path,
    messages: Sequence[tuple[str, int, str]],
    *,
    compression: str = 'none',
    chunk_every: int = 0,
    qos: Mapping[str, Sequence[QosProfile]] | None = None,
) -> Path:
    """A bag of (topic, log time in ns, text), flushed after every `chunk_every` messages.

    `qos`: the profiles of topics whose publishers did not offer the default.
    """
    with BagWriter(directory, compression=compression) as writer:
        numbers: dict[str, int] = {}
        for index, (topic, time, text) in enumerate(messages):
            if topic not in numbers:
                profiles = (qos or {}).get(topic, [QosProfile()])
                numbers[topic] = writer.add_topic(
                    topic, 'std_msgs/msg/String', qos_text(*profiles)
                )
            writer.write(numbers[topic], string_cdr(text), time)
            if chunk_every and (index + 1) % chunk_every == 0:
                writer.flush()
    return directory


def library_file(
    path: Path,
    count: int = 40,
    *,
    compression: CompressionType = CompressionType.NONE,
    chunked: bool = True,
    chunk_size: int = 300,
    indexed: bool = True,
) -> Path:
    """An .mcap file written by the `mcap` library alone: `count` strings on two topics."""
    with path.open('wb') as stream:
        writer = Writer(
            stream,
            chunk_size=chunk_size,
            compression=compression,
            use_chunking=chunked,
            index_types=IndexType.ALL if indexed else IndexType.NONE,
            use_statistics=indexed,
            repeat_channels=indexed,
            repeat_schemas=indexed,
        )
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', STRING_DEFINITION)
        channels = [writer.register_channel(name, 'cdr', schema) for name in ('/a', '/b')]
        for index in range(count):
            writer.add_message(
                channels[index % 2], index * 10, string_cdr(f'message {index}'), index * 10
            )
        writer.finish()
    return path
