# SPDX-License-Identifier: Apache-2.0
"""By how much a mesh is too coarse under a contact.

A dent lives on the bending length sqrt(h / curvature); what triangles of an edge e under the
contact make of it is too stiff by a share that falls with (e / length)^2. The factor was measured
at 20 N on the mission's ball, where a mesh graded elsewhere was up to 14 % off.
"""

from __future__ import annotations

import numpy as np

from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.limit import SurfacePoints
from shell_deform.theory.reference import sharpest_curvature

FACTOR = 0.17


def coarseness(mesh: ControlMesh, wall: float, triangle: int, middle: SurfacePoints) -> float:
    """Relative stiffness error [-] of the mesh under a contact whose centre is `middle` (one
    point of the undeformed middle surface) in `triangle`; `wall` [m].
    """
    sharpest = float(sharpest_curvature(*middle.curvatures())[0])
    corners = mesh.vertices[mesh.triangles[triangle]]
    edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max())
    return FACTOR * edge * edge * sharpest / wall
