# SPDX-License-Identifier: Apache-2.0
"""A hold in the report: force against the logarithm of time, with the band that was predicted."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup
from matplotlib.figure import Figure

from grasp_replay.relaxed import HoldTrace
from grasp_replay.report import Section
from grasp_replay.report.pictures import LINEAR, NONLINEAR, THICK, figure_of, svg
from shell_deform.identify.relaxation import NINETY

COLOURS = (NONLINEAR, LINEAR, THICK)

SQUEEZE = 0.15
"""Of the time until which pushes were known; before it the fingers still move."""


def hold_sections(traces: Sequence[tuple[int, HoldTrace]]) -> list[Section]:
    """The section of the rows' holds, (row number, trace) each; none where none was recorded."""
    if not traces:
        return []
    body = Markup('')
    for number, trace in traces:
        told = trace.to_json()
        ends = ', '.join(
            f'finger {one["finger"]}: {one["predicted_n"]:.2f} ± {one["sigma_n"]:.2f} N '
            f'predicted, {one["felt_n"]:.2f} N felt'
            for one in told['fingers']
        )
        body += Markup(
            '<figure class="hold">{}<figcaption>Row {}: pushes as felt over the time since first '
            'touch. Line and 90 % band: predicted at the dashed line from what was felt until '
            'then and the relaxation of the object file; the band is of what the gauges say, with '
            'their noise and drift. After {:.3g} s {}; {:.0f} % of the later samples lie in the '
            'band.</figcaption></figure>'
        ).format(
            Markup(svg(force_over_time(trace))), number, told['predicted_at_s'], ends,
            100.0 * told['inside_band'],
        )  # fmt: skip
    return [Section('hold', 'While it is held', body)]


def force_over_time(trace: HoldTrace) -> Figure:
    """Pushes over the logarithm of time, the prediction and its 90 % band."""
    figure = figure_of(8.0, 3.8)
    axes = figure.add_axes((0.09, 0.14, 0.89, 0.82))
    # What is left out on the left is the squeeze: the time axis has no beginning.
    shown = trace.time > SQUEEZE * trace.known
    for k, finger in enumerate(trace.finger):
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(trace.time[shown], trace.push[shown, k], '.', ms=1.5, alpha=0.3, color=colour)
        force, half = trace.force[:, k], NINETY * trace.sigma[:, k]
        axes.plot(trace.later, force, color=colour, label=f'finger {finger}')
        axes.fill_between(trace.later, force - half, force + half, color=colour, alpha=0.25)
    axes.axvline(trace.known, color='black', linestyle='--', label='known until here')
    axes.set_xscale('log')
    axes.set(xlabel='time since first touch (s)', ylabel='push (N)')
    axes.grid(alpha=0.3, which='both')
    axes.legend(fontsize=8)
    return figure
