# SPDX-License-Identifier: Apache-2.0
"""`write_report`: everything of a run in one offline HTML file, and its pictures beside it."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.colors import to_hex

from . import pictures
from .errors import error_scale
from .scene import Curve, Floats, LinearityTrace, PublishedRow, ReportError, RowScene, Section
from .viewer import colour_table, pack

NEWTON_PER_LBF = 4.4482216152605
SAME_FORCE = 0.01
STATISTICS = {
    'mean': 'mean_error_m',
    'RMS': 'rms_error_m',
    'p95': 'p95_error_m',
    'max': 'max_error_m',
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
    predictions: Sequence[str],
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
            **_published_cells(match, predictions),
            'measured': _measured(row),
            'errors': [_milli(value, 3) for value in errors],
            'best': _unbeaten(errors, _floor(row)),
            'floor': _milli(row.get('noise_floor_m'), 3),
        }
    for match in left:
        yield {
            'order': match.force_lbf * NEWTON_PER_LBF,
            'newton': '–',
            **_published_cells(match, predictions),
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


def _published_cells(row: PublishedRow | None, predictions: Sequence[str]) -> dict[str, list[str]]:
    if row is None:
        return {'published': ['–'] * 4, 'predicted': ['–'] * len(predictions)}
    return {
        'published': [
            f'{row.force_lbf:.2f}',
            _milli(row.max_displacement_m),
            _milli(row.nonlinear_error_m),
            _milli(row.linear_error_m),
        ],
        'predicted': [_milli(row.predicted_m.get(name)) for name in predictions],
    }


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


def write_report(
    results: Mapping[str, Any],
    scenes: Sequence[RowScene],
    out_dir: Path,
    provenance: Mapping[str, Any],
    *,
    published: Sequence[PublishedRow] = (),
    curves: Sequence[Curve] = (),
    linearity: LinearityTrace | None = None,
    timings: Mapping[str, float] | None = None,
    sections: Sequence[Section] = (),
    bands: str = '',
) -> Path:
    """Write `report.html` and `pictures/<key>.png` into `out_dir`; returns the page's path.

    results: the document of `results.json`; its `rows` go with `scenes`, in order (a row without
    shapes is allowed when `scenes` is empty). provenance: names to values, one level of groups;
    a key `synthetic` is shown at the top. published: the paper's rows, kept apart from ours.
    curves: force over displacement; by default those of the results. timings: seconds by name.
    bands: what the bands and bars of the curves mean, in a sentence.
    sections: parts that other modules wrote, shown after the table.
    The same input gives the same bytes. Raises ReportError if rows and scenes do not fit.
    """
    rows = list(results['rows'])
    if scenes and len(scenes) != len(rows):
        raise ReportError(
            f'report: {len(scenes)} scenes for {len(rows)} rows of results; give one per row'
        )
    keys = [scene.key for scene in scenes]
    if len(set(keys)) != len(keys):
        raise ReportError(f'report: the row keys {", ".join(keys)} are not unique')
    theories = list(dict.fromkeys(name for row in rows for name in row['theories']))
    predictions = list(dict.fromkeys(name for row in published for name in row.predicted_m))
    kind = scenes[0].kind if scenes else 'measured'
    top = error_scale(scenes)
    drawn = {scene.key: pictures.png(pictures.triptych(scene, top)) for scene in scenes}
    here = files(__package__)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    page = environment.from_string((here / 'page.html').read_text()).render(
        title=f'Grasped shell: {provenance.get("title", provenance.get("object", "report"))}',
        synthetic=provenance.get('synthetic', ''),
        published=bool(published),
        predictions=predictions,
        theories=theories,
        kind=kind,
        table=sorted(_table(rows, theories, published, predictions), key=lambda row: row['order']),
        verdicts=[
            (f'{float(row["force_n"]):.2f} N', row['verdict'])
            for row in rows
            if row.get('verdict')
        ],
        statistics=list(STATISTICS),
        detail=list(_detail(rows, theories)),
        sections=list(sections),
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
        force_plot=Markup(
            pictures.svg(
                pictures.force_displacement(curves or _curves_of_results(rows, theories, kind))
            )
        ),
        bands=bands,
        linearity_plot=Markup(pictures.svg(pictures.linearity(linearity))) if linearity else '',
        timings=[(name, f'{value:.2f} s') for name, value in (timings or {}).items()],
        provenance=list(_grouped(provenance)),
        gradient=Markup(_gradient()),
        css=Markup((here / 'page.css').read_text()),
        packed=Markup(json.dumps([pack(scene, top) for scene in scenes])),
        colours=colour_table(),
        script=Markup((here / 'viewer.js').read_text()),
    )
    folder = out_dir / 'pictures'
    folder.mkdir(parents=True, exist_ok=True)
    for key, picture in drawn.items():
        (folder / f'{key}.png').write_bytes(picture)
    path = out_dir / 'report.html'
    path.write_text(page, encoding='utf-8')
    return path


def _gradient() -> str:
    stops = (to_hex(colormaps['cividis'](k / 8)) for k in range(9))
    return f'linear-gradient(to right, {", ".join(stops)})'
