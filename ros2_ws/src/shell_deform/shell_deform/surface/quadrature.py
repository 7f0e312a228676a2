# SPDX-License-Identifier: Apache-2.0
"""Symmetric integration rules on the parameter triangle.

D. A. Dunavant, High degree efficient symmetrical Gaussian quadrature rules for the triangle,
Int. J. Numer. Meth. Eng. 21:1129 (1985), doi 10.1002/nme.1620210612; weights here add up to 1/2.
"""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

# Points: weight (of a unit total) and barycentric coordinates, one per orbit.
_ORBITS: dict[int, tuple[tuple[float, tuple[float, float, float]], ...]] = {
    1: ((1.0, (1 / 3, 1 / 3, 1 / 3)),),
    3: ((1 / 3, (2 / 3, 1 / 6, 1 / 6)),),
    6: (
        (0.223381589678011, (0.108103018168070, 0.445948490915965, 0.445948490915965)),
        (0.109951743655322, (0.816847572980459, 0.091576213509771, 0.091576213509771)),
    ),
    7: (
        (0.225, (1 / 3, 1 / 3, 1 / 3)),
        (0.132394152788506, (0.059715871789770, 0.470142064105115, 0.470142064105115)),
        (0.125939180544827, (0.797426985353087, 0.101286507323456, 0.101286507323456)),
    ),
    12: (
        (0.116786275726379, (0.501426509658179, 0.249286745170910, 0.249286745170910)),
        (0.050844906370207, (0.873821971016996, 0.063089014491502, 0.063089014491502)),
        (0.082851075618374, (0.053145049844817, 0.310352451033784, 0.636502499121399)),
    ),
}

POINT_COUNTS = tuple(_ORBITS)
"""Available numbers of points per triangle."""


@cache
def triangle_rule(count: int) -> tuple[FloatArray, FloatArray]:
    """Points (count, 2) as (u, v) and weights (count,) of a rule with 1, 3, 6, 7 or 12 points.

    Exact for polynomials up to degree 1, 2, 4, 5 and 6.

    Raises:
        ValueError: no rule with that number of points.
    """
    if count not in _ORBITS:
        raise ValueError(f'{count} integration points per triangle; allowed are {POINT_COUNTS}')
    points, weights = [], []
    for weight, coordinates in _ORBITS[count]:
        for _, u, v in sorted(set(permutations(coordinates))):
            points.append((u, v))
            weights.append(weight)
    rule = np.array(points), 0.5 * np.array(weights) / np.sum(weights)
    for array in rule:
        array.setflags(write=False)
    return rule
