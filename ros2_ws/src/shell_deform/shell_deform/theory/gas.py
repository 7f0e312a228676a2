# SPDX-License-Identifier: Apache-2.0
"""What fills a closed shell: nothing, the room's air, sealed air (isothermal), or a liquid."""

from __future__ import annotations

import math
from dataclasses import dataclass

STANDARD_ATMOSPHERE_PA = 101325.0

LIQUID_BULK_MODULUS_PA = 2.2e9
"""Of water at 20 degrees Celsius (CRC Handbook of Chemistry and Physics): its volume stays."""


class GasError(ValueError):
    """A gas that cannot be: negative absolute pressure, or an unknown kind."""


@dataclass(frozen=True)
class Gas:
    """The air or liquid inside.

    Attributes:
        kind: 'none' or 'open' (no pressure difference, whatever the volume), 'sealed' air, or
            'liquid', which fills it.
        gauge_pressure: overpressure at the stress-free shape [Pa].
        ambient: pressure outside [Pa].
    """

    kind: str = 'none'
    gauge_pressure: float = 0.0
    ambient: float = STANDARD_ATMOSPHERE_PA

    def __post_init__(self) -> None:
        if self.kind not in ('none', 'open', 'sealed', 'liquid'):
            raise GasError(
                f"gas kind is {self.kind!r}; choose 'none', 'open', 'sealed' or 'liquid'"
            )
        if not math.isfinite(self.gauge_pressure) or not math.isfinite(self.ambient):
            raise GasError('gas pressures must be finite numbers in Pa')
        if self.gauge_pressure + self.ambient < 0:
            raise GasError(
                f'absolute gas pressure {self.gauge_pressure + self.ambient} Pa is negative'
            )

    @property
    def is_sealed(self) -> bool:
        """Whether volume changes the pressure."""
        return self.kind in ('sealed', 'liquid')

    def pressure(self, volume_ratio: float) -> float:
        """Overpressure [Pa] at volume / rest volume: Boyle's law against the room, or Hooke's."""
        if not self.is_sealed:
            return 0.0
        if self.kind == 'liquid':
            return self.gauge_pressure - LIQUID_BULK_MODULUS_PA * (volume_ratio - 1.0)
        return (self.gauge_pressure + self.ambient) / volume_ratio - self.ambient

    def pressure_slope(self, volume_ratio: float) -> float:
        """d(overpressure)/d(volume ratio) [Pa]: negative."""
        if not self.is_sealed:
            return 0.0
        if self.kind == 'liquid':
            return -LIQUID_BULK_MODULUS_PA
        return -(self.gauge_pressure + self.ambient) / volume_ratio**2

    def energy_density(self, volume_ratio: float) -> float:
        """Potential energy per rest volume [J/m^3]: minus the work the overpressure has done.

        Infinite where a gas has no volume left.
        """
        if not self.is_sealed:
            return 0.0
        if self.kind == 'liquid':
            change = volume_ratio - 1.0
            return 0.5 * LIQUID_BULK_MODULUS_PA * change**2 - self.gauge_pressure * change
        if not volume_ratio > 0.0:
            return math.inf
        absolute = self.gauge_pressure + self.ambient
        return self.ambient * (volume_ratio - 1.0) - absolute * math.log(volume_ratio)
