# SPDX-License-Identifier: Apache-2.0
"""Solve every kept solid model again (needs CalculiX)."""

from __future__ import annotations

import json
from collections.abc import Callable

from bags import solid_ball, solid_can, solid_cup, solid_three_fingers
from bags.axisymmetric import ball_of


def solve() -> None:
    """All models; the three-finger ball takes the modulus found for the two-finger one."""
    tasks: list[tuple[str, Callable[[], None]]] = [
        ('two-finger ball', solid_ball.two_finger_ball),
        ('sphere series', solid_ball.sphere_series),
        ('half can', solid_can.half_soda_can),
        ('cup', solid_cup.off_axis_cup),
        ('three-finger ball', _three_finger_ball),
    ]
    for name, task in tasks:
        print(f'solving the {name}', flush=True)
        task()


def _three_finger_ball() -> None:
    kept = json.loads((solid_ball.FOLDER / 'ball_two_finger.json').read_text())
    solid_three_fingers.three_finger_ball(ball_of(kept))
