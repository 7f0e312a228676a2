# SPDX-License-Identifier: Apache-2.0
"""The gauge of the transition from linear to nonlinear theory.

Linear theory is the first term of the response in the loads. The second term costs one more right
hand side per pair of contacts, solved once at rest, and says how the response bends away from the
straight line, for this shell, these contacts, this pressure: no fitted constant of R/h enters.
With w = a F + b F^2 along the loading the secant stiffness is 1 - q to first order,
q = (b / a^2) w. Written as 1 / (1 + q + q^2 / 2), the same to second order as the exponential that
thin spheres follow up to twice the wall, it stays useful beyond; linear theory then misses the
rest of the displacement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.background.small_loads import pair_products

Array = NDArray[np.float64]


def linear_error(
    compliance: Array, second_order: Array, force: Array, displacement: Array | None = None
) -> float:
    """Share of the displacement that linear theory misses or invents under pushes (k,) [N].

    `displacement` (k,) [m]: of the contacts as served; without it the linear one stands in, which
    underrates a dent that has already softened.
    """
    linear = compliance @ force
    bend = second_order @ pair_products(force)
    size = float(np.abs(linear).max(initial=0.0))
    if size == 0.0:
        return 0.0
    worst = int(np.argmax(np.abs(linear)))
    depth = 1.0
    if displacement is not None:
        depth = float(np.abs(displacement).max(initial=0.0)) / size
    q = float(bend[worst] / linear[worst]) * depth
    return 1.0 - 1.0 / (1.0 + q + 0.5 * q * q) if q > 0 else -q


def softened_depth(compliance: Array, second_order: Array, force: Array) -> float:
    """Largest displacement [m] that pushes (k,) [N] make, as far as the second order tells.

    Linear theory gives a F; with the stiffness of the module the true w obeys w / (1 + q + q^2/2)
    = a F, q = (b / a^2) w. Where no w does, the shell has given way: the answer is the w at which
    the push would have been largest.
    """
    linear = compliance @ force
    bend = second_order @ pair_products(force)
    size = float(np.abs(linear).max(initial=0.0))
    if size == 0.0:
        return 0.0
    worst = int(np.argmax(np.abs(linear)))
    q = float(bend[worst] / linear[worst])
    if q <= 0.0:
        return size
    rest = (1.0 - q) ** 2 - 2.0 * q * q
    if q >= 1.0 or rest < 0.0:
        return size * np.sqrt(2.0) / q
    return size * ((1.0 - q) - float(np.sqrt(rest))) / (q * q)
