# SPDX-License-Identifier: Apache-2.0
"""Reading: every kind of bag gives its messages in time order, or one sentence."""

from __future__ import annotations

import os
import shutil
import sqlite3
from pathlib import Path

import pytest
from bag_samples import DATA, library_file, string_cdr, write_strings
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType

from grasp_replay.bag_reader import open_bag
from grasp_replay.errors import BagError


def _texts(path: Path, **choice: object) -> list[str]:
    with open_bag(path) as bag:
        return [bag.decode(message).data for message in bag.messages(**choice)]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('name', 'topics', 'messages', 'storage'),
    [
        ('all_types', 94, 188, 'mcap'),
        ('talker', 3, 20, 'mcap'),
        ('talker_sqlite3', 3, 20, 'sqlite3'),
        ('wbag', 8, 6074, 'mcap'),
        ('wrong_rmw_test', 2, 7, 'mcap'),
    ],
)
def test_foreign_bags_are_read_completely_and_in_order(
    name: str, topics: int, messages: int, storage: str
) -> None:
    with open_bag(DATA / name) as bag:
        times = [message.log_time for message in bag.messages()]
        assert (len(bag.topics), len(times), bag.message_count) == (topics, messages, messages)
        assert bag.storage == storage
    assert times == sorted(times)


def test_all_94_foreign_types_are_decoded() -> None:
    with open_bag(DATA / 'all_types') as bag:
        kinds = {type(bag.decode(message)).__name__ for message in bag.messages()}
    assert len(kinds) == 94


def test_a_topic_without_messages_is_listed() -> None:
    with open_bag(DATA / 'talker') as bag:
        assert bag.topics['/parameter_events'].count == 0


def test_wrong_serialisation_is_named_when_decoded() -> None:
    with (
        open_bag(DATA / 'wrong_rmw_test') as bag,
        pytest.raises(BagError, match=r"serialised as 'wrong_format'; only cdr"),
    ):
        bag.decode(next(bag.messages()))


def test_a_message_that_does_not_fit_its_type_is_named() -> None:
    with (
        open_bag(DATA / 'talker_sqlite3') as bag,
        pytest.raises(BagError, match=r'topic /rosout.*is no rcl_interfaces/msg/Log'),
    ):
        bag.decode(next(bag.messages(['/rosout'])))


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('chunked', [True, False])
@pytest.mark.parametrize('indexed', [True, False])
def test_every_form_of_mcap_gives_the_same_messages(
    tmp_path: Path, compression: CompressionType, chunked: bool, indexed: bool
) -> None:
    path = library_file(
        tmp_path / 'x.mcap', compression=compression, chunked=chunked, indexed=indexed
    )
    assert _texts(path) == [f'message {index}' for index in range(40)]


def test_missing_metadata_is_noted_and_survived(tmp_path: Path) -> None:
    bag_path = shutil.copytree(DATA / 'wbag', tmp_path / 'wbag')
    (bag_path / 'metadata.yaml').unlink()
    with open_bag(bag_path) as bag:
        assert sum(1 for _ in bag.messages()) == 6074
        assert 'metadata.yaml is missing' in bag.notes[0]


def test_unusable_metadata_is_noted_and_survived(tmp_path: Path) -> None:
    bag_path = shutil.copytree(DATA / 'talker', tmp_path / 'talker')
    (bag_path / 'metadata.yaml').write_text('rosbag2_bagfile_information: [')
    with open_bag(bag_path) as bag:
        assert bag.message_count == 20
        assert 'metadata.yaml cannot be used' in bag.notes[0]


def test_a_false_message_count_in_the_metadata_is_noted(tmp_path: Path) -> None:
    bag_path = shutil.copytree(DATA / 'talker', tmp_path / 'talker')
    text = (bag_path / 'metadata.yaml').read_text()
    (bag_path / 'metadata.yaml').write_text(text.replace('message_count: 20', 'message_count: 21'))
    with open_bag(bag_path) as bag:
        assert bag.notes == ['metadata.yaml declares 21 messages, the files hold 20']


def test_a_missing_file_of_several_is_named(tmp_path: Path) -> None:
    bag_path = shutil.copytree(DATA / 'wbag', tmp_path / 'wbag')
    (bag_path / 'wbag_3.mcap').unlink()
    with pytest.raises(BagError, match=r'lacks wbag_3\.mcap'):
        open_bag(bag_path)


def test_a_path_that_does_not_exist_is_named(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='does not exist; give a bag directory'):
        open_bag(tmp_path / 'nothing')


def test_an_empty_directory_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r'holds no \.mcap and no \.db3 file'):
        open_bag(tmp_path)


def test_a_ros1_bag_is_named_with_the_way_to_convert_it(tmp_path: Path) -> None:
    path = tmp_path / 'old.bag'
    path.write_bytes(b'#ROSBAG V2.0\n' + b'\0' * 100)
    with pytest.raises(BagError, match=r'is a ROS 1 bag; convert it first: rosbags-convert'):
        open_bag(path)


@pytest.mark.parametrize('content', [b'', b'\x89PNG\r\n\x1a\n', b'hello'])
def test_a_file_that_is_no_bag_is_refused(tmp_path: Path, content: bytes) -> None:
    for name in ('x.mcap', 'x.db3', 'x.txt'):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(BagError):
            open_bag(path)


def test_a_foreign_sqlite_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'other.db3'
    connection = sqlite3.connect(path)
    connection.execute('create table things (id integer)')
    connection.commit()
    connection.close()
    with pytest.raises(BagError, match='missing tables'):
        open_bag(path)


def test_a_cut_bag_is_refused_with_the_way_to_save_it(tmp_path: Path) -> None:
    path = library_file(tmp_path / 'x.mcap')
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(BagError, match='is damaged: .* save what is sound with `bag_check x.mcap'):
        open_bag(path)


def test_a_flipped_bit_in_a_message_is_found_by_the_checksum(tmp_path: Path) -> None:
    path = library_file(tmp_path / 'x.mcap')
    content = bytearray(path.read_bytes())
    content[content.index(b'message 7') + 8] ^= 1
    path.write_bytes(content)
    with open_bag(path) as bag, pytest.raises(BagError, match='does not match its checksum'):
        list(bag.messages())


def test_topics_and_times_select_messages(tmp_path: Path) -> None:
    path = library_file(tmp_path / 'x.mcap')
    assert _texts(path, topics=['/a'], start=100, stop=160) == [
        'message 10',
        'message 12',
        'message 14',
    ]


def test_one_topic_with_two_types_is_refused(tmp_path: Path) -> None:
    from grasp_replay.bag_writer import BagWriter

    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/x', 'std_msgs/msg/String')
        writer.add_topic('/x', 'std_msgs/msg/Float64')
    with pytest.raises(BagError, match='holds both std_msgs/msg/String and std_msgs/msg/Float64'):
        open_bag(tmp_path / 'bag')


@settings(max_examples=30, deadline=None)
@given(times=st.lists(st.integers(0, 1000), max_size=60), chunk=st.integers(1, 20))
@example(times=[1, 1, 0, 1], chunk=2)
def test_messages_come_in_time_order_and_equal_times_in_file_order(
    tmp_path_factory: pytest.TempPathFactory, times: list[int], chunk: int
) -> None:
    directory = tmp_path_factory.mktemp('order') / 'bag'
    write_strings(
        directory,
        [('/x', time, str(index)) for index, time in enumerate(times)],
        chunk_every=chunk,
    )
    expected = sorted(range(len(times)), key=lambda index: times[index])
    assert _texts(directory) == [str(index) for index in expected]


def test_an_independent_reader_sees_the_same_messages(tmp_path: Path) -> None:
    directory = write_strings(
        tmp_path / 'bag', [('/x', index, f'text {index}') for index in range(500)], chunk_every=50
    )
    with (directory / 'bag_0.mcap').open('rb') as stream:
        theirs = [message.data for _, _, message in make_reader(stream).iter_messages()]
    with open_bag(directory) as bag:
        ours = [message.data for message in bag.messages()]
    assert ours == theirs == [string_cdr(f'text {index}') for index in range(500)]


def test_a_pipe_is_no_bag_and_nobody_waits_for_its_writer(tmp_path):
    os.mkfifo(tmp_path / 'pipe.mcap')
    with pytest.raises(BagError, match='no regular file'):
        open_bag(tmp_path / 'pipe.mcap')
