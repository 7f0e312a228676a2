# SPDX-License-Identifier: Apache-2.0
"""`write_report`: everything of a run in one offline HTML file, and its pictures beside it."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.colors import to_hex

from . import pictures
from .errors import ErrorScales, error_scales
from .numbering import numbered
from .scene import (
    Curve,
    ErrorLine,
    Floats,
    LinearityTrace,
    PublishedRow,
    ReportError,
    RowScene,
    Section,
)
from .viewer import colour_table, pack

NEWTON_PER_LBF = 4.4482216152605
SAME_FORCE = 0.01
REFERENCE = ('authors', 'year', 'title', 'published', 'place', 'doi', 'modulus')
STATISTICS = {
    'mean': 'mean_error_m',
    'RMS': 'rms_error_m',
    'p95': 'p95_error_m',
    'largest mean over a disc of 2 mm': 'max_error_m',
    'largest single point': 'raw_max_error_m',
    'dent mean': 'dent_mean_error_m',
    'max displacement': 'max_displacement_m',
}


def _milli(value: object, digits: int = 2) -> str:
    return f'{value * 1e3:.{digits}f}' if isinstance(value, int | float) else '–'


def _measured(row: Mapping[str, Any]) -> str:
    depth = _milli(row.get('measured_max_displacement_m'))
    sigma = row.get('measured_max_displacement_sigma_m')
    return depth if sigma is None else f'{depth} ± {_milli(sigma)}'


def _published_for(force_n: float, published: Sequence[PublishedRow]) -> PublishedRow | None:
    for row in published:
        if abs(row.force_lbf * NEWTON_PER_LBF - force_n) <= SAME_FORCE * force_n:
            return row
    return None


def _table(
    rows: Sequence[Mapping[str, Any]],
    theories: Sequence[str],
    published: Sequence[PublishedRow],
) -> Iterator[dict[str, Any]]:
    left = list(published)
    for row in rows:
        force = float(row['force_n'])
        match = _published_for(force, left)
        if match is not None:
            left.remove(match)
        errors = [row['theories'].get(name, {}).get('mean_error_m') for name in theories]
        yield {
            'order': force,
            'newton': f'{force:.2f}',
            'published': _published_cells(match),
            'measured': _measured(row),
            'errors': [_milli(value, 3) for value in errors],
            'best': _unbeaten(errors, _floor(row)),
            'floor': _milli(row.get('noise_floor_m'), 3),
        }
    for match in left:
        yield {
            'order': match.force_lbf * NEWTON_PER_LBF,
            'newton': '–',
            'published': _published_cells(match),
            'measured': '–',
            'errors': ['–'] * len(theories),
            'best': set(),
            'floor': '–',
        }


def _floor(row: Mapping[str, Any]) -> float:
    known = [row.get('noise_floor_m'), row.get('undeformed_residual_m')]
    return max((value for value in known if value is not None), default=0.0)


def _unbeaten(errors: Sequence[float | None], floor: float) -> set[int]:
    """Which errors none undercuts by more than `floor`; nothing if that holds for all."""
    known = {k: value for k, value in enumerate(errors) if value is not None}
    least = min(known.values(), default=0.0)
    found = {k for k, value in known.items() if value - least <= floor}
    return found if len(found) < len(known) else set()


def _published_cells(row: PublishedRow | None) -> list[str]:
    if row is None:
        return ['–'] * 4
    return [
        f'{row.force_lbf:.2f}',
        _milli(row.max_displacement_m),
        _milli(row.nonlinear_error_m),
        _milli(row.linear_error_m),
    ]


def _models(
    published: Sequence[PublishedRow], predictions: Sequence[str]
) -> Iterator[tuple[str, list[str]]]:
    """Each model's displacements for the published forces, and how far each is off."""
    rows = sorted(published, key=lambda row: row.force_lbf)
    for name in predictions:
        cells = []
        for row in rows:
            value = row.predicted_m.get(name)
            cells.append('–' if value is None else _beside(value, row.max_displacement_m))
        yield name, cells


def _beside(value: float, measured: float) -> str:
    """A displacement, and how far it is off in whole percent (no minus before 0)."""
    return f'{_milli(value)} ({round(100 * (value / measured - 1)):+d} %)'


def _modulus(results: Mapping[str, Any]) -> str:
    """The modulus of the columns; theory thick, where it is one of them, has its own."""
    value = results.get('young_modulus_pa')
    if value is None:
        return ''
    of_solid = results.get('solid_young_modulus_pa', value)
    thick = any(
        row['theories'].get('thick', {}).get('mean_error_m') is not None for row in results['rows']
    )
    more = f' (thick: {of_solid / 1e6:.2f} MPa)' if thick and of_solid != value else ''
    return f'E {value / 1e6:.2f} MPa{more}'


def _error_plot(
    rows: Sequence[Mapping[str, Any]],
    theories: Sequence[str],
    published: Sequence[PublishedRow],
    kind: Any,
) -> Markup:
    """Published mean errors beside ours; empty without any of ours."""
    lines = []
    if published:
        force = np.array([row.force_lbf * NEWTON_PER_LBF for row in published])
        for name, theory, values in (
            ('nonlinear, Table I', 'koiter', [row.nonlinear_error_m for row in published]),
            ('linear, Table I', 'linear', [row.linear_error_m for row in published]),
        ):
            lines.append(ErrorLine(name, theory, 'published', force, np.array(values)))
    ours = [(row, row['theories']) for row in rows]
    for name in theories:
        known = [(float(row['force_n']), found[name]) for row, found in ours if name in found]
        pairs = np.array([(force, found['mean_error_m']) for force, found in known], dtype=float)
        if np.isfinite(pairs).any(axis=0).all():
            lines.append(ErrorLine(name, name, kind, pairs[:, 0], pairs[:, 1]))
    floors = [(float(row['force_n']), row.get('noise_floor_m')) for row in rows]
    floor = np.array([pair for pair in floors if pair[1] is not None]).reshape(-1, 2)
    if len(floor):
        lines.append(ErrorLine('noise floor', 'floor', kind, floor[:, 0], floor[:, 1]))
    return Markup(pictures.svg(pictures.mean_errors(lines))) if theories else Markup('')


def _detail(
    rows: Sequence[Mapping[str, Any]], theories: Sequence[str]
) -> Iterator[dict[str, Any]]:
    for row in rows:
        for name in theories:
            numbers = row['theories'].get(name)
            if numbers is not None:
                yield {
                    'newton': f'{float(row["force_n"]):.2f}',
                    'theory': name,
                    'numbers': [_milli(numbers.get(key), 3) for key in STATISTICS.values()],
                }


def _grouped(provenance: Mapping[str, Any]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    for group, value in provenance.items():
        if group in ('title', 'synthetic'):
            continue
        lines = value.items() if isinstance(value, Mapping) else [('', value)]
        yield str(group), [(str(name), str(inner)) for name, inner in lines]


def _curves_of_results(
    rows: Sequence[Mapping[str, Any]], theories: Sequence[str], kind: Any
) -> list[Curve]:
    def series(values: Sequence[float | None]) -> tuple[Floats, Floats]:
        pairs = [
            (value, float(row['force_n']))
            for value, row in zip(values, rows, strict=True)
            if value is not None
        ]
        both = np.array(pairs, dtype=np.float64).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    curves = [
        Curve('recording', kind, *series([row.get('measured_max_displacement_m') for row in rows]))
    ]
    for name in theories:
        values = [row['theories'].get(name, {}).get('max_displacement_m') for row in rows]
        curves.append(Curve(name, 'predicted', *series(values)))
    return curves


@dataclass(frozen=True)
class Report:
    """What a page shows.

    Attributes:
        results: the document of `results.json`; its `rows` go with `scenes`, in order (a row
            without shapes is allowed when `scenes` is empty).
        provenance: names to values, one level of groups; a key `synthetic` is shown at the top.
        published: the paper's rows, kept apart from ours. published_in: what is known of the
            paper, of the names in `REFERENCE`.
        curves: force over displacement; by default those of the results. bands: what their bands
            and bars mean, in a sentence. timings: seconds by name.
        sections: parts that other modules wrote, shown after the table.
    """

    results: Mapping[str, Any]
    scenes: Sequence[RowScene]
    provenance: Mapping[str, Any]
    published: Sequence[PublishedRow] = ()
    published_in: Mapping[str, Any] | None = None
    curves: Sequence[Curve] = ()
    linearity: LinearityTrace | None = None
    timings: Mapping[str, float] | None = None
    sections: Sequence[Section] = ()
    bands: str = ''


def write_report(report: Report, out_dir: Path) -> Path:
    """Write `report.html` and `pictures/<key>.png` into `out_dir`; returns the page's path.

    The same input gives the same bytes. Raises ReportError if rows and scenes do not fit.
    """
    scenes = report.scenes
    _check(report.results['rows'], scenes)
    tops = error_scales(scenes)
    drawn = {scene.key: pictures.png(pictures.triptych(scene, tops)) for scene in scenes}
    page = _page(report, drawn, tops)
    folder = out_dir / 'pictures'
    folder.mkdir(parents=True, exist_ok=True)
    for key, picture in drawn.items():
        (folder / f'{key}.png').write_bytes(picture)
    path = out_dir / 'report.html'
    path.write_text(page, encoding='utf-8')
    return path


def _check(rows: Sequence[Mapping[str, Any]], scenes: Sequence[RowScene]) -> None:
    if scenes and len(scenes) != len(rows):
        raise ReportError(
            f'report: {len(scenes)} scenes for {len(rows)} rows of results; give one per row'
        )
    keys = [scene.key for scene in scenes]
    if len(set(keys)) != len(keys):
        raise ReportError(f'report: the row keys {", ".join(keys)} are not unique')


def _page(report: Report, drawn: Mapping[str, bytes], tops: ErrorScales) -> str:
    """The page as text, with the `drawn` pictures of the rows in it."""
    scenes, provenance, published = report.scenes, report.provenance, report.published
    rows = list(report.results['rows'])
    theories = list(dict.fromkeys(name for row in rows for name in row['theories']))
    predictions = list(dict.fromkeys(name for row in published for name in row.predicted_m))
    kind = scenes[0].kind if scenes else 'measured'
    curves = report.curves or _curves_of_results(rows, theories, kind)
    package = files(__package__)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string((package / 'page.html').read_text())
    page = template.render(
        title=f'Grasped shell: {provenance.get("title", provenance.get("object", "report"))}',
        synthetic=provenance.get('synthetic', ''),
        published=bool(published),
        models=list(_models(published, predictions)),
        published_rows=sorted(published, key=lambda row: row.force_lbf),
        reference=_reference(report),
        modulus=_modulus(report.results),
        error_plot=_error_plot(rows, theories, published, kind),
        lbf=NEWTON_PER_LBF,
        theories=theories,
        kind=kind,
        table=sorted(_table(rows, theories, published), key=lambda row: row['order']),
        verdicts=[
            (f'{float(row["force_n"]):.2f} N', row['verdict'])
            for row in rows
            if row.get('verdict')
        ],
        statistics=list(STATISTICS),
        detail=list(_detail(rows, theories)),
        sections=list(report.sections),
        rows=[
            {
                'key': scene.key,
                'title': scene.title,
                'kind': scene.kind,
                'triptych': base64.b64encode(drawn[scene.key]).decode(),
                'profile': Markup(pictures.svg(pictures.profile(scene))),
                'half_width': '0.75',
            }
            for scene in scenes
        ],
        force_plot=Markup(pictures.svg(pictures.force_displacement(curves))),
        bands=report.bands,
        linearity_plot=_linearity_plot(report),
        timings=[(name, f'{value:.2f} s') for name, value in (report.timings or {}).items()],
        provenance=list(_grouped(provenance)),
        gradient=Markup(_gradient()),
        css=Markup((package / 'page.css').read_text()),
        packed=Markup(json.dumps([pack(scene, tops) for scene in scenes])),
        colours=colour_table(),
        script=Markup((package / 'viewer.js').read_text()),
    )
    return numbered(page)


def _reference(report: Report) -> dict[str, Any]:
    known = report.published_in
    return {**dict.fromkeys(REFERENCE, ''), **known} if known else {}


def _linearity_plot(report: Report) -> str:
    trace = report.linearity
    return Markup(pictures.svg(pictures.linearity(trace))) if trace else ''


def _gradient() -> str:
    stops = (to_hex(colormaps['cividis'](k / 8)) for k in range(9))
    return f'linear-gradient(to right, {", ".join(stops)})'
