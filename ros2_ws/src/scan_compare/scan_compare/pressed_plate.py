# SPDX-License-Identifier: Apache-2.0
"""The outer face of an elastic plate that a small flat pin presses: what lies under the pin.

Thin-shell theory alone misses how deep a pin sinks into a thick wall: next to it the wall shears,
and under it the material itself is squeezed. Both follow from the exact solution for an elastic
layer loaded on one face (Sneddon, Proc. Cambridge Phil. Soc. 42 (1946) 260). Apart from one
factor, the pressing force over 8 pi D, it depends on the thickness h and the pin radius a alone;
Poisson's ratio and Young's modulus drop out.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.integrate import simpson
from scipy.special import sici

LARGEST_WAVE_NUMBER = 60.0
"""Beyond it [1/h] the layer is a half-space to nine digits."""


def bending(radius: np.ndarray) -> np.ndarray:
    """Return depth (n,) around a concentrated force, at distances (n,) well outside the pin.

    All in units of h and of the force over 8 pi D. r^2 ln r is Kirchhoff's plate; -4/5 ln r is
    the shear and the stretch of the wall seen from the loaded face, the next term of the layer's
    compliance (`face_compliance`) at long waves.
    """
    return (radius**2 - 0.8) * np.log(radius)


def depth_under_pin(pin_radius: float) -> float:
    """Return the depth at the axis under a rigid flat pin, in the units of `bending`.

    The mean of `bending` over the pressure of a rigid pin, 1 / (2 pi a sqrt(a^2 - r^2)), plus
    what the squeezed material under the pin adds.
    """
    a = pin_radius
    mean_log = np.log(2.0 * a) - 1.0
    mean_square_log = a**2 * 2.0 / 3.0 * (np.log(2.0 * a) - 5.0 / 6.0)
    return float(mean_square_log - 0.8 * mean_log + 8.0 * np.pi * squeeze(a))


@lru_cache(maxsize=64)
def squeeze(pin_radius: float) -> float:
    """Return what the layer's face sinks at the axis beyond `bending`, in units of P h^2 / D.

    The integral of the compliance beyond its two leading long-wave terms over the spectrum
    sin(k a) / (k a) of a rigid pin. For small pins it is the half-space's 1 / (24 a).
    """
    a = pin_radius
    k = np.linspace(1e-3, LARGEST_WAVE_NUMBER, 60_001)
    half_space = 1.0 / (6.0 * k)
    rest = face_compliance(k) - 1.0 / k**4 - 1.0 / (5.0 * k**2) - half_space
    inner = float(simpson(rest * k * np.sinc(k * a / np.pi), x=k))
    end = LARGEST_WAVE_NUMBER
    outer = -(np.sin(a * end) / end - a * sici(a * end)[1]) / (5.0 * a)
    return (np.pi / (12.0 * a) + inner + float(outer)) / (2.0 * np.pi)


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
