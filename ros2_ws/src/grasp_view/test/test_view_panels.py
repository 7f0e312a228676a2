# SPDX-License-Identifier: Apache-2.0
"""The panels: diagrams over time with the line at the picture, and the slider of a replay."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest
from view_paper import Paper, server, visitor

from grasp_view.plot_panel import PLOTS, SERIES, Plot, PlotPanel, marked, plottable
from grasp_view.replay_panel import HELD_S, ReplayPanel, ReplayState
from grasp_view.time_series import TimeSeries
from grasp_view.visitors import Window


def panel_of(rows: list[dict[str, float]], window: Window) -> tuple[PlotPanel, dict[str, object]]:
    """Diagrams of rows a second apart, and their handles by the first label of each."""
    series = TimeSeries(SERIES, 60.0)
    for number, row in enumerate(rows):
        series.add(float(number), row)
    one = visitor(window)
    panel = PlotPanel(one, series)
    gui: Paper = one.client.gui  # type: ignore[assignment]
    drawn = [h for name, h in gui.things.items() if name.startswith('add_uplot')]
    return panel, {str(h.given[0][1]['label']): h for h in drawn}


ROWS = [
    {'force_1': 1.0, 'max_displacement': 0.001, 'linearity': 0.02},
    {'force_1': 3.0, 'max_displacement': 0.002, 'linearity': 0.04},
]


def test_a_diagram_shows_its_series_in_its_unit_over_the_seconds_before_now() -> None:
    panel, handles = panel_of(ROWS, Window(500, 800))
    assert panel.empty
    panel.draw()
    assert not panel.empty
    for label, values in (('F1', (1.0, 3.0)), ('served', (1.0, 2.0)), ('linearity', (2.0, 4.0))):
        time_s, column, *_ = handles[label].data  # type: ignore[attr-defined]
        assert (time_s[0], column[0]) == pytest.approx((-1.0, values[0]))
        assert (time_s[-1], column[-1]) == pytest.approx((0.0, values[1]))


@pytest.mark.parametrize('plot', PLOTS)
def test_the_title_of_a_diagram_says_the_unit_that_it_draws(plot: Plot) -> None:
    unit = plot.title.partition('(')[2].rstrip(')')
    assert plot.factor == {'N': 1.0, 'mm': 1e3, '%': 1e2, 'ms': 1e3}[unit]
    assert plot.si == {'N': '_n', 'mm': '_m', '%': '', 'ms': '_s'}[unit]


def test_the_line_of_the_picture_stands_at_its_time_and_the_series_stay() -> None:
    panel, handles = panel_of(ROWS, Window(500, 800))
    panel.draw()
    panel.mark(0.25)
    time_s, force, *_, line = handles['F1'].data  # type: ignore[attr-defined]
    assert time_s[line == 1.0] == pytest.approx([-0.75])
    assert force[line == 1.0] == pytest.approx([1.5])
    panel.mark(float('nan'))
    assert handles['F1'].data[-1] is line  # type: ignore[attr-defined]


def test_a_gap_leaves_its_row_out_and_a_series_never_known_is_not_shown() -> None:
    gap = np.array([1.0, np.nan, 3.0])
    data, shown = plottable(np.arange(3.0), [gap, np.full(3, np.nan)], 1e3)
    assert shown == (True, False)
    assert data[0].tolist() == [0.0, 2.0] and data[1].tolist() == [1e3, 3e3]
    assert data[2].tolist() == [0.0, 0.0]
    nothing, shown = plottable(np.arange(3.0), [np.full(3, np.nan)], 1.0)
    assert shown == (False,) and len(nothing[0]) == 0


@pytest.mark.parametrize(('at', 'place'), [(-9.0, 0.0), (0.5, 0.5), (9.0, 2.0)])
def test_the_line_is_one_peak_inside_the_diagram(at: float, place: float) -> None:
    time_s, values, line = marked((np.arange(3.0), np.arange(3.0) ** 2), at)
    assert line.sum() == 1.0 and time_s[line == 1.0] == [place]
    assert (np.diff(time_s) >= 0.0).all()
    assert values[line == 1.0] == np.interp(place, [0.0, 1.0, 2.0], [0.0, 1.0, 4.0])


@pytest.fixture
def replay() -> tuple[ReplayPanel, dict[str, object], list[str]]:
    paper, told = server(), []
    panel = ReplayPanel(paper, told.append)
    things = paper.gui.things
    slider, steps = things['Recording (s)'], things['running']
    slider.max, slider.value, steps.label, steps.value = 1.0, 0.0, 'running', 'Pause'
    return panel, things, told


def test_a_replay_is_followed_by_its_slider_up_to_the_whole_hundredth_before_its_end(
    replay: tuple[ReplayPanel, dict[str, object], list[str]],
) -> None:
    panel, things, _ = replay
    slider, steps = things['Recording (s)'], things['running']
    panel.show(ReplayState(3.456, 12.349, paused=True))
    assert (slider.max, slider.value, steps.label) == (12.34, 3.46, 'paused')  # type: ignore[attr-defined]
    panel.show(ReplayState(99.0, 12.349))
    assert (slider.value, steps.label) == (12.34, 'running')  # type: ignore[attr-defined]
    panel.show(ReplayState(-1.0, 0.0))
    assert (slider.max, slider.value) == (0.01, 0.0)  # type: ignore[attr-defined]


def test_no_replay_and_one_without_an_end_hide_the_panel(
    replay: tuple[ReplayPanel, dict[str, object], list[str]],
) -> None:
    panel, things, _ = replay
    for state, shown in (
        (ReplayState(1.0, 2.0), True),
        (None, False),
        (ReplayState(1.0, 2.0), True),
        (ReplayState(1.0, float('inf')), False),
    ):
        panel.show(state)
        assert things['Replay'].visible == shown  # type: ignore[attr-defined]


def test_a_hand_on_the_slider_asks_for_its_time_and_is_left_alone_for_a_second(
    replay: tuple[ReplayPanel, dict[str, object], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    panel, things, _ = replay
    slider = things['Recording (s)']
    panel.show(ReplayState(1.0, 10.0))
    began = time.monotonic()
    for value in (4.0, 5.0):
        slider.value = value  # type: ignore[attr-defined]
        slider.told(SimpleNamespace(client=object()))  # type: ignore[attr-defined]
    slider.told(SimpleNamespace(client=None))  # type: ignore[attr-defined]
    assert panel.take_wanted() == 5.0 and panel.take_wanted() is None
    panel.show(ReplayState(1.0, 10.0))
    assert slider.value == 5.0  # type: ignore[attr-defined]
    monkeypatch.setattr(time, 'monotonic', lambda: began + HELD_S + 60.0)
    panel.show(ReplayState(1.0, 10.0))
    assert slider.value == 1.0  # type: ignore[attr-defined]


def test_a_button_says_its_word_to_the_replay(
    replay: tuple[ReplayPanel, dict[str, object], list[str]],
) -> None:
    _, things, told = replay
    things['running'].told(None)  # type: ignore[attr-defined]
    assert told == ['pause']
