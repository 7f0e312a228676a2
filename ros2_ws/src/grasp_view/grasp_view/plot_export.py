# SPDX-License-Identifier: Apache-2.0
"""What the diagrams show, as files: a table of every number over time, and a picture."""

from __future__ import annotations

import io

import numpy as np

from .plot_panel import LINES, PLOTS, SERIES
from .time_series import TimeSeries


def csv(series: TimeSeries) -> bytes:
    """One row a sample: time in s before the last one, then every number in SI, named."""
    table = np.stack(series.columns(SERIES, len(series)), axis=1)
    units = {name: plot.si for plot in PLOTS for name in plot.series}
    head = ','.join(['time_s', *(f'{name}{units[name]}' for name in SERIES)])
    rows = [
        ','.join('' if not np.isfinite(value) else f'{value:.9g}' for value in row)
        for row in table
    ]
    return '\n'.join([head, *rows, '']).encode()


def png(series: TimeSeries) -> bytes:
    """All diagrams one below the other."""
    # Imported with the first export: it takes longer than the page's start.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((9.0, 1.9 * len(PLOTS)), layout='constrained')
    FigureCanvasAgg(figure)
    for axes, plot in zip(figure.subplots(len(PLOTS), 1, sharex=True), PLOTS, strict=True):
        time, *columns = series.columns(tuple(plot.series), len(series))
        for column, label, (colour, dash) in zip(
            columns, plot.series.values(), LINES, strict=False
        ):
            style = (0, dash) if dash else 'solid'
            known = np.isfinite(column)
            axes.plot(
                time[known],
                column[known] * plot.factor,
                color=colour,
                linestyle=style,
                label=label,
            )
        axes.set_title(plot.title, loc='left', fontsize=9)
        axes.grid(color='0.9')
        if len(plot.series) > 1:
            axes.legend(loc='upper left', fontsize=8)
    axes.set_xlabel('time (s)')
    stream = io.BytesIO()
    figure.savefig(stream, format='png', dpi=150)
    return stream.getvalue()
