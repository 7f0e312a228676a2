# SPDX-License-Identifier: Apache-2.0
"""What the touch cells of fingers feel, as the background process hands it on.

Forces and areas are integrals over cells: a thin shell carries a flat finger on a ring whose
pressure at a point has no limit as meshes become finer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.contact_field import Touch
from shell_deform.contact.taxels import point_shares
from shell_deform.live.background.fingers import Finger
from shell_deform.live.exchange import MAX_TAXELS, TAXEL_FIELDS

Array = NDArray[np.float64]


def taxel_rows(
    fingers: tuple[Finger, ...], touches: tuple[Touch, ...], areas: Sequence[Array]
) -> Array:
    """(t, f) rows of `TAXEL_FIELDS` in the object's frame; a body without cells is one itself.

    `areas`: of each touch (p,), by `pressed_areas`.
    """
    parts = [_rows(*one) for one in zip(fingers, touches, areas, strict=True)]
    rows = np.concatenate(parts) if parts else np.zeros((0, len(TAXEL_FIELDS)))
    return rows[:MAX_TAXELS]


def _rows(finger: Finger, touch: Touch, areas: Array) -> Array:
    centres, weights, face = finger.carried.cells, touch.weights, touch.face.position
    whole = not len(centres)
    if whole:
        load = weights * touch.pressure
        centres = np.zeros((1, 3))
        if load.sum() > 0.0:
            centres = touch.pose.inside((load @ face / load.sum())[None])
    count = len(centres)
    shares = np.ones((1, len(face))) if whole else point_shares(touch, centres)

    def summed(values: Array) -> Array:
        return np.asarray(shares @ values, dtype=float)

    area = summed(areas)
    touched = np.where(area > 0.0, area, 1.0)
    friction = np.linalg.norm(touch.friction, axis=1)
    rows = np.zeros((count, len(TAXEL_FIELDS)))
    rows[:, 0:3] = touch.pose.outside(centres)
    rows[:, 3:6] = touch.pose.distance(finger.carried.shape, rows[:, 0:3]).normal
    rows[:, 6:9] = np.stack([summed(part) for part in touch.forces.T], axis=1)
    rows[:, 9], rows[:, 10] = area, summed(areas * touch.sticking)
    rows[:, 11] = summed(weights * touch.pressure) / touched
    rows[:, 12] = summed(weights * friction) / touched
    rows[:, 13], rows[:, 14] = finger.number, np.arange(count)
    return rows
