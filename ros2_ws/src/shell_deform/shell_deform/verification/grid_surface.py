# SPDX-License-Identifier: Apache-2.0
"""Regular meshes of parametric test surfaces, with a ring of control points beyond every edge.

The ring belongs to the spline space, not to the surface: triangles outside are inactive. So the
displacement is a full quadratic-complete spline up to the edge, free of the natural conditions
that reflected boundary rules would impose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from numpy.typing import NDArray

from shell_deform.surface.control_mesh import ControlMesh, control_mesh, moved
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import quadrature_basis

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Surface = Callable[[Array, Array], Array]
Spacing = Callable[[Array], Array]


@dataclass(frozen=True)
class GridSurface:
    """A patch s, t in [0, 1]^2 on a grid of `cells` (along s, along t).

    Attributes:
        mesh: control mesh, the outer ring included.
        number: (ns + 3, nt + 3) vertex number of grid point (i - 1, j - 1).
    """

    mesh: ControlMesh
    number: Index

    def edge(self, side: str) -> Index:
        """Vertices of the side 's0', 's1', 't0' or 't1', corners included."""
        inside = self.number[1:-1, 1:-1]
        return {
            's0': inside[0, :],
            's1': inside[-1, :],
            't0': inside[:, 0],
            't1': inside[:, -1],
        }[side].copy()

    def corner(self, s: int, t: int) -> int:
        """Vertex at s, t of 0 or 1."""
        inside = self.number[1:-1, 1:-1]
        return int(inside[-s, -t])


def even(x: Array) -> Array:
    """Equal cells."""
    return x


def fine_at_start(x: Array) -> Array:
    """Cells that are half as wide at 0 as on average."""
    return x - 0.5 * x * (1.0 - x)


def fine_at_end(x: Array) -> Array:
    """Cells that are half as wide at 1 as on average."""
    return x + 0.5 * x * (1.0 - x)


def fine_at_both(x: Array) -> Array:
    """Cells that are half as wide at 0 and 1 as on average."""
    return x - 0.5 * np.sin(2.0 * np.pi * x) / (2.0 * np.pi)


def grid_surface(
    surface: Surface,
    cells: tuple[int, int],
    along_s: Spacing = even,
    along_t: Spacing = even,
) -> GridSurface:
    """Control mesh whose limit surface is `surface(s, t) -> (p, 3)` in the least-squares sense.

    `along_s` and `along_t` place the grid lines: smooth, from 0 to 1, defined a little beyond.
    """
    ns, nt = cells
    i, j = np.meshgrid(np.arange(-1, ns + 2), np.arange(-1, nt + 2), indexing='ij')
    number = np.arange(i.size).reshape(i.shape)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    cell_i, cell_j = i[:-1, :-1].ravel(), j[:-1, :-1].ravel()
    inside = (cell_i >= 0) & (cell_i < ns) & (cell_j >= 0) & (cell_j < nt)
    s, t = along_s(i.ravel() / ns), along_t(j.ravel() / nt)
    start = surface(s, t)
    mesh = control_mesh(start, triangles, corners=[], active=np.tile(inside, 2))
    return GridSurface(fitted(mesh, s, t, surface), number)


def closed_tube(radius: float, length: float, cells: tuple[int, int]) -> GridSurface:
    """A closed cylinder about y from y = 0, `cells` around (from z on) and along, no seam.

    Grid columns -1 and ns + 1 are those on the other side of column 0, which is column ns too.
    """
    around, along = cells
    i, j = np.meshgrid(np.arange(around), np.arange(-1, along + 2), indexing='ij')
    number = np.arange(i.size).reshape(i.shape)
    other = np.roll(number, -1, axis=0)
    a, b = number[:, :-1].ravel(), other[:, :-1].ravel()
    c, d = other[:, 1:].ravel(), number[:, 1:].ravel()
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    cell = j[:, :-1].ravel()
    inside = np.tile((cell >= 0) & (cell < along), 2)
    angle, along_y = 2.0 * np.pi * i.ravel() / around, length * j.ravel() / along
    ring = np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=1)
    line = np.stack([0.0 * angle, along_y, 0.0 * angle], axis=1)
    mesh = control_mesh(ring + line, triangles, corners=[], active=inside)
    # A regular ring of control points has a limit that is as regular, and smaller.
    first = LimitSurface(mesh).limit_positions(mesh.vertices)[number[0, 1]]
    size = radius / np.hypot(first[0], first[2])
    wrapped = number[np.arange(-1, around + 2) % around]
    return GridSurface(moved(mesh, size * ring + line), wrapped)


def fitted(mesh: ControlMesh, s: Array, t: Array, surface: Surface) -> ControlMesh:
    """`mesh` moved so that its limit surface follows `surface` at the integration points.

    s, t (n,) are the surface parameters of the vertices, linear in every triangle.
    """
    basis = quadrature_basis(mesh, 12)
    corners = mesh.triangles[basis.triangle[basis.element]]
    u, v = basis.parameters.T
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    target = surface(
        np.einsum('pk,pk->p', weights, s[corners]), np.einsum('pk,pk->p', weights, t[corners])
    )
    nodes = np.concatenate(
        [basis.nodes[basis.node_offsets[e] : basis.node_offsets[e + 1]] for e in basis.element]
    )
    size = (len(u), len(mesh.vertices))
    matrix = sp.csr_matrix((basis.values, nodes, basis.row_offsets), shape=size)
    normal = (matrix.T @ matrix + 1e-10 * sp.identity(size[1])).tocsc()
    right = matrix.T @ (target - matrix @ mesh.vertices)
    return moved(mesh, mesh.vertices + sla.splu(normal).solve(right))
