# SPDX-License-Identifier: Apache-2.0
"""The grasp in the report: friction that closure needs over the squeeze, the squeeze window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from grasp_replay.report import Section
from grasp_replay.report.pictures import LINEAR, NONLINEAR, REST, svg
from grasp_replay.touch_cells import sentence

UNLIMITED_N = 1e8
"""A push beyond it means that nothing known is the limit."""

NO_FRICTION = 20.0
"""Needed friction from here on means that none would do."""


def grasp_sections(rows: Sequence[Mapping[str, Any]]) -> list[Section]:
    """The section of the rows' `grasp` documents; none where no row has a grasp that solved."""
    known = [row for row in rows if row.get('grasp') and 'failed' not in row['grasp']]
    if not known:
        return []
    known = with_nearest_limits(sorted(known, key=lambda row: float(row['force_n'])))
    head = ''.join(
        f'<th>{text}</th>'
        for text in (
            'squeeze (N)', 'needed friction', 'closed', 'probability', 'lifts (kg)',
            'least squeeze (N)', 'most squeeze (N)', 'limit',
        )
    )  # fmt: skip
    body = Markup(
        '<figure>{curve}<figcaption>Friction that closure needs on the deformed normals{theory}, '
        'with one sigma, over the mean push of the fingers; dotted: the friction that the table '
        'is for. Below it the grasp is closed.</figcaption></figure>'
        '<figure>{bars}<figcaption>Squeeze window of each row: from the least push that lifts '
        'the object{mass} to the first limit of the wall, which rows beyond it take from the last '
        'one that keeps it; the mark is the push of the row.'
        '</figcaption></figure>'
        '<div class="wide"><table id="grasp-rows"><caption>What the grasp of each row needs, '
        'lifts and bears.</caption><thead><tr>{head}</tr></thead>'
        '<tbody>{cells}</tbody></table></div><p class="note">{note}.</p>{touch}'
    ).format(
        curve=Markup(svg(needed_friction(known))),
        bars=Markup(svg(windows(known))),
        theory=_theories(known),
        mass=_mass(known),
        head=Markup(head),
        cells=Markup('').join(map(_cells, known)),
        note=str(known[0]['grasp']['note']).capitalize(),
        touch=Markup('').join(map(_touch, known)),
    )
    return [Section('grasp', 'Does the grasp hold', body)]


def _touch(row: Mapping[str, Any]) -> Markup:
    """A line for measured touch cells; empty where none were recorded."""
    touch = row['grasp'].get('touch')
    if not touch:
        return Markup('')
    return Markup('<p class="touch">Touch cells at {push:.2f} N: {told}.</p>').format(
        push=_push(row['grasp']), told=sentence(touch)
    )


def with_nearest_limits(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Rows (by their push) whose windows end where the nearest row within the limits says.

    A row tells its limit in proportion to its push. Stress and strain under a finger grow faster
    than the push, so the row before the limit is nearer to the truth than one far beyond it.
    """
    told: list[Mapping[str, Any]] = []
    kept: Mapping[str, Any] | None = None
    for row in rows:
        grasp = row['grasp']
        if _push(grasp) <= grasp['most_push_n']:
            kept = grasp
        elif kept is not None and len(kept['fingers']) == len(grasp['fingers']):
            nearest = {name: kept[name] for name in ('most_push_n', 'limit')}
            if kept['most_push_n'] > _push(grasp):
                # That row did not see it coming: it lies between the two.
                nearest = {'most_push_n': _push(kept), 'limit': grasp['limit']}
            told.append({**row, 'grasp': {**grasp, **nearest}})
            continue
        told.append(row)
    return told


def _theories(rows: Sequence[Mapping[str, Any]]) -> str:
    """Whose normals they are: those of a thin theory turn too far on a thick wall."""
    names = sorted({row['grasp']['theory'] for row in rows if 'theory' in row['grasp']})
    return f' of theory {" and ".join(names)}' if names else ''


def _mass(rows: Sequence[Mapping[str, Any]]) -> str:
    """What the object weighs, where that was told."""
    mass = float(rows[0]['grasp'].get('mass_given_kg', 0.0))
    return f' of {mass:.3g} kg' if mass > 0.0 else ', whose mass is not told,'


def _cells(row: Mapping[str, Any]) -> Markup:
    grasp = row['grasp']
    needed = 'none would do'
    if grasp['needed_friction'] < NO_FRICTION:
        needed = f'{grasp["needed_friction"]:.3f} ± {grasp["needed_friction_sigma"]:.3f}'
    return Markup('<tr>{}</tr>').format(
        Markup('').join(
            Markup('<td>{}</td>').format(escape(text))
            for text in (
                f'{_push(grasp):.2f}',
                needed,
                'yes' if grasp['closed'] else f'no: {grasp["why"]}',
                f'{grasp["closure_probability"]:.2f}',
                f'{grasp["liftable_mass_kg"]:.3g} ± {grasp["liftable_mass_sigma_kg"]:.2g}',
                _newton(grasp['least_push_n']),
                _newton(grasp['most_push_n']),
                _limit(grasp),
            )
        )
    )


def _push(grasp: Mapping[str, Any]) -> float:
    """Mean push of the fingers [N]."""
    return float(np.mean([finger['push_n'] for finger in grasp['fingers']] or [0.0]))


def _limit(grasp: Mapping[str, Any]) -> str:
    """What ends the window, and whether a yield stress was told at all."""
    if grasp['limit'] == 'yield' and grasp.get('stress_unresolved'):
        return f'yield, not resolved: {grasp["stress_unresolved"]}'
    return grasp['limit'] or '–'


def _newton(value: float) -> str:
    return f'{value:.2f}' if value < UNLIMITED_N else '–'


def _axes(height: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(8.0, height), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.09, 0.42 / height + 0.03, 0.89, 0.9 - 0.42 / height))
    axes.grid(alpha=0.3)
    return figure, axes


def needed_friction(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Needed friction with its sigma over the squeeze, and the friction given."""
    figure, axes = _axes(3.4)
    grasps = [row['grasp'] for row in rows if row['grasp']['needed_friction'] < NO_FRICTION]
    push = np.array([_push(one) for one in grasps])
    needed = np.array([one['needed_friction'] for one in grasps])
    sigma = np.array([one['needed_friction_sigma'] for one in grasps])
    axes.plot(push, needed, 'o-', color=NONLINEAR, label='needed on the deformed shape')
    axes.fill_between(
        push, np.maximum(needed - sigma, 0.0), needed + sigma, color=NONLINEAR, alpha=0.18
    )
    given = float(rows[0]['grasp']['friction_given'])
    axes.axhline(given, color=LINEAR, linestyle=':', label=f'given, {given:g}')
    axes.set(xlabel='mean push of the fingers (N)', ylabel='friction (-)')
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8, loc='center left')
    return figure


def windows(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """One bar a row: its squeeze window, and its push as a mark."""
    figure, axes = _axes(1.2 + 0.3 * len(rows))
    grasps = [row['grasp'] for row in rows]
    push = [_push(one) for one in grasps]
    ends = [one[name] for one in grasps for name in ('least_push_n', 'most_push_n')]
    top = 1.25 * max([*push, *(end for end in ends if end < UNLIMITED_N), 1e-9])
    for number, (one, here) in enumerate(zip(grasps, push, strict=True)):
        least, most = one['least_push_n'], min(one['most_push_n'], top)
        if least < most:
            axes.barh(number, most - least, left=least, height=0.5, color=NONLINEAR, alpha=0.5)
        axes.plot([here, here], [number - 0.4, number + 0.4], color='black')
    axes.set_yticks(range(len(rows)), [f'{float(row["force_n"]):.1f} N' for row in rows])
    axes.set(xlabel='mean push of the fingers (N)')
    axes.set_xlim(0.0, top)
    axes.axvline(0.0, color=REST)
    return figure
