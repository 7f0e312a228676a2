# SPDX-License-Identifier: Apache-2.0
"""The files of a recorded turn: numbers, a table, and torque against angle as a page."""

from __future__ import annotations

import base64
import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from grasp_replay.report.plain_page import plain_page
from grasp_replay.results import json_text, write_file

NUMBERS, TABLE, PAGE = 'turning.json', 'turning.csv', 'turning.html'


def write_turn(turn: dict[str, Any], out: Path) -> Path:
    """Write the three files into `out`; returns the page."""
    out.mkdir(parents=True, exist_ok=True)
    write_file(out / NUMBERS, json_text(turn))
    text = io.StringIO()
    writer = csv.DictWriter(text, list(turn['rows'][0]), lineterminator='\n')
    writer.writeheader()
    writer.writerows(turn['rows'])
    write_file(out / TABLE, text.getvalue())
    title = f'{turn["object"]}: torque against angle'
    facts = Markup('').join(Markup('<p>{}</p>').format(line) for line in sentences(turn))
    body = Markup(
        '<p>{}</p>\n<figure><img alt="{}" src="data:image/svg+xml;base64,{}">'
        '<figcaption>Torque of grip {} over the angle that it has turned: solved, {}what friction '
        'allows where fingers rub.</figcaption></figure>\n{}'
    ).format(
        turn['label'],
        title,
        base64.b64encode(_picture(turn)).decode(),
        turn['grip'],
        'measured by the wrist, ' if 'rms_error_nm' in turn else '',
        facts,
    )
    write_file(out / PAGE, plain_page(title, body))
    return out / PAGE


def sentences(turn: dict[str, Any]) -> list[str]:
    """What the turn comes to, for the page and a terminal."""
    last = np.degrees(turn['rows'][-1]['turn_rad'])
    found = [
        f'Grip {turn["grip"]} of {turn["object"]} turned by {last:.3g} degrees: largest torque '
        f'{turn["largest_torque_nm"]:.4g} N m.'
    ]
    if 'rms_error_nm' in turn:
        found.append(
            f'The wrist felt {turn["largest_measured_torque_nm"]:.4g} N m at most; the solved '
            f'torque lies {turn["rms_error_nm"]:.2g} N m (rms) beside it.'
        )
    if 'warning_at_s' in turn:
        found.append(
            f'The fingers are about to slip from {turn["warning_at_s"]:.2f} s on, '
            f'{100 * turn["warning_before_share"]:.0f} % of the torque before they do; '
            f'they slip at {turn["slip_torque_nm"]:.4g} N m.'
        )
    if turn['message']:
        found.append(f'Not followed to the end: {turn["message"]}.')
    return found


def _picture(turn: dict[str, Any]) -> bytes:
    """Torque against angle (SVG), the same bytes for the same numbers."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    rows = turn['rows']
    angle = np.degrees([row['turn_rad'] for row in rows])
    with matplotlib.rc_context({'svg.hashsalt': 'turning'}):
        figure = Figure(figsize=(7.5, 4.5), layout='constrained')
        axes = figure.add_subplot()
        felt = [row['measured_torque_nm'] for row in rows]
        if any(value is not None for value in felt):
            axes.plot(angle, [np.nan if v is None else v for v in felt], 'k.', label='measured')
        axes.plot(angle, [row['torque_nm'] for row in rows], label='solved')
        if rows[0]['friction_capacity_nm'] is not None:
            capacity = [row['friction_capacity_nm'] for row in rows]
            axes.plot(angle, capacity, '--', label='friction allows')
            warned = [a for a, row in zip(angle, rows, strict=True) if row['slip_warning']]
            if warned:
                axes.axvspan(warned[0], angle.max(), alpha=0.2, color='C3', label='slip warning')
        axes.set(xlabel='angle [degrees]', ylabel='torque [N m]')
        axes.legend()
        picture = io.BytesIO()
        FigureCanvasSVG(figure).print_svg(picture, metadata={'Date': None})
    return picture.getvalue()
