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
from numpy.typing import NDArray

from shell_deform.grasp.mapping import MapRequest, Workplace, described, ranking
from shell_deform.grasp.measures import HONESTY
from shell_deform.grasp.window import UNLIMITED

SHOWN = 50
COLUMNS = (
    'number', 'worst_capacity_n', 'worst_capacity_sigma_n', 'liftable_mass_kg',
    'liftable_mass_sigma_kg', 'closed', 'closure_probability', 'needed_friction',
    'needed_friction_sigma', 'epsilon_n', 'gravity_slip_n', 'gravity_slip_sigma_n',
    'worst_slip_n', 'worst_slip_sigma_n', 'push_n', 'depth_m', 'least_push_n', 'most_push_n',
    'limit', 'snap_margin', 'smallest_stiffness_n_m', 'adversary_work_j', 'energy_j',
    'squeeze_work_j', 'rigid_share', 'largest_stress_pa', 'stress_sigma_pa',
    'stress_unresolved', 'largest_strain', 'dent_push_n', 'stable', 'contact_points',
)  # fmt: skip
HEADINGS = {
    'number': 'grasp', 'worst_capacity_n': 'worst of 26 [N]', 'liftable_mass_kg': 'lifts [kg]',
    'closed': 'closed', 'closure_probability': 'P(closed)', 'needed_friction': 'needed friction',
    'push_n': 'push [N]', 'least_push_n': 'least push [N]', 'most_push_n': 'most push [N]',
    'limit': 'limit', 'snap_margin': 'snap margin',
}  # fmt: skip
STYLE = (
    'body{font:15px/1.45 system-ui,sans-serif;color:#1b2330;max-width:66em;margin:2em auto;'
    'padding:0 1em}h1{margin:0 0 .3em}figure{margin:1.5em 0}img{max-width:100%}'
    'figcaption{color:#4a5565;font-size:13px}table{border-collapse:collapse;font-size:13px;'
    'font-variant-numeric:tabular-nums}td,th{padding:.3em .8em;text-align:right}'
    'thead th{position:sticky;top:0;background:#fff;border-bottom:2px solid #cbd3de}'
    'tbody tr:nth-child(even){background:#f3f5f8}'
)


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
    name, asked = escape(place.shell.name), told['request']
    closed = sum(one['closed'] for one in told['grasps'])
    squeeze = f'{asked["force"]:g} N' if asked['force'] else f'{1e3 * asked["depth"]:g} mm'
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<title>Grasps of {name}</title><style>{STYLE}</style></head><body>'
        f'<h1>Grasps of {name}</h1><p>{len(told["grasps"])} grasps of '
        f'{escape(asked["hand"].replace("_", " "))}, each squeezed to {squeeze}, friction '
        f'{asked["friction"]:g} ± {asked["friction_sigma"]:g}, {1e3 * asked["mass"]:g} g to lift: '
        f'{closed} are closed. {len(told["failed"])} more have no equilibrium. Ranked: '
        f'{escape(told["ranked_by"])}. {escape(HONESTY.capitalize())}.</p>'
        '<figure><img alt="Places of the contacts on both sides of the object, by liftable mass '
        f'and by snap margin" src="data:image/png;base64,{_picture(told, place)}">'
        '<figcaption>Where the contacts of all grasps are, on either side of the object: what the '
        'grasp lifts, and its stiffness over that of the first squeeze (0: it snaps).'
        f'</figcaption></figure><h2>The best {min(SHOWN, len(told["grasps"]))}</h2>'
        f'<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></body></html>\n'
    )


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    if isinstance(value, float):
        return f'{value:.3g}' if value < UNLIMITED else '–'
    return escape(str(value)) or '–'


def _picture(told: dict[str, Any], place: Workplace) -> str:
    """The contacts on both sides, coloured by liftable mass and by snap margin, as base64 PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 8.6), dpi=110, layout='constrained')
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 2, sharex=True, sharey=True, squeeze=True)
    shown = told['grasps']
    at, axis = (
        np.array([row for one in shown for row in one[name]]).reshape(-1, 3)
        for name in ('at_m', 'axis')
    )
    size = float(np.clip(30000.0 / max(len(at), 1), 14.0, 40.0))
    for row, (name, label) in zip(
        panels,
        (('liftable_mass_kg', 'liftable mass [kg]'), ('snap_margin', 'snap margin [-]')),
        strict=True,
    ):
        value = np.repeat([one[name] for one in shown], len(at) // max(len(shown), 1))
        # A few grasps far from all others would leave these one colour.
        ends = np.quantile(value, [0.02, 0.98]) if len(value) else np.array([0.0, 1.0])
        for axes, side in zip(row, (-1.0, 1.0), strict=True):
            # Seen along y, z up: x to the right from the front, to the left from behind.
            view = 1e3 * np.array([[-side, 0.0, 0.0], [0.0, 0.0, 1.0]])
            _draw_side(axes, place, view, side)
            facing = side * axis[:, 1] < 0.0
            dots = axes.scatter(
                *(view @ at[facing].T), c=value[facing], cmap='cividis', s=size,
                vmin=ends[0], vmax=ends[1], edgecolors='white', linewidths=0.2,
            )  # fmt: skip
        figure.colorbar(dots, ax=row, label=label, shrink=0.85)
    for axes, where in zip(panels[0], ('-y', '+y'), strict=True):
        axes.set_title(f'from {where}', fontsize=10)
    stream = io.BytesIO()
    figure.savefig(stream, format='png', metadata={'Software': None})
    return base64.b64encode(stream.getvalue()).decode()


def _draw_side(axes: Any, place: Workplace, view: NDArray[np.float64], side: float) -> None:
    """The half of the object that faces the eye, by `view` (2, 3) in mm."""
    from matplotlib.collections import PolyCollection

    corners = place.points[place.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = side * normal[:, 1] / np.linalg.norm(normal, axis=1)
    order = np.argsort(side * corners[:, :, 1].mean(axis=1))
    order = order[light[order] > 0.0]
    grey = np.repeat(0.72 + 0.22 * light[order, None], 3, axis=1)
    faces = PolyCollection(
        corners[order] @ view.T, facecolors=grey, edgecolors=grey, linewidths=0.3
    )
    axes.add_collection(faces)
    axes.set_aspect('equal')
    axes.set(xlabel='x [mm]' if side < 0.0 else '-x [mm]', ylabel='z [mm]')
    axes.tick_params(labelsize=8)
    axes.spines[['top', 'right']].set_visible(False)


def _write(path: Path, text: str) -> None:
    """A file that is there as a whole or not at all."""
    temporary = path.with_name(f'.{path.name}.part')
    temporary.write_text(text, encoding='utf-8')
    os.replace(temporary, path)
