# SPDX-License-Identifier: Apache-2.0
"""Compiled energy, gradient and Hessian of every theory at one point; twins of the numpy modules.

One kernel per quantity, a theory chosen by its code, so that numba's on-disk cache serves every
theory. All workspaces are passed in: nothing is allocated per point.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled.kernel_types import Float, FloatRows, Floats, Int, Void, kernel

LINEAR, PAPER, PAPER_RESTORED, KOITER = 0, 1, 2, 3


@kernel(Void, Floats, Floats, Floats)
def cross(a: Any, b: Any, out: Any) -> None:
    """Cross product of two vectors (3,) into `out`."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel(Float, Floats, Floats)
def dot(a: Any, b: Any) -> float:
    """Scalar product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(Void, FloatRows, Floats, FloatRows)
def _set_frame_curvature(tangents: Any, curvature: Any, k: Any) -> None:
    for i in range(3):
        k[0, i] = curvature[0] * tangents[0, i] + curvature[1] * tangents[1, i]
        k[1, i] = curvature[1] * tangents[0, i] + curvature[2] * tangents[1, i]


@kernel(
    Void, Int, FloatRows, FloatRows, FloatRows, Floats, Floats, FloatRows, FloatRows,
    called_from_python=True,
)  # fmt: skip
def point_strains(
    theory: int,
    q: Any,
    tangents: Any,
    second: Any,
    curvature: Any,
    strain: Any,
    jac: Any,
    work: Any,
) -> None:
    """Strains (6,) and their derivative (6, 15) at derivative vectors q (5, 3).

    The membrane strains depend on the first two vectors only. `work` (6, 3) keeps a_1 x a_2, n,
    frame vectors and, for Koiter, the dual vectors a^1, a^2 for `add_point_hessian`.
    """
    jac[:, :] = 0.0
    m, normal, k, dual_1, dual_2 = work[0], work[1], work[2:4], work[4], work[5]
    if theory == LINEAR:
        a_1, a_2 = tangents[0], tangents[1]
    else:
        a_1, a_2 = q[0], q[1]
    cross(a_1, a_2, m)
    inverse = 1.0 / np.sqrt(dot(m, m))
    for i in range(3):
        normal[i] = m[i] * inverse
        jac[0, i] = a_1[i]
        jac[1, 3 + i] = a_2[i]
        jac[2, i] = a_2[i]
        jac[2, 3 + i] = a_1[i]
    if theory == KOITER:
        cross(a_2, normal, dual_1)
        cross(normal, a_1, dual_2)
        for i in range(3):
            dual_1[i] *= inverse
            dual_2[i] *= inverse
        for row in range(3):
            vector = 2 if row == 0 else (4 if row == 1 else 3)
            factor = 2.0 if row == 2 else 1.0
            # dn = -(n . da_c) a^c, so d(a_ij . n) = n . (da_ij - (a_ij . a^c) da_c)
            along_1 = factor * dot(q[vector], dual_1)
            along_2 = factor * dot(q[vector], dual_2)
            for i in range(3):
                jac[3 + row, i] = -along_1 * normal[i]
                jac[3 + row, 3 + i] = -along_2 * normal[i]
                jac[3 + row, 3 * vector + i] = factor * normal[i]
    else:
        for row in range(3):
            vector = 2 if row == 0 else (4 if row == 1 else 3)
            factor = 2.0 if row == 2 else 1.0
            a_ij = second[vector - 2] if theory == LINEAR else q[vector]
            cross(a_2, a_ij, dual_1)
            cross(a_ij, a_1, dual_2)
            for i in range(3):
                jac[3 + row, i] = factor * dual_1[i]
                jac[3 + row, 3 + i] = factor * dual_2[i]
                jac[3 + row, 3 * vector + i] = factor * m[i]
    if theory in (LINEAR, PAPER):
        _set_frame_curvature(tangents, curvature, k)
        for i in range(3):
            jac[3, i] -= k[0, i]
            jac[4, 3 + i] -= k[1, i]
            jac[5, i] -= k[1, i]
            jac[5, 3 + i] -= k[0, i]
    if theory == LINEAR:
        for row in range(6):
            total = 0.0
            for i in range(3):
                total += jac[row, i] * (q[0, i] - tangents[0, i])
                total += jac[row, 3 + i] * (q[1, i] - tangents[1, i])
                for c in range(3):
                    total += jac[row, 6 + 3 * c + i] * (q[2 + c, i] - second[c, i])
            strain[row] = total
        return
    strain[0] = 0.5 * (dot(a_1, a_1) - 1.0)
    strain[1] = 0.5 * (dot(a_2, a_2) - 1.0)
    strain[2] = dot(a_1, a_2)
    fibre = normal if theory == KOITER else m
    strain[3] = dot(q[2], fibre)
    strain[4] = dot(q[4], fibre)
    strain[5] = 2.0 * dot(q[3], fibre)
    if theory == PAPER:
        strain[3] -= dot(a_1, k[0])
        strain[4] -= dot(a_2, k[1])
        strain[5] -= dot(a_1, k[1]) + dot(a_2, k[0])
    else:
        strain[3] -= curvature[0]
        strain[4] -= curvature[2]
        strain[5] -= 2.0 * curvature[1]


@kernel(Float, Floats, FloatRows, FloatRows, Floats, called_from_python=True)
def point_stress(strain: Any, membrane: Any, bending: Any, stress: Any) -> float:
    """Stress resultants (6,) from strains, by (3, 3) stiffnesses; returns the energy density."""
    energy = 0.0
    for i in range(3):
        n, moment = 0.0, 0.0
        for j in range(3):
            n += membrane[i, j] * strain[j]
            moment += bending[i, j] * strain[3 + j]
        stress[i] = n
        stress[3 + i] = moment
        energy += 0.5 * (n * strain[i] + moment * strain[3 + i])
    return energy


@kernel(Void, FloatRows, Int, Int, Floats, Float)
def _add_cross(h: Any, row: int, column: int, v: Any, factor: float) -> None:
    h[row, column + 1] -= factor * v[2]
    h[row, column + 2] += factor * v[1]
    h[row + 1, column] += factor * v[2]
    h[row + 1, column + 2] -= factor * v[0]
    h[row + 2, column] -= factor * v[1]
    h[row + 2, column + 1] += factor * v[0]


@kernel(Void, FloatRows, Floats, Floats, FloatRows, Floats, FloatRows)
def _add_koiter_bending(q: Any, stress: Any, normal: Any, dual: Any, c: Any, h: Any) -> None:
    """d2(c . n) with c = sum of moments times a_ij, by dn = -(n . da_x) a^x taken twice.

    -2 (n . da_x) a^x . (dc - c^y da_y) - (c . n) a^xy (n . da_x) (n . da_y),  c^x = c . a^x.
    """
    for i in range(3):
        c[i] = stress[3] * q[2, i] + stress[4] * q[4, i] + 2.0 * stress[5] * q[3, i]
    # dc - c^y da_y = sum_y g_y dq_y
    g = (-dot(c, dual[0]), -dot(c, dual[1]), stress[3], 2.0 * stress[5], stress[4])
    along = dot(c, normal)
    for x in range(2):
        for y in range(2):
            metric = along * dot(dual[x], dual[y])
            for i in range(3):
                for j in range(3):
                    h[3 * x + i, 3 * y + j] -= metric * normal[i] * normal[j]
        for y in range(5):
            for i in range(3):
                for j in range(3):
                    part = g[y] * normal[i] * dual[x, j]
                    h[3 * x + i, 3 * y + j] -= part
                    h[3 * y + j, 3 * x + i] -= part


@kernel(Void, FloatRows, Floats, FloatRows, FloatRows)
def _add_paper_bending(q: Any, stress: Any, blocks: Any, h: Any) -> None:
    """d2(c . m) with m = a_1 x a_2 and c = sum of moments times a_ij."""
    by_1, by_2, c = blocks[0:3], blocks[3:6], blocks[6]  # dm/da_1, dm/da_2
    by_1[:, :] = 0.0
    by_2[:, :] = 0.0
    _add_cross(by_1, 0, 0, q[1], -1.0)
    _add_cross(by_2, 0, 0, q[0], 1.0)
    for vector in range(3):
        moment = stress[3] if vector == 0 else (2.0 * stress[5] if vector == 1 else stress[4])
        base = 6 + 3 * vector
        for i in range(3):
            for j in range(3):
                h[base + i, j] += moment * by_1[i, j]
                h[j, base + i] += moment * by_1[i, j]
                h[base + i, 3 + j] += moment * by_2[i, j]
                h[3 + j, base + i] += moment * by_2[i, j]
    for i in range(3):
        c[i] = stress[3] * q[2, i] + stress[4] * q[4, i] + 2.0 * stress[5] * q[3, i]
    _add_cross(h, 0, 3, c, -1.0)
    _add_cross(h, 3, 0, c, 1.0)


@kernel(Void, Int, FloatRows, Floats, FloatRows, FloatRows, FloatRows, called_from_python=True)
def add_point_hessian(theory: int, q: Any, stress: Any, work: Any, blocks: Any, h: Any) -> None:
    """Add sum_k stress_k d2(strain_k)/dq2 to h (15, 15); call after `point_strains`.

    `blocks` (7, 3) is work space.
    """
    if theory == LINEAR:
        return
    for i in range(3):
        h[i, i] += stress[0]
        h[3 + i, 3 + i] += stress[1]
        h[i, 3 + i] += stress[2]
        h[3 + i, i] += stress[2]
    if theory == KOITER:
        _add_koiter_bending(q, stress, work[1], work[4:6], blocks[6], h)
    else:
        _add_paper_bending(q, stress, blocks, h)
