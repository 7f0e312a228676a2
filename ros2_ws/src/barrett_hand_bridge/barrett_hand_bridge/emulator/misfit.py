# SPDX-License-Identifier: Apache-2.0
"""Emulated hands that differ from what the driver's estimators assume.

The driver's drift model, tendon law and calibration know the numbers that the emulator draws from.
A check against those alone is a check of algebra; these sets change one law each. None of them
comes from a data sheet (there is none): they are what bonded gauges and tendons may well do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from barrett_hand_bridge.emulator.mechanics import FINGERS, HandBody, HandMechanics


@dataclass(frozen=True)
class Misfit:
    """What is other than drawn: factors on the gauges' traits, minutes, play of tendons in rad."""

    meaning: str
    warm_up_factor: float = 1.0
    warm_up_minutes: float | None = None
    walk_factor: float = 1.0
    play_factor: float = 1.0
    tendon_play_rad: float = 0.0


MISFITS = {
    'none': Misfit('the gauges and tendons that the driver assumes'),
    'warm-up': Misfit('warm-up twice as large within 4 minutes', 2.0, 4.0),
    'walk': Misfit('random walk of the zero three times as fast', walk_factor=3.0),
    'play': Misfit(
        'play of the gauge four times as wide: one count of the 8-bit one', play_factor=4.0
    ),
    'tendon': Misfit(
        'tendons with a hysteresis of 4 mrad beside their stretch', tendon_play_rad=0.004
    ),
}


def misfit_body(body: HandBody, misfit: Misfit) -> HandBody:
    """The hand's body with the tendons of a misfit."""
    return replace(body, tendon_play_rad=dict.fromkeys(FINGERS, misfit.tendon_play_rad))


def misfit_gauges(mechanics: HandMechanics, misfit: Misfit) -> None:
    """Change the traits of all gauges of a hand that has not moved yet."""
    for gauge in mechanics.gauges.values():
        drawn = gauge.character
        gauge.character = replace(
            drawn,
            warm_up_counts=misfit.warm_up_factor * drawn.warm_up_counts,
            warm_up_minutes=misfit.warm_up_minutes or drawn.warm_up_minutes,
            walk_counts_per_sqrt_minute=misfit.walk_factor * drawn.walk_counts_per_sqrt_minute,
            play_counts=misfit.play_factor * drawn.play_counts,
        )
