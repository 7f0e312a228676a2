"""The compiled form of `fusion.fuse_numpy`: the same least-squares problem without temporaries.

Rows of the design are added one by one to normal equations scaled to a unit diagonal; with
A = L L^T the upper triangular inverse of L^T is the root of the covariance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from shell_deform.compiled.kernel_arrays import float_rows, floats
from shell_deform.compiled.kernel_types import (
    Bool,
    Bools,
    Float,
    FloatRows,
    Floats,
    Int,
    Longs,
    kernel,
)
from shell_deform.live.tick.sample import FLAG_NO_GAUGE, FLAG_SATURATED

BLIND = FLAG_SATURATED | FLAG_NO_GAUGE
GAUGE, MOTION, SLIP, TANGENTIAL, BALANCE, SHIFT, MODULUS = range(7)


@kernel(Int, FloatRows, Floats, Longs, Longs, Int, Float, Float, Int, Int)
def _put(
    rows: Any,
    values: Any,
    kinds: Any,
    owners: Any,
    m: int,
    weight: float,
    value: float,
    kind: int,
    owner: int,
) -> int:
    """Scale row `m`, already written, and remember where it comes from."""
    for i in range(rows.shape[1]):
        rows[m, i] *= weight
    values[m] = value * weight
    kinds[m] = kind
    owners[m] = owner
    return m + 1


@kernel(
    Int, Bool, Bool, Floats, Floats, Floats, Floats, Floats, Float, Floats, Floats, FloatRows,
    FloatRows, FloatRows, Longs, Bools, Floats, Floats, Floats, Floats, Floats, Floats, FloatRows,
    Floats, Longs, Longs,
    called_from_python=True,
)  # fmt: skip
def assemble(
    use_force: bool,
    use_travel: bool,
    errors: Any,
    force: Any,
    displacement: Any,
    offset: Any,
    rigid: Any,
    rigid_scale: float,
    reaction: Any,
    rigid_reaction: Any,
    displacement_by: Any,
    reaction_by: Any,
    rigid_by: Any,
    flags: Any,
    present: Any,
    push: Any,
    sigma_push: Any,
    travel: Any,
    sigma_travel: Any,
    tangential: Any,
    sigma_tangential: Any,
    rows: Any,
    values: Any,
    kinds: Any,
    owners: Any,
) -> int:
    """Fill the weighted design; returns how many rows. `errors` as `ErrorModel.numbers`."""
    floor, drift, quantum, tendon, tendon_relative = errors[0:5]
    mounting, slip, shift, outside, modulus, model, default_travel = errors[5:12]
    k, r = len(force), len(rigid)
    j = 3 * k + r + 1
    rows[:] = 0.0
    m = 0
    travelling = False
    for i in range(k):
        travelled = use_travel and present[i] and np.isfinite(travel[i])
        travelling = travelling or travelled
        reported = sigma_push[i] if np.isfinite(sigma_push[i]) else 1e6
        sigma = np.sqrt(max(reported, floor) ** 2 + drift**2 + quantum**2 / 12.0)
        if flags[i] & BLIND:
            sigma = 1e3 if travelled else max(sigma, 0.5 * push[i])
        if travelled and not use_force:
            sigma = 1e3
        if not present[i]:
            sigma = floor
        rows[m, i] = 1.0
        value = (push[i] if present[i] else 0.0) - force[i]
        m = _put(rows, values, kinds, owners, m, 1.0 / sigma, value, GAUGE, i)
    for i in range(k):
        if not (use_travel and present[i] and np.isfinite(travel[i])):
            continue
        spread = sigma_travel[i] if np.isfinite(sigma_travel[i]) else default_travel
        stretch = tendon * abs(push[i]) * tendon_relative
        sigma = np.sqrt(spread**2 + mounting**2 + stretch**2)
        for c in range(j):
            rows[m, c] = displacement_by[i, c]
        rows[m, i] += tendon
        value = travel[i] + offset[i] - tendon * force[i] - displacement[i]
        m = _put(rows, values, kinds, owners, m, 1.0 / sigma, value, MOTION, i)
    for i in range(2 * k):
        rows[m, k + i] = 1.0
        m = _put(rows, values, kinds, owners, m, 1.0 / slip, 0.0, SLIP, i // 2)
    for i in range(2 * k):
        if np.isfinite(sigma_tangential[i]) and present[i // 2]:
            for c in range(j):
                rows[m, c] = reaction_by[i, c]
            sigma = np.sqrt(sigma_tangential[i] ** 2 + floor**2)
            value = tangential[i] - reaction[i]
            m = _put(rows, values, kinds, owners, m, 1.0 / sigma, value, TANGENTIAL, i // 2)
    for i in range(r):
        for c in range(j):
            rows[m, c] = rigid_by[i, c]
        weight = rigid_scale / outside
        m = _put(rows, values, kinds, owners, m, weight, -rigid_reaction[i], BALANCE, -1)
        rows[m, 3 * k + i] = 1.0
        # Without motion data nothing tells a shift: the object stays where it is.
        width = shift * rigid_scale * (1.0 if travelling else 1e-3)
        value = -rigid[i] if travelling else 0.0
        m = _put(rows, values, kinds, owners, m, 1.0 / width, value, SHIFT, -1)
    rows[m, j - 1] = 1.0
    sigma = np.sqrt(modulus**2 + model**2) + 1e-9
    return _put(rows, values, kinds, owners, m, 1.0 / sigma, 0.0, MODULUS, -1)


@kernel(
    types.Tuple((Float, Int)), FloatRows, Floats, Int, Floats, FloatRows,
    called_from_python=True,
)  # fmt: skip
def solve(rows: Any, values: Any, count: int, inputs: Any, root: Any) -> tuple[float, int]:
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
