# SPDX-License-Identifier: Apache-2.0
"""Recorded turns: a bag with the poses of a grip, solved beside what a wrist felt."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from grasp_replay.commands import grasp_report
from grasp_replay.errors import BagError
from grasp_replay.turning import _unwrapped, is_turn, read_turn, solve_turn

BAGS = Path(__file__).parents[4] / 'bags'
TUBE, CAP = BAGS / 'tube_bend', BAGS / 'cap_unscrew'


def truth(bag):
    return yaml.safe_load((bag / 'truth.yaml').read_text())


def test_bags_with_the_poses_of_a_grip_are_known():
    assert is_turn(TUBE) and is_turn(CAP)
    assert not is_turn(BAGS / 'tennis_ball_two_finger')


def test_poses_and_forces_are_read_with_their_stamps():
    turned = read_turn(CAP)
    assert turned.grip == 'upper' and len(turned.time) == 160
    assert np.degrees(turned.turn[-1]) == pytest.approx([0, 0, 0.2], abs=1e-9)
    assert turned.fingers[0] == pytest.approx([5.0, 5.0, 5.0])


def test_a_turn_of_more_than_half_a_circle_goes_on_round():
    angles = np.radians(np.arange(0.0, 721.0, 30.0))
    short = np.outer((angles + np.pi) % (2 * np.pi) - np.pi, [0, 0, 1.0])
    np.testing.assert_allclose(_unwrapped(short)[:, 2], angles, atol=1e-9)


def test_the_bent_tube_is_solved_beside_the_solid(tmp_path, capsys):
    assert grasp_report.main([str(TUBE), '--out', str(tmp_path), '--json']) == 0
    turn = json.loads(capsys.readouterr().out)
    largest = truth(TUBE)['largest_moment_nm']
    assert turn['largest_torque_nm'] == pytest.approx(largest, rel=0.01)
    assert turn['rms_error_nm'] < 0.01 * largest
    assert json.loads((tmp_path / 'turning.json').read_text()) == turn
    assert (tmp_path / 'turning.csv').read_text().startswith('time_s,turn_rad,torque_nm')
    text = (tmp_path / 'turning.html').read_text()
    assert '<svg' not in text
    assert 'largest torque' in text and '<b>Figure 1.</b>' in text


def test_the_cap_slips_at_the_sum_of_friction_and_is_announced_before():
    turn = solve_turn(CAP, most_cases=12)
    assert turn['message'] == ''
    assert turn['slip_torque_nm'] == pytest.approx(truth(CAP)['slip_torque_nm'], rel=0.02)
    assert turn['warning_before_share'] >= 0.10
    assert turn['rows'][0]['slip_warning'] is False and turn['rows'][-1]['slip_warning'] is True


def copied(bag, folder, **changes):
    shutil.copytree(bag, folder)
    path = folder / 'object.yaml'
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **changes}))
    return folder


def test_a_grip_that_the_object_lacks_is_named(tmp_path):
    bag = copied(TUBE, tmp_path / 'bag', contacts=[], supports=[])
    with pytest.raises(BagError, match='no contacts'):
        solve_turn(bag)
    other = copied(TUBE, tmp_path / 'other', contacts=[{'kind': 'grip', 'where': 'lower'}],
                   supports=[])  # fmt: skip
    with pytest.raises(BagError, match="moves a grip 'upper'; the object file has lower"):
        solve_turn(other)


def test_rows_before_the_end_are_kept_and_the_end_is_said(tmp_path, capsys):
    # A wall that is not there to speak of kinks long before 36 degrees.
    bag = copied(TUBE, tmp_path / 'bag', thickness_m=1e-4, control_vertices=400)
    assert grasp_report.main([str(bag), '--out', str(tmp_path / 'out')]) == 1
    told = capsys.readouterr()
    assert 'no equilibrium' in told.err and 'Not followed to the end' in told.out
    assert len(json.loads((tmp_path / 'out' / 'turning.json').read_text())['rows']) > 1
