# SPDX-License-Identifier: Apache-2.0
"""The wall of a thick shell at one point: energy, stresses and tangent of eleven metric numbers.

A point of the wall at height z over the middle surface lies at x = phi + zeta(z) d with a unit
director d and zeta = lambda z + kappa z^2 / h. In an orthonormal tangent frame of the undeformed
middle surface the deformed wall is described by

    s = (a_11, a_22, a_12,  c_11, c_22, c_12,  e_11, e_22, e_12,  g_1, g_2),
    a_ab = phi,a . phi,b   c_ab = sym(phi,a . d,b)   e_ab = d,a . d,b   g_a = phi,a . d,

and by the two thickness numbers l = (lambda, kappa), whose gradients along the surface are left
out: they are found here, at every point, by a Newton iteration for dW/dl = 0 and eliminated from
the tangent. With m = 1 + z K the rest shifter of curvature tensor K and f(z) = 5/4 (1 - 4 z^2/h^2)
the assumed profile of transverse shear, the right Cauchy-Green tensor at height z is

    C_ab = m^-1 (a + 2 zeta c + zeta^2 e) m^-1,   C_a3 = zeta' f m^-1 g,   C_33 = zeta'^2.

The law is neo-Hookean, W = G/2 (J^-2/3 tr C - 3) + K/2 (J - 1)^2 with J^2 = det C, the first part
integrated at four Gauss heights and the volumetric part at two: with two thickness numbers J = 1
cannot hold at more, and a nearly incompressible wall would lock in bending.

Both invariants are scalars of the unshifted metric A = a + 2 zeta c + zeta^2 e, of the rise
r = zeta' and of t = f g, because m^-1 comes out of a determinant as a factor:

    tr C = m^-2 : A + r^2,   J^2 = r^2 Q / det(m)^2,   Q = det A - t . adj(A) . t,

so the local Newton iteration differentiates two numbers by zeta and r, and the tangent is made of
the derivatives of Q by (A, t), summed over the heights in powers of zeta.

A pin that presses on the outer face with the pressure P (per undeformed middle area) along the
unit axis a adds P y zeta(h/2), y = a . d. P enters the local equations as a force: prescribed as a
position it would drag lambda along wherever a trial state is far from equilibrium.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shell_deform.compiled.kernel_types import Bool, Float, FloatRows, Floats, Int, Void, kernel

STRAINS = 11
"""Metric numbers of a point; with a pin, y = axis . d is one more."""

FIBRE_KEEPS = 0.2
"""A local Newton step leaves at least this share of the shortest fibre stretch."""

MOST_LOCAL_STEPS = 30
SETTLED = 1e-7
"""A local step below this is the last: the error it leaves is about its square."""

# Gauss heights over h/2 and weights: four of the isochoric part, then two of the volumetric part.
HEIGHTS = np.array(
    [
        -0.8611363115940526, -0.3399810435848563, 0.3399810435848563, 0.8611363115940526,
        -0.5773502691896257, 0.5773502691896257,
    ]
)  # fmt: skip
GAUSS = np.array(
    [
        0.3478548451374538, 0.6521451548625461, 0.6521451548625461, 0.3478548451374538,
        1.0, 1.0,
    ]
)  # fmt: skip
ISOCHORIC_HEIGHTS = 4


WORK_SHAPE = (15, 17)
"""Work space of `solve_thickness` and `wall_stress`: a row for each height, then scratch."""

# Columns of a height: z, z^2 / h, 2 z / h; weight of its modulus; det(m)^-2; f; m^-2 (11, 22, 12).
Z, Z_2, R_2, WEIGHT, SHIFT, PROFILE, I_1, I_2, I_12 = 0, 1, 2, 3, 4, 5, 6, 7, 8


@kernel(Void, Floats, Float, Float, Float, FloatRows)
def _set_heights(curvature: Any, h: float, shear: float, bulk: float, heights: Any) -> None:
    """What the undeformed wall says at every height."""
    for g in range(len(HEIGHTS)):
        row = heights[g]
        z = 0.5 * h * HEIGHTS[g]
        m_1, m_2, m_12 = 1.0 + z * curvature[0], 1.0 + z * curvature[2], z * curvature[1]
        determinant = m_1 * m_2 - m_12 * m_12
        shift = 1.0 / (determinant * determinant)
        row[Z], row[Z_2], row[R_2] = z, z * z / h, 2.0 * z / h
        modulus = shear if g < ISOCHORIC_HEIGHTS else bulk
        row[WEIGHT] = 0.5 * h * GAUSS[g] * determinant * modulus
        row[SHIFT], row[PROFILE] = shift, 1.25 * (1.0 - HEIGHTS[g] * HEIGHTS[g])
        row[I_1] = shift * (m_2 * m_2 + m_12 * m_12)
        row[I_2] = shift * (m_1 * m_1 + m_12 * m_12)
        row[I_12] = -2.0 * shift * m_12 * (m_1 + m_2)


@kernel(Bool, Floats, FloatRows, Float, Float, Float, Float, Floats)
def _thickness_equations(
    s: Any, heights: Any, h: float, load: float, lam: float, kap: float, equations: Any
) -> bool:
    """dW/dl, then d2W/dl2 (11, 12, 22), at fixed strains; False where the wall is inside out.

    `load`: pressure of a pin times axis . d.
    """
    residual_0, residual_1 = load * 0.5 * h, load * 0.25 * h
    curve_00, curve_01, curve_11 = 0.0, 0.0, 0.0
    for g in range(len(HEIGHTS)):
        row = heights[g]
        zeta, r = lam * row[Z] + kap * row[Z_2], lam + kap * row[R_2]
        t_1, t_2 = row[PROFILE] * s[9], row[PROFILE] * s[10]
        # The metric, its derivatives by zeta and those of Q by it.
        a_1 = s[0] + zeta * (2.0 * s[3] + zeta * s[6])
        a_2 = s[1] + zeta * (2.0 * s[4] + zeta * s[7])
        a_12 = s[2] + zeta * (2.0 * s[5] + zeta * s[8])
        b_1, b_2, b_12 = s[3] + zeta * s[6], s[4] + zeta * s[7], s[5] + zeta * s[8]
        d_1, d_2, d_12 = a_2 - t_2 * t_2, a_1 - t_1 * t_1, t_1 * t_2 - a_12
        area = d_1 * d_2 - d_12 * d_12
        if not (area > 0.0 and r > 0.0):
            return False
        inverse, by_r, weight = 1.0 / area, 1.0 / r, row[WEIGHT]
        first = 2.0 * (d_1 * b_1 + d_2 * b_2 + 2.0 * d_12 * b_12) * inverse
        second = 2.0 * (
            d_1 * s[6] + d_2 * s[7] + 2.0 * d_12 * s[8] + 4.0 * (b_1 * b_2 - b_12 * b_12)
        ) * inverse  # fmt: skip
        if g < ISOCHORIC_HEIGHTS:
            i_1, i_2, i_12 = row[I_1], row[I_2], row[I_12]
            third, trace = 1.0 / 3.0, i_1 * a_1 + i_2 * a_2 + i_12 * a_12 + r * r
            p = 0.5 * weight * (r * r * area * row[SHIFT]) ** (-third)
            change = 2.0 * (i_1 * b_1 + i_2 * b_2 + i_12 * b_12)
            bend = 2.0 * (i_1 * s[6] + i_2 * s[7] + i_12 * s[8])
            slope = change - third * trace * first
            on_zeta, on_r = p * slope, 2.0 * p * (r - third * trace * by_r)
            zz = p * (bend - third * (first * (slope + change) + trace * (second - first * first)))
            zr = -2.0 * third * p * (slope * by_r + r * first)
            rr = p * (10.0 / 9.0 * trace * by_r * by_r - 2.0 * third)
        else:
            j = r * np.sqrt(area * row[SHIFT])
            p, j_zeta, j_r = weight * (j - 1.0), 0.5 * j * first, j * by_r
            on_zeta, on_r = p * j_zeta, p * j_r
            zz = weight * j_zeta * j_zeta + p * j * (0.5 * second - 0.25 * first * first)
            zr = weight * j_zeta * j_r + 0.5 * p * first * j_r
            rr = weight * j_r * j_r
        z_0, z_1, r_1 = row[Z], row[Z_2], row[R_2]
        residual_0 += on_zeta * z_0 + on_r
        residual_1 += on_zeta * z_1 + on_r * r_1
        curve_00 += zz * z_0 * z_0 + 2.0 * zr * z_0 + rr
        curve_01 += zz * z_0 * z_1 + zr * (z_0 * r_1 + z_1) + rr * r_1
        curve_11 += zz * z_1 * z_1 + 2.0 * zr * z_1 * r_1 + rr * r_1 * r_1
    equations[0], equations[1] = residual_0, residual_1
    equations[2], equations[3], equations[4] = curve_00, curve_01, curve_11
    return True


@kernel(
    Bool, Floats, Floats, Float, Float, Float, Float, Float, Floats, FloatRows,
    called_from_python=True,
)  # fmt: skip
def solve_thickness(
    s: Any, curvature: Any, h: float, shear: float, bulk: float, push: float, tilt: float, lk: Any,
    work: Any,
) -> bool:  # fmt: skip
    """Find the thickness numbers lk (2,) that balance the strains s (11,); False where none do.

    `curvature`: rest curvature (K_11, K_12, K_22), K_ab = A_a . N,b. `push`: pressure of a pin
    [Pa], `tilt`: its axis . d. Newton's method from where small strains would end, damped so that
    no fibre turns inside out, with negative curvature flipped. `work` (`WORK_SHAPE`) serves
    `wall_stress` next.
    """
    equations = work[6]
    _set_heights(curvature, h, shear, bulk, work)
    area = s[0] * s[1] - s[2] * s[2]
    if not area > 0.0:
        return False
    # The wall thins by nu / (1 - nu) of what its area grows, at the middle and with the height.
    first_lame = bulk - 2.0 / 3.0 * shear
    share = 0.5 * first_lame / (first_lame + 2.0 * shear)
    lk[0] = area ** (-share)
    grows = 2.0 * lk[0] * (s[1] * s[3] + s[0] * s[4] - 2.0 * s[2] * s[5]) / area
    grows -= 2.0 * (curvature[0] + curvature[2])
    lk[1] = -0.5 * h * share * lk[0] * grows
    keep = 0.5 * lk[0]
    lk[1] = max(-keep, min(keep, lk[1]))
    for _ in range(MOST_LOCAL_STEPS):
        if not _thickness_equations(s, work, h, push * tilt, lk[0], lk[1], equations):
            return False
        residual = (equations[0], equations[1])
        p, q, r = equations[2], equations[3], equations[4]
        determinant = p * r - q * q
        step_0 = -(r * residual[0] - q * residual[1]) / determinant
        step_1 = -(p * residual[1] - q * residual[0]) / determinant
        if not (determinant > 0.0 and p > 0.0):
            half, middle = 0.5 * (p - r), 0.5 * (p + r)
            radius = np.sqrt(half * half + q * q)
            high, low = abs(middle + radius), abs(middle - radius)
            cosine = np.sqrt(max(0.0, 0.5 * (1.0 + half / radius))) if radius > 0.0 else 1.0
            sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
            if q < 0.0:
                sine = -sine
            along = cosine * residual[0] + sine * residual[1]
            across = -sine * residual[0] + cosine * residual[1]
            along, across = -along / max(high, 1e-30), -across / max(low, 1e-30)
            step_0, step_1 = cosine * along - sine * across, sine * along + cosine * across
        keep = FIBRE_KEEPS * (lk[0] - abs(lk[1]))
        for _ in range(60):
            if lk[0] + step_0 - abs(lk[1] + step_1) >= keep:
                break
            step_0 *= 0.5
            step_1 *= 0.5
        lk[0] += step_0
        lk[1] += step_1
        if not (np.isfinite(lk[0]) and np.isfinite(lk[1])):
            return False
        if max(abs(step_0), abs(step_1)) < SETTLED:
            return True
    return False


# What a height says: A, t, dQ by A and t, dW by Q and tr C, second derivatives of W.
D_A, D_T, W_Q, W_I, W_QQ, W_IQ, W_QR, W_IR, W_RR = 5, 8, 10, 11, 12, 13, 14, 15, 16


@kernel(Float, Bool, Floats, Floats, Float, Float, Floats)
def _set_height(isochoric: bool, row: Any, s: Any, zeta: float, r: float, state: Any) -> float:
    """Energy of a height and its derivatives by Q and tr C; those by r count r^2 in tr C, too."""
    t_1, t_2 = row[PROFILE] * s[9], row[PROFILE] * s[10]
    a_1 = s[0] + zeta * (2.0 * s[3] + zeta * s[6])
    a_2 = s[1] + zeta * (2.0 * s[4] + zeta * s[7])
    a_12 = s[2] + zeta * (2.0 * s[5] + zeta * s[8])
    state[0], state[1], state[2], state[3], state[4] = a_1, a_2, a_12, t_1, t_2
    d_1, d_2, d_12 = a_2 - t_2 * t_2, a_1 - t_1 * t_1, t_1 * t_2 - a_12
    state[D_A], state[D_A + 1], state[D_A + 2] = d_1, d_2, 2.0 * d_12
    state[D_T], state[D_T + 1] = 2.0 * (a_12 * t_2 - a_2 * t_1), 2.0 * (a_12 * t_1 - a_1 * t_2)
    area = d_1 * d_2 - d_12 * d_12
    weight, inverse, by_r = row[WEIGHT], 1.0 / area, 1.0 / r
    if isochoric:
        third = 1.0 / 3.0
        trace = row[I_1] * a_1 + row[I_2] * a_2 + row[I_12] * a_12 + r * r
        p = 0.5 * weight * (r * r * area * row[SHIFT]) ** (-third)
        by_q = -third * p * trace * inverse
        state[W_Q], state[W_I] = by_q, p
        state[W_QQ], state[W_IQ] = -4.0 * third * by_q * inverse, -third * p * inverse
        state[W_QR] = -2.0 * third * (p * r * inverse + by_q * by_r)
        state[W_IR] = -2.0 * third * p * by_r
        state[W_RR] = p * (10.0 / 9.0 * trace * by_r * by_r - 2.0 * third)
        return p * trace - 1.5 * weight
    j = r * np.sqrt(area * row[SHIFT])
    p = 0.5 * weight * inverse * j
    state[W_Q], state[W_I] = p * (j - 1.0), 0.0
    state[W_QQ], state[W_IQ] = 0.5 * p * inverse, 0.0
    state[W_QR], state[W_IR] = p * (2.0 * j - 1.0) * by_r, 0.0
    state[W_RR] = weight * j * j * by_r * by_r
    return 0.5 * weight * (j - 1.0) * (j - 1.0)


@kernel(Void, Floats, Float, Floats, Floats)
def _add_stress(row: Any, zeta: float, state: Any, stress: Any) -> None:
    """Add a height's stresses: on a, c, e one in-plane tensor times 1, 2 zeta, zeta^2."""
    by_q, by_i = state[W_Q], state[W_I]
    for i in range(3):
        force = by_q * state[D_A + i] + by_i * row[I_1 + i]
        stress[i] += force
        stress[3 + i] += 2.0 * zeta * force
        stress[6 + i] += zeta * zeta * force
    stress[9] += by_q * row[PROFILE] * state[D_T]
    stress[10] += by_q * row[PROFILE] * state[D_T + 1]


@kernel(Void, Bool, Floats, Floats, Float, Floats, FloatRows, FloatRows)
def _add_moduli(
    sheared: bool, row: Any, s: Any, zeta: float, state: Any, sums: Any, tangent: Any
) -> None:
    """Add second derivatives of a height's energy: by A to rows 0 to 4 of `sums`, times powers of
    zeta, as (11, 12, 13, 22, 23, 33); by A and t to rows 5 to 7; by t and by lk to `tangent`.
    """
    d_1, d_2, d_3, u_1, u_2 = state[5], state[6], state[7], state[8], state[9]
    i_1, i_2, i_3 = row[I_1], row[I_2], row[I_12]
    by_q, qq, iq = state[W_Q], state[W_QQ], state[W_IQ]
    h_11 = qq * d_1 * d_1 + 2.0 * iq * d_1 * i_1
    h_22 = qq * d_2 * d_2 + 2.0 * iq * d_2 * i_2
    h_33 = qq * d_3 * d_3 + 2.0 * iq * d_3 * i_3 - 2.0 * by_q
    h_12 = qq * d_1 * d_2 + iq * (d_1 * i_2 + d_2 * i_1) + by_q
    h_13 = qq * d_1 * d_3 + iq * (d_1 * i_3 + d_3 * i_1)
    h_23 = qq * d_2 * d_3 + iq * (d_2 * i_3 + d_3 * i_2)
    power = 1.0
    for n in range(5):
        out = sums[n]
        out[0] += power * h_11
        out[1] += power * h_12
        out[2] += power * h_13
        out[3] += power * h_22
        out[4] += power * h_23
        out[5] += power * h_33
        power *= zeta
    # How A changes with zeta, and what that and the rise do to the forces on A.
    b_1, b_2, b_3 = (
        2.0 * (s[3] + zeta * s[6]), 2.0 * (s[4] + zeta * s[7]), 2.0 * (s[5] + zeta * s[8])
    )  # fmt: skip
    on_zeta = (
        h_11 * b_1 + h_12 * b_2 + h_13 * b_3,
        h_12 * b_1 + h_22 * b_2 + h_23 * b_3,
        h_13 * b_1 + h_23 * b_2 + h_33 * b_3,
    )
    qr, ir = state[W_QR], state[W_IR]
    on_rise = (qr * d_1 + ir * i_1, qr * d_2 + ir * i_2, qr * d_3 + ir * i_3)
    by_i = state[W_I]
    force = (by_q * d_1 + by_i * i_1, by_q * d_2 + by_i * i_2, by_q * d_3 + by_i * i_3)
    z_by, r_by = (row[Z], row[Z_2]), (1.0, row[R_2])
    zz = b_1 * on_zeta[0] + b_2 * on_zeta[1] + b_3 * on_zeta[2]
    zz += 2.0 * (force[0] * s[6] + force[1] * s[7] + force[2] * s[8])
    zr = b_1 * on_rise[0] + b_2 * on_rise[1] + b_3 * on_rise[2]
    rr = state[W_RR]
    for m in range(2):
        for i in range(3):
            value = on_zeta[i] * z_by[m] + on_rise[i] * r_by[m]
            turned = 2.0 * z_by[m] * force[i]
            tangent[i, 12 + m] += value
            tangent[3 + i, 12 + m] += 2.0 * zeta * value + turned
            tangent[6 + i, 12 + m] += zeta * (zeta * value + turned)
        for n in range(m, 2):
            tangent[12 + m, 12 + n] += (
                zz * z_by[m] * z_by[n]
                + zr * (z_by[m] * r_by[n] + z_by[n] * r_by[m])
                + rr * r_by[m] * r_by[n]
            )
    if not sheared:
        return
    f, t_1, t_2 = row[PROFILE], state[3], state[4]
    x_1, x_2, x_3 = qq * d_1 + iq * i_1, qq * d_2 + iq * i_2, qq * d_3 + iq * i_3
    g_11, g_12 = f * x_1 * u_1, f * (x_1 * u_2 - 2.0 * by_q * t_2)
    g_21, g_22 = f * (x_2 * u_1 - 2.0 * by_q * t_1), f * x_2 * u_2
    g_31, g_32 = f * (x_3 * u_1 + 2.0 * by_q * t_2), f * (x_3 * u_2 + 2.0 * by_q * t_1)
    power = 1.0
    for n in range(5, 8):
        out = sums[n]
        out[0] += power * g_11
        out[1] += power * g_12
        out[2] += power * g_21
        out[3] += power * g_22
        out[4] += power * g_31
        out[5] += power * g_32
        power *= zeta
    tangent[9, 9] += f * f * (qq * u_1 * u_1 - 2.0 * by_q * state[1])
    tangent[9, 10] += f * f * (qq * u_1 * u_2 + 2.0 * by_q * state[2])
    tangent[10, 10] += f * f * (qq * u_2 * u_2 - 2.0 * by_q * state[0])
    zeta_1, zeta_2 = g_11 * b_1 + g_21 * b_2 + g_31 * b_3, g_12 * b_1 + g_22 * b_2 + g_32 * b_3
    for m in range(2):
        tangent[9, 12 + m] += zeta_1 * z_by[m] + f * qr * u_1 * r_by[m]
        tangent[10, 12 + m] += zeta_2 * z_by[m] + f * qr * u_2 * r_by[m]


@kernel(Void, FloatRows, FloatRows)
def _spread_moduli(sums: Any, tangent: Any) -> None:
    """Put the sums of `_add_moduli` where the powers 1, 2 zeta, zeta^2 of a, c, e want them."""
    factor = (1.0, 2.0, 1.0)
    at = ((0, 1, 2), (1, 3, 4), (2, 4, 5))
    for b in range(3):
        for d in range(b, 3):
            scale, source = factor[b] * factor[d], sums[b + d]
            for i in range(3):
                for k in range(3):
                    tangent[3 * b + i, 3 * d + k] = scale * source[at[i][k]]
        source = sums[5 + b]
        for i in range(3):
            for k in range(2):
                tangent[3 * b + i, 9 + k] = factor[b] * source[2 * i + k]
    for i in range(14):
        for k in range(i):
            tangent[i, k] = tangent[k, i]


@kernel(
    Float, Bool, Bool, Floats, Float, Float, Float, Floats, Floats, FloatRows, FloatRows,
    called_from_python=True,
)  # fmt: skip
def wall_stress(
    sheared: bool, stiff: bool, s: Any, h: float, push: float, tilt: float, lk: Any, stress: Any,
    tangent: Any, work: Any,
) -> float:  # fmt: skip
    """Energy per middle area and stresses (12,) at the thickness numbers that were just solved.

    If `stiff` the tangent (14, 14), too; without `sheared` its rows of shear stay zero. Row 11 of
    both belongs to y = axis . d, rows and columns 12 and 13 to lk, not yet eliminated.
    """
    state, sums = work[6], work[7:15]
    lam, kap = lk[0], lk[1]
    top = h * (0.5 * lam + 0.25 * kap)
    energy = push * tilt * top
    stress[:11] = 0.0
    stress[11] = push * top
    if stiff:
        sums[:, :] = 0.0
        tangent[:, :] = 0.0
        tangent[11, 12], tangent[11, 13] = push * 0.5 * h, push * 0.25 * h
    for g in range(len(HEIGHTS)):
        row = work[g]
        zeta, r = lam * row[Z] + kap * row[Z_2], lam + kap * row[R_2]
        energy += _set_height(g < ISOCHORIC_HEIGHTS, row, s, zeta, r, state)
        _add_stress(row, zeta, state, stress)
        if stiff:
            _add_moduli(sheared, row, s, zeta, state, sums, tangent)
    if stiff:
        _spread_moduli(sums, tangent)
    return energy


@kernel(Void, Int, FloatRows, FloatRows, called_from_python=True)
def eliminate_thickness(count: int, tangent: Any, follow: Any) -> None:
    """Schur complement of lk in the tangent (14, 14) of `wall_stress`, for the first `count` rows.

    `follow` (2, 12) becomes H_ll^-1 H_ls: minus the change of lk per change of the strains.
    """
    p, q, r = tangent[12, 12], tangent[12, 13], tangent[13, 13]
    scale = 1.0 / (p * r - q * q)
    for i in range(count):
        u, v = tangent[12, i], tangent[13, i]
        follow[0, i] = scale * (r * u - q * v)
        follow[1, i] = scale * (p * v - q * u)
    for i in range(count):
        u, v = tangent[12, i], tangent[13, i]
        for k in range(count):
            tangent[i, k] -= u * follow[0, k] + v * follow[1, k]
