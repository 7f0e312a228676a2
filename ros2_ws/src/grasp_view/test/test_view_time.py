# SPDX-License-Identifier: Apache-2.0
"""What the page remembers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from grasp_view.plot_panel import marked, plottable
from grasp_view.scale_bar import round_length, scale_html
from grasp_view.time_series import History, TimeSeries
from grasp_view.visitors import Visitor, Window


def test_only_the_last_seconds_are_kept() -> None:
    series = TimeSeries(['a'], span=2.0)
    for k in range(10):
        series.add(float(k), {'a': k})
    time, values = series.columns(['a'], 100)
    assert time.tolist() == values.tolist() == [7.0, 8.0, 9.0]


def test_a_number_that_did_not_come_is_a_gap() -> None:
    series = TimeSeries(['a', 'b'], span=9.0)
    series.add(0.0, {'a': 1.0})
    assert np.isnan(series.columns(['b'], 9)[1]).all()


def test_long_series_are_thinned_and_keep_their_newest_value() -> None:
    series = TimeSeries(['a'], span=1e9)
    for k in range(1000):
        series.add(float(k), {'a': k})
    time, _ = series.columns(['a'], 50)
    assert len(time) == 50 and time[0] == 0 and time[-1] == 999


def test_a_replay_that_loops_starts_the_series_anew() -> None:
    series = TimeSeries(['a'], span=100.0)
    for time in (5.0, 6.0, 1.0):
        series.add(time, {'a': time})
    assert series.columns(['a'], 9)[0].tolist() == [1.0]


def test_an_empty_series_has_empty_columns() -> None:
    assert [len(c) for c in TimeSeries(['a'], 1.0).columns(['a'], 5)] == [0, 0]


def test_the_history_finds_the_picture_of_a_time() -> None:
    history: History[str] = History(span=10.0, most=100)
    for time, name in ((1.0, 'one'), (2.0, 'two'), (3.0, 'three')):
        history.add(time, name)
    assert [history.at(t) for t in (0.5, 1.0, 1.9, 2.0, 99.0)] == [
        'one',
        'one',
        'one',
        'two',
        'three',
    ]
    assert history.ends == (1.0, 3.0)


def test_the_history_forgets_what_is_too_old_and_what_a_loop_left() -> None:
    history: History[int] = History(span=1.0, most=100)
    for k in range(5):
        history.add(float(k), k)
    assert len(history) == 2 and history.at(0.0) == 3
    history.add(0.0, 7)
    assert len(history) == 1 and history.at(9.0) == 7


def test_an_empty_history_has_no_picture() -> None:
    history: History[int] = History(span=1.0, most=10)
    assert history.at(1.0) is None and history.ends == (0.0, 0.0)


def test_rows_with_gaps_and_columns_never_known_are_not_plotted() -> None:
    nan = np.nan
    time = np.array([0.0, 1.0, 2.0])
    data, shown = plottable(time, [np.array([nan, 1.0, 2.0]), np.array([nan] * 3)], 10.0)
    assert shown == (True, False)
    assert [column.tolist() for column in data] == [[1.0, 2.0], [10.0, 20.0], [0.0, 0.0]]


@pytest.mark.parametrize('count', [0, 3])
def test_nothing_known_plots_nothing(count: int) -> None:
    data, shown = plottable(np.arange(float(count)), [np.full(count, np.nan)], 1.0)
    assert shown == (False,) and all(len(column) == 0 for column in data)


@pytest.mark.parametrize(('at', 'stands'), [(-0.5, -0.5), (-9.0, -2.0), (9.0, 0.0), (-1.0, -1.0)])
def test_a_line_marks_the_time_of_the_picture_and_leaves_the_others(
    at: float, stands: float
) -> None:
    time, values = np.array([-2.0, -1.0, 0.0]), np.array([0.0, 10.0, 30.0])
    new_time, new_values, line = marked((time, values), at)
    assert new_time[line == 1.0].tolist() == [stands] and (np.diff(new_time) >= 0.0).all()
    assert np.interp(new_time, time, values) == pytest.approx(new_values)


def test_the_time_of_a_picture_is_that_of_its_stamp() -> None:
    series = TimeSeries(['stamp'], span=9.0)
    assert np.isnan(series.when('stamp', 1.0))
    # A recording played at twice its speed, which then loops.
    for time, stamp in ((0.0, np.nan), (1.0, 100.0), (2.0, 102.0), (3.0, 100.0)):
        series.add(time, {'stamp': stamp})
    assert [series.when('stamp', stamp) for stamp in (101.5, 100.0)] == [2.0, 3.0]


@pytest.mark.parametrize(
    ('most', 'length'), [(0.024, 0.02), (20.0, 20.0), (1.99, 1.0), (7.0, 5.0), (100.0, 100.0)]
)
def test_a_scale_bar_is_a_round_length(most: float, length: float) -> None:
    assert round_length(most) == pytest.approx(length)


def test_the_height_of_a_picture_is_what_its_camera_sees_where_it_looks() -> None:
    camera = SimpleNamespace(position=(3.0, 0.0, 1.0), look_at=(0.0, 4.0, 1.0), fov=np.pi / 2)
    seen = Visitor(SimpleNamespace(camera=camera), Window(1440, 856)).reach  # type: ignore[arg-type]
    assert seen == pytest.approx(2 * 5.0)
    # 10 units of a scene in which a metre is 20 are 500 mm, over 1000 pixels.
    assert scale_html(seen / 1000).endswith('</i>50 mm') and 'width:100px' in scale_html(0.01)


@pytest.mark.parametrize('pixel', [0.0, float('nan'), float('inf')])
def test_without_a_camera_there_is_no_scale_bar(pixel: float) -> None:
    assert scale_html(pixel) == ''
