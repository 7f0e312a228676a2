# SPDX-License-Identifier: Apache-2.0
"""The depth at which a rigid body carries a force on a surface that does not yield."""

from __future__ import annotations

from collections.abc import Callable

# The depth is found to this share of the force.
FORCE_TOLERANCE = 1e-12


def depth_of_force(
    excess: Callable[[float], tuple[float, float]], start: float, force: float, reach: float
) -> float:
    """Depth [m] where `excess`, push less `force` [N] and its slope [N/m], is nothing.

    The push grows with the depth: Newton's method, kept between bounds by bisection. The bounds
    are looked for from `start` on, in steps from a thousandth of `reach` [m], the surface's size.
    """
    low = high = start
    step = 1e-3 * reach
    while excess(low)[0] > 0.0 and low > start - 4.0 * reach:
        low -= step
        step *= 2.0
    step = 1e-3 * reach
    while excess(high)[0] < 0.0 and high < start + 4.0 * reach:
        high += step
        step *= 2.0
    depth = start
    for _ in range(100):
        missing, rate = excess(depth)
        if abs(missing) <= FORCE_TOLERANCE * abs(force):
            break
        low, high = (depth, high) if missing < 0.0 else (low, depth)
        trial = depth - missing / rate if rate > 0.0 else low
        depth = trial if low < trial < high else 0.5 * (low + high)
        if high - low <= 1e-15 * reach:
            break
    return depth
