# SPDX-License-Identifier: Apache-2.0
"""The recordings: sound, complete, labelled, within their limits, and true to their truth."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bags import scanner as scanning
from bags.experiments import EXPERIMENTS
from bags.recording import START_NS, TOPICS
from bags.stage import Stage
from bags.surfaces import BallTruth
from scipy.spatial.transform import Rotation

from barrett_hand_bridge.calibration import read_calibration
from grasp_replay.bag_reader import open_bag

ROOT = Path(__file__).resolve().parents[1] / 'bags'
NAMES = sorted(EXPERIMENTS)
BALL = 'tennis_ball_two_finger'
CONTACT, SATURATED, NOT_TARED = 1, 2, 8


def document(name: str, file: str = 'experiment.yaml') -> dict[str, Any]:
    return yaml.safe_load((ROOT / name / file).read_text())


def cloud(message: Any) -> np.ndarray:
    """All fields of a cloud of float32 and uint8 as a structured array."""
    kinds = {7: '<f4', 2: 'u1'}
    layout = np.dtype(
        {
            'names': [field.name for field in message.fields],
            'formats': [kinds[field.datatype] for field in message.fields],
            'offsets': [field.offset for field in message.fields],
            'itemsize': message.point_step,
        }
    )
    return np.frombuffer(bytes(message.data), layout)


def contacts(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) in ns and contacts (n, 3) of a recording."""
    with open_bag(ROOT / name) as bag:
        found = [(m.log_time, cloud(bag.decode(m))) for m in bag.messages(['/hand/contacts'])]
    return np.array([time for time, _ in found]), np.stack([rows for _, rows in found])


def scans(name: str) -> list[tuple[int, np.ndarray]]:
    """Stamp and points (n, 3) of every scan."""
    with open_bag(ROOT / name) as bag:
        found = [(m.log_time, cloud(bag.decode(m))) for m in bag.messages(['/scan/points'])]
    return [(time, np.stack([p['x'], p['y'], p['z']], axis=1)) for time, p in found]


def in_window(stamps: np.ndarray, window: dict[str, Any]) -> np.ndarray:
    seconds = (stamps - START_NS) * 1e-9
    return (seconds >= window['from_s']) & (seconds <= window['to_s'])


@pytest.mark.parametrize('name', NAMES)
class TestEveryRecording:
    def test_it_is_a_sound_bag_with_every_topic_and_its_qos(self, name: str) -> None:
        with open_bag(ROOT / name) as bag:
            assert not bag.notes
            assert set(bag.topics) == set(TOPICS)
            assert all('reliability' in topic.qos for topic in bag.topics.values())
            assert bag.start >= START_NS
            assert bag.duration <= 40.0

    def test_every_cycle_has_one_message_per_hand_topic_in_step(self, name: str) -> None:
        facts = document(name)
        cycles = round(facts['duration_s'] * facts['hand']['cycles_per_second'])
        with open_bag(ROOT / name) as bag:
            for topic in TOPICS:
                if topic.startswith('/hand/') or topic == '/object_pose':
                    assert bag.topics[topic].count == cycles, topic
            times = [message.log_time for message in bag.messages(['/hand/contacts'])]
        assert set(np.diff(times)) == {10_000_000}

    def test_it_says_that_it_is_synthetic(self, name: str) -> None:
        facts = document(name)
        assert facts['synthetic'] is True
        assert facts['values']['measured'] == []
        for file in ('experiment.yaml', 'README.md', 'truth.yaml', 'metadata.yaml'):
            assert 'synthetic' in (ROOT / name / file).read_text().lower(), file

    def test_its_scans_are_listed_and_small_enough(self, name: str) -> None:
        listed = document(name)['scans']
        found = scans(name)
        assert [row['scan_stamp_ns'] for row in listed] == [stamp for stamp, _ in found]
        assert [row['points'] for row in listed] == [len(points) for _, points in found]
        assert all(10_000 < len(points) <= 80_000 for _, points in found)
        assert all(np.isfinite(points).all() for _, points in found)

    def test_its_calibration_belongs_to_its_hand(self, name: str) -> None:
        calibration = read_calibration(ROOT / name / 'calibration.yaml')
        assert calibration.serial_number == str(document(name, 'truth.yaml')['seed'])

    def test_its_holds_carry_the_prescribed_force(self, name: str) -> None:
        facts = document(name)
        fingers = facts['hand']['fingers']
        with np.load(ROOT / name / 'truth_series.npz') as series:
            stamps, force = series['stamp_ns'], series['force_n']
        for window in facts['windows']:
            inside = in_window(stamps, window)
            for finger in fingers:
                held = force[inside, finger - 1]
                if window.get('relaxes'):
                    assert (np.diff(held) <= 1e-9).all()
                    assert 0.9 * window['prescribed_force_n'] < held[0]
                    continue
                assert np.ptp(held[1:]) < 1e-4
                assert held[-1] == pytest.approx(window['prescribed_force_n'], abs=2e-3)

    def test_the_scan_of_a_seed_is_reproduced_to_the_byte(self, name: str) -> None:
        experiment = EXPERIMENTS[name]
        stage = Stage(experiment.setting(), experiment.seed, experiment.imperfections)
        stage.port.stop()
        _, points = scans(name)[0]
        rotation, origin = stage.pose()
        surface = stage.setting.truth.surface(0.0)
        again = scanning.scan(
            surface.moved(rotation @ stage.setting.from_solution, origin),
            list(experiment.views),
            [],
            origin,
            experiment.scanner,
            experiment.seed * 1000,
        )
        assert points.tobytes() == again.points.tobytes()


def test_all_recordings_together_are_small() -> None:
    size = {name: sum(file.stat().st_size for file in (ROOT / name).iterdir()) for name in NAMES}
    assert size[BALL] + size['half_soda_can'] < 25e6
    assert sum(size.values()) < 60e6


def test_equal_files_are_not_kept_twice() -> None:
    digests = [hashlib.sha256(file.read_bytes()).digest() for file in ROOT.glob('*/*.mcap')]
    assert len(set(digests)) == len(digests)


class TestTheBallAtThePublishedLoads:
    def test_it_holds_the_undeformed_scan_and_the_four_rows(self) -> None:
        rows = document(BALL)['scans']
        assert [row['kind'] for row in rows] == ['undeformed'] + ['held'] * 4
        assert [row['hold']['published_row'] for row in rows[1:]] == [1, 2, 3, 4]

    def test_the_gauges_measure_the_force_within_their_own_uncertainty(self) -> None:
        stamps, rows = contacts(BALL)
        for window in document(BALL)['windows']:
            inside = rows[in_window(stamps, window)][:, :2]
            force = np.sqrt(sum(inside[f'f{axis}'] ** 2 for axis in 'xyz')).mean(axis=0)
            sigma = inside['sigma_n'].mean(axis=0)
            assert (inside['flags'] & CONTACT).all()
            assert not (inside['flags'] & NOT_TARED).any()
            assert (abs(force - window['prescribed_force_n']) < 3 * sigma + 0.1).all()

    def test_the_pins_tell_the_displacement(self) -> None:
        stamps, rows = contacts(BALL)
        truth = BallTruth()
        for window in document(BALL)['windows']:
            travel = rows[in_window(stamps, window)][:, :2]['travel'].mean()
            expected = truth.outer_displacement(window['prescribed_force_n'])
            assert travel == pytest.approx(expected, abs=0.4e-3)

    def test_the_dent_extrapolated_to_the_axis_tells_the_displacement(self) -> None:
        truths = document(BALL, 'truth.yaml')['scans']
        for (_, points), row in zip(scans(BALL)[1:], truths[1:], strict=True):
            place = np.array(row['scan_placement'])
            object_pose = np.array(row['object_pose'])
            found = Rotation.from_quat(place[3:]).inv().apply(points - place[:3])
            found = Rotation.from_quat(object_pose[3:]).inv().apply(found - object_pose[:3])
            for side in (-1.0, 1.0):
                depth, radius = 0.0325 - side * found[:, 0], np.hypot(found[:, 1], found[:, 2])
                near = (radius > 0.0012) & (radius < 0.004) & (depth < 0.0325)
                assert near.sum() > 30
                line = np.polynomial.Polynomial.fit(radius[near], depth[near], 2)
                assert line(0.0) == pytest.approx(row['displacement_outer_m'], abs=0.9e-3)

    def test_the_points_without_error_lie_on_the_solid_solution(self) -> None:
        truth = BallTruth()
        truths = document(BALL, 'truth.yaml')['scans']
        with np.load(ROOT / BALL / 'truth_scans.npz') as kept:
            for number, (_, points) in enumerate(scans(BALL)):
                true = points + kept[f'true_minus_reported_um_{number}'] * 1e-6
                pose = np.array(truths[number]['object_pose'])
                found = Rotation.from_quat(pose[3:]).inv().apply(true - pose[:3])
                profile = truth.profile(truths[number]['force_n'])
                radius = np.hypot(found[:, 1], found[:, 2])
                cap = (abs(found[:, 0]) > 0.02) & (radius > 0.016) & (radius < 0.022)
                outside = profile[np.argmax(profile[:, 1]) :]
                height = np.interp(radius[cap], outside[:, 0], outside[:, 1])
                assert abs(height - abs(found[cap, 0])).max() < 5e-5


def test_the_saturated_gauge_reads_its_last_code_and_says_so() -> None:
    stamps, rows = contacts('gauge_saturation')
    window = document('gauge_saturation')['windows'][1]
    inside = in_window(stamps, window)
    assert (rows[inside][:, :2]['flags'] & SATURATED).all()
    with open_bag(ROOT / 'gauge_saturation') as bag:
        counts = [bag.decode(m).data for m in bag.messages(['/hand/finger_1/gauge_counts'])]
    assert max(counts) == 255.0


def test_the_drift_run_drifts_by_counts() -> None:
    with np.load(ROOT / 'gauge_drift' / 'truth_series.npz') as series:
        drift = series['drift_counts'][:, :2]
    assert (abs(drift[-1] - drift[100]) > 1.0).any()
    assert document('gauge_drift')['gauge_time_lapse'] == 60.0


def test_in_the_regrasp_the_object_turns_under_the_pins() -> None:
    with open_bag(ROOT / 'regrasp_sliding') as bag:
        turns = [bag.decode(m).pose.orientation for m in bag.messages(['/object_pose'])]
    first = Rotation.from_quat([[q.x, q.y, q.z, q.w] for q in turns[:1]])
    angles = np.degrees(
        (first.inv() * Rotation.from_quat([[q.x, q.y, q.z, q.w] for q in turns])).magnitude()
    )
    assert angles.max() > 30.0
    assert abs(np.diff(angles)).max() < 1.0
