# SPDX-License-Identifier: Apache-2.0
"""Directions across a given one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def lateral_vectors(direction: Array) -> tuple[Array, Array]:
    """Two orthonormal vectors (3,) across the unit vector `direction` (3,)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
