# SPDX-License-Identifier: Apache-2.0
"""By how much a mesh is too coarse under a contact.

A dent lives on the bending length sqrt(h / curvature); what triangles of an edge e under the
contact make of it is too stiff by a share that falls with (e / length)^2. The factor was measured
at 20 N on the mission's ball, where a mesh graded elsewhere was up to 14 % off.
"""

from __future__ import annotations

import numpy as np

from shell_deform.contact.loads import ContactPatch
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory.reference import sharpest_curvature

FACTOR = 0.17


def coarseness(surface: LimitSurface, wall: float, patch: ContactPatch) -> float:
    """Relative stiffness error [-] of the mesh under `patch`; `wall` [m]."""
    mesh = surface.mesh
    found = surface.closest_point(mesh.vertices, patch.point[None])
    mean, gauss = surface.evaluate(mesh.vertices, found.triangle, found.parameters).curvatures()
    sharpest = float(sharpest_curvature(mean, gauss)[0])
    corners = mesh.vertices[mesh.triangles[int(found.triangle[0])]]
    edge = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max())
    return FACTOR * edge * edge * sharpest / wall
