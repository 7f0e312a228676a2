# SPDX-License-Identifier: Apache-2.0
"""Descriptions beside a bag that expand or nest beyond reason cost neither time nor memory."""

from pathlib import Path

import pytest

from grasp_replay.bag_reader import read_metadata
from grasp_replay.errors import BagError
from grasp_replay.experiment import read_experiment

LAUGHS = 'a: &a [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n' + ''.join(
    f'{chr(97 + i)}: &{chr(97 + i)} [{",".join(["*" + chr(96 + i)] * 9)}]\n' for i in range(1, 9)
)
BOMBS = [LAUGHS + 'name: *i\nobject: *i\n', '[' * 20_000, '{a: ' * 20_000]


@pytest.mark.parametrize('text', BOMBS)
def test_a_description_that_is_a_bomb_is_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / 'experiment.yaml').write_text(text)
    with pytest.raises(BagError, match=r'experiment.yaml cannot be read \(') as caught:
        read_experiment(tmp_path)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize('text', BOMBS)
def test_metadata_that_is_a_bomb_is_a_note(tmp_path: Path, text: str) -> None:
    (tmp_path / 'metadata.yaml').write_text(text)
    information, notes = read_metadata(tmp_path)
    assert information == {} and 'cannot be used' in notes[0]
    assert len(notes[0]) < 500


def test_metadata_that_is_a_device_is_not_read(tmp_path: Path) -> None:
    (tmp_path / 'metadata.yaml').symlink_to('/dev/zero')
    assert read_metadata(tmp_path)[0] == {}
