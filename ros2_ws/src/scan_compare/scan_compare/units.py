# SPDX-License-Identifier: Apache-2.0
"""Length units of scan files: declared by the user, or inferred against the object's known size.

STL, OBJ, PLY, XYZ and VRML as written by a NextEngine carry no unit, and the scanner's software
defaults to inches in installations in the United States; an inch read as a millimetre shrinks
the object 25.4 times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_common.options import METRES_PER_UNIT

INFERABLE_UNITS = ('mm', 'inch', 'm')
"""Units that the size alone can tell apart; neighbours lie a factor of at least 25.4 apart."""

SMALLEST_PART = 0.12
"""A scan may show a part of the object: its extent is at least this share of the object's."""

LARGEST_PART = 1.6
"""Outliers, fixtures and fingers may widen a scan to this multiple of the object's extent.

LARGEST_PART / SMALLEST_PART is below 25.4, so at most one inferable unit fits a scan."""


class UnitError(ValueError):
    """The unit of a scan is unknown, or the declared one contradicts the object's size."""


@dataclass(frozen=True)
class Unit:
    """A chosen unit: `name`, `metres` per unit, `inferred` from the size or declared."""

    name: str
    metres: float
    inferred: bool
    explanation: str


def metres_per_unit(name: str) -> float:
    """Return the length of one `name` [m]; raises UnitError for an unknown name."""
    try:
        return METRES_PER_UNIT['inch' if name == 'in' else name]
    except KeyError:
        known = ', '.join(METRES_PER_UNIT)
        raise UnitError(f'unknown unit {name!r}; allowed: {known}') from None


def robust_extent(points: np.ndarray) -> float:
    """Return the largest side of the box around `points` (n, 3), stray points left out.

    The box spans the 0.5 % to 99.5 % quantiles of each coordinate, in the points' own unit.
    """
    if len(points) == 0:
        return 0.0
    # one coordinate after the other: a quantile works on a copy
    sides = [np.subtract(*np.quantile(points[:, axis], (0.995, 0.005))) for axis in range(3)]
    return float(max(sides))


def choose_unit(extent: float, declared: str | None, expected_size_m: float | None) -> Unit:
    """Choose the unit of a scan whose largest side is `extent` file units long.

    `expected_size_m` is the largest side of the object [m], or None when no object is known.
    A declared unit is checked against it. Raises UnitError if the size contradicts the declared
    unit, if no unit fits, or if neither a unit nor a size is given.
    """
    if declared is not None:
        return _declared_unit(extent, declared, expected_size_m)
    if expected_size_m is None:
        raise UnitError(
            'the file carries no unit and no object size is known; '
            f'state the unit ({", ".join(METRES_PER_UNIT)})'
        )
    for name in INFERABLE_UNITS:
        ratio = extent * METRES_PER_UNIT[name] / expected_size_m
        if SMALLEST_PART <= ratio <= LARGEST_PART:
            return Unit(
                name,
                METRES_PER_UNIT[name],
                True,
                f'unit inferred: {name} (extent {extent:.4g} {name} = '
                f'{1e3 * extent * METRES_PER_UNIT[name]:.4g} mm, '
                f'object {1e3 * expected_size_m:.4g} mm)',
            )
    sizes = ', '.join(
        f'{1e3 * extent * METRES_PER_UNIT[name]:.4g} mm as {name}' for name in INFERABLE_UNITS
    )
    raise UnitError(
        f'no unit makes an extent of {extent:.4g} fit the object of '
        f'{1e3 * expected_size_m:.4g} mm ({sizes}); state the unit or choose another object'
    )


def _declared_unit(extent: float, declared: str, expected_size_m: float | None) -> Unit:
    metres = metres_per_unit(declared)
    unit = Unit(declared, metres, False, f'unit declared: {declared}')
    if expected_size_m is None:
        return unit
    ratio = extent * metres / expected_size_m
    if SMALLEST_PART <= ratio <= LARGEST_PART:
        return unit
    better = [
        name
        for name in INFERABLE_UNITS
        if SMALLEST_PART <= extent * METRES_PER_UNIT[name] / expected_size_m <= LARGEST_PART
    ]
    hint = ''
    if better:
        factor = METRES_PER_UNIT[better[0]] / metres
        # the factor is named as a number above one, the way users know it (25.4, 1000)
        factor = factor if factor > 1.0 else 1.0 / factor
        hint = f': off by the factor {factor:.4g}, the file is in {better[0]}'
    else:
        for factor, words in ((25.4, 'inches were read as mm'), (1 / 25.4, 'mm as inches')):
            if SMALLEST_PART <= ratio * factor <= LARGEST_PART:
                hint = f': off by the factor 25.4, {words} before'
    raise UnitError(
        f'unit {declared} makes the scan {1e3 * extent * metres:.4g} mm large but the object is '
        f'{1e3 * expected_size_m:.4g} mm{hint}; state the right unit or the right object'
    )
