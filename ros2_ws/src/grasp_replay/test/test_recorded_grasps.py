# SPDX-License-Identifier: Apache-2.0
"""Grasps as drivers and scanners record them: the same numbers as the plain one, or a refusal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from grasp_samples import header, write_grasp

from grasp_replay.bag_reader import open_bag
from grasp_replay.bag_writer import BagWriter
from grasp_replay.commands.grasp_report import main
from grasp_replay.errors import BagError
from grasp_replay.pipeline import Outcome, PipelineOptions, run
from grasp_replay.recording import read_recording
from grasp_replay.results import row_document
from grasp_replay.ros_types import standard_types
from shell_deform.live.pose import pose_of

SCANS, CONTACTS = '/scan/points', '/hand/contacts'
COARSE = PipelineOptions(young='object', changes={'control_vertices': 200}, thick=False)
Change = Callable[[str, Any, int], Any]


def _stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _rewritten(
    source: Path, target: Path, change: Change, described: bool = False, repeat: int = 1
) -> Path:
    """A copy of a bag with each message changed; by default without its experiment.yaml's scans.

    `change` takes the topic, the decoded message and how many of the topic came before.
    """
    store = standard_types()
    with open_bag(source) as bag, BagWriter(target) as writer:
        numbers: dict[str, int] = {}
        seen: dict[str, int] = {}
        for message in bag.messages():
            decoded = bag.decode(message)
            place = seen[message.topic] = seen.get(message.topic, -1) + 1
            changed = change(message.topic, decoded, place)
            if changed is None:
                continue
            if message.topic not in numbers:
                numbers[message.topic] = writer.add_topic(
                    message.topic, 'sensor_msgs/msg/PointCloud2'
                )
            data = bytes(store.serialize_cdr(changed, 'sensor_msgs/msg/PointCloud2'))
            for again in range(repeat):
                writer.write(numbers[message.topic], data, message.log_time + again)
    content = yaml.safe_load((source / 'experiment.yaml').read_text())
    if not described:
        del content['scans']
    (target / 'experiment.yaml').write_text(yaml.safe_dump(content))
    return target


def _with(message: Any, **fields: Any) -> Any:
    values = {name: getattr(message, name) for name in message.__dataclass_fields__}
    return type(message)(
        **{name: values[name] for name in values if name != '__msgtype__'} | fields
    )


def _points(message: Any) -> np.ndarray:
    return np.frombuffer(bytes(message.data), '<f4').reshape(-1, 3)


def _cloud(message: Any, points: np.ndarray, height: int = 1) -> Any:
    data = np.ascontiguousarray(points, '<f4').view(np.uint8).ravel()
    width = len(points) // height
    return _with(message, data=data, width=width, height=height, row_step=12 * width)


@pytest.fixture(scope='module')
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_grasp(tmp_path_factory.mktemp('grasp') / 'grasp')


@pytest.fixture(scope='module')
def plain(grasp: Path, tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    bag = _rewritten(grasp, tmp_path_factory.mktemp('plain') / 'bag', lambda _t, m, _n: m)
    return run(bag, COARSE)


def _numbers(outcome: Outcome) -> list[tuple[float, float]]:
    rows = [row_document(row) for row in outcome.rows]
    return [(row['force_n'], row['theories']['koiter']['mean_error_m']) for row in rows]


def _notes(outcome: Outcome) -> str:
    return '; '.join(row_document(outcome.rows[0])['notes'])


def test_points_that_a_driver_repeats_count_once(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    def change(topic: str, message: Any, _place: int) -> Any:
        if topic != SCANS:
            return message
        points = _points(message)
        return _cloud(message, np.vstack([points, *5 * [points[points[:, 0] > 0.02]]]))

    outcome = run(_rewritten(grasp, tmp_path / 'bag', change), COARSE)
    assert _numbers(outcome) == _numbers(plain)
    assert 'welded to 4000' in _notes(outcome)


def test_the_holes_of_an_organised_cloud_are_dropped(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    def change(topic: str, message: Any, _place: int) -> Any:
        if topic != SCANS:
            return message
        points = np.repeat(_points(message), 2, axis=0)
        points[1::2] = np.nan
        points = np.vstack([points, np.zeros((40, 3)), np.full((40, 3), 1e7)])
        return _cloud(message, points, height=20)

    outcome = run(_rewritten(grasp, tmp_path / 'bag', change), COARSE)
    for (force, error), (true_force, true_error) in zip(
        _numbers(outcome), _numbers(plain), strict=True
    ):
        assert force == true_force
        # the zeros are one point in the middle of the ball
        assert error == pytest.approx(true_error, rel=1e-3)
    assert '4000 points with NaN' in _notes(outcome)
    assert '40 points dropped' in _notes(outcome)


def test_messages_without_stamps_go_by_the_times_of_recording_and_it_is_said(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    bag = _rewritten(grasp, tmp_path / 'bag', lambda _t, m, _n: _with(m, header=header(0)))
    outcome = run(bag, COARSE)
    assert _numbers(outcome) == _numbers(plain)
    assert 'carry the stamp 0: all messages go by the times' in _notes(outcome)


def test_one_scan_alone_without_a_stamp_goes_by_the_time_of_recording(
    grasp: Path, tmp_path: Path
) -> None:
    def change(topic: str, message: Any, place: int) -> Any:
        if topic != SCANS:
            return message
        return _with(message, header=header(0)) if place == 1 else None

    found = read_recording(_rewritten(grasp, tmp_path / 'bag', change))
    (scan,) = found.scans
    assert found.samples[0].stamp < scan.stamp <= found.samples[-1].stamp + 10**9
    assert found.notes == (
        '1 scans carry the stamp 0: all messages go by the times at which they were recorded',
    )


def test_scans_that_repeat_a_stamp_are_told_apart_and_still_found_by_their_own(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    first: list[Any] = []

    def change(topic: str, message: Any, place: int) -> Any:
        if topic == SCANS and place == 1:
            first.append(message.header)
        return _with(message, header=first[0]) if topic == SCANS and place == 2 else message

    outcome = run(_rewritten(grasp, tmp_path / 'bag', change), COARSE)
    assert _numbers(outcome) == _numbers(plain)
    assert '2 scans carry the stamp' in _notes(outcome)
    told = run(_rewritten(grasp, tmp_path / 'told', change, described=True), COARSE)
    assert _numbers(told) == _numbers(plain)


def test_messages_that_no_clock_tells_apart_are_refused(grasp: Path, tmp_path: Path) -> None:
    store, target = standard_types(), tmp_path / 'bag'
    with open_bag(grasp) as bag, BagWriter(target) as writer:
        numbers = {
            name: writer.add_topic(name, 'sensor_msgs/msg/PointCloud2') for name in bag.topics
        }
        for message in bag.messages():
            bare = _with(bag.decode(message), header=header(0))
            data = bytes(store.serialize_cdr(bare, 'sensor_msgs/msg/PointCloud2'))
            writer.write(numbers[message.topic], data, 5)
    with pytest.raises(BagError, match='let the drivers fill header.stamp'):
        run(target, COARSE)


def test_messages_recorded_twice_are_taken_once(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    outcome = run(_rewritten(grasp, tmp_path / 'bag', lambda _t, m, _n: m, repeat=2), COARSE)
    assert _numbers(outcome) == _numbers(plain)
    assert '3 scans recorded twice, taken once' in _notes(outcome)


def test_a_stale_copy_of_contacts_may_carry_the_stamp_of_the_sample_it_copies(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    last: list[Any] = []

    def change(topic: str, message: Any, place: int) -> Any:
        if topic != CONTACTS:
            return message
        if place % 10 != 9:
            last[:] = [message]
            return message
        stale = np.array(last[0].data, np.uint8)
        flags = next(field.offset for field in message.fields if field.name == 'flags')
        stale[flags :: message.point_step] |= 4
        return _with(last[0], data=stale)

    outcome = run(_rewritten(grasp, tmp_path / 'bag', change), COARSE)
    assert [force for force, _ in _numbers(outcome)] == pytest.approx(
        [force for force, _ in _numbers(plain)]
    )
    assert 'stamp' not in _notes(outcome)


def _turned(points: np.ndarray) -> np.ndarray:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return points @ turn.T @ np.diag([1.0, -1.0, -1.0]) + [0.03, 0.02, 0.4]


def test_scans_in_a_frame_of_their_own_are_searched_and_it_is_said(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    def change(topic: str, message: Any, _place: int) -> Any:
        if topic != SCANS:
            return message
        other = _cloud(message, _turned(_points(message)))
        return _with(other, header=header(_stamp(message), 'scanner'))

    outcome = run(_rewritten(grasp, tmp_path / 'bag', change), COARSE)
    for (_, error), (_, true_error) in zip(_numbers(outcome), _numbers(plain), strict=True):
        assert error == pytest.approx(true_error, rel=0.05)
    assert 'scans are in the frame scanner, contacts in hand_base' in _notes(outcome)


def _elsewhere(numbers: list[float]) -> Change:
    pose = pose_of(numbers)

    def change(topic: str, message: Any, _place: int) -> Any:
        data = np.array(message.data, np.uint8)
        floats = (
            data.view('<f4').reshape(len(data) // message.point_step, -1)
            if (message.point_step % 4 == 0)
            else None
        )
        if floats is None:
            # contacts: fourteen floats and two bytes a point
            rows = data.reshape(-1, message.point_step)
            floats = rows[:, :56].copy().view('<f4')
        floats[:, :3] = pose.from_object(floats[:, :3].astype(float))
        if topic == CONTACTS:
            for first in (3, 6):
                floats[:, first : first + 3] = floats[:, first : first + 3] @ pose.rotation.T
            rows[:, :56] = floats.view(np.uint8)
        return _with(message, data=data)

    return change


POSE = [0.02, -0.01, 0.2, 0.0, 0.0, 0.6, 0.8]


def test_an_object_whose_pose_nobody_recorded_is_searched_and_it_is_said(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    bag = _rewritten(grasp, tmp_path / 'bag', _elsewhere(POSE))
    outcome = run(bag, COARSE)
    for (force, error), (true_force, true_error) in zip(
        _numbers(outcome), _numbers(plain), strict=True
    ):
        assert force == pytest.approx(true_force)
        assert error < 1.2 * true_error
    assert 'no object_pose is recorded: its pose was searched' in _notes(outcome)
    given = run(bag, replace(COARSE, object_pose=pose_of(POSE)))
    assert 'object_pose' not in _notes(given)
    for (_, error), (_, true_error) in zip(_numbers(given), _numbers(plain), strict=True):
        assert error == pytest.approx(true_error, rel=0.02)


def test_without_any_pose_scans_of_another_frame_are_refused_with_the_way_out(
    grasp: Path, tmp_path: Path
) -> None:
    move = _elsewhere(POSE)

    def change(topic: str, message: Any, place: int) -> Any:
        frame = 'scanner' if topic == SCANS else 'hand_base'
        return _with(move(topic, message, place), header=header(_stamp(message), frame))

    with pytest.raises(BagError, match=r'no object_pose is recorded.*--object-pose'):
        run(_rewritten(grasp, tmp_path / 'bag', change), COARSE)


def test_clouds_in_millimetres_are_read_when_it_is_said(
    grasp: Path, tmp_path: Path, plain: Outcome
) -> None:
    bag = write_grasp(tmp_path / 'grasp', scan_unit=1000.0)
    bag = _rewritten(bag, tmp_path / 'bag', lambda _t, m, _n: m)
    with pytest.raises(BagError, match='factor 1000, the file is in mm'):
        run(bag, COARSE)
    outcome = run(bag, replace(COARSE, scan_unit='mm'))
    for (_, error), (_, true_error) in zip(_numbers(outcome), _numbers(plain), strict=True):
        assert error == pytest.approx(true_error, rel=1e-3)


@pytest.mark.parametrize('pose', ['1 2 3', '0 0 0 0 0 0 0', 'somewhere'])
def test_a_pose_that_is_none_is_a_wrong_argument(
    pose: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_info:
        main([str(tmp_path), '--out', str(tmp_path / 'out'), '--object-pose', pose])
    assert exit_info.value.code == 2
    assert 'nor "search"' in capsys.readouterr().err
