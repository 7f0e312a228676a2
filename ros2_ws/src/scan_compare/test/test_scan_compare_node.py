# SPDX-License-Identifier: Apache-2.0
"""The real node as a process: a scan is answered with the surface of its time."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.qos import qos_profile_sensor_data
from scan_observer import ScanObserver
from scan_shells import ball, scan_points, two_dents
from sensor_msgs.msg import PointCloud2

from scan_compare.deformed_surface import (
    DeformedSurface,
    outer_face_at_rest,
    surface_of_outer_face,
)

SECOND = 1_000_000_000
GRASP = ball(two_dents(0.006, bulge=0.0003))
DEEPER = ball(two_dents(0.008, bulge=0.0003))
REST = ball()


@pytest.fixture
def observer(domain_id: int) -> Iterator[ScanObserver]:
    observer = ScanObserver()
    yield observer
    observer.close()


@pytest.fixture
def serve(start: Callable[..., Any], observer: ScanObserver) -> Callable[..., Any]:
    def run(**parameters: object) -> Any:
        arguments = ['--ros-args']
        for name, value in parameters.items():
            arguments += ['-p', f'{name}:={value}']
        node = start('scan_compare', *arguments)
        observer.connect()
        return node

    return run


def test_a_scan_is_compared_with_the_surface_of_its_own_time(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve()
    observer.send_mesh(GRASP)
    surfaces = {second * SECOND: GRASP if second < 5 else DEEPER for second in range(1, 9)}
    observer.wait(lambda: surfaces_taken(observer, surfaces, 8))
    points = scan_points(GRASP, 20_000)
    observer.send_scan(points, 3 * SECOND)
    observer.wait(lambda: observer.errors and len(observer.numbers) == 3)
    cloud = observer.errors[0]
    assert cloud.header.stamp.sec == 3
    assert cloud.header.frame_id == 'hand_base'
    assert [field.name for field in cloud.fields] == ['x', 'y', 'z', 'distance']
    rows = np.frombuffer(cloud.data, '<f4').reshape(-1, 4)
    assert len(rows) == 20_000
    assert np.abs(rows[:, 3]).mean() == pytest.approx(observer.numbers['mean_error'], rel=1e-3)
    assert observer.numbers['mean_error'] == pytest.approx(0.1013e-3, rel=0.1)
    observer.wait(lambda: observer.stamped)
    named = dict(zip(observer.stamped[0].name, observer.stamped[0].position, strict=True))
    assert named['mean_error'] == observer.numbers['mean_error']
    assert observer.stamped[0].header.stamp == observer.errors[0].header.stamp
    assert observer.numbers['noise_floor'] == pytest.approx(0.1013e-3, rel=1e-3)
    observer.send_scan(points, 7 * SECOND)
    observer.wait(lambda: len(observer.errors) == 2)
    observer.wait(lambda: observer.numbers['mean_error'] > 0.11e-3)
    observer.wait(lambda: 'exceeds the noise floor' in observer.summary)


def test_a_surface_with_an_outer_face_is_compared_by_that(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve()
    observer.send_mesh(GRASP)
    middle = GRASP.limit.limit_positions(GRASP.deformed)
    normals = GRASP.limit.vertex_normals(GRASP.deformed)
    # 0.3 mm thicker where the ball is dented: half a wall along the normal would be that far off
    dented = np.exp(-((np.hypot(middle[:, :1], middle[:, 1:2]) / 0.008) ** 2))
    outer = middle + (0.5 * GRASP.thickness + 0.3e-3 * dented) * normals
    at_rest = outer_face_at_rest(
        GRASP.limit, GRASP.limit.limit_positions(GRASP.rest), GRASP.thickness
    )
    face = surface_of_outer_face(GRASP.limit, at_rest, outer, GRASP.thickness)

    def taken() -> bool:
        observer.send_surface(GRASP, 3 * SECOND, outer)
        return observer.values.get('surfaces kept') == '1'

    observer.wait(taken)
    observer.send_scan(scan_points(face, 20_000), 3 * SECOND)
    observer.wait(lambda: observer.errors and len(observer.numbers) == 3)
    rows = np.frombuffer(observer.errors[0].data, '<f4').reshape(-1, 4)
    near = np.hypot(rows[:, 0], rows[:, 1]) < 0.003
    assert rows[near, 3].mean() == pytest.approx(0.0, abs=0.02e-3)


def test_scans_faster_than_comparisons_are_all_judged_in_their_order(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve(surface_wait=0.1)
    for second in range(1, 7):
        observer.send_scan(scan_points(REST, 5_000, seed=second), second * SECOND, 'object')
    observer.wait(lambda: len(observer.errors) == 6)
    assert [cloud.header.stamp.sec for cloud in observer.errors] == [1, 2, 3, 4, 5, 6]
    observer.wait(lambda: observer.values.get('comparisons') == '6')
    assert observer.values['dropped'] == '0'


def test_beyond_the_waiting_memory_the_oldest_scans_are_dropped_counted_and_named(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve(surface_wait=60.0, waiting_memory=1.0)
    for second in range(1, 5):
        # 20 000 points take 0.48 MB: two may wait for the surface that never comes
        observer.send_scan(scan_points(REST, 20_000), second * SECOND, 'object')
    observer.wait(lambda: observer.values.get('dropped') == '2')
    assert observer.values['waiting'] == '2'
    assert 'the scan of 2.000 s was dropped unjudged' in observer.summary


def test_a_stopped_comparing_process_holds_nothing_up_and_its_scan_is_judged_by_another(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    node = serve(surface_wait=0.1)
    (child,) = comparing_processes(node)
    os.kill(child, signal.SIGSTOP)
    observer.send_scan(scan_points(REST, 200_000), SECOND, 'object')
    observer.wait(lambda: observer.values.get('busy') == 'True')
    assert observer.get_parameter('object') == 'tennis_ball'
    for count in (1, 2, 3):
        surface = {(2 + count) * SECOND: GRASP}
        observer.wait(lambda: surfaces_taken(observer, surface, count))  # noqa: B023
    observer.wait(lambda: observer.errors)
    assert observer.errors[0].width == 200_000
    assert observer.values['process restarts'] == '1'
    assert child not in comparing_processes(node)


def comparing_processes(node: Any) -> list[int]:
    children = Path(f'/proc/{node.process.pid}/task/{node.process.pid}/children')
    found = [int(child) for child in children.read_text().split()]
    return [c for c in found if 'scan_compare.worker' in Path(f'/proc/{c}/cmdline').read_text()]


def surfaces_taken(
    observer: ScanObserver, surfaces: dict[int, DeformedSurface], count: int
) -> bool:
    # again and again: the topic is best effort
    for stamp_ns, surface in surfaces.items():
        observer.send_surface(surface, stamp_ns)
    return observer.values.get('surfaces kept') == str(count)


def test_without_a_surface_the_object_at_rest_is_compared_and_said_so(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve(surface_wait=0.1)
    observer.send_scan(scan_points(REST, 5_000), SECOND, 'object')
    observer.wait(lambda: observer.errors)
    assert observer.errors[0].header.frame_id == 'object'
    observer.wait(lambda: 'object at rest' in observer.summary)


def test_a_scan_in_inches_is_refused_with_the_factor(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve(surface_wait=0.1)
    observer.send_scan(scan_points(REST, 5_000) / 0.0254, SECOND, 'object')
    observer.wait(lambda: 'the file is in inch' in observer.summary)
    assert not observer.errors


def test_an_empty_scan_is_refused(serve: Callable[..., Any], observer: ScanObserver) -> None:
    serve(surface_wait=0.1)
    observer.send_scan(np.empty((0, 3)), SECOND, 'object')
    observer.wait(lambda: 'no points' in observer.summary)


def test_the_service_compares_the_scan_file(
    serve: Callable[..., Any], observer: ScanObserver, tmp_path: Path
) -> None:
    path = tmp_path / 'ball.xyz'
    np.savetxt(path, 1e3 * scan_points(REST, 5_000), fmt='%.5f')
    serve(scan_file=path, report_directory=tmp_path / 'reports')
    answer = observer.call_compare()
    assert answer.success, answer.message
    statistics = json.loads(answer.message)
    assert statistics['mean_error_m'] == pytest.approx(0.1013e-3, rel=0.1)
    assert any('unit inferred: mm' in note for note in statistics['notes'])
    assert (tmp_path / 'reports' / 'scan_0' / 'report.html').exists()


def test_the_service_without_any_scan_says_what_is_missing(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    serve()
    answer = observer.call_compare()
    assert not answer.success
    assert 'no scan has arrived' in answer.message
    # A scanner that loses parts offers none.
    observer.node.create_publisher(PointCloud2, 'scan/points', qos_profile_sensor_data)
    observer.wait(lambda: 'publish it RELIABLE' in observer.summary)


def test_a_killed_comparing_process_is_replaced(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    node = serve(surface_wait=0.1)
    observer.wait(lambda: observer.values)
    for child in comparing_processes(node):
        os.kill(child, signal.SIGKILL)
    observer.wait(lambda: observer.values.get('process restarts') == '1')
    observer.send_scan(scan_points(REST, 5_000), SECOND, 'object')
    observer.wait(lambda: observer.errors)


def test_the_node_ends_cleanly_and_leaves_nothing_running(
    serve: Callable[..., Any], observer: ScanObserver
) -> None:
    node = serve()
    observer.wait(lambda: observer.values)
    children = Path(f'/proc/{node.process.pid}/task/{node.process.pid}/children')
    started = children.read_text().split()
    assert node.stop(signal.SIGTERM) == 0
    assert 'Traceback' not in node.text
    observer.wait(lambda: not any(Path(f'/proc/{child}').exists() for child in started))


def test_an_unknown_object_ends_the_node_with_one_sentence(start: Callable[..., Any]) -> None:
    node = start('scan_compare', '--ros-args', '-p', 'object:=no_such_thing')
    assert node.ended() == 1
    assert 'scan_compare: object: ' in node.text
    assert 'no_such_thing' in node.text
    assert 'Traceback' not in node.text
