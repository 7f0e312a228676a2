# SPDX-License-Identifier: Apache-2.0
"""The stage of the recordings: grasps that fit, forces that are met, bags in canonical order."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bags import canonical, grasps
from bags import settings as places
from bags.experiments import EXPERIMENTS
from bags.recording import START_NS
from bags.stage import Imperfections, Stage, along_pins, quaternion
from hypothesis import given, settings
from hypothesis import strategies as st

from barrett_hand_bridge.emulator.geometry import MountedPin
from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_writer import BagWriter

ROOT = Path(__file__).resolve().parents[1]
STEP_NS = 10_000_000


@pytest.fixture
def stage(request: pytest.FixtureRequest) -> Stage:
    experiment = EXPERIMENTS[request.param]
    made = Stage(experiment.setting(), experiment.seed, experiment.imperfections)
    made.port.start()
    request.addfinalizer(made.port.stop)
    return made


@pytest.mark.parametrize('name', sorted(EXPERIMENTS))
def test_at_first_touch_every_pin_stands_on_the_object_along_its_normal(name: str) -> None:
    setting = EXPERIMENTS[name].setting()
    rest = setting.truth.surface(0.0).moved(
        setting.rotation @ setting.from_solution, setting.origin
    )
    for touch in setting.touches.values():
        distance = np.linalg.norm(rest.vertices - touch.point, axis=1)
        nearest = int(np.argmin(distance))
        assert distance[nearest] < 0.15e-3
        assert rest.normals[nearest] @ touch.inward < -0.9999


@pytest.mark.parametrize(
    ('stage', 'force'),
    [
        ('tennis_ball_two_finger', 16.5),
        ('half_soda_can', 0.756),
        ('tennis_ball_three_finger', 11.0),
        ('cup_off_axis', 4.0),
    ],
    indirect=['stage'],
)
def test_every_finger_in_use_meets_the_prescribed_force(stage: Stage, force: float) -> None:
    stage.step(stage.counts_for(force), 0.01)
    for finger in stage.fingers:
        assert stage.mechanics.truth(finger).force_n == pytest.approx(force, abs=2e-3)
    assert stage.rows[-1].force_n[stage.fingers[0] - 1] == pytest.approx(force, abs=2e-3)


@pytest.mark.parametrize('stage', ['tennis_ball_two_finger'], indirect=True)
def test_the_pins_stand_as_far_apart_as_the_dented_ball_is_wide(stage: Stage) -> None:
    stage.step(stage.counts_for(20.0), 0.01)
    first, second = (np.array(stage.mechanics.truth(f).pin_tip) for f in stage.fingers)
    width = 0.065 - 2 * stage.setting.truth.outer_displacement(stage.force())
    assert np.linalg.norm(second - first) == pytest.approx(width, abs=3e-5)


@pytest.mark.parametrize('stage', ['gauge_drift'], indirect=True)
def test_a_time_lapse_ages_the_gauges_and_not_the_clock_of_the_recording(stage: Stage) -> None:
    stage.time_lapse = 60.0
    for _ in range(10):
        stage.step(stage.counts, 0.01)
    assert stage.mechanics.gauges[1].age_s == pytest.approx(6.0, abs=0.01)


def test_the_bridge_is_not_told_how_the_pins_really_sit() -> None:
    setting = places.ball_between_two_pins()
    stage = Stage(setting, 1, Imperfections())
    stage.port.stop()
    for finger in stage.fingers:
        real = stage.mechanics.body.pins[finger]
        told = setting.touches[finger].pin
        assert 0 < abs(real.length_m - told.length_m) < 1e-3
        assert 0 < abs(real.lean_rad - told.lean_rad) < math.radians(1.5)


@settings(deadline=None, max_examples=50)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    st.floats(0.01, 0.1),
)
def test_the_frame_along_the_pins_is_a_rotation_with_x_along_them(
    away: list[float], size: float
) -> None:
    line = np.array([2.0, 0.0, 0.0]) + away
    rotation = along_pins(np.zeros(3), size * line)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation[:, 0], line / np.linalg.norm(line), atol=1e-12)
    assert quaternion(rotation)[3] >= 0.0


def test_a_contact_out_of_reach_is_refused() -> None:
    with pytest.raises(ValueError, match='does not reach'):
        grasps.touch_at(1, math.pi / 2, 0.5, MountedPin())


def raw_bag(folder: Path, samples: int, skipped: int | None = None) -> tuple[Path, list[int]]:
    """A raw recording with gauge counts and poses, one pose left out."""
    stamps = [START_NS + STEP_NS * (number + 1) for number in range(samples)]
    with open_bag(ROOT / 'bags' / 'half_soda_can') as bag:
        poses = [m.data for m in bag.messages(['/object_pose'])][:samples]
        counts = [m.data for m in bag.messages(['/hand/finger_1/gauge_counts'])][:samples]
    with BagWriter(folder / 'raw', reserve_bytes=0) as writer:
        gauge = writer.add_topic('/hand/finger_1/gauge_counts', 'std_msgs/msg/Float64')
        pose = writer.add_topic('/object_pose', 'geometry_msgs/msg/PoseStamped')
        for number in range(samples):
            writer.write(gauge, counts[number], stamps[number] + 7)
            if number != skipped:
                writer.write(pose, poses[number], stamps[number] + 3)
    return folder / 'raw', stamps


def test_the_canonical_bag_is_sorted_by_stamp_and_topic(tmp_path: Path) -> None:
    raw, stamps = raw_bag(tmp_path, 5)
    assert canonical.write_canonical(raw, tmp_path / 'out', stamps, 0, {}) == 10
    with open_bag(tmp_path / 'out') as bag:
        found = [(message.log_time, message.topic) for message in bag.messages()]
    expected = ['/object_pose', '/hand/finger_1/gauge_counts']
    assert found == [(stamp, topic) for stamp in stamps for topic in expected]


def test_a_recording_with_a_hole_is_refused(tmp_path: Path) -> None:
    raw, stamps = raw_bag(tmp_path, 5, skipped=2)
    with pytest.raises(canonical.IncompleteRecordingError, match='/object_pose'):
        canonical.write_canonical(raw, tmp_path / 'out', stamps, 0, {})


def test_an_unknown_recording_is_named_in_one_sentence() -> None:
    run = subprocess.run(
        [sys.executable, str(ROOT / 'bags' / 'generate.py'), 'no_such'],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert run.returncode == 1
    assert run.stderr.startswith("unknown recording 'no_such': one of tennis_ball_two_finger")


@pytest.mark.soak
def test_recording_again_gives_the_same_truth_wire_bytes_and_scans(
    tmp_path: Path, domain_id: int
) -> None:
    subprocess.run(
        [sys.executable, ROOT / 'bags' / 'generate.py', '--out', tmp_path, 'half_soda_can'],
        check=True,
        timeout=600,
    )
    again, kept = tmp_path / 'half_soda_can', ROOT / 'bags' / 'half_soda_can'
    with open_bag(again) as first, open_bag(kept) as second:
        scans = [list(bag.messages(['/scan/points'])) for bag in (first, second)]
    assert scans[0] == scans[1]
    # The digest of the wire is in truth.yaml.
    assert (again / 'truth.yaml').read_bytes() == (kept / 'truth.yaml').read_bytes()
    with (
        np.load(again / 'truth_series.npz') as first_series,
        np.load(kept / 'truth_series.npz') as second_series,
    ):
        for name in first_series:
            np.testing.assert_array_equal(first_series[name], second_series[name])
