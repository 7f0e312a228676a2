# SPDX-License-Identifier: Apache-2.0
"""The outer face of a thick wall over the vertices of its middle surface, x(h/2)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.assemble.shear_nodes import shear_frames
from shell_deform.surface.loop_basis import QuadratureBasis

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class ThickOuterFace:
    """The outer face of one shell at any of its states; what the rest shape says is found once."""

    def __init__(
        self, shell: Discretisation, basis: QuadratureBasis, wall: Array, sheared: Index
    ) -> None:
        """`basis`: quadrature. `wall` (n,) thickness [m]. `sheared` (m,) vertices with shear."""
        self._shell, self._wall, self._sheared = shell, wall, sheared
        self._to_vertices = _means_at_vertices(shell, basis)
        # Vertices beyond an edge: no point of the surface is theirs.
        self._beyond = np.diff(self._to_vertices.indptr) == 0
        self._frames = shear_frames(shell.surface, sheared)
        tangents = np.stack(shell.surface.vertex_tangents(shell.mesh.vertices), axis=2)
        self._to_components = np.linalg.pinv(tangents)

    def at(self, positions: Array, heights: Array) -> Array:
        """(n, 3) points of the face over the limit positions of the vertices [m].

        `positions`: all unknowns. `heights` (p,) of the face over the quadrature points [m].
        """
        shell = self._shell
        controls = positions[: len(shell.mesh.vertices)]
        place = shell.surface.limit_positions(controls)
        director = shell.surface.vertex_normals(controls) + self._pushed_shear(positions)
        director /= np.linalg.norm(director, axis=1)[:, None]
        tops = np.where(self._beyond, 0.5 * self._wall, self._to_vertices @ heights)
        return place + tops[:, None] * director

    def _pushed_shear(self, positions: Array) -> Array:
        """(n, 3) shear of the director at the vertices, in the deformed tangent planes."""
        surface, n = self._shell.surface, len(self._shell.mesh.vertices)
        first_frame, second_frame = self._frames
        w = positions[n : n + len(self._sheared)] / float(self._wall.mean())
        field = np.zeros((n, 3))
        field[self._sheared] = w[:, :1] * first_frame + w[:, 1:2] * second_frame
        components = np.einsum('nai,ni->na', self._to_components, surface.limit_positions(field))
        moved_first, moved_second = surface.vertex_tangents(positions[:n])
        return components[:, :1] * moved_first + components[:, 1:] * moved_second


def _means_at_vertices(shell: Discretisation, basis: QuadratureBasis) -> sp.csr_matrix:
    """(n, p) means over the points of a vertex's triangles, by area and nearness."""
    corners = shell.mesh.triangles[basis.triangle[basis.element]]
    u, v = basis.parameters.T
    share = np.stack([1.0 - u - v, u, v], axis=1) * shell.weights[:, None]
    p = np.repeat(np.arange(len(shell.weights)), 3)
    shape = (len(shell.mesh.vertices), len(shell.weights))
    matrix = sp.csr_matrix((share.ravel(), (corners.ravel(), p)), shape=shape)
    total = np.asarray(matrix.sum(axis=1)).ravel()
    return sp.diags(1.0 / np.where(total > 0, total, 1.0)) @ matrix
