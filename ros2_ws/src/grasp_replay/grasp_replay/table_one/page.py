# SPDX-License-Identifier: Apache-2.0
"""The study of Table I as a section of a report, and as a page of its own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from grasp_replay.errors import BagError
from grasp_replay.report import Curve, Section
from grasp_replay.report import pictures as drawing
from grasp_replay.report.plain_page import plain_page
from grasp_replay.results import json_text, write_file

NUMBERS, PAGE = 'table_one.json', 'table_one.html'
TITLE = 'Table I, settled'
WHAT = {
    'koiter': 'koiter',
    'paper': 'paper as printed, (5)/(6) put right',
    'paper_restored': 'paper with the dropped terms',
    'linear': 'linear',
    'thick': 'a wall with a thickness',
}


def section(study: dict[str, Any]) -> Section:
    """The study as HTML."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters.update(
        milli=_milli,
        mega=lambda value: f'{value / 1e6:.2f}',
        kilo=lambda value: '–' if value is None else f'{value / 1e3:.1f}',
        newton=lambda value: f'{value:.2f}',
        ratio=lambda value: f'{value:.1f}',
        percent=lambda value: f'{100 * value:+.1f}\u00a0%',
        share=lambda value: f'{100 * value:.1f} %',
        second=_second,
    )
    one = study['row_one']
    main = [
        ('koiter, E from row 1', one),
        ('koiter, all rows', study['all_rows']),
        ('linear, E from row 1', study['linear_row_one']),
        ('linear, all rows', study['linear_all_rows']),
        ('thick, E from row 1', study['thick_row_one']),
        ('koiter without air, E from row 1', study['without_air']),
    ]
    low, high = (band['young_modulus_pa'] / one['young_modulus_pa'] - 1 for band in one['band'])
    soft, stiff = (band['displacement_m'] for band in one['band'])
    bands = ', '.join(
        f'row {row} {_milli(less)} to {_milli(more)} mm'
        for row, (less, more) in enumerate(zip(stiff, soft, strict=True), start=1)
    )
    text = (files(__package__) / 'section.html').read_text()
    body = environment.from_string(text).render(
        study=study,
        main=main,
        pressures=[
            (f'{found["gauge_pressure_pa"] / 1e3:g} kPa', found)
            for found in study['pressure_scan']
        ],
        influences=[
            (f'{WHAT[found["theory"]]}, pin {1e3 * found["pin_radius_m"]:g} mm', found)
            for found in study['influences']
        ],
        band_of_modulus=f'{100 * low:+.1f} to {100 * high:+.1f} %',
        bands=bands,
        curves_plot=Markup(drawing.svg(drawing.force_displacement(curves(study)))),
    )
    return Section('table-one', TITLE, Markup(body))


def curves(study: dict[str, Any]) -> list[Curve]:
    """Published points and predictions with their bands, as force over displacement."""
    rows = study['rows']
    force = np.array([row['force_n'] for row in rows])
    points = np.array([row['measured_max_displacement_m'] for row in rows])
    found = [
        Curve(
            'Table I', 'published', points, force,
            displacement_band_m=study['scanner_accuracy_m'],
        )
    ]  # fmt: skip
    for name, key in (('koiter', 'row_one'), ('linear', 'linear_row_one')):
        one = study[key]
        depth = np.array([0.0, *one['displacement_m']])
        lines = [
            np.interp(depth, [0.0, *band['displacement_m']], [0.0, *force]) for band in one['band']
        ]
        found.append(
            Curve(
                name, 'predicted', depth, np.array([0.0, *force]),
                lower_n=np.minimum(*lines), upper_n=np.maximum(*lines),
            )
        )  # fmt: skip
    return found


def write_table_one(study: dict[str, Any], out: Path) -> Path:
    """Write `table_one.json` and `table_one.html` into `out`; returns the page, or BagError."""
    found = section(study)
    page = plain_page(found.title, found.body)
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_file(out / PAGE, page)
        write_file(out / NUMBERS, json_text(study))
    except OSError as error:
        raise BagError(f'{out} cannot be written: {error.strerror}') from error
    return out / PAGE


def lines(study: dict[str, Any]) -> list[list[str]]:
    """The main numbers for the terminal: heading first."""
    rows: Sequence[dict[str, Any]] = study['rows']
    heading = ['model', 'E [MPa]', *(f'{row["force_n"]:.2f} N' for row in rows)]
    published = [
        'published', '', *(_milli(row['measured_max_displacement_m']) + ' mm' for row in rows)
    ]  # fmt: skip
    table = [heading, published]
    for name, key in (
        ('koiter, E from row 1', 'row_one'),
        ('koiter, all rows', 'all_rows'),
        ('linear, E from row 1', 'linear_row_one'),
        ('linear, all rows', 'linear_all_rows'),
        ('thick, E from row 1', 'thick_row_one'),
    ):
        found = study[key]
        cells = [
            f'{_milli(w)} mm {100 * error:+.1f} %' if w is not None else '–'
            for w, error in zip(found['displacement_m'], found['relative_error'], strict=True)
        ]
        table.append([name, f'{found["young_modulus_pa"] / 1e6:.2f}', *cells])
    return table


def _milli(value: float | None, digits: int = 2) -> str:
    return '–' if value is None else f'{1e3 * value:.{digits}f}'


def _second(found: dict[str, Any]) -> str:
    other = found.get('independent_displacement_m')
    if other is None or None in found['displacement_m']:
        return '–'
    largest = max(
        (ours / theirs - 1.0 for ours, theirs in zip(found['displacement_m'], other, strict=True)),
        key=abs,
    )
    return f'{100 * largest:+.2f} %'
