# SPDX-License-Identifier: Apache-2.0
"""How round a surface is at a place: what the size of a contact there depends on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..surface.fit import Target
from ..surface.frames import lateral_vectors

FloatArray = npt.NDArray[np.float64]

RING_POINTS = 12
RINGS = (0.5, 1.0)
"""Where normals are compared, in shares of the reach."""


def local_radius(target: Target, place: FloatArray, reach: float) -> float:
    """Smallest radius of curvature [m] of `target` where it is nearest to `place` (3,).

    The turn of the normal within `reach` [m] is fitted by a linear map, so that a scan's noise
    and the facets of a profile, which are smaller, count little. Infinite on a plane.
    """
    foot, normal = (found[0] for found in target.project(place[None]))
    frame = np.stack(lateral_vectors(normal))
    angle = 2.0 * np.pi * np.arange(RING_POINTS) / RING_POINTS
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ frame
    around = foot + np.concatenate([reach * share * circle for share in RINGS])
    feet, normals = target.project(around)
    # Beside the rim of an open surface every point has the rim's foot: it tells nothing new.
    moved, turned = (feet - foot) @ frame.T, (normals - normal) @ frame.T
    shape = np.linalg.lstsq(moved, turned, rcond=1e-6)[0]
    bend = np.abs(np.linalg.eigvalsh(0.5 * (shape + shape.T))).max()
    return float(1.0 / bend) if bend > 0.0 else float(np.inf)
