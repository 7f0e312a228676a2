# SPDX-License-Identifier: Apache-2.0
"""The compiled form of `fusion_plain`: the same least-squares problem without temporaries.

Rows of the design are added one by one to normal equations scaled to a unit diagonal; with
A = L L^T the upper triangular inverse of L^T is the root of the covariance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from shell_deform.compiled.kernel_arrays import float_rows, floats, longs
from shell_deform.compiled.kernel_types import (
    Bool,
    Bools,
    Float,
    FloatRows,
    Floats,
    Int,
    Longs,
    kernel,
    named,
)
from shell_deform.live.tick.fusion_types import (
    BALANCE,
    GAUGE,
    MODULUS,
    MOTION,
    SHIFT,
    SLIP,
    TANGENTIAL,
    Design,
    LeastSquares,
    Measured,
    Response,
    Widths,
)
from shell_deform.live.tick.sample import FLAG_NO_GAUGE, FLAG_SATURATED

BLIND = FLAG_SATURATED | FLAG_NO_GAUGE

WIDTHS = named(Widths, **dict.fromkeys(Widths._fields, Float))
RESPONSE = named(
    Response,
    force=Floats,
    displacement=Floats,
    travel_offset=Floats,
    rigid=Floats,
    rigid_scale=Float,
    reaction=Floats,
    lateral=FloatRows,
    rigid_reaction=Floats,
    displacement_by=FloatRows,
    reaction_by=FloatRows,
    rigid_by=FloatRows,
)
MEASURED = named(
    Measured,
    finger=Longs,
    flags=Longs,
    present=Bools,
    push=Floats,
    sigma_push=Floats,
    travel=Floats,
    sigma_travel=Floats,
    tangential=Floats,
    sigma_tangential=Floats,
)
DESIGN = named(Design, rows=FloatRows, values=Floats, kinds=Longs, contacts=Longs)


def least_squares(
    use_force: bool, use_travel: bool, widths: Widths, response: Response, measured: Measured
) -> LeastSquares:
    """Most probable inputs of the response; which of gauges and motion count is given."""
    j = 3 * len(response.force) + len(response.rigid) + 1
    inputs, root = np.empty(j), np.empty((j, j))
    found = fit(use_force, use_travel, widths, response, measured, inputs, root)
    return LeastSquares(inputs, root, *found)


@kernel(Int, DESIGN, Int, Float, Float, Int, Int)
def _put(design: Any, m: int, weight: float, value: float, kind: int, contact: int) -> int:
    """Scale row `m`, already written, and remember where it comes from."""
    for i in range(design.rows.shape[1]):
        design.rows[m, i] *= weight
    design.values[m] = value * weight
    design.kinds[m] = kind
    design.contacts[m] = contact
    return m + 1


@kernel(Bool, Bool, MEASURED, Int)
def _travelled(use_travel: bool, measured: Any, i: int) -> bool:
    """Whether the motion of contact i is known and counts."""
    return use_travel and measured.present[i] and np.isfinite(measured.travel[i])


@kernel(Float, Bool, Bool, WIDTHS, MEASURED, Int)
def _push_sigma(use_force: bool, travelled: bool, widths: Any, measured: Any, i: int) -> float:
    """Sigma of the push of contact i [N]."""
    if not measured.present[i]:
        return widths.force_floor
    reported = measured.sigma_push[i] if np.isfinite(measured.sigma_push[i]) else 1e6
    floor = max(reported, widths.force_floor)
    sigma = np.sqrt(floor**2 + widths.drift**2 + widths.quantum**2 / 12.0)
    if travelled and not use_force:
        return 1e3
    if measured.flags[i] & BLIND:
        # A clipped gauge is a lower bound; it counts only where nothing else speaks.
        return 1e3 if travelled else max(sigma, 0.5 * measured.push[i])
    return sigma


@kernel(Int, Bool, Bool, WIDTHS, RESPONSE, MEASURED, DESIGN, Int)
def _observe_contacts(
    use_force: bool,
    use_travel: bool,
    widths: Any,
    response: Any,
    measured: Any,
    design: Any,
    m: int,
) -> int:
    """Gauges, then motion: rows from `m` on; returns where the next one goes."""
    k, rows = len(response.force), design.rows
    for i in range(k):
        travelled = _travelled(use_travel, measured, i)
        sigma = _push_sigma(use_force, travelled, widths, measured, i)
        rows[m, i] = 1.0
        value = (measured.push[i] if measured.present[i] else 0.0) - response.force[i]
        m = _put(design, m, 1.0 / sigma, value, GAUGE, i)
    for i in range(k):
        if not _travelled(use_travel, measured, i):
            continue
        known = np.isfinite(measured.sigma_travel[i])
        spread = measured.sigma_travel[i] if known else widths.default_travel
        stretch = widths.tendon * abs(measured.push[i]) * widths.tendon_relative
        sigma = np.sqrt(spread**2 + widths.mounting**2 + stretch**2)
        for c in range(rows.shape[1]):
            rows[m, c] = response.displacement_by[i, c]
        rows[m, i] += widths.tendon
        value = measured.travel[i] + response.travel_offset[i]
        value = value - widths.tendon * response.force[i] - response.displacement[i]
        m = _put(design, m, 1.0 / sigma, value, MOTION, i)
    return m


@kernel(Int, WIDTHS, RESPONSE, MEASURED, DESIGN, Int)
def _observe_lateral(widths: Any, response: Any, measured: Any, design: Any, m: int) -> int:
    """Slips and tangential forces: rows from `m` on; returns where the next one goes."""
    k, rows = len(response.force), design.rows
    for i in range(2 * k):
        rows[m, k + i] = 1.0
        m = _put(design, m, 1.0 / widths.slip, 0.0, SLIP, i // 2)
    for i in range(2 * k):
        if np.isfinite(measured.sigma_tangential[i]) and measured.present[i // 2]:
            for c in range(rows.shape[1]):
                rows[m, c] = response.reaction_by[i, c]
            sigma = np.sqrt(measured.sigma_tangential[i] ** 2 + widths.force_floor**2)
            value = measured.tangential[i] - response.reaction[i]
            m = _put(design, m, 1.0 / sigma, value, TANGENTIAL, i // 2)
    return m


@kernel(Int, Bool, WIDTHS, RESPONSE, DESIGN, Int)
def _observe_object(moving: bool, widths: Any, response: Any, design: Any, m: int) -> int:
    """Balance and shift of the whole object: rows from `m` on; returns where the next one goes."""
    k, rows, scale = len(response.force), design.rows, response.rigid_scale
    for i in range(len(response.rigid)):
        for c in range(rows.shape[1]):
            rows[m, c] = response.rigid_by[i, c]
        value = -response.rigid_reaction[i]
        m = _put(design, m, scale / widths.outside, value, BALANCE, -1)
        rows[m, 3 * k + i] = 1.0
        # Without motion data nothing tells a shift: the object stays where it is.
        sigma = widths.rigid * scale * (1.0 if moving else 1e-3)
        value = -response.rigid[i] if moving else 0.0
        m = _put(design, m, 1.0 / sigma, value, SHIFT, -1)
    return m


@kernel(Int, Bool, Bool, WIDTHS, RESPONSE, MEASURED, DESIGN)
def _observe(
    use_force: bool, use_travel: bool, widths: Any, response: Any, measured: Any, design: Any
) -> int:
    """Fill the weighted design, whose rows are zero; returns how many there are."""
    moving = False
    for i in range(len(response.force)):
        moving = moving or _travelled(use_travel, measured, i)
    m = _observe_contacts(use_force, use_travel, widths, response, measured, design, 0)
    m = _observe_lateral(widths, response, measured, design, m)
    m = _observe_object(moving, widths, response, design, m)
    design.rows[m, design.rows.shape[1] - 1] = 1.0
    sigma = np.sqrt(widths.modulus**2 + widths.model**2) + 1e-9
    return _put(design, m, 1.0 / sigma, 0.0, MODULUS, -1)


@kernel(types.Tuple((Float, Int)), FloatRows, Floats, Int, Floats, FloatRows)
def _solve(rows: Any, values: Any, count: int, inputs: Any, root: Any) -> tuple[float, int]:
    """Least squares of the first `count` rows; returns chi squared and the most strained row.

    Fills `inputs` (j,) and the upper triangular `root` (j, j) of their covariance.
    """
    j = rows.shape[1]
    scale = floats(j, 0.0)
    for m in range(count):
        for a in range(j):
            scale[a] += rows[m, a] * rows[m, a]
    for a in range(j):
        scale[a] = 1.0 / np.sqrt(scale[a])
    lower = float_rows(j, j)
    right = floats(j, 0.0)
    for m in range(count):
        for a in range(j):
            left = rows[m, a] * scale[a]
            if left != 0.0:
                right[a] += left * values[m]
                for b in range(a + 1):
                    lower[a, b] += left * rows[m, b] * scale[b]
    for a in range(j):
        for b in range(a + 1):
            total = lower[a, b]
            for c in range(b):
                total -= lower[a, c] * lower[b, c]
            lower[a, b] = np.sqrt(max(total, 1e-15)) if a == b else total / lower[b, b]
    # Columns of the inverse of L^T: the root of the covariance, upper triangular.
    for i in range(j):
        for a in range(j):
            root[a, i] = 0.0
        root[i, i] = 1.0 / lower[i, i]
        for a in range(i - 1, -1, -1):
            total = 0.0
            for c in range(a + 1, i + 1):
                total -= lower[c, a] * root[c, i]
            root[a, i] = total / lower[a, a]
    for a in range(j):
        inputs[a] = 0.0
    for i in range(j):
        along = 0.0
        for a in range(i + 1):
            along += root[a, i] * right[a]
        for a in range(i + 1):
            inputs[a] += root[a, i] * along
    for a in range(j):
        inputs[a] *= scale[a]
        for i in range(j):
            root[a, i] *= scale[a]
    chi, worst, most = 0.0, 0, -1.0
    for m in range(count):
        residual = -values[m]
        for a in range(j):
            residual += rows[m, a] * inputs[a]
        chi += residual * residual
        if residual * residual > most:
            worst, most = m, residual * residual
    return chi, worst


@kernel(
    types.Tuple((Float, Int, Int, Int)), Bool, Bool, WIDTHS, RESPONSE, MEASURED, Floats, FloatRows,
    called_from_python=True,
)  # fmt: skip
def fit(
    use_force: bool,
    use_travel: bool,
    widths: Any,
    response: Any,
    measured: Any,
    inputs: Any,
    root: Any,
) -> tuple[float, int, int, int]:
    """Fill `inputs` (j,) and `root` (j, j); the other fields of a `LeastSquares`."""
    j = len(inputs)
    most = 6 * len(response.force) + 2 * len(response.rigid) + 1
    design = Design(float_rows(most, j), floats(most, 0.0), longs(most, 0), longs(most, 0))
    count = _observe(use_force, use_travel, widths, response, measured, design)
    chi_squared, worst = _solve(design.rows, design.values, count, inputs, root)
    return chi_squared, count - j, design.kinds[worst], design.contacts[worst]
