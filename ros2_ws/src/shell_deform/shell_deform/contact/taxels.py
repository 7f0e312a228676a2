# SPDX-License-Identifier: Apache-2.0
"""What the cells of a touch array feel of a contact: forces, never pressures at points.

A thin shell carries a flat finger on a ring so narrow that its pressure has no limit as meshes
become finer; the integral over a cell has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shell_deform.contact.contact_field import Touch

Array = NDArray[np.float64]


def cell_forces(touch: Touch, centres: Array) -> Array:
    """(c, 3) forces of the shell on the cells of a body [N], in the body's frame.

    `centres` (c, 3): of the cells in that frame [m]; each pressed point loads the cell nearest to
    it, so that the cells together carry the whole force of the contact.
    """
    result = np.zeros((len(centres), 3))
    if len(touch.pressure):
        places = touch.pose.inside(touch.face.position)
        cell = cKDTree(centres).query(places)[1]
        np.add.at(result, cell, -touch.forces @ touch.pose.turn)
    return result
