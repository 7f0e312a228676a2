# SPDX-License-Identifier: Apache-2.0
"""Numbers over time: a strip below the scene, a diagram a tab; on a phone a folder of its sheet.

Drag over a diagram to look closer, double-click for the whole again. A line marks the time of the
picture; while somebody looks back in time it moves and the diagrams stand still, so that a closer
look stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from .poses import Floats
from .time_series import TimeSeries
from .visitors import STRIP, Visitor

ROWS = 240
LINES = (('#1f77b8', ()), ('#c8641a', (6, 3)), ('#8a6bb0', (2, 2)))
DIAGRAM_HEIGHT, GAP = 120, 16


@dataclass(frozen=True)
class Plot:
    """One diagram: series of `TimeSeries` by name with their labels, times `factor` = unit.

    si: what an exported column's name ends with.
    """

    title: str
    series: dict[str, str]
    factor: float
    si: str


PLOTS = (
    Plot('force (N)', {'force_1': 'F1', 'force_2': 'F2', 'force_3': 'F3'}, 1.0, '_n'),
    Plot('displacement (mm)', {'max_displacement': 'served'}, 1e3, '_m'),
    Plot('linear off by (%)', {'linearity': 'linearity'}, 1e2, ''),
    Plot('age (ms)', {'surface_age': 'surface', 'nonlinear_age': 'nonlinear'}, 1e3, '_s'),
    Plot('latency (ms)', {'latency': 'surface'}, 1e3, '_s'),
    Plot(
        'scan (mm)',
        {'mean_error': 'mean', 'max_error': 'max', 'noise_floor': 'floor'},
        1e3,
        '_m',
    ),
)
SERIES = tuple(name for plot in PLOTS for name in plot.series)
STAMP = 'stamp'
"""Beside them: the stamp (s) of the surface that was shown."""
MARK = 'mark'
"""The scale of the line at the time of the picture."""


class PlotPanel:
    """The diagrams of one browser."""

    def __init__(self, visitor: Visitor, series: TimeSeries) -> None:
        self._series = series
        self._handles: list[tuple[Plot, viser.GuiUplotHandle]] = []
        self._shown: dict[str, tuple[bool, ...]] = {}
        self._drawn: dict[str, tuple[Floats, ...]] = {}
        self._now = self._marked = 0.0
        gui, self._ink = visitor.client.gui, visitor.palette.ink
        room = _room(visitor)
        for plot in PLOTS:
            unknown = (False,) * len(plot.series)
            # A range that is given stays, or becomes what a visitor zooms to; one that follows the
            # data runs away where they come faster than a browser draws.
            whole = (-series.span, 0.0)
            empty = np.array(whole)
            with room(plot.title):
                handle = gui.add_uplot(
                    (empty, *(np.zeros(2) for _ in plot.series), np.zeros(2)),
                    _lines(plot, unknown, self._ink),
                    scales={
                        'x': uplot.Scale(time=False, range=whole),
                        'y': uplot.Scale(auto=True),
                        MARK: uplot.Scale(auto=False, range=(0.0, 1.0)),
                    },
                    legend=uplot.Legend(show=True, live=False),
                    padding=(8, 20, 0, 4),
                    height=DIAGRAM_HEIGHT,
                    axes=_axes(visitor),
                )
            self._handles.append((plot, handle))
            self._shown[plot.title] = unknown

    def draw(self) -> None:
        """Bring the diagrams up to date."""
        for plot, handle in self._handles:
            time, *columns = self._series.columns(tuple(plot.series), ROWS)
            # Seconds before now: the diagram's window stands still while the lines move.
            self._now = self._marked = float(time[-1:].sum())
            data, shown = plottable(time - self._now, columns, plot.factor)
            if not len(data[0]):
                continue
            if shown != self._shown[plot.title]:
                self._shown[plot.title] = shown
                handle.series = _lines(plot, shown, self._ink)
            self._drawn[plot.title] = data
            handle.data = marked(data, 0.0)

    @property
    def empty(self) -> bool:
        """Whether nothing was drawn yet."""
        return not self._drawn

    def mark(self, time: float) -> None:
        """Move the line to `time` s of the series, if that is known; leave the rest as it is."""
        if time == self._marked or not np.isfinite(time):
            return
        self._marked = time
        for plot, handle in self._handles:
            if plot.title in self._drawn:
                handle.data = marked(self._drawn[plot.title], time - self._now)


def _room(visitor: Visitor) -> Callable[[str], AbstractContextManager[object]]:
    """Opens the place of a diagram by its title: a tab of the strip, or a folder of the sheet."""
    gui, window = visitor.client.gui, visitor.window
    if window.phone:
        # `page.css` shows what follows this mark below the transport.
        gui.add_html('<i class="grasp-diagrams"></i>')
        return lambda title: gui.add_folder(title, expand_by_default=title == PLOTS[0].title)
    panel = gui.add_panel()
    panel.float(x=GAP, y=-GAP, width=window.scene[0] - 2 * GAP, height=STRIP - GAP)
    if window.narrow:
        panel.minimize()
    return panel.add_tab


def plottable(
    time: Floats, columns: Sequence[Floats], factor: float
) -> tuple[tuple[Floats, ...], tuple[bool, ...]]:
    """Rows without gaps, times `factor`, and which columns are known at all.

    The diagram cannot scale an axis to NaN: rows with a gap in a known column are left out, a
    column never known is zero and not shown.
    """
    known = tuple(bool(np.isfinite(column).any()) for column in columns)
    whole = np.ones(len(time), dtype=bool)
    for column, is_known in zip(columns, known, strict=True):
        if is_known:
            whole &= np.isfinite(column)
    if not any(known):
        return (time[:0], *(column[:0] for column in columns)), known
    return (
        time[whole],
        *(
            column[whole] * factor if is_known else np.zeros(int(whole.sum()))
            for column, is_known in zip(columns, known, strict=True)
        ),
    ), known


def marked(data: tuple[Floats, ...], at: float) -> tuple[Floats, ...]:
    """Columns over their time with one more: 1 at the time `at`, 0 elsewhere."""
    time, *columns = data
    at = float(np.clip(at, time[0], time[-1]))
    place = int(np.searchsorted(time, at))

    def with_place(values: Floats) -> Floats:
        return np.insert(values, place, np.full(3, np.interp(at, time, values)))

    line = np.zeros(len(time) + 3)
    line[place + 1] = 1.0
    return with_place(time), *map(with_place, columns), line


def _axes(visitor: Visitor) -> tuple[uplot.Axis, ...]:
    ink, grid = visitor.palette.second_ink, '#8593a133'
    axis: uplot.Axis = {'stroke': ink, 'grid': {'stroke': grid}}
    return axis, axis


def _lines(plot: Plot, shown: tuple[bool, ...], ink: str) -> tuple[uplot.Series, ...]:
    return (
        uplot.Series(label='s'),
        *(
            uplot.Series(label=label, stroke=colour, width=2, dash=dash, show=show)
            for label, (colour, dash), show in zip(
                plot.series.values(), LINES, shown, strict=False
            )
        ),
        uplot.Series(
            label='time shown', stroke=ink, width=1.5, scale=MARK, points={'show': False}
        ),
    )
