# SPDX-License-Identifier: Apache-2.0
"""Bags as recorders, disks and people leave them: read rightly, or refused for what they are."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from pathlib import Path

import bag_mutations
import lz4.frame
import mcap_bytes as m
import pytest
from mcap_bytes import SECOND

from grasp_replay.bag_reader import open_bag, read_metadata
from grasp_replay.commands.bag_check import check
from grasp_replay.errors import BagError
from grasp_replay.mcap_blocks import zstd
from grasp_replay.mcap_scan import scan_file
from grasp_replay.replay_core import refusal

LOOSE = (
    m.header()
    + m.schema()
    + m.channel()
    + b''.join(m.message(i * SECOND, m.cdr(f'{i} s')) for i in range(1, 6))
)


def _file(folder: Path, data: bytes, name: str = 'x.mcap') -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def _texts(path: Path) -> list[str]:
    with open_bag(path) as bag:
        return [bag.decode(message).data for message in bag.messages()]


def _two_chunks(
    first: bytes,
    second: bytes,
    times: tuple[int, int, int, int],
    counts: dict[int, int],
    named: tuple[int, ...] = (0, 1),
) -> bytes:
    """A file of two chunks and an index that names those of these numbers."""
    one, two = m.chunk(first, *times[:2]), m.chunk(second, *times[2:])
    place = len(m.MAGIC) + len(m.header())
    index = (
        m.chunk_index(place, one, *times[:2]),
        m.chunk_index(place + len(one), two, *times[2:]),
    )
    summary = m.schema() + m.channel() + m.statistics(counts, len(named), times[0], times[3])
    summary += b''.join(index[number] for number in named)
    return m.whole(m.header() + one + two, summary)


def test_messages_recorded_before_the_simulated_clock_ran_are_kept(tmp_path: Path) -> None:
    first = m.schema() + m.channel() + m.message(0, m.cdr('a')) * 2
    second = m.message(5 * SECOND, m.cdr('b')) + m.message(6 * SECOND, m.cdr('c'))
    path = _file(tmp_path, _two_chunks(first, second, (0, 0, 5 * SECOND, 6 * SECOND), {1: 4}))
    with open_bag(path) as bag:
        assert (bag.start, bag.end, bag.message_count) == (0, 6 * SECOND, 4)
    assert _texts(path) == ['a', 'a', 'b', 'c']


def test_an_empty_chunk_does_not_begin_a_bag_at_time_zero(tmp_path: Path) -> None:
    second = m.message(5 * SECOND, m.cdr('b')) + m.message(6 * SECOND, m.cdr('c'))
    data = _two_chunks(m.schema() + m.channel(), second, (0, 0, 5 * SECOND, 6 * SECOND), {1: 2})
    with open_bag(_file(tmp_path, data)) as bag:
        assert bag.duration == 1.0


def test_types_that_the_summary_does_not_repeat_are_found_in_the_chunks(tmp_path: Path) -> None:
    body = m.schema() + m.channel() + m.message(SECOND, m.cdr('a'))
    stored = m.chunk(body, SECOND, SECOND)
    place = len(m.MAGIC) + len(m.header())
    summary = m.channel() + m.statistics({1: 1}, 1, SECOND, SECOND)
    summary += m.chunk_index(place, stored, SECOND, SECOND)
    path = _file(tmp_path, m.whole(m.header() + stored, summary))
    with open_bag(path) as bag:
        assert bag.topics['/a'].type_name == m.STRING
    assert _texts(path) == ['a']


def test_a_topic_without_a_type_is_named_and_not_replayed(tmp_path: Path) -> None:
    data = m.header() + m.channel(1, '/p', schema_id=0) + m.message(SECOND, m.cdr('a'))
    with open_bag(_file(tmp_path, m.whole(data))) as bag:
        assert refusal(bag.topics['/p']) == 'the recording does not name its type'


@pytest.mark.parametrize('indexed', [True, False])
def test_a_channel_that_is_defined_twice_is_damage(tmp_path: Path, indexed: bool) -> None:
    first = m.schema() + m.channel() + m.message(SECOND, m.cdr('a'))
    second = m.channel(1, '/b') + m.message(2 * SECOND, m.cdr('b'))
    if indexed:
        data = _two_chunks(first, second, (SECOND, SECOND, 2 * SECOND, 2 * SECOND), {1: 2})
    else:
        data = m.whole(m.header() + first + second)
    path = _file(tmp_path, data)
    assert not check(path)['sound']
    with pytest.raises(BagError, match=r'channel 1 is defined twice.*/a and on /b'):
        _texts(path)


def test_one_type_by_two_layouts_on_a_topic_is_refused(tmp_path: Path) -> None:
    pair = b'\0\1\0\0' + struct.pack('<dd', 1.0, 2.0)
    layouts = (b'float64 a\nfloat64 b\n', b'float64 b\nfloat64 a\n')
    data = m.header() + b''.join(
        m.schema(k, 'x_msgs/msg/P', layout) + m.channel(k, '/p', schema_id=k)
        for k, layout in enumerate(layouts, 1)
    )
    data += m.message(SECOND, pair) + m.message(2 * SECOND, pair, identity=2)
    with pytest.raises(BagError, match='by two definitions that differ'):
        open_bag(_file(tmp_path, m.whole(data)))


def test_one_type_whose_definitions_differ_in_comments_is_read(tmp_path: Path) -> None:
    data = m.header() + m.schema() + m.channel()
    data += m.schema(2, m.STRING, b'# of another release\nstring data\n') + m.channel(2, '/a', 2)
    data += m.message(SECOND, m.cdr('a')) + m.message(2 * SECOND, m.cdr('b'), identity=2)
    assert _texts(_file(tmp_path, m.whole(data))) == ['a', 'b']


def test_a_flipped_byte_outside_chunks_is_told_by_the_data_section(tmp_path: Path) -> None:
    path = _file(tmp_path, m.whole(LOOSE).replace(m.cdr('3 s'), m.cdr('7 s')))
    (lost,) = check(path)['lost']
    assert 'do not match their checksum' in lost['text']
    with pytest.raises(BagError, match='damaged'):
        open_bag(path)


def test_a_flipped_byte_in_an_attachment_is_found_and_named(tmp_path: Path) -> None:
    data = m.whole(m.header() + m.attachment('hand.yaml', b'gain: 1.0') + LOOSE[len(m.header()) :])
    path = _file(tmp_path, data.replace(b'gain: 1.0', b'gain: 7.0'))
    (lost,) = check(path)['lost']
    assert "attachment 'hand.yaml' does not match its checksum" in lost['reason']


def test_recovery_keeps_attachments_and_metadata(tmp_path: Path) -> None:
    data = m.header() + m.attachment('hand.yaml', b'gain: 1.0') + m.metadata('run', {'by': 'me'})
    path = _file(tmp_path, m.whole(data + LOOSE[len(m.header()) :])[:-30])
    saved = check(path, tmp_path / 'saved')['recovered']
    assert (saved['messages'], saved['attachments'], saved['metadata']) == (5, 1, 1)
    again = check(tmp_path / 'saved', tmp_path / 'again')['recovered']
    assert (again['attachments'], again['metadata'], again['left']) == (1, 1, [])


def _split(compression: str, body: bytes) -> bytes:
    half = len(body) // 2
    pieces = body[:half], body[half:]
    if compression == 'lz4':
        return b''.join(map(lz4.frame.compress, pieces))
    return b''.join(map(zstd.compress, pieces))


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
@pytest.mark.parametrize('front', [b'', b'\x50\x2a\x4d\x18\4\0\0\0abcd'])
def test_a_chunk_of_several_frames_is_read(tmp_path: Path, compression: str, front: bytes) -> None:
    body = LOOSE[len(m.header()) :]
    stored = front + _split(compression, body)
    path = _file(
        tmp_path, m.whole(m.header() + m.chunk(body, SECOND, 5 * SECOND, compression, stored))
    )
    assert check(path)['sound']
    assert _texts(path) == [f'{i} s' for i in range(1, 6)]


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_a_chunk_that_ends_within_its_second_frame_is_damaged(
    tmp_path: Path, compression: str
) -> None:
    body = LOOSE[len(m.header()) :]
    stored = _split(compression, body)[:-3]
    data = m.header() + m.chunk(body, SECOND, 5 * SECOND, compression, stored)
    with pytest.raises(BagError, match='holds nothing that can be read'):
        check(_file(tmp_path, m.whole(data)))


@pytest.mark.parametrize('indexed', [True, False])
@pytest.mark.parametrize('before', [True, False])
def test_messages_outside_the_chunks_are_kept_and_named(
    tmp_path: Path, indexed: bool, before: bool
) -> None:
    body = m.schema() + m.channel() + m.message(2 * SECOND, m.cdr('b'))
    stored = m.chunk(body, 2 * SECOND, 2 * SECOND)
    alone = m.message(SECOND if before else 3 * SECOND, m.cdr('alone'))
    front = m.header() + (m.schema() + m.channel() + alone if before else b'')
    data = front + stored + (b'' if before else alone)
    summary = b''
    if indexed:
        summary = m.schema() + m.channel() + m.statistics({1: 2}, 1, SECOND, 3 * SECOND)
        summary += m.chunk_index(len(m.MAGIC) + len(front), stored, 2 * SECOND, 2 * SECOND)
    path = _file(tmp_path, m.whole(data, summary))
    assert sorted(_texts(path)) == ['alone', 'b']
    report = check(path, tmp_path / 'saved')
    assert report['recovered']['messages'] == 2
    assert _texts(tmp_path / 'saved') == _texts(path)


@pytest.mark.parametrize('pack', [zstd.compress, lz4.frame.compress])
def test_messages_compressed_one_by_one_are_known_by_their_bytes(tmp_path: Path, pack) -> None:  # type: ignore[no-untyped-def]
    data = m.header() + m.schema() + m.channel() + m.message(SECOND, pack(m.cdr('hello')))
    path = _file(tmp_path, m.whole(data))
    assert _texts(path) == ['hello']
    report = check(path, tmp_path / 'saved')
    assert any('compressed one by one' in note for note in report['notes'])
    with open_bag(tmp_path / 'saved') as bag:
        assert next(bag.messages()).data == m.cdr('hello')
        assert bag.notes == []


def _listed(folder: Path, *names: str) -> None:
    (folder / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  version: 9\n'
        f'  relative_file_paths: [{", ".join(names)}]\n  message_count: 5\n'
    )


def test_a_file_that_the_metadata_lists_twice_is_read_once(tmp_path: Path) -> None:
    _file(tmp_path, m.whole(LOOSE), 'a_0.mcap')
    _listed(tmp_path, 'a_0.mcap', 'a_0.mcap')
    with open_bag(tmp_path) as bag:
        assert bag.message_count == 5
        assert 'metadata.yaml lists a file twice; it is read once' in bag.notes


def test_files_in_a_subfolder_are_found(tmp_path: Path) -> None:
    _file(tmp_path, m.whole(LOOSE), 'sub/a_0.mcap')
    _listed(tmp_path, 'sub/a_0.mcap')
    assert len(_texts(tmp_path)) == 5


def _database(path: Path, *seconds: int) -> None:
    path.parent.mkdir(exist_ok=True)
    base = sqlite3.connect(path)
    base.execute(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
        'serialization_format TEXT, offered_qos_profiles TEXT)'
    )
    base.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
        'data BLOB)'
    )
    base.execute('INSERT INTO topics VALUES(1, "/a", ?, "cdr", "")', (m.STRING,))
    base.executemany(
        'INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)',
        [(second * SECOND, m.cdr(f'{second} s')) for second in seconds],
    )
    base.commit()
    base.close()


def test_sqlite_files_that_overlap_are_read_in_the_order_of_time(tmp_path: Path) -> None:
    _database(tmp_path / 'a_10.db3', 3, 6)
    _database(tmp_path / 'a_2.db3', 0, 5)
    with open_bag(tmp_path) as bag:
        assert [file.name for file in bag.files] == ['a_2.db3', 'a_10.db3']
        assert (bag.start, bag.end) == (0, 6 * SECOND)
        assert [bag.decode(item).data for item in bag.messages()] == ['0 s', '3 s', '5 s', '6 s']


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (b'version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n', 'git lfs pull'),
        (b'<!DOCTYPE html><html>', 'a web page'),
        (zstd.compress(b'x'), 'zstd -d x.mcap'),
        (b'\x1f\x8b\x08\0', 'gunzip x.mcap'),
        (b'PK\x03\x04', 'unzip x.mcap'),
    ],
)
def test_what_is_met_in_place_of_a_bag_is_named(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = _file(tmp_path, content + b'\0' * 40)
    for read in (open_bag, check):
        with pytest.raises(BagError, match=words):
            read(path)


def test_a_bag_compressed_file_by_file_is_named_without_its_metadata(tmp_path: Path) -> None:
    _file(tmp_path, zstd.compress(m.whole(LOOSE)), 'a_0.mcap.zstd')
    with pytest.raises(BagError, match=r'zstd -d a_0\.mcap\.zstd'):
        open_bag(tmp_path)


def test_messages_in_the_log_of_a_database_are_not_left_out_in_silence(tmp_path: Path) -> None:
    _database(tmp_path / 'whole' / 'a.db3', 1, 2)
    base = sqlite3.connect(tmp_path / 'whole' / 'a.db3')
    base.execute('PRAGMA journal_mode=WAL')
    base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 3, ?)', (m.cdr('c'),))
    base.commit()
    shutil.copytree(tmp_path / 'whole', tmp_path / 'copied')
    base.close()
    path = tmp_path / 'copied'
    with pytest.raises(BagError, match=r'a\.db3-wal holds messages.*journal_mode=DELETE'):
        open_bag(path)
    with sqlite3.connect(path / 'a.db3') as merged:
        merged.execute('PRAGMA journal_mode=DELETE')
    merged.close()
    assert len(_texts(path)) == 3


def test_messages_of_no_topic_and_rows_without_bytes_in_a_database_are_named(
    tmp_path: Path,
) -> None:
    _database(tmp_path / 'a.db3', 1, 2)
    with sqlite3.connect(tmp_path / 'a.db3') as base:
        base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(9, 3, "x")')
    assert (
        '1 messages of a.db3 belong to no topic of it and are left out' in check(tmp_path)['notes']
    )
    with base:
        base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 4, NULL)')
    base.close()
    with pytest.raises(BagError, match='topic /a at 4 ns: the database holds nothing'):
        check(tmp_path)


def test_a_cut_database_is_refused_with_the_way_out(tmp_path: Path) -> None:
    _database(tmp_path / 'a.db3', *range(400))
    os.truncate(tmp_path / 'a.db3', 8192)
    with pytest.raises(BagError, match=r'sqlite3 FILE \.recover'):
        check(tmp_path)


def test_a_folder_of_both_kinds_of_files_is_named(tmp_path: Path) -> None:
    _database(tmp_path / 'a_0.db3', 1)
    _file(tmp_path, m.whole(LOOSE), 'a_1.mcap')
    with pytest.raises(BagError, match='holds MCAP and SQLite files'):
        open_bag(tmp_path)


def test_recovery_keeps_what_channels_and_metadata_say_beside_the_messages(
    tmp_path: Path,
) -> None:
    said = {'offered_qos_profiles': '[: no list', 'origin': 'arm 3'}
    own = m.metadata('rosbag2', {'serialized_metadata': 'custom_data: {cell: north, by: record}'})
    data = m.header() + m.schema() + m.channel(metadata=said) + own + m.message(1, m.cdr('a'))
    path = _file(tmp_path, m.whole(data), 'bag/x.mcap')
    (path.parent / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information: {relative_file_paths: [x.mcap], custom_data: {by: anna}}'
    )
    check(path.parent, tmp_path / 'saved')
    metadata, _ = read_metadata(tmp_path / 'saved')
    assert metadata['custom_data'] == {'cell': 'north', 'by': 'anna', 'recovered_from': 'x.mcap'}
    with (tmp_path / 'saved' / 'saved_0.mcap').open('rb') as stream:
        (kept,) = scan_file(stream).definitions.channels.values()
    assert kept.metadata == said


def test_a_type_that_the_file_does_not_define_is_named(tmp_path: Path) -> None:
    path = _file(tmp_path, m.whole(m.header() + m.channel(schema_id=7) + m.message(1, b'')))
    assert any('the type of /a is not defined' in note for note in check(path)['notes'])


HALVES = (
    m.schema() + m.channel() + m.message(1, m.cdr('a')) + m.message(2, m.cdr('b')),
    m.message(3, m.cdr('c')) + m.message(4, m.cdr('d')),
)


@pytest.mark.parametrize('named', [(0,), (1,), (0, 0), (0, 1, 1), (1, 0)])
def test_an_index_that_names_a_chunk_twice_or_not_at_all_is_not_followed(
    tmp_path: Path, named: tuple[int, ...]
) -> None:
    path = _file(tmp_path, _two_chunks(*HALVES, (1, 2, 3, 4), {1: 4}, named))
    assert _texts(path) == ['a', 'b', 'c', 'd']
    assert check(path)['messages'] == 4


@pytest.mark.parametrize('counts', [{1: 3}, {1: 5}, {}])
def test_a_false_count_in_an_index_is_named_beside_the_true_one(
    tmp_path: Path, counts: dict[int, int]
) -> None:
    path = _file(tmp_path, _two_chunks(*HALVES, (1, 2, 3, 4), counts))
    report = check(path)
    assert (report['messages'], report['topics'][0]['messages']) == (4, 4)
    said = f'the index declares {counts.get(1)} messages on /a, 4 are there'
    assert (said in report['notes']) == bool(counts)


def test_a_chunk_whose_times_are_false_is_damage_for_every_reader(tmp_path: Path) -> None:
    path = _file(tmp_path, _two_chunks(*HALVES, (1, 2, 3, 3), {1: 4}))
    with pytest.raises(BagError, match='outside the times it declares'):
        _texts(path)
    report = check(path, tmp_path / 'saved')
    assert 'outside the times it declares' in report['lost'][0]['reason']
    assert _texts(tmp_path / 'saved') == ['a', 'b', 'c', 'd']


def test_an_empty_file_is_named(tmp_path: Path) -> None:
    for read in (open_bag, check):
        with pytest.raises(BagError, match='is empty; copy or record it again'):
            read(_file(tmp_path, b''))


def test_damaged_bags_of_every_form_end_in_a_sentence_or_in_true_messages(tmp_path: Path) -> None:
    read, _ = bag_mutations.run(400, 4, tmp_path)
    assert 0 < read < 400
