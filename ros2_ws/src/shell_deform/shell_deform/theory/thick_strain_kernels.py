# SPDX-License-Identifier: Apache-2.0
"""Metric numbers of a thick wall from the derivatives of its middle surface and its shear.

The director is the unit vector d along v = n + W^a a_a: n the normal of the deformed middle
surface, W the shear, components of a field that lives on the undeformed surface and is pushed by
the tangent map, so that a rigid motion leaves it alone and W = 0 is Koiter's kinematics. At a
point the unknowns are

    y = (a_1, a_2, a_11, a_12, a_22, W^1, W^2, W^1_,1, W^1_,2, W^2_,1, W^2_,2)         (21,)

and everything the wall feels depends on them through

    m = (a_11, a_22, a_12, v_11, v_12, v_21, v_22, r_1, r_2, W^1, W^2, axis . v)       (12,)
    v_cb = a_c . v,b = -b_cb + W^e,b a_ce + W^e a_c . a_eb,    r_b = n . v,b = W^e b_eb.

`director_numbers` gives m with its derivative, `metric_numbers` the strains s of
`thick_law_kernels` from m with theirs. The last entries of m and s exist under a pin only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled.kernel_types import Bool, Float, FloatRows, Floats, Int, Void, kernel
from shell_deform.theory.kernels import cross, dot


@kernel(Void, FloatRows, Floats, Floats, Floats, FloatRows, FloatRows)
def director_numbers(q: Any, shear: Any, axis: Any, m: Any, jac: Any, work: Any) -> None:
    """m (12,) and its derivative (12, 21) at derivative vectors q (5, 3) and shear (6,).

    `work` (10, 3) keeps n, a^1, a^2 and v_a + b_a for `add_director_hessian`.
    """
    normal, dual_1, dual_2, across = work[0], work[1], work[2], work[3]
    a = (q[0], q[1])
    cross(q[0], q[1], across)
    inverse = 1.0 / np.sqrt(dot(across, across))
    for i in range(3):
        normal[i] = across[i] * inverse
    cross(q[1], normal, dual_1)
    cross(normal, q[0], dual_2)
    for i in range(3):
        dual_1[i] *= inverse
        dual_2[i] *= inverse
    jac[:, :] = 0.0
    m[0], m[1], m[2] = dot(q[0], q[0]), dot(q[1], q[1]), dot(q[0], q[1])
    for i in range(3):
        jac[0, i] = 2.0 * q[0, i]
        jac[1, 3 + i] = 2.0 * q[1, i]
        jac[2, i] = q[1, i]
        jac[2, 3 + i] = q[0, i]
    w = (shear[0], shear[1])
    m[7], m[8] = 0.0, 0.0
    # b_eb = a_eb . n: second derivative vectors 2, 3, 4 of q are 11, 12, 22.
    for b in range(2):
        mixed = work[4 + b]
        for i in range(3):
            mixed[i] = (
                shear[2 + b] * q[0, i]
                + shear[4 + b] * q[1, i]
                + w[0] * q[2 + b, i]
                + w[1] * q[3 + b, i]
            )
        for c in range(2):
            row = 3 + 2 * c + b
            vector = 2 + b + c
            form = dot(q[vector], normal)
            along_1, along_2 = dot(q[vector], dual_1), dot(q[vector], dual_2)
            m[row] = dot(a[c], mixed) - form
            for i in range(3):
                jac[row, i] += along_1 * normal[i]
                jac[row, 3 + i] += along_2 * normal[i]
                jac[row, 3 * vector + i] -= normal[i]
                jac[row, 3 * c + i] += mixed[i]
                jac[row, i] += shear[2 + b] * a[c][i]
                jac[row, 3 + i] += shear[4 + b] * a[c][i]
                jac[row, 6 + 3 * b + i] += w[0] * a[c][i]
                jac[row, 9 + 3 * b + i] += w[1] * a[c][i]
            for e in range(2):
                jac[row, 15 + e] = dot(a[c], q[2 + e + b])
                jac[row, 17 + 2 * e + b] = dot(a[c], a[e])
            # r_b takes W^c b_cb.
            m[7 + b] += w[c] * form
            jac[7 + b, 15 + c] = form
            for i in range(3):
                jac[7 + b, i] -= w[c] * along_1 * normal[i]
                jac[7 + b, 3 + i] -= w[c] * along_2 * normal[i]
                jac[7 + b, 3 * vector + i] += w[c] * normal[i]
    m[9], m[10] = w
    jac[9, 15], jac[10, 16] = 1.0, 1.0
    axial_1, axial_2 = dot(axis, dual_1), dot(axis, dual_2)
    m[11] = dot(axis, normal) + w[0] * dot(axis, q[0]) + w[1] * dot(axis, q[1])
    for i in range(3):
        jac[11, i] = w[0] * axis[i] - axial_1 * normal[i]
        jac[11, 3 + i] = w[1] * axis[i] - axial_2 * normal[i]
    jac[11, 15], jac[11, 16] = dot(axis, q[0]), dot(axis, q[1])


@kernel(Void, Floats, Floats, FloatRows, FloatRows)
def _add_normal_hessian(c: Any, by: Any, duals: Any, h: Any) -> None:
    """d2(c . n) with c = sum_y by_y y: -2 (n . da_x) a^x . (dc - c^y da_y) - (c . n) a^xy ...

    `by` (5,): how c depends on the derivative vectors, a_1 and a_2 not yet counted. `duals` (3, 3)
    holds n, a^1, a^2.
    """
    normal = duals[0]
    along = dot(c, normal)
    g = (by[0] - dot(c, duals[1]), by[1] - dot(c, duals[2]), by[2], by[3], by[4])
    for x in range(2):
        for y in range(2):
            metric = along * dot(duals[1 + x], duals[1 + y])
            for i in range(3):
                for j in range(3):
                    h[3 * x + i, 3 * y + j] -= metric * normal[i] * normal[j]
        for y in range(5):
            for i in range(3):
                for j in range(3):
                    part = g[y] * normal[i] * duals[1 + x, j]
                    h[3 * x + i, 3 * y + j] -= part
                    h[3 * y + j, 3 * x + i] -= part


@kernel(Void, FloatRows, Floats, Floats, Floats, FloatRows, FloatRows, FloatRows)
def add_director_hessian(
    q: Any, shear: Any, axis: Any, force: Any, jac: Any, work: Any, h: Any
) -> None:
    """Add sum_k force_k d2 m_k / dy2 to h (21, 21); call after `director_numbers`."""
    c, by = work[6], work[7:9].reshape(6)
    g = (force[3], force[4], force[5], force[6])  # g[2 c + b] works on v_cb
    rho = (force[7], force[8])
    w = (shear[0], shear[1])
    for i in range(3):
        h[i, i] += 2.0 * force[0]
        h[3 + i, 3 + i] += 2.0 * force[1]
        h[i, 3 + i] += force[2]
        h[3 + i, i] += force[2]
    # All that works on the second fundamental form, at fixed shear.
    by[0], by[1] = 0.0, 0.0
    by[2] = rho[0] * w[0] - g[0]
    by[3] = rho[0] * w[1] + rho[1] * w[0] - g[1] - g[2]
    by[4] = rho[1] * w[1] - g[3]
    for i in range(3):
        c[i] = by[2] * q[2, i] + by[3] * q[3, i] + by[4] * q[4, i] + force[11] * axis[i]
    _add_normal_hessian(c, by, work[0:3], h)
    normal, dual_1, dual_2 = work[0], work[1], work[2]
    for e in range(2):
        for b in range(2):
            vector = 2 + e + b
            along_1, along_2 = rho[b] * dot(q[vector], dual_1), rho[b] * dot(q[vector], dual_2)
            for i in range(3):
                first, second = -along_1 * normal[i], -along_2 * normal[i]
                third = rho[b] * normal[i]
                h[15 + e, i] += first
                h[i, 15 + e] += first
                h[15 + e, 3 + i] += second
                h[3 + i, 15 + e] += second
                h[15 + e, 3 * vector + i] += third
                h[3 * vector + i, 15 + e] += third
        for i in range(3):
            h[15 + e, 3 * e + i] += force[11] * axis[i]
            h[3 * e + i, 15 + e] += force[11] * axis[i]
    # g_cb a_c . (W^e,b a_e + W^e a_eb)
    for k in range(2):
        for b in range(2):
            factor = g[2 * k + b]
            for e in range(2):
                vector = 2 + e + b
                spread, turn = factor * shear[2 + 2 * e + b], factor * w[e]
                for i in range(3):
                    h[3 * k + i, 3 * e + i] += spread
                    h[3 * e + i, 3 * k + i] += spread
                    h[3 * k + i, 3 * vector + i] += turn
                    h[3 * vector + i, 3 * k + i] += turn
                    for_k, for_e = factor * q[e, i], factor * q[k, i]
                    h[17 + 2 * e + b, 3 * k + i] += for_k
                    h[3 * k + i, 17 + 2 * e + b] += for_k
                    h[17 + 2 * e + b, 3 * e + i] += for_e
                    h[3 * e + i, 17 + 2 * e + b] += for_e
                    for_k, for_v = factor * q[vector, i], factor * q[k, i]
                    h[15 + e, 3 * k + i] += for_k
                    h[3 * k + i, 15 + e] += for_k
                    h[15 + e, 3 * vector + i] += for_v
                    h[3 * vector + i, 15 + e] += for_v


U_1, U_2, K_1, K_2, M_11, M_22, M_12, X = 0, 1, 2, 3, 4, 5, 6, 7
"""Rows between m and s: u_a = a_ab W^b, k_b = v . v,b, M_ab = v,a . v,b, X = v . v."""


@kernel(Void, Floats, Floats, FloatRows, FloatRows, FloatRows)
def metric_numbers(m: Any, s: Any, jac: Any, between: Any, work: Any) -> None:
    """Strains s (12,) and their derivative (12, 12) from m (12,).

    `between` (9, 12): rows U_1 .. X with their derivatives by m, values in its last row. `work`
    (9, 24) keeps the inverse metric in its first row.
    """
    a_1, a_2, a_12 = m[0], m[1], m[2]
    v_11, v_12, v_21, v_22, r_1, r_2, w_1, w_2 = m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10]
    t = between
    t[:, :] = 0.0
    value = t[8]
    determinant = a_1 * a_2 - a_12 * a_12
    p, q, r = a_2 / determinant, -a_12 / determinant, a_1 / determinant
    y_1, y_2 = (
        (p * v_11 + q * v_21, q * v_11 + r * v_21),
        (p * v_12 + q * v_22, q * v_12 + r * v_22),
    )
    work[0, 0], work[0, 1], work[0, 2] = p, q, r
    u_1, u_2 = a_1 * w_1 + a_12 * w_2, a_12 * w_1 + a_2 * w_2
    value[U_1], value[U_2] = u_1, u_2
    t[U_1, 0], t[U_1, 2], t[U_1, 9], t[U_1, 10] = w_1, w_2, a_1, a_12
    t[U_2, 1], t[U_2, 2], t[U_2, 9], t[U_2, 10] = w_2, w_1, a_12, a_2
    k_1, k_2 = r_1 + w_1 * v_11 + w_2 * v_21, r_2 + w_1 * v_12 + w_2 * v_22
    value[K_1], value[K_2] = k_1, k_2
    t[K_1, 7], t[K_1, 3], t[K_1, 5], t[K_1, 9], t[K_1, 10] = 1.0, w_1, w_2, v_11, v_21
    t[K_2, 8], t[K_2, 4], t[K_2, 6], t[K_2, 9], t[K_2, 10] = 1.0, w_1, w_2, v_12, v_22
    value[M_11] = v_11 * y_1[0] + v_21 * y_1[1] + r_1 * r_1
    value[M_22] = v_12 * y_2[0] + v_22 * y_2[1] + r_2 * r_2
    value[M_12] = v_11 * y_2[0] + v_21 * y_2[1] + r_1 * r_2
    t[M_11, 3], t[M_11, 5], t[M_11, 7] = 2.0 * y_1[0], 2.0 * y_1[1], 2.0 * r_1
    t[M_22, 4], t[M_22, 6], t[M_22, 8] = 2.0 * y_2[0], 2.0 * y_2[1], 2.0 * r_2
    t[M_12, 3], t[M_12, 5], t[M_12, 4], t[M_12, 6] = y_2[0], y_2[1], y_1[0], y_1[1]
    t[M_12, 7], t[M_12, 8] = r_2, r_1
    t[M_11, 0], t[M_11, 1], t[M_11, 2] = -(y_1[0] ** 2), -(y_1[1] ** 2), -2.0 * y_1[0] * y_1[1]
    t[M_22, 0], t[M_22, 1], t[M_22, 2] = -(y_2[0] ** 2), -(y_2[1] ** 2), -2.0 * y_2[0] * y_2[1]
    t[M_12, 0], t[M_12, 1] = -y_1[0] * y_2[0], -y_1[1] * y_2[1]
    t[M_12, 2] = -(y_1[0] * y_2[1] + y_1[1] * y_2[0])
    x = 1.0 + w_1 * u_1 + w_2 * u_2
    value[X] = x
    t[X, 0], t[X, 1], t[X, 2] = w_1 * w_1, w_2 * w_2, 2.0 * w_1 * w_2
    t[X, 9], t[X, 10] = 2.0 * u_1, 2.0 * u_2
    i_2 = 1.0 / x
    i_1 = np.sqrt(i_2)
    i_3, i_4 = i_1 * i_2, i_2 * i_2
    i_5 = i_1 * i_4
    jac[:, :] = 0.0
    for i in range(3):
        s[i] = m[i]
        jac[i, i] = 1.0
    bent = 0.5 * (v_12 + v_21)
    turned = 0.5 * (u_1 * k_2 + u_2 * k_1)
    s[3] = v_11 * i_1 - u_1 * k_1 * i_3
    s[4] = v_22 * i_1 - u_2 * k_2 * i_3
    s[5] = bent * i_1 - turned * i_3
    s[6] = value[M_11] * i_2 - k_1 * k_1 * i_4
    s[7] = value[M_22] * i_2 - k_2 * k_2 * i_4
    s[8] = value[M_12] * i_2 - k_1 * k_2 * i_4
    s[9], s[10], s[11] = u_1 * i_1, u_2 * i_1, m[11] * i_1
    by_x = (
        -0.5 * i_3 * v_11 + 1.5 * i_5 * u_1 * k_1,
        -0.5 * i_3 * v_22 + 1.5 * i_5 * u_2 * k_2,
        -0.5 * i_3 * bent + 1.5 * i_5 * turned,
        -i_4 * value[M_11] + 2.0 * i_2 * i_4 * k_1 * k_1,
        -i_4 * value[M_22] + 2.0 * i_2 * i_4 * k_2 * k_2,
        -i_4 * value[M_12] + 2.0 * i_2 * i_4 * k_1 * k_2,
    )
    for j in range(11):
        x_j = t[X, j]
        jac[3, j] = -i_3 * (k_1 * t[U_1, j] + u_1 * t[K_1, j]) + by_x[0] * x_j
        jac[4, j] = -i_3 * (k_2 * t[U_2, j] + u_2 * t[K_2, j]) + by_x[1] * x_j
        jac[5, j] = by_x[2] * x_j - 0.5 * i_3 * (
            k_2 * t[U_1, j] + u_1 * t[K_2, j] + k_1 * t[U_2, j] + u_2 * t[K_1, j]
        )
        jac[6, j] = i_2 * t[M_11, j] - 2.0 * i_4 * k_1 * t[K_1, j] + by_x[3] * x_j
        jac[7, j] = i_2 * t[M_22, j] - 2.0 * i_4 * k_2 * t[K_2, j] + by_x[4] * x_j
        jac[8, j] = i_2 * t[M_12, j] + by_x[5] * x_j
        jac[8, j] -= i_4 * (k_2 * t[K_1, j] + k_1 * t[K_2, j])
        jac[9, j] = i_1 * t[U_1, j] - 0.5 * i_3 * u_1 * x_j
        jac[10, j] = i_1 * t[U_2, j] - 0.5 * i_3 * u_2 * x_j
        jac[11, j] = -0.5 * i_3 * m[11] * x_j
    jac[3, 3] += i_1
    jac[4, 6] += i_1
    jac[5, 4] += 0.5 * i_1
    jac[5, 5] += 0.5 * i_1
    jac[11, 11] = i_1


@kernel(Void, FloatRows, FloatRows, Int, FloatRows)
def add_transposed_product(left: Any, right: Any, count: int, out: Any) -> None:
    """Add left^T right to the first `count` rows of out; `right` and `out` are (4 k, 24), (., 24).

    Four rows at once over 24 columns, however many count: loops of this length become vector code,
    shorter ones are unrolled into scalars.
    """
    for k in range(0, len(right), 4):
        r_0, r_1, r_2, r_3 = right[k], right[k + 1], right[k + 2], right[k + 3]
        l_0, l_1, l_2, l_3 = left[k], left[k + 1], left[k + 2], left[k + 3]
        for i in range(count):
            f_0, f_1, f_2, f_3 = l_0[i], l_1[i], l_2[i], l_3[i]
            row = out[i]
            for j in range(24):
                row[j] += f_0 * r_0[j] + f_1 * r_1[j] + f_2 * r_2[j] + f_3 * r_3[j]


@kernel(Void, FloatRows, Int, Int, Float)
def _add_pair(h: Any, i: int, j: int, value: float) -> None:
    h[i, j] += value
    h[j, i] += value


@kernel(Void, Floats, Float, Float, Float, Float, Float, Float, FloatRows)
def _add_form_hessian(
    m: Any, p: float, q: float, r: float, f_1: float, f_2: float, f_12: float, h: Any
) -> None:
    """Add the second derivative of f_ab v_ca a^cd v_db by the metric and v; a^cd = (p, q, r).

    d2(v_a S v_b) = 2 dv_a S dv_b - 2 dv_a S da y_b - 2 dv_b S da y_a + 2 y_a da S da y_b, y = S v.
    """
    v_11, v_12, v_21, v_22 = m[3], m[4], m[5], m[6]
    s = ((p, q), (q, r))
    y = ((p * v_11 + q * v_21, q * v_11 + r * v_21), (p * v_12 + q * v_22, q * v_12 + r * v_22))
    f = ((2.0 * f_1, f_12), (f_12, 2.0 * f_2))
    # da y = Q(y) (da_11, da_22, da_12)
    for a in range(2):
        for b in range(2):
            factor = f[a][b]
            q_b = ((y[b][0], 0.0, y[b][1]), (0.0, y[b][1], y[b][0]))
            q_a = ((y[a][0], 0.0, y[a][1]), (0.0, y[a][1], y[a][0]))
            for c in range(2):
                row = 3 + 2 * c + a
                for d in range(2):
                    h[row, 3 + 2 * d + b] += factor * s[c][d]
                for j in range(3):
                    value = factor * (s[c][0] * q_b[0][j] + s[c][1] * q_b[1][j])
                    h[row, j] -= value
                    h[j, row] -= value
            for i in range(3):
                for j in range(3):
                    h[i, j] += factor * (
                        q_a[0][i] * (p * q_b[0][j] + q * q_b[1][j])
                        + q_a[1][i] * (q * q_b[0][j] + r * q_b[1][j])
                    )


@kernel(Void, Floats, Floats, FloatRows, FloatRows, Bool, FloatRows)
def add_metric_hessian(
    m: Any, stress: Any, between: Any, work: Any, sheared: bool, h: Any
) -> None:
    """Add sum_k stress_k d2 s_k / dm2 to h (12, 12); call after `metric_numbers`.

    Without shear (W = 0 at the point and no unknown of it) only v,a . v,b is curved in m.
    """
    t, value = between, between[8]
    p, q, r = work[0, 0], work[0, 1], work[0, 2]
    i_2 = 1.0 / value[X]
    i_1 = np.sqrt(i_2)
    i_3, i_4 = i_1 * i_2, i_2 * i_2
    _add_form_hessian(m, p, q, r, i_2 * stress[6], i_2 * stress[7], i_2 * stress[8], h)
    if not sheared:
        return
    i_5, i_6 = i_1 * i_4, i_2 * i_4
    i_7, i_8 = i_3 * i_4, i_4 * i_4
    u_1, u_2, k_1, k_2 = value[U_1], value[U_2], value[K_1], value[K_2]
    s_3, s_4, s_5 = stress[3], stress[4], 0.5 * stress[5]
    e_1, e_2, e_12 = stress[6], stress[7], stress[8]
    linear = (
        s_3 * m[3] + s_4 * m[6] + s_5 * (m[4] + m[5])
        + stress[9] * u_1 + stress[10] * u_2 + stress[11] * m[11]
    )  # fmt: skip
    on_u_1, on_u_2 = s_3 * k_1 + s_5 * k_2, s_4 * k_2 + s_5 * k_1
    on_k_1, on_k_2 = s_3 * u_1 + s_5 * u_2, s_4 * u_2 + s_5 * u_1
    turned = u_1 * on_u_1 + u_2 * on_u_2
    forms = e_1 * value[M_11] + e_2 * value[M_22] + e_12 * value[M_12]
    square_1, square_2 = 2.0 * e_1 * k_1 + e_12 * k_2, 2.0 * e_2 * k_2 + e_12 * k_1
    squares = 0.5 * (k_1 * square_1 + k_2 * square_2)
    by_u_1, by_u_2 = stress[9] * i_1 - i_3 * on_u_1, stress[10] * i_1 - i_3 * on_u_2
    by_k_1, by_k_2 = -i_3 * on_k_1 - i_4 * square_1, -i_3 * on_k_2 - i_4 * square_2
    by_x = -0.5 * i_3 * linear + 1.5 * i_5 * turned - i_4 * forms + 2.0 * i_6 * squares
    by_xx = 0.75 * i_5 * linear - 3.75 * i_7 * turned + 2.0 * i_6 * forms - 6.0 * i_8 * squares
    # Second derivatives between the rows: the force on each of them per change of m. Two rows take
    # the place of those of M, which are needed no more.
    forces, on_x = work[1:9], t[M_11]
    for j in range(12):
        u_1j, u_2j, k_1j, k_2j, x_j = t[U_1, j], t[U_2, j], t[K_1, j], t[K_2, j], t[X, j]
        on_x[j] = (
            (1.5 * i_5 * on_u_1 - 0.5 * i_3 * stress[9]) * u_1j
            + (1.5 * i_5 * on_u_2 - 0.5 * i_3 * stress[10]) * u_2j
            + (1.5 * i_5 * on_k_1 + 2.0 * i_6 * square_1) * k_1j
            + (1.5 * i_5 * on_k_2 + 2.0 * i_6 * square_2) * k_2j
            - i_4 * (e_1 * t[M_11, j] + e_2 * t[M_22, j] + e_12 * t[M_12, j])
        )
        forces[U_1, j] = -i_3 * (s_3 * k_1j + s_5 * k_2j)
        forces[U_2, j] = -i_3 * (s_5 * k_1j + s_4 * k_2j)
        forces[K_1, j] = -i_3 * (s_3 * u_1j + s_5 * u_2j) - i_4 * (2.0 * e_1 * k_1j + e_12 * k_2j)
        forces[K_2, j] = -i_3 * (s_5 * u_1j + s_4 * u_2j) - i_4 * (e_12 * k_1j + 2.0 * e_2 * k_2j)
        forces[M_11, j], forces[M_22, j], forces[M_12, j] = x_j, 0.0, 0.0
        forces[X, j] = by_xx * x_j
    on_x[3] -= 0.5 * i_3 * s_3
    on_x[6] -= 0.5 * i_3 * s_4
    on_x[4] -= 0.5 * i_3 * s_5
    on_x[5] -= 0.5 * i_3 * s_5
    on_x[11] -= 0.5 * i_3 * stress[11]
    for j in range(12):
        forces[X, j] += on_x[j]
    add_transposed_product(t[:8], forces, 12, h)
    # Second derivatives of the rows themselves.
    w_1, w_2 = m[9], m[10]
    _add_pair(h, 0, 9, by_u_1 + 2.0 * w_1 * by_x)
    _add_pair(h, 1, 10, by_u_2 + 2.0 * w_2 * by_x)
    _add_pair(h, 2, 10, by_u_1 + 2.0 * w_1 * by_x)
    _add_pair(h, 2, 9, by_u_2 + 2.0 * w_2 * by_x)
    h[9, 9] += 2.0 * m[0] * by_x
    h[10, 10] += 2.0 * m[1] * by_x
    _add_pair(h, 9, 10, 2.0 * m[2] * by_x)
    _add_pair(h, 9, 3, by_k_1)
    _add_pair(h, 10, 5, by_k_1)
    _add_pair(h, 9, 4, by_k_2)
    _add_pair(h, 10, 6, by_k_2)
    h[7, 7] += 2.0 * i_2 * e_1
    h[8, 8] += 2.0 * i_2 * e_2
    _add_pair(h, 7, 8, i_2 * e_12)
