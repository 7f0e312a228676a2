# SPDX-License-Identifier: Apache-2.0
"""`import grasp_replay`: what a notebook finds there."""

import subprocess
import sys
from pathlib import Path

import pytest

import grasp_replay

BAG = Path(__file__).parents[4] / 'bags' / 'tennis_ball_two_finger'


def test_the_import_loads_no_numpy():
    code = 'import grasp_replay, sys; print("numpy" in sys.modules)'
    said = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert said.stdout == 'False\n'


def test_everything_promised_is_there_and_documented():
    assert all(getattr(grasp_replay, name).__doc__ for name in grasp_replay.__all__)
    with pytest.raises(AttributeError, match='no attribute'):
        grasp_replay.nothing  # noqa: B018


def test_a_bag_is_opened_and_a_recording_read():
    with grasp_replay.open_bag(BAG) as bag:
        contacts = next(topic for name, topic in bag.topics.items() if 'hand/contacts' in name)
    recording = grasp_replay.read_recording(BAG)
    assert len(recording.samples) == contacts.count > 100
    assert recording.scans


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(grasp_replay.BagError, match=str(tmp_path)):
        grasp_replay.open_bag(tmp_path)
