# SPDX-License-Identifier: Apache-2.0
"""The outer face of a thick wall over the vertices of its middle surface, x(h/2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.shear_nodes import shear_frames

if TYPE_CHECKING:
    from shell_deform.assemble.thick import ThickShell

Array = NDArray[np.float64]


class ThickOuterFace:
    """The outer face of one shell at any of its states; what the rest shape says is found once."""

    def __init__(self, shell: ThickShell) -> None:
        self._shell = shell
        self._to_vertices = _means_at_vertices(shell)
        # Vertices beyond an edge: no point of the surface is theirs.
        self._beyond = np.diff(self._to_vertices.indptr) == 0
        self._frames = shear_frames(shell.surface, shell.sheared)
        tangents = np.stack(shell.surface.vertex_tangents(shell.mesh.vertices), axis=2)
        self._to_components = np.linalg.pinv(tangents)

    def at(self, positions: Array) -> Array:
        """(n, 3) points of the face over the limit positions of the vertices [m]."""
        shell = self._shell
        controls = positions[: len(shell.mesh.vertices)]
        place = shell.surface.limit_positions(controls)
        director = shell.surface.vertex_normals(controls) + self._pushed_shear(positions)
        director /= np.linalg.norm(director, axis=1)[:, None]
        tops = np.where(self._beyond, 0.5 * shell.wall, self._to_vertices @ self._tops(positions))
        return place + tops[:, None] * director

    def _tops(self, positions: Array) -> Array:
        """(p,) height of the outer face over the middle surface [m]."""
        shell = self._shell
        states = shell.point_states(positions, np.arange(len(shell.weights)))
        if states is None:
            return 0.5 * shell.thickness
        return shell.thickness * (0.5 * states[:, 0] + 0.25 * states[:, 1])

    def _pushed_shear(self, positions: Array) -> Array:
        """(n, 3) shear of the director at the vertices, in the deformed tangent planes."""
        shell, surface = self._shell, self._shell.surface
        n = len(shell.mesh.vertices)
        first_frame, second_frame = self._frames
        w = positions[n : shell.first_pin] / float(shell.wall.mean())
        field = np.zeros((n, 3))
        field[shell.sheared] = w[:, :1] * first_frame + w[:, 1:2] * second_frame
        components = np.einsum('nai,ni->na', self._to_components, surface.limit_positions(field))
        moved_first, moved_second = surface.vertex_tangents(positions[:n])
        return components[:, :1] * moved_first + components[:, 1:] * moved_second


def _means_at_vertices(shell: ThickShell) -> sp.csr_matrix:
    """(n, p) means over the points of a vertex's triangles, by area and nearness."""
    basis = shell.basis
    corners = shell.mesh.triangles[basis.triangle[basis.element]]
    u, v = basis.parameters.T
    share = np.stack([1.0 - u - v, u, v], axis=1) * shell.weights[:, None]
    p = np.repeat(np.arange(len(shell.weights)), 3)
    shape = (len(shell.mesh.vertices), len(shell.weights))
    matrix = sp.csr_matrix((share.ravel(), (corners.ravel(), p)), shape=shape)
    total = np.asarray(matrix.sum(axis=1)).ravel()
    return sp.diags(1.0 / np.where(total > 0, total, 1.0)) @ matrix
