# SPDX-License-Identifier: Apache-2.0
"""The files of a map: JSON and CSV of all grasps, a page with the picture and the best ones."""

from __future__ import annotations

import base64
import csv
import io
import json
import os
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from shell_deform.grasp.mapping import MapRequest, Workplace, described, ranking
from shell_deform.grasp.measures import HONESTY

SHOWN = 50
COLUMNS = (
    'number', 'worst_capacity_n', 'liftable_mass_kg', 'closed', 'closure_probability',
    'needed_friction', 'needed_friction_sigma', 'epsilon_n', 'gravity_slip_n', 'worst_slip_n',
    'push_n', 'depth_m', 'least_push_n', 'most_push_n', 'limit', 'snap_margin',
    'smallest_stiffness_n_m', 'adversary_work_j', 'energy_j', 'squeeze_work_j', 'rigid_share',
    'largest_stress_pa', 'stress_sigma_pa', 'stress_unresolved', 'largest_strain', 'dent_push_n',
    'stable', 'contact_points',
)  # fmt: skip
HEADINGS = {
    'number': 'grasp', 'worst_capacity_n': 'worst of 26 [N]', 'liftable_mass_kg': 'lifts [kg]',
    'closure_probability': 'P(closed)', 'needed_friction': 'needed friction',
    'push_n': 'push [N]', 'least_push_n': 'least push [N]', 'most_push_n': 'most push [N]',
    'limit': 'limit', 'snap_margin': 'snap margin',
}  # fmt: skip


def document(request: MapRequest, grasps: list[dict[str, Any]]) -> dict[str, Any]:
    """The document of `map.json`: request, grasps in the order of their rank, failures."""
    ranked = ranking(grasps)
    return {
        'request': described(request),
        'note': HONESTY,
        'ranked_by': 'stable first, then the largest force carried in the worst of 26 directions',
        'grasps': ranked,
        'failed': [one for one in grasps if 'failed' in one],
    }


def write_map(
    request: MapRequest, grasps: list[dict[str, Any]], place: Workplace, out: Path
) -> dict[str, Any]:
    """Write `map.json`, `map.csv` and `map.html` into `out`; returns the document."""
    told = document(request, grasps)
    _write(out / 'map.json', json.dumps(told, indent=1, allow_nan=False) + '\n')
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(COLUMNS)
    writer.writerows([one[name] for name in COLUMNS] for one in told['grasps'])
    _write(out / 'map.csv', stream.getvalue())
    _write(out / 'map.html', _page(told, place))
    return told


def _page(told: dict[str, Any], place: Workplace) -> str:
    head = ''.join(f'<th>{escape(text)}</th>' for text in HEADINGS.values())
    rows = ''.join(
        '<tr>' + ''.join(f'<td>{_cell(one[name])}</td>' for name in HEADINGS) + '</tr>'
        for one in told['grasps'][:SHOWN]
    )
    name = escape(place.shell.name)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<title>Grasps of {name}</title><style>body{{font:15px sans-serif;margin:2em}}'
        'td,th{padding:.2em .7em;text-align:right}img{max-width:100%}</style></head><body>'
        f'<h1>Grasps of {name}</h1><p>{len(told["grasps"])} grasps, {len(told["failed"])} without '
        f'an equilibrium. Ranked: {escape(told["ranked_by"])}. {escape(HONESTY.capitalize())}.</p>'
        f'<img alt="Places of the first pin, by liftable mass and by snap margin" '
        f'src="data:image/png;base64,{_picture(told, place)}">'
        f'<table><tr>{head}</tr>{rows}</table></body></html>\n'
    )


def _cell(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else escape(str(value))


def _picture(told: dict[str, Any], place: Workplace) -> str:
    """The places of all pins, coloured by liftable mass and by snap margin, as base64 PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.0), dpi=110)
    FigureCanvasAgg(figure)
    shown = told['grasps']
    for i, (name, label) in enumerate(
        (('liftable_mass_kg', 'liftable mass [kg]'), ('snap_margin', 'snap margin [-]'))
    ):
        axes = figure.add_subplot(1, 2, i + 1, projection='3d')
        corners = 1e3 * place.points
        axes.plot_trisurf(
            *corners.T, triangles=place.triangles, color=(0.8, 0.8, 0.8, 0.25), linewidth=0.0
        )
        if shown:
            at = 1e3 * np.array([point for one in shown for point in one['at_m']])
            value = np.repeat([one[name] for one in shown], len(shown[0]['at_m']))
            dots = axes.scatter(*at.T, c=value, cmap='cividis', s=12, depthshade=False)
            figure.colorbar(dots, ax=axes, label=label, shrink=0.7)
        axes.set(xlabel='x [mm]', ylabel='y [mm]', zlabel='z [mm]')
        axes.set_aspect('equal')
    stream = io.BytesIO()
    figure.savefig(stream, format='png', metadata={'Software': None})
    return base64.b64encode(stream.getvalue()).decode()


def _write(path: Path, text: str) -> None:
    """A file that is there as a whole or not at all."""
    temporary = path.with_name(f'.{path.name}.part')
    temporary.write_text(text, encoding='utf-8')
    os.replace(temporary, path)
