# SPDX-License-Identifier: Apache-2.0
"""Every file of the MCAP conformance suite: the same bytes as published, read, checked, saved."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from bag_samples import DATA as FOLDER
from mcap_conformance import CONTENTS, DATA, TEN_TIMES, cases, written

from grasp_replay.bag_reader import open_bag
from grasp_replay.commands.bag_check import check

CASES = {name: (content, parts) for name, content, parts in cases()}
EXPECTED = {
    'OneMessage': [(2, 1, 10)],
    'OneSchemalessMessage': [(2, 1, 10)],
    'TenMessages': sorted((time, time, k) for k, time in enumerate(TEN_TIMES)),
}
"""Log time, publish time and sequence number of each message, in the order of time."""


def test_the_files_are_those_of_the_suite() -> None:
    lines = (FOLDER / 'mcap_conformance.sha256').read_text().splitlines()
    published = {name: digest for digest, name in map(str.split, lines)}
    ours = {
        name: hashlib.sha256(written(content, parts)).hexdigest()
        for name, (content, parts) in CASES.items()
    }
    assert len(ours) == 416
    assert ours == published


@pytest.mark.parametrize('name', CASES)
def test_a_file_of_the_suite_is_read_found_sound_and_saved(tmp_path: Path, name: str) -> None:
    content, parts = CASES[name]
    path = tmp_path / 'x.mcap'
    path.write_bytes(written(content, parts))
    expected = EXPECTED.get(content, [])
    type_name = 'Example' if CONTENTS[content].schema else ''
    report = check(path, tmp_path / 'saved')
    assert report['sound']
    saved = report['recovered']
    assert saved['messages'] == report['messages'] == len(expected)
    assert (saved['attachments'], saved['metadata']) == (
        content == 'OneAttachment',
        content == 'OneMetadata',
    )
    for place in (path, tmp_path / 'saved'):
        with open_bag(place) as bag:
            messages = list(bag.messages())
            assert [(m.log_time, m.publish_time, m.sequence) for m in messages] == expected
            assert {m.data for m in messages} == ({DATA} if expected else set())
            topics = {topic.name: (topic.type_name, topic.count) for topic in bag.topics.values()}
            assert topics == ({'example': (type_name, len(expected))} if expected else {})
