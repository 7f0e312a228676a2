# SPDX-License-Identifier: Apache-2.0
"""The outer face of an elastic shell that a flat rigid pin presses: what lies under the pin.

Thin-shell theory alone misses how deep a pin sinks into a thick wall: next to it the wall shears,
and under it the material itself is squeezed. Both follow from the exact compliance of an elastic
layer loaded on one face (Sneddon, Proc. Cambridge Phil. Soc. 42 (1946) 260). The pin is flat and
rigid: the pressure under it is the one that keeps it so, found in Legendre functions of
sqrt(1 - r^2 / a^2), whose Hankel transforms are spherical Bessel functions. Under a small pin it
is that of a stamp on a half-space, under a wide one it crowds at the rim.

Away from the pin the wall is a shallow shell: its curvature acts like a bed of springs (Reissner,
J. Math. Phys. 25 (1946) 80).

All lengths are in units of the thickness h, forces in units of 8 pi D / h^2 times the depth.
Poisson's ratio enters the bed of springs alone, and hardly; Young's modulus drops out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import simpson
from scipy.special import bei, ber, j0, kei, ker, spherical_jn

POISSON = 0.4
"""Of the bed of springs: 0.3 or 0.5 changes it by a tenth."""

SOFTEST_BED = 1e-8
"""A bed below this [1/h^4] is none, to rounding, within a hundred thicknesses."""

WAVES_OF_PIN = 120.0
LARGEST_WAVE_NUMBER = 15.0
"""Waves are summed up to the larger of these two, [1/a] and [1/h]; beyond, the layer is a
half-space to five digits and the sum has a closed tail."""

NEAR = 8.0
"""So many thicknesses from the rim of the pin nothing of its local field is left."""


@dataclass(frozen=True)
class PressedPin:
    """How a plate lies around and under a flat rigid pin, in units of h.

    A dent is level x `level` + curvature x `curvature` + force x `force`: the first two are what
    the plate would do by itself about the pin's axis, 1 and r^2, the third is the force's own.
    Their logarithms (the moment of the pressure) and local fields hang on the pin's radius.

    Attributes:
        depth: (3,) depth at the axis, under the pin, for a unit of level, curvature and force.
        moment: (2,) factor of ln r + 1 outside, for a unit of curvature and of force.
        radius: (k,) distances at which the local field is tabulated.
        local: (k, 2) local field of the layer there, for curvature and force.
    """

    depth: np.ndarray
    moment: np.ndarray
    radius: np.ndarray
    local: np.ndarray

    def fields(self, radius: np.ndarray, bed: float) -> np.ndarray:
        """Return depth (n, 3) outside the pin for a unit of level, curvature and force.

        bed: stiffness of the bed of springs in units of D / h^4, see `bed_of`.
        """
        level, square, logarithm, kernel = shallow_shell(radius, bed)
        near = [np.interp(radius, self.radius, field, right=0.0) for field in self.local.T]
        ring = logarithm + level
        return np.column_stack(
            (
                level,
                square + self.moment[0] * ring + near[0],
                kernel - 0.8 * logarithm + self.moment[1] * ring + near[1],
            )
        )


def bed_of(curvature: np.ndarray) -> float:
    """Return the bed of springs, in D / h^4, of a wall with `curvature` (2, 2) in 1/h.

    Membrane stiffness E h k1 k2. A wall that is curved one way, or both ways against each other,
    has none: its dents run along straight lines, on which they need not stretch it.
    """
    return float(12.0 * (1.0 - POISSON**2) * max(0.0, np.linalg.det(curvature)))


def shallow_shell(radius: np.ndarray, bed: float) -> tuple[np.ndarray, ...]:
    """Return solutions (n,) of a plate on a bed that begin as 1, r^2, ln r and r^2 ln r.

    Kelvin's functions of r over the bending length bed^(-1/4), mixed such that each begins with
    its power alone.
    """
    length = max(bed, SOFTEST_BED) ** -0.25
    x = np.asarray(radius, float) / length
    inner, outer = ber(x), bei(x)
    scale = np.log(2.0 * length) - np.euler_gamma
    square = 4.0 * length**2 * outer
    logarithm = -ker(x) + scale * inner + 0.25 * np.pi * outer
    kernel = -(length**2) * (4.0 * kei(x) + np.pi * inner) + (scale + 1.0) * square
    return inner, square, logarithm, kernel


@lru_cache(maxsize=64)
def pressed_pin(pin_radius: float) -> PressedPin:
    """Return the plate around and under a pin of `pin_radius` [h]."""
    a = pin_radius
    count = int(8 + 3 * min(a, 10.0))
    wave, weight = _waves(a)
    bases = np.array([spherical_jn(2 * n, wave * a) for n in range(count)])
    layer = face_compliance(wave)
    compliance, square = _compliance(a, wave, weight, bases, layer)
    # Higher pressures, without a resultant, keep the face under the pin flat.
    against = np.column_stack((square[1:], compliance[1:, 0]))
    higher = -np.linalg.solve(compliance[1:, 1:], against)
    depth = np.array(
        [
            1.0,
            square[0] + compliance[0, 1:] @ higher[:, 0],
            compliance[0, 0] + compliance[0, 1:] @ higher[:, 1],
        ]
    )
    moment = np.array([0.0, square[0]]) + square[1] * higher[0]
    pressure = np.column_stack((np.r_[0.0, higher[:, 0]], np.r_[1.0, higher[:, 1]]))
    radius = np.geomspace(a, a + NEAR, 80)
    local = (layer - wave**-4 - 0.2 * wave**-2) * wave * weight
    field = 4.0 * (j0(np.outer(radius, wave)) * local) @ (bases.T @ pressure)
    return PressedPin(depth, moment, radius, field)


def _waves(a: float) -> tuple[np.ndarray, np.ndarray]:
    """Return wave numbers (k,) [1/h] and their trapezoidal weights; dense at the long ones."""
    last = max(LARGEST_WAVE_NUMBER, WAVES_OF_PIN / a)
    fine = 0.1 / max(a, NEAR + a if last < 100.0 else 1.0)
    long, short = np.linspace(1e-3, 1.0, 801), np.arange(1.0, last, max(fine, last / 20_000))
    wave = np.concatenate([long, short[1:]])
    weight = np.zeros(len(wave))
    weight[:-1] += 0.5 * np.diff(wave)
    weight[1:] += 0.5 * np.diff(wave)
    return wave, weight


def _compliance(
    a: float, wave: np.ndarray, weight: np.ndarray, bases: np.ndarray, layer: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return depth (b, b) over one pressure under another, and the mean of r^2 over each (b,).

    Long waves alone are r^2 ln r - 4/5 ln r about the axis: the divergence at wave number zero,
    which is a level and a curvature, is taken out.
    """
    count = len(bases)
    first = np.zeros(count)
    first[0] = 1.0
    square = np.zeros(count)
    square[:2] = 2.0 * a**2 / 3.0, -4.0 * a**2 / 15.0
    unit = np.outer(first, first)
    mixed = np.outer(square, first) + np.outer(first, square)
    long = wave <= 1.0
    k, q = wave[long], bases[:, long]
    rest = (layer[long] * k * q)[:, None] * q - (
        unit[..., None] * k**-3 + (0.2 * unit - 0.25 * mixed)[..., None] / k
    )
    short = ~long
    edge = weight.copy()
    edge[np.count_nonzero(long) - 1] = 0.5 * (wave[short][0] - k[-1])
    edge[: len(k) - 1] = 0.0
    total = 4.0 * simpson(rest, x=k)
    total += 4.0 * (bases * (layer * wave * edge)) @ bases.T
    sign = (-1.0) ** np.arange(count)
    total += np.outer(sign, sign) / (3.0 * a**2 * wave[-1])
    offset = np.euler_gamma - np.log(2.0)
    return total - 2.0 * unit - mixed * (offset - 1.0) + 0.8 * offset * unit, square


def face_compliance(wave_number: np.ndarray) -> np.ndarray:
    """Return how far the loaded face of a free layer sinks under a unit pressure wave (n,).

    wave_number (n,): in units of 1/h; the result in units of h^4 / D. Sum of the symmetric and
    the antisymmetric solution of the layer: 1/k^4 + 1/(5 k^2) for long waves (bending, shear),
    1/(6 k) for short ones (a half-space).
    """
    k = np.asarray(wave_number, float)
    # scaled by exp(-k): the hyperbolic functions of short waves overflow
    small = np.exp(-k)
    cosh, sinh = 0.5 * (1.0 + small**2), 0.5 * (1.0 - small**2)
    linear = k * small
    symmetric = (cosh - small) / (sinh + linear)
    # sinh k - k cancels for long waves: its series
    series = small * k**3 / 6.0 * (1.0 + k**2 / 20.0 * (1.0 + k**2 / 42.0 * (1.0 + k**2 / 72.0)))
    antisymmetric = (cosh + small) / np.where(k < 0.5, series, sinh - linear)
    return (symmetric + antisymmetric) / (12.0 * k)
