# SPDX-License-Identifier: Apache-2.0
"""The surfaces of the last seconds, to answer a scan with the one of its own time."""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field

import numpy as np

SPACING_NS = 20_000_000
"""Of surfaces closer together in time than this [ns] only one is kept."""


@dataclass(frozen=True, order=True)
class StampedSurface:
    """Limit positions (n, 3) and displacements (n, 3) [m] of the middle surface at a time.

    outer: (n, 3) points of the outer face over them [m]; None where it is half a wall off.
    """

    stamp_ns: int
    position: np.ndarray = field(compare=False)
    displacement: np.ndarray = field(compare=False)
    frame: str = field(compare=False, default='')
    outer: np.ndarray | None = field(compare=False, default=None)

    @property
    def rest(self) -> np.ndarray:
        """Limit positions (n, 3) at rest [m]."""
        return self.position.astype(np.float64) - self.displacement

    @property
    def max_displacement(self) -> float:
        """Largest displacement of a control vertex [m]."""
        return float(np.sqrt(np.max(np.sum(self.displacement**2, axis=1))))


class SurfaceHistory:
    """Keeps surfaces by stamp for a given time."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._surfaces: list[StampedSurface] = []
        self._newest: StampedSurface | None = None

    def __len__(self) -> int:
        return len(self._surfaces)

    @property
    def newest(self) -> StampedSurface | None:
        """The surface of the latest stamp."""
        return self._newest

    def add(self, surface: StampedSurface) -> None:
        """Keep a surface; a stamp far before the newest one means the clock was set back."""
        newest = self._newest
        horizon = int(1e9 * self.seconds)
        if newest is not None and surface.stamp_ns < newest.stamp_ns - horizon:
            self._surfaces.clear()
            self._newest = newest = None
        if newest is None or surface.stamp_ns >= newest.stamp_ns:
            self._newest = surface
        place = bisect_left(self._surfaces, surface)
        beside = self._surfaces[max(0, place - 1) : place + 1]
        if any(abs(surface.stamp_ns - kept.stamp_ns) < SPACING_NS for kept in beside):
            return
        insort(self._surfaces, surface)
        assert self._newest is not None
        oldest = self._newest.stamp_ns - horizon
        while self._surfaces and self._surfaces[0].stamp_ns < oldest:
            del self._surfaces[0]

    def at(self, stamp_ns: int) -> StampedSurface | None:
        """Return the surface nearest in time; the newest for stamp zero; None without any."""
        if self._newest is None or stamp_ns == 0:
            return self._newest
        return min((*self._surfaces, self._newest), key=lambda kept: abs(kept.stamp_ns - stamp_ns))
