# SPDX-License-Identifier: Apache-2.0
"""The curves of a hold and of a turn as drawings, coloured by the page's style."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .colour_map import nice_ceiling, three_digits
from .curves import WARN_FROM, HoldCurve, TurnCurve, share
from .poses import Floats

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 320, 150, 40, 8, 10, 30
NINETY = 1.645
SHORTEST_S = 0.5
HEADROOM = 0.06

Scale = Callable[[float], float]


def hold_curve_html(curve: HoldCurve) -> str:
    """Force against the logarithm of time with the band of what is to come; empty before it."""
    later = curve.later
    if later is None or not len(later.force) or curve.age < SHORTEST_S or len(curve.rows) < 2:
        return ''
    rows = np.array([row for row in curve.rows if row[0] >= 0.1 * SHORTEST_S])
    end = curve.age + float(later.later.max())
    fingers = sorted({int(finger) for finger in later.finger})
    lines, bands = [], []
    for finger in fingers:
        known = rows[rows[:, finger] > 0.0] if 1 <= finger <= 3 else rows[:0]
        own = later.finger == finger
        order = np.argsort(later.later[own])
        time = curve.age + later.later[own][order]
        force, half = later.force[own][order], NINETY * later.sigma[own][order]
        if not len(known):
            continue
        start = np.array([[curve.age, known[-1, finger]]])
        lines.append((finger, known[:, [0, finger]], np.concatenate([start, _pair(time, force)])))
        up, down = _pair(time, force + half), _pair(time, force - half)
        bands.append(np.concatenate([up, down[::-1]]))
    if not lines:
        return ''
    drawn = np.concatenate([*(line for _, *two in lines for line in two), *bands])
    low, high = _limits(drawn[:, 1])
    first = float(rows[0, 0])

    def x(time: float) -> float:
        span = np.log10(end / first)
        return LEFT + (WIDTH - LEFT - RIGHT) * float(np.log10(max(time, first) / first) / span)

    y = _up(low, high)
    parts = [_decades(first, end, x), _heights(low, high, y)]
    parts += [_ring(band, x, y) for band in bands]
    for finger, seen, coming in lines:
        parts += [_line(seen, x, y, f'f{finger}'), _line(coming, x, y, f'f{finger} coming')]
    now = x(curve.age)
    parts.append(f'<line class="now" x1="{now:.1f}" x2="{now:.1f}" y1="{TOP}" y2="{_bottom()}"/>')
    keys = ''.join(f'<span class="k f{finger}">F{finger}</span>' for finger, *_ in lines)
    ahead = ', '.join(f'F{finger} {coming[-1, 1]:.1f} N' for finger, _, coming in lines)
    return (
        '<div class="grasp-section grasp-hold-curve"><b>Force while held</b><i>N over s</i>'
        f'{_svg("Force over the logarithm of time", parts)}<p>{keys}'
        f'<span class="k band">90 % of what comes if the fingers stay</span></p>'
        f'<p>held for {three_digits(curve.age)} s; in {three_digits(float(later.later.max()))} s '
        f'{ahead}</p></div>'
    )


def turn_curve_html(curve: TurnCurve) -> str:
    """Torque against angle with what friction allows; empty while nothing turns."""
    if len(curve.rows) < 2:
        return ''
    rows = np.array(curve.rows)
    order = np.argsort(rows[:, 0], kind='stable')
    rows = rows[order]
    capacity = np.isfinite(rows[:, 3]).all()
    sign = np.sign(rows[np.abs(rows[:, 1]).argmax(), 1]) or 1.0
    drawn = [rows[:, 1], np.zeros(1)] + [sign * rows[:, 3]] * bool(capacity)
    low, high = _limits(np.concatenate(drawn))
    first, last = float(rows[0, 0]), float(rows[-1, 0])

    def x(angle: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (angle - first) / max(last - first, 1e-12)

    y = _up(low, high)
    parts = [_angles(first, last, x), _heights(low, high, y)]
    warned = [row[0] for row in curve.rows if share(row) > WARN_FROM]
    if warned:
        ends = sorted([x(warned[0]), x(curve.rows[-1][0])])
        wide = max(ends[1] - ends[0], 2.0)
        parts.append(
            f'<rect class="slip" x="{ends[0]:.1f}" y="{TOP}" width="{wide:.1f}" '
            f'height="{_bottom() - TOP:.1f}"/>'
        )
    if capacity:
        parts.append(_line(_pair(rows[:, 0], sign * rows[:, 3]), x, y, 'allowed'))
    parts.append(_line(rows[:, :2], x, y, 'served'))
    angle, torque, _, allowed = curve.rows[-1]
    told = f'{three_digits(torque)} N m at {three_digits(angle)}°'
    keys = '<span class="k served">torque of the grip</span>'
    if capacity:
        told += f'; {100.0 * share(curve.rows[-1]):.0f} % of the friction of the fingers'
        keys += f'<span class="k allowed">friction allows {three_digits(allowed)}</span>'
    warning = '<b class="slip-warning">about to slip</b>' if curve.slips else ''
    return (
        '<div class="grasp-section grasp-turn-curve"><b>Torque of the turn</b><i>N m over °</i>'
        f'{_svg("Torque over angle", parts)}<p>{keys}</p><p>{told} {warning}</p></div>'
    )


def _pair(x: Floats, y: Floats) -> Floats:
    return np.stack([x, y], axis=1)


def _bottom() -> float:
    return float(HEIGHT - BOTTOM)


def _limits(values: Floats) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    margin = HEADROOM * max(high - low, 1e-9, 1e-3 * abs(high))
    return low - margin, high + margin


def _up(low: float, high: float) -> Scale:
    return lambda value: _bottom() - (_bottom() - TOP) * (value - low) / (high - low)


def _line(points: Floats, x: Scale, y: Scale, name: str) -> str:
    text = ' '.join(f'{x(a):.1f},{y(b):.1f}' for a, b in points)
    return f'<polyline class="{name}" points="{text}"/>'


def _ring(points: Floats, x: Scale, y: Scale) -> str:
    text = ' '.join(f'{x(a):.1f},{y(b):.1f}' for a, b in points)
    return f'<polygon class="band" points="{text}"/>'


def _heights(low: float, high: float, y: Scale) -> str:
    step = nice_ceiling((high - low) / 4.0)
    made = []
    for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1):
        at, text = y(k * step), three_digits(k * step).replace('-', '−')
        made.append(
            f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
            f'<text x="{LEFT - 4}" y="{at + 4:.1f}" text-anchor="end">{text}</text>'
        )
    return ''.join(made)


def _marks(places: Sequence[tuple[float, str]]) -> str:
    return ''.join(
        f'<line class="grid" x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{_bottom()}"/>'
        f'<text x="{at:.1f}" y="{_bottom() + 15:.1f}" text-anchor="middle">{text}</text>'
        for at, text in places
    )


def _decades(first: float, end: float, x: Scale) -> str:
    powers = range(int(np.ceil(np.log10(first) - 1e-9)), int(np.floor(np.log10(end))) + 1)
    return _marks([(x(10.0**power), three_digits(10.0**power)) for power in powers])


def _angles(first: float, last: float, x: Scale) -> str:
    step = nice_ceiling(max(last - first, 1e-9) / 5.0)
    numbers = range(int(np.ceil(first / step)), int(np.floor(last / step)) + 1)
    return _marks([(x(k * step), three_digits(k * step).replace('-', '−')) for k in numbers])


def _svg(name: str, parts: Sequence[str]) -> str:
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{name}">'
        f'{"".join(parts)}</svg>'
    )
