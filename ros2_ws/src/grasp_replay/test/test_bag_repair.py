# SPDX-License-Identifier: Apache-2.0
"""Damage: never a crash, every message of a whole chunk saved, and the loss named."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from bag_damage import Original, damage, original, recovered, untouched
from bag_samples import DATA, library_file, write_strings
from mcap.writer import CompressionType

from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_repair import examine, recover
from grasp_replay.commands.bag_check import check, main
from grasp_replay.errors import BagError


def _bag(path: Path, compression: str, messages: int = 60, chunk: int = 6) -> Original:
    write_strings(
        path,
        [
            (f'/topic_{i % 3}', i * 50_000_000, f'message {i} ' + 'x' * (i % 40))
            for i in range(messages)
        ],
        compression=compression,
        chunk_every=chunk,
    )
    return original((path / f'{path.name}_0.mcap').read_bytes())


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_cut_at_every_byte_all_messages_of_complete_chunks_are_recovered(
    tmp_path: Path, compression: str
) -> None:
    source = _bag(tmp_path / 'bag', compression, messages=24)
    for length in range(len(source.content)):
        scan, found = recovered(source.content[:length])
        assert not scan.sound
        assert scan.lost
        assert found == untouched(source, length, len(source.content)), length


def test_every_byte_changed_once_all_other_chunks_are_recovered(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'none', messages=24)
    everything = set().union(*source.messages)
    for position in range(len(source.content)):
        content = bytearray(source.content)
        content[position] ^= 0x55
        _, found = recovered(bytes(content))
        assert untouched(source, position, position + 1) <= found <= everything, position


@pytest.mark.parametrize('seed', range(5))
def test_random_damage_costs_only_the_chunks_it_touches(tmp_path: Path, seed: int) -> None:
    source = _bag(tmp_path / 'bag', ('none', 'lz4', 'zstd')[seed % 3], messages=200, chunk=20)
    everything = set().union(*source.messages)
    generator = random.Random(seed)
    for index in range(2000):
        content, start, end = damage(source.content, generator)
        _, found = recovered(content)
        assert untouched(source, start, end) <= found <= everything, (seed, index, start, end)


def test_a_recovered_bag_is_sound_and_keeps_topics_qos_times_and_sequence(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'zstd')
    first, last = source.chunks[3]
    content = bytearray(source.content)
    content[(first + last) // 2] ^= 1
    path = tmp_path / 'damaged.mcap'
    path.write_bytes(content)
    examination = examine([path])
    assert recover(examination, tmp_path / 'saved').messages == 54
    with open_bag(tmp_path / 'bag') as old, open_bag(tmp_path / 'saved') as new:
        kept = [m for m in old.messages() if not 900_000_000 <= m.log_time < 1_200_000_000]
        assert list(new.messages()) == kept
        for name, topic in new.topics.items():
            assert topic.qos == old.topics[name].qos
            assert topic.type_hash == old.topics[name].type_hash


def test_the_lost_span_is_named_in_bytes_and_seconds(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'none')
    first, last = source.chunks[3]
    content = bytearray(source.content)
    content[last - 1] ^= 1
    path = tmp_path / 'damaged.mcap'
    path.write_bytes(content)
    (span,) = examine([path]).lost
    assert (span.start, span.end) == (first, last)
    assert span.sentence(0) == (
        f'damaged.mcap, bytes {first} to {last}, between 0.850 s and 1.200 s: '
        f'the chunk at byte {first} does not match its checksum'
    )


def test_the_number_of_lost_messages_is_told_when_the_summary_is_sound(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'none')
    content = bytearray(source.content)
    content[source.chunks[0][1] - 1] ^= 1
    path = tmp_path / 'damaged.mcap'
    path.write_bytes(content)
    report = check(path)
    assert (report['messages'], report['messages_lost']) == (54, 6)


def test_a_chunk_that_declares_a_terabyte_is_not_believed(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'zstd')
    content = bytearray(source.content)
    start = source.chunks[2][0] + 9 + 16
    content[start : start + 8] = (2**40).to_bytes(8, 'little')
    scan, found = recovered(bytes(content))
    assert 'declares 1099511627776 bytes' in scan.lost[0].reason
    assert found == untouched(source, start, start + 8)


def test_messages_outside_chunks_are_recovered_up_to_the_cut(tmp_path: Path) -> None:
    path = library_file(tmp_path / 'x.mcap', chunked=False, indexed=False)
    content = path.read_bytes()
    cut = content.index(b'message 20')
    _, found = recovered(content[:cut])
    assert len(found) == 20


@pytest.mark.parametrize('compression', list(CompressionType))
def test_a_file_without_index_is_made_whole(tmp_path: Path, compression: CompressionType) -> None:
    path = library_file(tmp_path / 'x.mcap', compression=compression, indexed=False)
    report = check(path, tmp_path / 'saved')
    assert report['sound']
    assert 'chunks have no message index' in ' '.join(report['notes'])
    again = check(tmp_path / 'saved')
    assert again['notes'] == []
    assert again['messages'] == 40


def test_a_bag_without_messages_declares_none(tmp_path: Path) -> None:
    write_strings(tmp_path / 'bag', [])
    assert examine([tmp_path / 'bag' / 'bag_0.mcap']).declared == 0


def test_several_files_are_saved_into_one_bag(tmp_path: Path) -> None:
    report = check(DATA / 'wbag', tmp_path / 'saved')
    assert report['recovered']['messages'] == 6074
    with open_bag(DATA / 'wbag') as old, open_bag(tmp_path / 'saved') as new:
        assert sorted(old.messages()) == sorted(new.messages())


def test_bytes_after_the_end_are_named(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'none')
    scan, found = recovered(source.content + b'rest')
    assert scan.lost[0].reason == 'bytes after the end mark'
    assert len(found) == 60


def test_messages_without_their_definition_are_counted_and_left_out(tmp_path: Path) -> None:
    source = _bag(tmp_path / 'bag', 'none')
    content = bytearray(source.content[: source.chunks[-1][1]])
    content[source.chunks[0][1] - 1] ^= 1
    path = tmp_path / 'damaged.mcap'
    path.write_bytes(content)
    examination = examine([path])
    assert examination.nameless == 54
    assert recover(examination, tmp_path / 'saved').messages == 0


def test_exit_codes_sound_damaged_and_no_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = _bag(tmp_path / 'bag', 'none')
    damaged = tmp_path / 'damaged.mcap'
    damaged.write_bytes(source.content[:-200])
    assert main([str(tmp_path / 'bag')]) == 0
    assert main([str(damaged)]) == 1
    assert 'is damaged' in capsys.readouterr().err
    assert main([str(damaged), '--recover', str(tmp_path / 'saved')]) == 1
    assert '60 messages were saved into' in capsys.readouterr().err
    assert main([str(tmp_path / 'saved')]) == 0
    assert main([str(tmp_path / 'nothing')]) == 1
    with pytest.raises(SystemExit) as exit_info:
        main([])
    assert exit_info.value.code == 2


def test_a_bag_of_nothing_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / 'x.mcap'
    path.write_bytes(b'\x89MCAP0\r\n')
    with pytest.raises(BagError, match='holds nothing that can be read'):
        check(path)


def test_the_json_report_is_the_only_thing_on_stdout(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    assert main([str(DATA / 'talker'), '--json']) == 0
    report = json.loads(capsys.readouterr().out)
    assert report['messages'] == 20
    assert [topic['messages'] for topic in report['topics']] == [0, 10, 10]


def test_recovering_a_sqlite_bag_names_the_tool_that_can(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r'only MCAP files can be recovered; use `sqlite3'):
        check(DATA / 'talker_sqlite3', tmp_path / 'saved')
