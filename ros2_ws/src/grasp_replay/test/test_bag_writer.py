# SPDX-License-Identifier: Apache-2.0
"""Writing: rosbag2's layout, deterministic bytes, and what survives a crash or a full disk."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import pytest
import yaml
from bag_samples import string_cdr, write_strings
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_writer import BagWriter, DiskFull
from grasp_replay.errors import BagError
from grasp_replay.mcap_scan import scan_file
from grasp_replay.qos import QosProfile, qos_text


def test_the_layout_is_rosbag2_version_9(tmp_path: Path) -> None:
    write_strings(tmp_path / 'bag', [('/x', 5, 'a'), ('/x', 9, 'b')])
    document = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    information = document['rosbag2_bagfile_information']
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['bag_0.mcap']
    assert information['starting_time'] == {'nanoseconds_since_epoch': 5}
    assert information['duration'] == {'nanoseconds': 4}
    assert information['topics_with_message_count'][0]['message_count'] == 2
    assert sorted(path.name for path in (tmp_path / 'bag').iterdir()) == [
        'bag_0.mcap',
        'metadata.yaml',
    ]


def test_an_independent_library_reads_the_bag_with_its_qos_and_type_hash(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        profile = QosProfile(durability='transient_local', depth=1)
        topic = writer.add_topic('/w', 'geometry_msgs/msg/WrenchStamped', qos_text(profile))
        writer.write(topic, b'\x00\x01\x00\x00' + b'\0' * 68, 1)
    with Reader(tmp_path / 'bag') as reader:
        connection = reader.connections[0]
        assert reader.message_count == 1
        # The hash that rclpy announces for this type.
        assert connection.digest == (
            'RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77'
        )
        assert connection.ext.offered_qos_profiles[0].durability.name == 'TRANSIENT_LOCAL'
        assert 'MSG: geometry_msgs/Wrench' in connection.msgdef.data


def test_every_chunk_is_indexed_and_carries_a_checksum(tmp_path: Path) -> None:
    write_strings(tmp_path / 'bag', [('/x', i, str(i)) for i in range(100)], chunk_every=10)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        scan = scan_file(stream)
    assert scan.sound
    assert len(scan.blocks) == 10
    assert (scan.unchecked_blocks, scan.unindexed_blocks) == (0, 0)


def test_the_same_calls_give_the_same_bytes(tmp_path: Path) -> None:
    messages = [('/x', index * 1000, f'text {index}') for index in range(300)]
    first = write_strings(tmp_path / '1' / 'bag', messages, compression='zstd')
    second = write_strings(tmp_path / '2' / 'bag', messages, compression='zstd')
    for name in ('bag_0.mcap', 'metadata.yaml'):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_an_existing_directory_is_never_overwritten(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='exists already; a bag is never overwritten'):
        BagWriter(tmp_path)


def test_an_unknown_compression_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="unknown compression 'gzip'"):
        BagWriter(tmp_path / 'bag', compression='gzip')


def test_a_chunk_spans_at_most_one_second(tmp_path: Path) -> None:
    write_strings(tmp_path / 'bag', [('/x', i * 100_000_000, str(i)) for i in range(50)])
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        blocks = scan_file(stream).blocks
    assert max(block.end - block.start for block in blocks) < 1_000_000_000


def test_what_was_flushed_survives_without_a_close(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / 'bag')
    topic = writer.add_topic('/x', 'std_msgs/msg/String')
    for index in range(25):
        writer.write(topic, string_cdr(str(index)), index)
        if index == 19:
            writer.flush()
    with writer.file.open('rb') as stream:
        scan = scan_file(stream)
    assert scan.message_count == 20
    assert not scan.complete
    writer.close()


def test_an_unknown_type_is_recorded_without_definition(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write(writer.add_topic('/x', 'nobody_msgs/msg/Nothing'), b'\0\1\0\0', 1)
    with open_bag(tmp_path / 'bag') as bag:
        assert bag.topics['/x'].definition == ''
        message = next(bag.messages())
        with pytest.raises(BagError, match='nobody_msgs/msg/Nothing is unknown'):
            bag.decode(message)


def test_a_closed_bag_takes_no_more_messages(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / 'bag')
    topic = writer.add_topic('/x', 'std_msgs/msg/String')
    writer.close()
    with pytest.raises(BagError, match='is closed'):
        writer.write(topic, b'', 0)


class SmallDisk:
    """A file on a disk with `room` bytes for it, and as many more as the reserve gives back."""

    def __init__(self, path: Path, room: int, code: int = errno.ENOSPC) -> None:
        self.stream = path.open('xb', buffering=0)
        self.reserve = path.parent / '.reserve'
        self.room = room
        self.code = code

    def write(self, data: Any) -> int:
        free = self.room + (0 if self.reserve.exists() else 2**20) - self.stream.tell()
        if free <= 0:
            raise OSError(self.code, 'No space left on device')
        return self.stream.write(memoryview(data)[:free])

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def _record_until_full(writer: BagWriter) -> int:
    topic = writer.add_topic('/x', 'std_msgs/msg/String')
    index = 0
    while index < 100_000:
        writer.write(topic, string_cdr('x' * 500), index * 10_000_000)
        index += 1
    return index


def test_a_full_disk_ends_the_recording_with_a_valid_bag(tmp_path: Path) -> None:
    writer = BagWriter(
        tmp_path / 'bag',
        compression='none',
        reserve_bytes=2**20,
        open_file=lambda path: SmallDisk(path, 400_000),
    )
    with pytest.raises(DiskFull, match='was closed with .* messages and is valid'):
        _record_until_full(writer)
    with open_bag(tmp_path / 'bag') as bag:
        assert not bag.notes
        assert sum(1 for _ in bag.messages()) == bag.message_count == writer.message_count > 600


def test_a_disk_full_beyond_the_reserve_leaves_whole_chunks(tmp_path: Path) -> None:
    writer = BagWriter(
        tmp_path / 'bag',
        compression='none',
        reserve_bytes=0,
        open_file=lambda path: SmallDisk(path, -(2**20) + 400_000),
    )
    with pytest.raises(BagError, match='cannot be written further: No space left'):
        _record_until_full(writer)
    with writer.file.open('rb') as stream:
        scan = scan_file(stream)
    assert scan.message_count > 600
    assert scan.lost[0].start == scan.size


def test_a_failing_disk_is_named(tmp_path: Path) -> None:
    writer = BagWriter(
        tmp_path / 'bag',
        reserve_bytes=2**20,
        compression='none',
        open_file=lambda path: SmallDisk(path, 400_000, errno.EIO),
    )
    with pytest.raises(BagError, match='cannot be written further'):
        _record_until_full(writer)


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_each_compression_is_read_by_an_independent_reader(
    tmp_path: Path, compression: str
) -> None:
    write_strings(tmp_path / 'bag', [('/x', 1, 'hello')], compression=compression)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        messages = list(make_reader(stream, validate_crcs=True).iter_messages())
    assert [message.data for _, _, message in messages] == [string_cdr('hello')]
