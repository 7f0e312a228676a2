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


@kernel(Float, FloatRows, Floats, FloatRows)
def _set_inverse(full: Any, c: Any, inverse: Any) -> float:
    """Inverse (3, 3) of the symmetric tensor c = (11, 22, 12, 13, 23, 33); its determinant."""
    p, q, r, s, t, u = c[0], c[1], c[2], c[3], c[4], c[5]
    full[0, 0] = q * u - t * t
    full[1, 1] = p * u - s * s
    full[2, 2] = p * q - r * r
    full[0, 1] = s * t - r * u
    full[0, 2] = r * t - q * s
    full[1, 2] = r * s - p * t
    determinant = p * full[0, 0] + r * full[0, 1] + s * full[0, 2]
    scale = 1.0 / determinant
    for i in range(3):
        for j in range(i, 3):
            inverse[i, j] = full[i, j] * scale
            inverse[j, i] = inverse[i, j]
    return determinant


@kernel(Void, Float, Floats, FloatRows)
def _set_shifter(z: float, curvature: Any, shift: Any) -> None:
    """Rest shifter m at height z: m^-1 in shift[0:2, 0:2], det m in shift[2, 0].

    Rows 3 to 5 are m^-1 . m^-1 on the components (11, 22, 12) of a symmetric tensor.
    """
    m_1, m_2, m_12 = 1.0 + z * curvature[0], 1.0 + z * curvature[2], z * curvature[1]
    determinant = m_1 * m_2 - m_12 * m_12
    p, r, q = m_2 / determinant, m_1 / determinant, -m_12 / determinant
    shift[0, 0], shift[0, 1], shift[1, 0], shift[1, 1] = p, q, q, r
    shift[2, 0] = determinant
    shift[3, 0], shift[3, 1], shift[3, 2] = p * p, q * q, 2.0 * p * q
    shift[4, 0], shift[4, 1], shift[4, 2] = q * q, r * r, 2.0 * q * r
    shift[5, 0], shift[5, 1], shift[5, 2] = p * q, q * r, p * r + q * q


@kernel(Void, Floats, Float, Float, Float, Float, FloatRows, Floats, FloatRows)
def _set_metric(
    s: Any, z: float, h: float, lam: float, kap: float, shift: Any, c: Any, by_l: Any
) -> None:
    """C (6,) at height z, and its change per rise of zeta (row 0) and of zeta' (row 1)."""
    zeta, rise = lam * z + kap * z * z / h, lam + 2.0 * kap * z / h
    profile = 1.25 * (1.0 - 4.0 * z * z / (h * h))
    for i in range(3):
        value, slope = 0.0, 0.0
        for j in range(3):
            m = shift[3 + i, j]
            value += m * (s[j] + zeta * (2.0 * s[3 + j] + zeta * s[6 + j]))
            slope += m * 2.0 * (s[3 + j] + zeta * s[6 + j])
        c[i] = value
        by_l[0, i], by_l[1, i] = slope, 0.0
    for i in range(2):
        sheared = profile * (shift[i, 0] * s[9] + shift[i, 1] * s[10])
        c[3 + i] = rise * sheared
        by_l[0, 3 + i], by_l[1, 3 + i] = 0.0, sheared
    c[5] = rise * rise
    by_l[0, 5], by_l[1, 5] = 0.0, 2.0 * rise


@kernel(Float, Bool, Float, Float, Floats, FloatRows, FloatRows, Floats, FloatRows)
def _set_stress(
    isochoric: bool, modulus: float, weight: float, c: Any, full: Any, inverse: Any, stress: Any,
    tangent: Any,
) -> float:  # fmt: skip
    """Energy, its derivative (6,) and second derivative (6, 6) by the components of C.

    Off-diagonal components count once each, so their derivatives carry a factor of two.
    """
    determinant = _set_inverse(full, c, inverse)
    if not determinant > 0.0:
        return np.nan
    j = np.sqrt(determinant)
    alpha_0, alpha_1, alpha_5 = inverse[0, 0], inverse[1, 1], inverse[2, 2]
    alpha_2, alpha_3, alpha_4 = 2.0 * inverse[0, 1], 2.0 * inverse[0, 2], 2.0 * inverse[1, 2]
    alpha = (alpha_0, alpha_1, alpha_2, alpha_3, alpha_4, alpha_5)
    first, second = (0, 1, 0, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    count = (1.0, 1.0, 2.0, 2.0, 2.0, 1.0)
    trace_by = (1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    if isochoric:
        trace = c[0] + c[1] + c[5]
        factor = weight * 0.5 * modulus * j ** (-2.0 / 3.0)
        energy = factor * trace - weight * 1.5 * modulus
        for i in range(6):
            stress[i] = factor * (trace_by[i] - trace * alpha[i] / 3.0)
    else:
        energy = weight * 0.5 * modulus * (j - 1.0) ** 2
        factor = weight * modulus * (j - 1.0) * j
        trace = 0.0
        for i in range(6):
            stress[i] = 0.5 * factor * alpha[i]
    curve = weight * modulus * j * j
    for i in range(6):
        for k in range(i, 6):
            beta = (
                0.5
                * count[i]
                * count[k]
                * (
                    inverse[first[i], first[k]] * inverse[second[i], second[k]]
                    + inverse[first[i], second[k]] * inverse[second[i], first[k]]
                )
            )
            if isochoric:
                value = factor * (
                    trace * (alpha[i] * alpha[k] / 9.0 + beta / 3.0)
                    - (alpha[i] * trace_by[k] + alpha[k] * trace_by[i]) / 3.0
                )
            else:
                value = 0.25 * curve * alpha[i] * alpha[k] + factor * (
                    0.25 * alpha[i] * alpha[k] - 0.5 * beta
                )
            tangent[i, k] = value
            tangent[k, i] = value
    return energy


@kernel(
    Float, Floats, Floats, Float, Float, Float, Float, Float, Floats, Floats, FloatRows, FloatRows,
)  # fmt: skip
def _thickness_equations(
    s: Any, curvature: Any, h: float, shear: float, bulk: float, push: float, tilt: float, lk: Any,
    residual: Any, curve: Any, work: Any,
) -> float:  # fmt: skip
    """Energy, dW/dl (2,) and d2W/dl2 (2, 2) at fixed strains; NaN where the wall is inside out."""
    shift, full, inverse, by_l = work[0:6], work[6:9], work[9:12], work[12:14]
    tangent, c, stress = work[14:20], work[20], work[21]
    lam, kap = lk[0], lk[1]
    energy = push * tilt * h * (0.5 * lam + 0.25 * kap)
    residual[0], residual[1] = push * tilt * 0.5 * h, push * tilt * 0.25 * h
    curve[0, 0], curve[0, 1], curve[1, 1] = 0.0, 0.0, 0.0
    for g in range(len(HEIGHTS)):
        z = 0.5 * h * HEIGHTS[g]
        _set_shifter(z, curvature, shift)
        _set_metric(s, z, h, lam, kap, shift, c, by_l)
        isochoric = g < ISOCHORIC_HEIGHTS
        weight = 0.5 * h * GAUSS[g] * shift[2, 0]
        energy += _set_stress(
            isochoric, shear if isochoric else bulk, weight, c, full, inverse, stress, tangent
        )
        # The in-plane metric bends with zeta, C_33 with zeta': second derivatives of C by l.
        on_zeta, on_rise, bend = 0.0, 0.0, 0.0
        zz, rr, zr = 0.0, 0.0, 0.0
        for i in range(6):
            on_zeta += stress[i] * by_l[0, i]
            on_rise += stress[i] * by_l[1, i]
            for k in range(6):
                zz += by_l[0, i] * tangent[i, k] * by_l[0, k]
                zr += by_l[0, i] * tangent[i, k] * by_l[1, k]
                rr += by_l[1, i] * tangent[i, k] * by_l[1, k]
        for i in range(3):
            for k in range(3):
                bend += 2.0 * stress[i] * shift[3 + i, k] * s[6 + k]
        zz += bend
        rr += 2.0 * stress[5]
        z_0, z_1, r_0, r_1 = z, z * z / h, 1.0, 2.0 * z / h
        residual[0] += on_zeta * z_0 + on_rise * r_0
        residual[1] += on_zeta * z_1 + on_rise * r_1
        curve[0, 0] += zz * z_0 * z_0 + 2.0 * zr * z_0 * r_0 + rr * r_0 * r_0
        curve[0, 1] += zz * z_0 * z_1 + zr * (z_0 * r_1 + z_1 * r_0) + rr * r_0 * r_1
        curve[1, 1] += zz * z_1 * z_1 + 2.0 * zr * z_1 * r_1 + rr * r_1 * r_1
    curve[1, 0] = curve[0, 1]
    return energy


@kernel(
    Float, Floats, Floats, Float, Float, Float, Float, Float, Floats, FloatRows,
    called_from_python=True,
)  # fmt: skip
def solve_thickness(
    s: Any, curvature: Any, h: float, shear: float, bulk: float, push: float, tilt: float, lk: Any,
    work: Any,
) -> float:  # fmt: skip
    """Energy per middle area at the thickness numbers lk (2,) that balance the strains s.

    Newton's method from the given lk, damped so that no fibre turns inside out, with negative
    curvature flipped. NaN where it does not settle or the wall is inside out.
    """
    residual, curve = work[22], work[23:25]
    for _ in range(MOST_LOCAL_STEPS):
        energy = _thickness_equations(
            s, curvature, h, shear, bulk, push, tilt, lk, residual, curve, work
        )
        if not np.isfinite(energy):
            return np.nan
        p, q, r = curve[0, 0], curve[0, 1], curve[1, 1]
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
            return np.nan
        if max(abs(step_0), abs(step_1)) < SETTLED:
            return energy
    return np.nan


@kernel(
    Void, Float, Float, Float, Float, Float, Floats, FloatRows, Floats, FloatRows, FloatRows,
    FloatRows, Floats, FloatRows,
)  # fmt: skip
def _add_height(
    zeta: float, slide: float, profile: float, z: float, h: float, s: Any, shift: Any, force: Any,
    moduli: Any, by_l: Any, mixed: Any, stress: Any, tangent: Any,
) -> None:  # fmt: skip
    """Add one height's stresses, and the upper triangle of its tangent, in powers of zeta."""
    power = (1.0, 2.0 * zeta, zeta * zeta)
    z_by = (z, z * z / h)
    r_by = (1.0, 2.0 * z / h)
    # Stress resultants on a, c, e are one in-plane tensor times 1, 2 zeta, zeta^2.
    for i in range(3):
        n = 0.0
        for j in range(3):
            n += shift[3 + j, i] * force[j]
        mixed[5, i] = n
        for b in range(3):
            stress[3 * b + i] += power[b] * n
    for i in range(2):
        t = 0.0
        for j in range(2):
            t += shift[j, i] * force[3 + j]
        mixed[5, 3 + i] = t
        stress[9 + i] += slide * t
    for i in range(3):
        # Row i of M^T D: response of the in-plane resultant to every component of C.
        for k in range(6):
            value = 0.0
            for j in range(3):
                value += shift[3 + j, i] * moduli[j, k]
            mixed[i, k] = value
    for i in range(2):
        for k in range(6):
            value = 0.0
            for j in range(2):
                value += shift[j, i] * moduli[3 + j, k]
            mixed[3 + i, k] = value
    for i in range(3):
        for k in range(3):
            value = 0.0
            for j in range(3):
                value += mixed[i, j] * shift[3 + j, k]
            for b in range(3):
                for d in range(b, 3):
                    tangent[3 * b + i, 3 * d + k] += power[b] * power[d] * value
        for k in range(2):
            value = slide * (mixed[i, 3] * shift[0, k] + mixed[i, 4] * shift[1, k])
            for b in range(3):
                tangent[3 * b + i, 9 + k] += power[b] * value
        zeta_part, rise_part = 0.0, 0.0
        for k in range(6):
            zeta_part += mixed[i, k] * by_l[0, k]
            rise_part += mixed[i, k] * by_l[1, k]
        for m in range(2):
            value = zeta_part * z_by[m] + rise_part * r_by[m]
            for b in range(3):
                tangent[3 * b + i, 12 + m] += power[b] * value
            tangent[3 + i, 12 + m] += 2.0 * z_by[m] * mixed[5, i]
            tangent[6 + i, 12 + m] += 2.0 * zeta * z_by[m] * mixed[5, i]
    for i in range(2):
        for k in range(i, 2):
            tangent[9 + i, 9 + k] += (
                slide * slide * (mixed[3 + i, 3] * shift[0, k] + mixed[3 + i, 4] * shift[1, k])
            )
        zeta_part, rise_part = 0.0, 0.0
        for k in range(6):
            zeta_part += mixed[3 + i, k] * by_l[0, k]
            rise_part += mixed[3 + i, k] * by_l[1, k]
        for m in range(2):
            tangent[9 + i, 12 + m] += slide * (zeta_part * z_by[m] + rise_part * r_by[m])
            tangent[9 + i, 12 + m] += profile * mixed[5, 3 + i] * r_by[m]
    bend = 0.0
    for i in range(3):
        bend += 2.0 * mixed[5, i] * s[6 + i]
    zz, zr, rr = bend, 0.0, 2.0 * force[5]
    for i in range(6):
        for k in range(6):
            zz += by_l[0, i] * moduli[i, k] * by_l[0, k]
            zr += by_l[0, i] * moduli[i, k] * by_l[1, k]
            rr += by_l[1, i] * moduli[i, k] * by_l[1, k]
    for m in range(2):
        for n in range(m, 2):
            tangent[12 + m, 12 + n] += (
                zz * z_by[m] * z_by[n]
                + zr * (z_by[m] * r_by[n] + z_by[n] * r_by[m])
                + rr * r_by[m] * r_by[n]
            )


@kernel(
    Float, Floats, Floats, Float, Float, Float, Float, Float, Floats, Floats, FloatRows, FloatRows,
    called_from_python=True,
)  # fmt: skip
def wall_stress(
    s: Any, curvature: Any, h: float, shear: float, bulk: float, push: float, tilt: float, lk: Any,
    stress: Any, tangent: Any, work: Any,
) -> float:  # fmt: skip
    """Energy per middle area, stresses (12,) and tangent (14, 14) at the thickness numbers l.

    Row 11 of both belongs to y = axis . d. Rows and columns 12, 13 of `tangent` belong to lk, not
    yet eliminated. `curvature`: rest curvature (K_11, K_12, K_22), K_ab = A_a . N,b.
    """
    shift, full, inverse, by_l = work[0:6], work[6:9], work[9:12], work[12:14]
    moduli, c, force, mixed = work[14:20], work[20], work[21], work[25:31]
    lam, kap = lk[0], lk[1]
    energy = push * tilt * h * (0.5 * lam + 0.25 * kap)
    stress[:12] = 0.0
    tangent[:, :] = 0.0
    stress[11] = push * h * (0.5 * lam + 0.25 * kap)
    tangent[11, 12], tangent[11, 13] = push * 0.5 * h, push * 0.25 * h
    for g in range(len(HEIGHTS)):
        z = 0.5 * h * HEIGHTS[g]
        _set_shifter(z, curvature, shift)
        _set_metric(s, z, h, lam, kap, shift, c, by_l)
        isochoric = g < ISOCHORIC_HEIGHTS
        weight = 0.5 * h * GAUSS[g] * shift[2, 0]
        energy += _set_stress(
            isochoric, shear if isochoric else bulk, weight, c, full, inverse, force, moduli
        )
        zeta, rise = lam * z + kap * z * z / h, lam + 2.0 * kap * z / h
        profile = 1.25 * (1.0 - 4.0 * z * z / (h * h))
        _add_height(
            zeta, rise * profile, profile, z, h, s, shift, force, moduli, by_l, mixed, stress,
            tangent,
        )  # fmt: skip
    for i in range(14):
        for k in range(i):
            tangent[i, k] = tangent[k, i]
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
