# SPDX-License-Identifier: Apache-2.0
"""What holds a shell: stiff springs at boundary points, and rigid motions that nothing prevents.

A support acts on the limit position and on the slope across the edge at the vertices of an edge,
by springs far stiffer than the wall: sparse, inside the pattern of the shell, exact to the ratio
of the stiffnesses, and valid at any deformation since each condition is linear in the
displacement.

Conditions are collocated at the vertices, which is not the whole edge. Along a line of the mesh
the position of the quartic box spline has two sequences of coefficients (the control points on the
line, and the sums of those beside it), the slope across it one more: between vertices a held edge
moves by 1e-3 of a dent beside it at 16 cells, 7e-5 at 64. So an edge is a little soft, at first
order in the cells, and what converges from below on a whole surface does so from above on a part
with edges of symmetry: the hinged roof under its force, linear, 7.468, 7.476, 7.479, 7.480 mm as a
whole on 8, 12, 16, 24 cells to a quarter, but 7.568, 7.535, 7.518, 7.502 mm as that quarter; the
pinched cylinder -9.6, -3.7, -1.1 % of its limit as a whole on 12, 16, 24, but +0.6, +0.5, +0.4 %
as an octant on 32, 48, 64 (`test_verification`). Holding more locks instead: with slopes in the
middles of the edges, too, the octant is 3.5, 1.4, 0.7 % stiff. Where per milles count, take the
whole.

A thick wall has a director, too. A clamp holds where that points, slope and transverse shear
together: with the slope alone the wall would turn in it as in a hinge, by shearing there, and
without any shear it would be too stiff by a layer of one triangle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.assemble.shear_nodes import shear_frames
from shell_deform.assemble.thick import ThickShell
from shell_deform.surface.loop_basis import basis_rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Spring stiffness over wall stiffness: large against the wall, small against 1 / round-off.
STIFFNESS_RATIO = 1e4


class SupportError(ValueError):
    """A support that this surface cannot have."""


class Places(NamedTuple):
    """Places of a surface: the triangle (q,) of each and its parameters (q, 2) there."""

    triangle: Index
    parameters: Array


@dataclass(frozen=True)
class SupportRows:
    """Linear conditions on the displacement: each row is kept near zero by its spring.

    What holds them may itself float: f common motions of all rows cost nothing, and the springs
    feel what is left of a motion without them.

    Attributes:
        offsets: (k + 1,) rows k use entries offsets[k]:offsets[k + 1].
        nodes: control points of the entries; n + v is the shear of vertex v of a thick wall, in
            the rows of a `ThickShell` only once `on` has found it. coefficients: (e, 3) what
            multiplies their motion.
        stiffness: (k,) spring constants [N/m] (rows are scaled to metres).
        floating: (k, f) how the rows move in each free motion, orthonormal under the stiffness;
            None where nothing floats.
    """

    offsets: Index
    nodes: Index
    coefficients: Array
    stiffness: Array
    floating: Array | None = None

    @cached_property
    def _row(self) -> Index:
        """The row of every entry."""
        return np.repeat(np.arange(len(self.stiffness)), np.diff(self.offsets))

    @property
    def floats(self) -> Array:
        """(k, f) `floating`, of no columns where nothing floats."""
        return np.zeros((len(self.stiffness), 0)) if self.floating is None else self.floating

    def on(self, shell: Discretisation) -> SupportRows:
        """The conditions in the unknowns of `shell`; shear that it has not, it has not to hold."""
        n = len(shell.mesh.vertices)
        row = np.concatenate([np.arange(n), np.full(n, -1)])
        if isinstance(shell, ThickShell):
            row[n + shell.sheared] = n + np.arange(len(shell.sheared))
        nodes = row[self.nodes]
        there = nodes >= 0
        offsets = np.concatenate([[0], np.cumsum(there)])[self.offsets]
        return SupportRows(
            offsets.astype(np.int64), nodes[there], self.coefficients[there], self.stiffness,
            self.floating,
        )  # fmt: skip

    def dense(self, size: int) -> Array:
        """The rows, without what floats, as columns of a dense (3 size, k) matrix."""
        rows = np.zeros((size, len(self.stiffness), 3))
        np.add.at(rows, (self.nodes, self._row), self.coefficients)
        columns = np.swapaxes(rows, 1, 2).reshape(3 * size, -1)
        if self.floating is None:
            return columns
        return columns - columns @ (self.stiffness[:, None] * self.floating) @ self.floating.T

    def motion(self, displacement: Array) -> Array:
        """(k,) the rows of control displacements (n, 3) [m]."""
        products = np.einsum('ei,ei->e', self.coefficients, displacement[self.nodes])
        motion = np.zeros(len(self.stiffness))
        np.add.at(motion, self._row, products)
        return motion

    def stretch(self, displacement: Array, target: Array | None = None) -> Array:
        """(k,) what each condition lacks [m] for control displacements (n, 3).

        `target` (k,) is where the conditions are moved to; None keeps them at zero. What floats
        follows.
        """
        stretch = self.motion(displacement)
        if target is not None:
            stretch -= target
        if self.floating is not None:
            stretch -= self.floating @ (self.floating.T @ (self.stiffness * stretch))
        return stretch

    def force(self, displacement: Array, target: Array | None = None) -> Array:
        """(n, 3) gradient of the spring energy [N] at control displacements (n, 3)."""
        pull = self.stiffness * self.stretch(displacement, target)
        return self.nodal(pull, len(displacement))

    def nodal(self, pull: Array, size: int) -> Array:
        """(size, 3) nodal forces [N] of forces (k,) along the rows."""
        result = np.zeros((size, 3))
        np.add.at(result, self.nodes, pull[self._row, None] * self.coefficients)
        return result

    def floated(self, size: int) -> Array:
        """(3 size, f) what the floating motions take off the springs' stiffness: minus V V^T."""
        result = np.zeros((3 * size, self.floats.shape[1]))
        for number, column in enumerate(self.floats.T):
            result[:, number] = self.nodal(self.stiffness * column, size).reshape(-1)
        return result

    def energy(self, displacement: Array, target: Array | None = None) -> float:
        """Spring energy [J]."""
        return float(0.5 * self.stiffness @ self.stretch(displacement, target) ** 2)

    def stiffness_values(self, shell: Discretisation) -> Array:
        """Their stiffness as values of the shell's sparsity pattern."""
        pattern = shell.pattern
        values = np.zeros(len(pattern.indices))
        for k, spring in enumerate(self.stiffness):
            entries = slice(self.offsets[k], self.offsets[k + 1])
            dofs = (3 * self.nodes[entries, None] + np.arange(3)).ravel()
            row = self.coefficients[entries].ravel()
            used = row != 0.0
            dofs, row = dofs[used], row[used]
            for dof, left in zip(dofs, row, strict=True):
                start, end = pattern.indptr[dof], pattern.indptr[dof + 1]
                at = start + np.searchsorted(pattern.indices[start:end], dofs)
                values[at] += spring * left * row
        return values


def joined(parts: list[SupportRows]) -> SupportRows | None:
    """All conditions together; None when there are none."""
    if not parts:
        return None
    counts = np.concatenate([np.diff(part.offsets) for part in parts])
    floating = any(part.floating is not None for part in parts)
    return SupportRows(
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        np.concatenate([part.nodes for part in parts]),
        np.concatenate([part.coefficients for part in parts]),
        np.concatenate([part.stiffness for part in parts]),
        scipy.linalg.block_diag(*(part.floats for part in parts)) if floating else None,
    )


def hold_position(shell: Discretisation, vertices: Index, directions: Array) -> SupportRows:
    """Keep the limit positions of `vertices` in place along `directions` (d, 3)."""
    return _springs(shell, _at_vertices(shell, vertices), directions, None)


def hold_slope(
    shell: Discretisation, vertices: Index, across: Array, directions: Array
) -> SupportRows:
    """Keep the change of position across an edge at its vertices, along `directions` (d, 3).

    `across` (v, 3) is the direction in the surface across the edge at each vertex: with
    all three directions the edge is clamped, with those in a plane of symmetry it is symmetric.
    """
    return _springs(shell, _at_vertices(shell, vertices), directions, across)


def hold_director(shell: ThickShell, vertices: Index, across: Array) -> SupportRows:
    """Keep change of position and director across an edge: what a clamp holds of a thick wall.

    The director turns with the slope and with the shear along `across` (v, 3); a clamped one may
    shear if it slopes by as much the other way. Exact to the square of the shear.
    """
    directions = np.eye(3)
    places, across = _with_middles(shell, vertices, across)
    normals = shell.surface.evaluate(shell.mesh.vertices, *places).normal
    slope = _springs(shell, places, directions, across)
    return _merged(slope, _shear_springs(shell, places, across, -normals))


def hold_shear(shell: Discretisation, vertices: Index, along: Array) -> SupportRows:
    """Keep the director from shearing along `along` (v, 3), in the surface, at vertices.

    As where a rigid plate is glued across the edge of a thick wall; a thin one has no shear.
    """
    if not isinstance(shell, ThickShell):
        none = np.zeros(0, dtype=np.int64)
        return SupportRows(np.zeros(1, dtype=np.int64), none, np.zeros((0, 3)), np.zeros(0))
    places, along = _with_middles(shell, vertices, along)
    return _shear_springs(shell, places, along, np.ones((len(along), 1)))


def clamp(shell: Discretisation, vertices: Index, across: Array) -> list[SupportRows]:
    """Conditions of a clamped edge; `across` (3,) or (v, 3) points from it into the surface."""
    everything = np.eye(3)
    directions = np.array(np.broadcast_to(across, (len(vertices), 3)), dtype=float)
    held = hold_position(shell, vertices, everything)
    if not isinstance(shell, ThickShell):
        return [held, hold_slope(shell, vertices, directions, everything)]
    normals = shell.surface.vertex_normals(shell.mesh.vertices)[vertices]
    return [
        held,
        hold_director(shell, vertices, directions),
        hold_shear(shell, vertices, np.cross(normals, directions)),
    ]


def symmetry(shell: Discretisation, vertices: Index, normal: Array) -> list[SupportRows]:
    """Conditions of a plane of symmetry with unit `normal` (3,), crossed at a right angle."""
    in_plane = np.linalg.svd(np.asarray(normal, dtype=float)[None])[2][1:]
    across = np.tile(normal, (len(vertices), 1))
    return [
        hold_position(shell, vertices, np.asarray(normal, dtype=float)[None]),
        hold_slope(shell, vertices, across, in_plane),
        hold_shear(shell, vertices, across),
    ]


def _at_vertices(shell: Discretisation, vertices: Index) -> Places:
    return Places(*vertex_parameters(shell.mesh.triangles, shell.mesh.active, vertices))


def _with_middles(shell: ThickShell, vertices: Index, across: Array) -> tuple[Places, Array]:
    """Where a director is held, and `across` (q, 3) there.

    A wall that shears all along an edge could turn between the vertices: its edges are held in
    their middles, too. Slopes alone would lock there, see the module docstring.
    """
    mesh = shell.mesh
    places = _at_vertices(shell, vertices)
    directions = np.array(np.broadcast_to(across, (len(vertices), 3)), dtype=float)
    if not shell.everywhere:
        return places, directions
    number = np.full(len(mesh.vertices), -1, dtype=np.int64)
    number[vertices] = np.arange(len(vertices))
    used = np.flatnonzero(mesh.active)
    corners = np.stack([mesh.triangles[used], np.roll(mesh.triangles[used], -1, axis=1)], axis=2)
    sides = np.sort(corners.reshape(-1, 2), axis=1)
    _, of, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    ends = number[sides]
    at = np.flatnonzero((count[of.reshape(-1)] == 1) & np.all(ends >= 0, axis=1))
    middles = np.array([[0.5, 0.0], [0.5, 0.5], [0.0, 0.5]])[at % 3]
    between = directions[ends[at]].sum(axis=1)
    between /= np.linalg.norm(between, axis=1)[:, None]
    return (
        Places(
            np.concatenate([places.triangle, used[at // 3]]),
            np.concatenate([places.parameters, middles]),
        ),
        np.concatenate([directions, between]),
    )


def _merged(one: SupportRows, other: SupportRows) -> SupportRows:
    """Conditions that are sums: row k of both together, with the springs of `one`."""
    row = np.concatenate([np.repeat(np.arange(len(p.stiffness)), np.diff(p.offsets))
                          for p in (one, other)])  # fmt: skip
    order = np.argsort(row, kind='stable')
    return SupportRows(
        one.offsets + other.offsets,
        np.concatenate([one.nodes, other.nodes])[order],
        np.concatenate([one.coefficients, other.coefficients])[order],
        one.stiffness,
    )


def _shear_springs(shell: ThickShell, places: Places, along: Array, share: Array) -> SupportRows:
    """Shear along `along` (v, 3) at each place times `share` (v, d): d conditions a place."""
    mesh, n = shell.mesh, len(shell.mesh.vertices)
    rows = basis_rows(mesh, *places)
    counts = np.diff(rows.node_offsets)
    of = np.repeat(np.arange(len(counts)), counts)
    scale = _edge_length(shell) / float(shell.wall.mean()) * rows.values
    unit = np.zeros((len(of), 3))
    for i, frame in enumerate(shear_frames(shell.surface, rows.nodes.astype(np.int64))):
        unit[:, i] = scale * np.einsum('ei,ei->e', frame, along[of])
    count = share.shape[1]
    order = np.argsort(np.tile(of, count) * count + np.repeat(np.arange(count), len(of)),
                       kind='stable')  # fmt: skip
    coefficients = (share[of].T[:, :, None] * unit[None]).reshape(-1, 3)[order]
    return SupportRows(
        offsets=np.concatenate([[0], np.cumsum(np.repeat(counts, count))]).astype(np.int64),
        nodes=n + np.tile(rows.nodes.astype(np.int64), count)[order],
        coefficients=coefficients,
        stiffness=np.full(len(counts) * count, _spring_constant(shell)),
    )


def _edge_length(shell: Discretisation) -> float:
    """What makes a length [m] of a slope: the edge of a triangle, on average."""
    return float(np.sqrt(shell.area / max(1, int(shell.mesh.active.sum()))))


def _spring_constant(shell: Discretisation) -> float:
    return STIFFNESS_RATIO * float(shell.membrane[:, 0, 0].max())


def _springs(
    shell: Discretisation, places: Places, directions: Array, across: Array | None
) -> SupportRows:
    mesh = shell.mesh
    rows = basis_rows(mesh, *places)
    edge_length = _edge_length(shell)
    counts = np.diff(rows.node_offsets)
    of = np.repeat(np.arange(len(counts)), counts)
    weights = rows.values
    if across is not None:
        first = np.stack(
            [
                np.add.reduceat(
                    rows.first[:, i, None] * mesh.vertices[rows.nodes],
                    rows.node_offsets[:-1],
                    axis=0,
                )
                for i in range(2)
            ],
            axis=2,
        )
        # components of the direction `across` in the parameter basis, by least squares
        inverse = np.linalg.pinv(first)
        c = np.einsum('vai,vi->va', inverse, across)
        weights = edge_length * np.einsum('ea,ea->e', rows.first, c[of])
    count = len(directions)
    order = np.argsort(
        np.tile(of, count) * count + np.repeat(np.arange(count), len(of)), kind='stable'
    )
    coefficients = (weights[None, :, None] * directions[:, None, :]).reshape(-1, 3)[order]
    return SupportRows(
        offsets=np.concatenate([[0], np.cumsum(np.repeat(counts, count))]).astype(np.int64),
        nodes=np.tile(rows.nodes.astype(np.int64), count)[order],
        coefficients=coefficients,
        stiffness=np.full(len(counts) * count, _spring_constant(shell)),
    )


def vertex_parameters(
    triangles: NDArray[np.int32], active: NDArray[np.bool_], vertices: Index
) -> tuple[Index, Array]:
    """An active triangle (v,) with each vertex, and the vertex's parameters (v, 2) in it."""
    corner_of = np.full((int(triangles.max()) + 1, 2), -1, dtype=np.int64)
    for corner in (2, 1, 0):
        used = np.flatnonzero(active)
        corner_of[triangles[used, corner], 0] = used
        corner_of[triangles[used, corner], 1] = corner
    found = corner_of[vertices]
    if np.any(found[:, 0] < 0):
        lost = int(np.asarray(vertices)[found[:, 0] < 0][0])
        raise SupportError(f'vertex {lost} lies on no triangle of the surface; support another')
    return found[:, 0], np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])[found[:, 1]]


GRIP_TOLERANCE = 2e-3
"""Two held pins always leave one rigid motion, along which both follow their own axes.

Where these are not in line the curved patches resist it by some 1e-5 of what they resist others:
enough to turn an unbalanced moment into thousands of newtons of grip, which tears the patches.
"""


def rigid_modes(positions: Array) -> Array:
    """Six orthonormal infinitesimal rigid motions (3 n, 6) of control points (n, 3)."""
    centred = positions - positions.mean(axis=0)
    scale = np.sqrt(np.mean(np.einsum('ni,ni->n', centred, centred)))
    modes = np.zeros((len(positions), 3, 6))
    for i in range(3):
        modes[:, i, i] = 1.0
        modes[:, :, 3 + i] = np.cross(np.eye(3)[i], centred / scale)
    orthonormal, _ = np.linalg.qr(modes.reshape(-1, 6))
    return orthonormal


def free_rigid_modes(modes: Array, rows: Array, tolerance: float = 1e-6) -> Array:
    """Rigid motions (N, k) that the constraint `rows` (N, c) do not prevent.

    `tolerance`: motions that meet the rows less than that, against the one that does most, are
    free; `GRIP_TOLERANCE` for rows of contacts.
    """
    if rows.shape[1] == 0 or modes.shape[1] == 0:
        return modes
    scaled = rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    _, singular, right = np.linalg.svd(scaled.T @ modes)
    rank = int(np.sum(singular > tolerance * max(1.0, float(singular[0]))))
    return modes @ right[rank:].T


def isostatic_dofs(modes: Array) -> Index:
    """As many dofs as rigid modes (N, k) whose fixing prevents exactly those motions.

    Pivoted elimination: each time the dof in which the remaining modes move most.
    """
    work = modes.copy()
    chosen = []
    for _ in range(modes.shape[1]):
        size = np.einsum('nk,nk->n', work, work)
        dof = int(np.argmax(size))
        chosen.append(dof)
        direction = work[dof] / np.sqrt(size[dof])
        work = work - np.outer(work @ direction, direction)
    return np.array(chosen, dtype=np.int64)
