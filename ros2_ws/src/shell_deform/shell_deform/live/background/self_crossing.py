# SPDX-License-Identifier: Apache-2.0
"""Whether the surface that is served passes through itself, looked at now and then.

Nothing in the energy of a shell keeps two parts of it apart. Looking takes as long as a refresh: a
few times a second is often enough to say so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.model import ShellModel
from shell_deform.readout import passes_through_itself

Array = NDArray[np.float64]

LOOK_EVERY_NS = 400_000_000
"""Of the stamps, so that a replay tells the same at any speed."""


class SelfCrossing:
    """What was last seen of one shell."""

    def __init__(self, model: ShellModel) -> None:
        self._model = model
        self._stamp: int | None = None
        self._found = False

    def found(self, positions: Array, stamp: int) -> bool:
        """Whether it crosses itself at control `positions` (n, 3), or did when last looked at."""
        if self._stamp is None or abs(stamp - self._stamp) >= LOOK_EVERY_NS:
            self._stamp = stamp
            self._found = passes_through_itself(self._model, positions) is not None
        return self._found
