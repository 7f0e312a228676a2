# SPDX-License-Identifier: Apache-2.0
"""Hanging known weights on the gauges of an emulated hand, as one does before measuring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from barrett_hand_bridge.emulator.mechanics import GRAVITY_M_PER_S2, HandMechanics
from barrett_hand_bridge.emulator.strain_gauge import StrainGauge

ARM_M = 0.050
MASSES_KG = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.4)
STEP_S = 0.01


def weighing_table(
    mechanics: HandMechanics,
    seed: int,
    *,
    masses_kg: Sequence[float] = MASSES_KG,
    arm_m: float = ARM_M,
    readings: int = 200,
) -> list[str]:
    """Lines of a CSV: every finger, the weights up and down again, mean and noise of the counts.

    The session is another one than the measurement: same gauges, warm, with other noise.
    """
    lines = ['finger,mass_kg,arm_m,counts,noise_counts']
    order = [*masses_kg, *list(masses_kg)[-2::-1]]
    streams = np.random.SeedSequence([seed, 7]).spawn(len(mechanics.gauges))
    for (finger, fitted), stream in zip(mechanics.gauges.items(), streams, strict=True):
        warm = replace(fitted.character, warm_up_counts=0.0)
        gauge = StrainGauge(warm, np.random.Generator(np.random.PCG64(stream)))
        for mass in order:
            counts = []
            for _ in range(readings):
                gauge.step(mass * GRAVITY_M_PER_S2 * arm_m, STEP_S)
                counts.append(gauge.counts)
            mean = float(np.mean(counts))
            lines.append(f'{finger},{mass:g},{arm_m:g},{mean:.4f},{float(np.std(counts)):.4f}')
    return lines
