# SPDX-License-Identifier: Apache-2.0
"""Numbers over time, docked beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from .poses import Floats
from .time_series import TimeSeries

ROWS = 240
LINES = (('#00457c', ()), ('#c05a00', (6, 3)), ('#666666', (2, 2)))


@dataclass(frozen=True)
class Plot:
    """One diagram: series of `TimeSeries` by name with their labels, times `factor` = unit."""

    title: str
    series: dict[str, str]
    factor: float


PLOTS = (
    Plot('force (N)', {'force_1': 'F1', 'force_2': 'F2', 'force_3': 'F3'}, 1.0),
    Plot('largest displacement (mm)', {'max_displacement': 'served'}, 1e3),
    Plot('error of linear theory (%)', {'linearity': 'linearity'}, 1e2),
    Plot('age (ms)', {'surface_age': 'surface', 'nonlinear_age': 'nonlinear'}, 1e3),
    Plot('latency: contacts to surface (ms)', {'latency': 'surface'}, 1e3),
    Plot(
        'scan error (mm)', {'mean_error': 'mean', 'max_error': 'max', 'noise_floor': 'floor'}, 1e3
    ),
)
SERIES = tuple(name for plot in PLOTS for name in plot.series)


class PlotPanel:
    """The diagrams of one browser."""

    def __init__(self, client: viser.ClientHandle, series: TimeSeries, folded: bool) -> None:
        self._series = series
        self._handles: list[tuple[Plot, viser.GuiUplotHandle]] = []
        self._shown: dict[str, tuple[bool, ...]] = {}
        gui = client.gui
        panel = gui.add_panel()
        panel.dock_left()
        panel.set_width(300)
        if folded:
            panel.minimize()
        with panel.add_tab(f'Last {series.span:g} s'):
            for plot in PLOTS:
                unknown = (False,) * len(plot.series)
                empty = np.array([-series.span])
                handle = gui.add_uplot(
                    (empty, *(np.zeros(1) for _ in plot.series)),
                    _lines(plot, unknown),
                    title=plot.title,
                    scales={
                        'x': uplot.Scale(time=False, range=(-series.span, 0.0)),
                        'y': uplot.Scale(auto=True),
                    },
                    legend=uplot.Legend(show=len(plot.series) > 1, live=False),
                    padding=(12, 24, 0, 8),
                    height=150,
                )
                self._handles.append((plot, handle))
                self._shown[plot.title] = unknown

    def draw(self) -> None:
        """Bring the diagrams up to date."""
        for plot, handle in self._handles:
            time, *columns = self._series.columns(tuple(plot.series), ROWS)
            # Seconds before now: the diagram's window stands still while the lines move.
            data, shown = plottable(time - time[-1:].sum(), columns, plot.factor)
            if not len(data[0]):
                continue
            if shown != self._shown[plot.title]:
                self._shown[plot.title] = shown
                handle.series = _lines(plot, shown)
            handle.data = data


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


def _lines(plot: Plot, shown: tuple[bool, ...]) -> tuple[uplot.Series, ...]:
    return (
        uplot.Series(label='s'),
        *(
            uplot.Series(label=label, stroke=colour, width=2, dash=dash, show=show)
            for label, (colour, dash), show in zip(
                plot.series.values(), LINES, shown, strict=False
            )
        ),
    )
