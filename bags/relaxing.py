# SPDX-License-Identifier: Apache-2.0
"""An emulated object whose force falls with the logarithm of time, by superposition of its steps.

A closed form that shares no code with the solver: what every step of the elastic force added is
multiplied with g(t) = 1 - share log10(1 + t / onset) of the time since.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from barrett_hand_bridge.emulator.squeeze import ForceTable


@dataclass(frozen=True)
class Fading:
    """`share` of the force lost a decade of time, from about `onset_s` on."""

    share: float
    onset_s: float

    def __call__(self, time_s: np.ndarray) -> np.ndarray:
        """g at times since a step, s."""
        return 1.0 - self.share * np.log10(1.0 + np.asarray(time_s) / self.onset_s)


@dataclass(frozen=True)
class FadingTable(ForceTable):
    """A force table within one step of time: what the steps before have lost is taken off."""

    lost_n: float = 0.0

    def displacement(self, force_n: float) -> float:
        """Displacement in m at a force in N now."""
        return super().displacement(force_n + self.lost_n if force_n > 0.0 else 0.0)

    def force(self, displacement_m: float) -> float:
        """Force in N at a displacement in m now (0 when not touching)."""
        return max(super().force(displacement_m) - self.lost_n, 0.0)


@dataclass
class FadingHistory:
    """Every step of the elastic force of one object, and when it was."""

    law: Fading
    table: ForceTable
    now_s: float = 0.0
    elastic_n: float = 0.0
    _times: list[float] = field(default_factory=list)
    _steps: list[float] = field(default_factory=list)

    def after(self, seconds: float) -> FadingTable:
        """The table after so many more seconds."""
        self.now_s += seconds
        since = self.now_s - np.array(self._times)
        lost = float(np.array(self._steps) @ (1.0 - self.law(since))) if self._times else 0.0
        table = self.table
        return FadingTable(table.displacement_m, table.force_n, table.name, lost)

    def moved(self, displacement_m: float) -> None:
        """The object has been dented so far in this step."""
        elastic = self.table.force(displacement_m)
        if elastic != self.elastic_n:
            self._times.append(self.now_s)
            self._steps.append(elastic - self.elastic_n)
            self.elastic_n = elastic
