# SPDX-License-Identifier: Apache-2.0
"""Air inside a closed shell: none, open to the room, or sealed (isothermal ideal gas)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STANDARD_ATMOSPHERE_PA = 101325.0


class GasError(ValueError):
    """A gas that cannot be: negative absolute pressure, or an unknown kind."""


@dataclass(frozen=True)
class Gas:
    """The air inside.

    Attributes:
        kind: 'none' or 'open' (no pressure difference, whatever the volume), or 'sealed'.
        gauge_pressure: overpressure at the stress-free shape [Pa].
        ambient: pressure outside [Pa].
    """

    kind: str = 'none'
    gauge_pressure: float = 0.0
    ambient: float = STANDARD_ATMOSPHERE_PA

    def __post_init__(self) -> None:
        if self.kind not in ('none', 'open', 'sealed'):
            raise GasError(f"gas kind is {self.kind!r}; choose 'none', 'open' or 'sealed'")
        if not np.isfinite(self.gauge_pressure) or not np.isfinite(self.ambient):
            raise GasError('gas pressures must be finite numbers in Pa')
        if self.gauge_pressure + self.ambient < 0:
            raise GasError(
                f'absolute gas pressure {self.gauge_pressure + self.ambient} Pa is negative'
            )

    @property
    def is_sealed(self) -> bool:
        """Whether volume changes the pressure."""
        return self.kind == 'sealed'

    def pressure(self, volume_ratio: float) -> float:
        """Overpressure [Pa] at volume / rest volume: Boyle's law against the room."""
        if not self.is_sealed:
            return 0.0
        return (self.gauge_pressure + self.ambient) / volume_ratio - self.ambient

    def pressure_slope(self, volume_ratio: float) -> float:
        """d(overpressure)/d(volume ratio) [Pa]: negative."""
        if not self.is_sealed:
            return 0.0
        return -(self.gauge_pressure + self.ambient) / volume_ratio**2

    def energy_density(self, volume_ratio: float) -> float:
        """Potential energy per rest volume [J/m^3]: minus the work the overpressure has done."""
        if not self.is_sealed:
            return 0.0
        absolute = self.gauge_pressure + self.ambient
        return self.ambient * (volume_ratio - 1.0) - absolute * float(np.log(volume_ratio))
