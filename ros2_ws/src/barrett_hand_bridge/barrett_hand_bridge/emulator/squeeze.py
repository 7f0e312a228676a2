# SPDX-License-Identifier: Apache-2.0
"""The object an emulated hand squeezes: force-displacement tables and where the contacts are.

Two arrangements: `Pinched`, an object free to move between two opposing pins (the ball of the
paper), and `Supported`, contacts fixed in the hand frame (an object standing on something).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from barrett_hand_bridge.emulator.geometry import Vector, dot, scale, subtract, unit
from grasp_common import bounded_yaml


class SqueezeError(ValueError):
    """An object description that cannot be used; the message says what and where."""


@dataclass(frozen=True)
class ForceTable:
    """Force on a contact against its displacement: both rise strictly from (0, 0). m and N."""

    displacement_m: tuple[float, ...]
    force_n: tuple[float, ...]
    name: str = 'force table'

    def __post_init__(self) -> None:
        d, f = np.asarray(self.displacement_m), np.asarray(self.force_n)
        if d.shape != f.shape or d.size < 2:
            raise SqueezeError(f'{self.name}: needs two equally long columns of at least 2 rows')
        if not (np.isfinite(d).all() and np.isfinite(f).all()):
            raise SqueezeError(f'{self.name}: holds a number that is not finite')
        if d[0] != 0.0 or f[0] != 0.0 or (np.diff(d) <= 0).any() or (np.diff(f) <= 0).any():
            raise SqueezeError(
                f'{self.name}: both columns must start at 0 and rise strictly (displacement in m, '
                'force in N); an object that snaps cannot be held by a position-controlled finger'
            )

    def displacement(self, force_n: float) -> float:
        """Displacement in m at a force in N; the last slope goes on beyond the table."""
        return _along(self.force_n, self.displacement_m, force_n)

    def force(self, displacement_m: float) -> float:
        """Force in N at a displacement in m (0 when not touching)."""
        return max(_along(self.displacement_m, self.force_n, displacement_m), 0.0)


def _along(x: tuple[float, ...], y: tuple[float, ...], at: float) -> float:
    if at > x[-1]:
        slope = (y[-1] - y[-2]) / (x[-1] - x[-2])
        return y[-1] + slope * (at - x[-1])
    return float(np.interp(at, x, y))


@dataclass(frozen=True)
class Pinched:
    """An object of `width_m` between the pins of two fingers, free to follow them."""

    fingers: tuple[int, int]
    width_m: float
    table: ForceTable


@dataclass(frozen=True)
class Supported:
    """An object that stands: per finger a point on its outer face and the inward unit normal."""

    points: Mapping[int, Vector]
    normals: Mapping[int, Vector]
    table: ForceTable


Squeezed = Pinched | Supported


@dataclass(frozen=True)
class ContactLoad:
    """The load of one finger: force on the finger (N, hand frame), its size, displacement (m)."""

    on_finger: Vector
    force_n: float
    displacement_m: float
    inward: Vector


NO_LOAD = ContactLoad((0.0, 0.0, 0.0), 0.0, 0.0, (0.0, 0.0, 0.0))

# Given a force in N and its direction per finger: where those pin tips are, bent back by it.
PinTips = Callable[[Mapping[int, float], Mapping[int, Vector]], Mapping[int, Vector]]


def contact_loads(
    squeezed: Squeezed | None, tips: PinTips, near_n: float = 0.0
) -> dict[int, ContactLoad]:
    """Loads of all touching fingers in equilibrium with the yielding of the fingers' tendons.

    `near_n` is a guess of the force: the search starts there.
    """
    if squeezed is None:
        return {}
    if isinstance(squeezed, Pinched):
        return _pinch(squeezed, tips, near_n)
    loads: dict[int, ContactLoad] = {}
    for finger, point in squeezed.points.items():
        normal = squeezed.normals[finger]

        def overlap(
            force: float, finger: int = finger, n: Vector = normal, p: Vector = point
        ) -> float:
            tip = tips({finger: force}, {finger: n})[finger]
            return dot(subtract(tip, p), n) - squeezed.table.displacement(force)

        force = _rising_force(overlap, near_n)
        if force > 0.0:
            loads[finger] = ContactLoad(
                scale(normal, -force), force, squeezed.table.displacement(force), normal
            )
    return loads


def _pinch(squeezed: Pinched, tips: PinTips, near_n: float) -> dict[int, ContactLoad]:
    first, second = squeezed.fingers

    def directions(at: Mapping[int, Vector]) -> dict[int, Vector]:
        line = unit(subtract(at[second], at[first]))
        return {first: line, second: scale(line, -1.0)}

    unloaded: dict[int, Vector] = {first: (0.0, 0.0, 0.0), second: (0.0, 0.0, 0.0)}
    inward = directions(tips({}, unloaded))

    def overlap(force: float) -> float:
        at = tips({first: force, second: force}, inward)
        gap = subtract(at[second], at[first])
        return squeezed.width_m - math.sqrt(dot(gap, gap)) - 2 * squeezed.table.displacement(force)

    force = _rising_force(overlap, near_n)
    if force <= 0.0:
        return {}
    inward = directions(tips({first: force, second: force}, inward))
    displacement = squeezed.table.displacement(force)
    return {
        finger: ContactLoad(scale(n, -force), force, displacement, n)
        for finger, n in inward.items()
    }


def _rising_force(overlap: Callable[[float], float], near_n: float) -> float:
    """The force in N at which a falling overlap (m) reaches zero; 0 if it starts below zero."""
    at_low = overlap(0.0)
    if at_low <= 0.0:
        return 0.0
    low, high = 0.0, max(1.02 * near_n, 0.2)
    at_high = overlap(high)
    while at_high > 0.0:
        low, at_low = high, at_high
        high *= 2.0
        if high > 1e4:
            raise SqueezeError('the fingers meet inside the object: it yields without end')
        at_high = overlap(high)
    if at_high < 0.0 and (below := 0.96 * high) > low and (at_below := overlap(below)) > 0.0:
        low, at_low = below, at_below
    for _ in range(60):
        guess = high - at_high * (high - low) / (at_high - at_low)
        guess = min(max(guess, low + 0.01 * (high - low)), high - 0.01 * (high - low))
        value = overlap(guess)
        if value > 0.0:
            low, at_low = guess, value
        else:
            high, at_high = guess, value
        if abs(value) < 1e-10 or high - low < 1e-10:
            break
    return 0.5 * (low + high)


def read_force_table(path: Path) -> ForceTable:
    """Read a CSV with the header `displacement_m,force_n`, or what `shell_solve --json` prints.

    Raises:
        SqueezeError: the file is missing, has another form, or its columns do not rise.
    """
    try:
        text = bounded_yaml.text_of(path)
    except (OSError, UnicodeDecodeError) as error:
        raise SqueezeError(f'{path}: cannot be read ({error})') from error
    if path.suffix == '.json':
        return _solved_table(text, path)
    lines = text.split()
    if not lines or lines[0] != 'displacement_m,force_n':
        raise SqueezeError(f'{path}: the first line must be "displacement_m,force_n"')
    try:
        rows = [tuple(float(value) for value in line.split(',')) for line in lines[1:]]
        displacement, force = zip(*rows, strict=True)
    except ValueError as error:
        raise SqueezeError(f'{path}: every row needs two numbers ({error})') from error
    return ForceTable(displacement, force, str(path))


def _solved_table(text: str, path: Path) -> ForceTable:
    """The points of a solved sweep; (0, 0) is put in front where the sweep starts later."""
    try:
        points = json.loads(text)['points']
        rows = [(float(point['displacement_m']), float(point['force_n'])) for point in points]
    except (ValueError, KeyError, TypeError) as error:
        raise SqueezeError(
            f'{path}: expected "points" with displacement_m and force_n ({error!r})'
        ) from error
    rows = [(0.0, 0.0), *(row for row in rows if row[0] > 0.0)]
    return ForceTable(tuple(row[0] for row in rows), tuple(row[1] for row in rows), str(path))


def read_squeezed(path: Path) -> Squeezed:
    """Read a squeezed object from YAML.

    Keys: `table` (CSV or solved sweep beside the file) or `displacement_m` and `force_n` (lists),
    and either
    `pinched: {fingers: [1, 2], width_m: 0.065}` or
    `supported: {1: {point_m: [x, y, z], inward_normal: [x, y, z]}}`.

    Raises:
        SqueezeError: the file is missing or does not describe an object.
    """
    try:
        document = bounded_yaml.read(path)
        if not isinstance(document, dict):
            raise SqueezeError(f'{path}: not a mapping')
        return _squeezed(document, path)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise SqueezeError(f'{path}: cannot be read ({error})') from error
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, SqueezeError):
            raise
        raise SqueezeError(f'{path}: missing or wrong value ({error!r})') from error


def _squeezed(document: dict[str, Any], path: Path) -> Squeezed:
    if 'table' in document:
        table = read_force_table(path.parent / str(document['table']))
    else:
        table = ForceTable(
            tuple(float(v) for v in document['displacement_m']),
            tuple(float(v) for v in document['force_n']),
            str(path),
        )
    if 'pinched' in document:
        first, second = (int(v) for v in document['pinched']['fingers'])
        return Pinched((first, second), float(document['pinched']['width_m']), table)
    contacts = document['supported']
    points: dict[int, Vector] = {}
    normals: dict[int, Vector] = {}
    for finger, contact in contacts.items():
        x, y, z = (float(v) for v in contact['point_m'])
        points[int(finger)] = (x, y, z)
        x, y, z = (float(v) for v in contact['inward_normal'])
        normals[int(finger)] = unit((x, y, z))
    return Supported(points, normals, table)
