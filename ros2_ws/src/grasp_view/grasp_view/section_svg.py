# SPDX-License-Identifier: Apache-2.0
"""The section through a dent as a drawing: equal axes, in mm, coloured by the page's style."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .colour_map import nice_ceiling, three_digits
from .poses import Floats
from .section import Section

Placed = Callable[[Floats], Floats]

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 320, 34, 8, 10, 22
# An older scan says its age: the dent may have changed since.
OLD_S = 1.0


def section_html(section: Section | None, linear: bool = True) -> str:
    """Title, drawing and key; one sentence while nothing is pressed."""
    if section is None:
        return (
            '<div class="grasp-section"><b>Section through the dent</b>'
            '<p>drawn when a finger presses</p></div>'
        )
    note = '' if section.registered else ', as placed'
    note += f', {section.scan_age:.1f} s old' if section.scan_age > OLD_S else ''
    key = (
        '<span class="k served">served ± sigma, middle surface</span>'
        + '<span class="k linear">linear</span>' * bool(len(section.linear) and linear)
        + '<span class="k rest">rest</span>'
        + f'<span class="k scan">scan, outer face{note}</span>' * bool(len(section.scan))
    )
    return (
        f'<div class="grasp-section"><b>Section through the dent of F{section.finger}</b>'
        f'<i>mm</i>{section_svg(section, linear)}<p>{key}</p></div>'
    )


def section_svg(section: Section, linear: bool = True) -> str:
    """The drawing alone."""
    known = [section.rest, section.served] + [section.scan] * bool(len(section.scan))
    heights = np.concatenate([curve[:, 1] for curve in known])
    low, high = float(heights.min()), max(float(heights.max()), 0.0)
    margin = 0.06 * section.reach
    low, high = low - margin, high + margin
    scale = (WIDTH - LEFT - RIGHT) / (2.0 * section.reach)
    height = TOP + BOTTOM + scale * (high - low)

    def at(points: Floats) -> Floats:
        return np.stack(
            [
                LEFT + (points[:, 0] + section.reach) * scale,
                TOP + (high - points[:, 1]) * scale,
            ],
            axis=1,
        )

    def line(points: Floats, name: str) -> str:
        text = ' '.join(f'{x:.1f},{y:.1f}' for x, y in at(points))
        return f'<polyline class="{name}" points="{text}"/>'

    up = np.stack([section.served[:, 0], section.served[:, 1] + section.band], axis=1)
    down = np.stack([section.served[:, 0], section.served[:, 1] - section.band], axis=1)
    ring = ' '.join(f'{x:.1f},{y:.1f}' for x, y in at(np.concatenate([up, down[::-1]])))
    dots = ''.join(f'<circle r="1.2" cx="{x:.1f}" cy="{y:.1f}"/>' for x, y in at(section.scan))
    parts = [
        _grid(section.reach, low, high, at),
        f'<polygon class="band" points="{ring}"/>',
        f'<g class="scan">{dots}</g>',
        line(section.rest, 'rest'),
        line(section.linear, 'linear') if len(section.linear) and linear else '',
        line(section.served, 'served'),
        _depth(section, at),
    ]
    name = f'Section: depth {three_digits(section.depth)} mm under finger {section.finger}'
    return (
        f'<svg viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{name}">'
        f'{"".join(parts)}</svg>'
    )


def _grid(reach: float, low: float, high: float, at: Placed) -> str:
    step = nice_ceiling(reach / 4.0)
    made = []
    left, right = at(np.array([[-reach, 0.0], [reach, 0.0]]))[:, 0]
    for k in range(int(np.ceil(low / step)), int(high / step) + 1):
        y = at(np.array([[0.0, k * step]]))[0, 1]
        made.append(
            f'<line class="grid" x1="{left:.1f}" x2="{right:.1f}" y1="{y:.1f}" y2="{y:.1f}"/>'
        )
        made.append(
            f'<text x="{left - 4:.1f}" y="{y + 4:.1f}" text-anchor="end">'
            f'{three_digits(k * step).replace("-", "−")}</text>'
        )
    bottom = at(np.array([[0.0, low]]))[0, 1]
    for k in range(-int(reach / step), int(reach / step) + 1):
        x = at(np.array([[k * step, 0.0]]))[0, 0]
        made.append(
            f'<text x="{x:.1f}" y="{bottom + 15:.1f}" text-anchor="middle">'
            f'{three_digits(k * step).replace("-", "−")}</text>'
        )
    return ''.join(made)


def _depth(section: Section, at: Placed) -> str:
    """The pin's axis down to its tip, and the depth as a measure beside it."""
    middle = int(np.abs(section.rest[:, 0]).argmin())
    beside = 0.28 * section.reach
    ends = np.array(
        [
            [0.0, max(section.rest[middle, 1], 0.0) + 0.06 * section.reach],
            section.pin,
            [beside, section.rest[middle, 1]],
            [beside, section.served[middle, 1]],
        ]
    )
    (x0, y0), (x1, y1), (x2, y2), (_, y3) = at(ends)
    return (
        f'<line class="pin f{section.finger}" x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" '
        f'y2="{y1:.1f}"/>'
        f'<path class="measure" d="M{x2 - 4:.1f},{y2:.1f}h8M{x2:.1f},{y2:.1f}V{y3:.1f}'
        f'M{x2 - 4:.1f},{y3:.1f}h8"/>'
        f'<text class="depth" x="{x2 + 7:.1f}" y="{(y2 + y3) / 2 + 4:.1f}">'
        f'{three_digits(section.depth)}</text>'
    )
