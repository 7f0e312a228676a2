# SPDX-License-Identifier: Apache-2.0
"""Strain energy, its gradient and its tangent stiffness over a whole Loop surface.

A `Discretisation` is the undeformed shell at its quadrature points (`shell_points.py`) with what a
deformed one answers, by compiled kernels or their numpy twins. Positions are control points (n, 3)
[m].
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble import plain
from shell_deform.assemble.shell_points import ShellPoints
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import QuadratureBasis, quadrature_basis
from shell_deform.theory import THEORIES
from shell_deform.theory.material import Material
from shell_deform.theory.reference import (
    frame_coefficients,
    frame_rows,
    reference_points,
)

if HAVE_NUMBA:
    from shell_deform.assemble import kernels

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def summed(
    part: Callable[[int], tuple[float, Array, Array]], threads: int
) -> tuple[float, Array, Array]:
    """Sums of what the parts give, in their order, each in a thread of its own."""
    if threads == 1:
        return part(0)
    with ThreadPoolExecutor(threads) as pool:
        energies, gradients, values = zip(*pool.map(part, range(threads)), strict=True)
    return sum(energies), np.sum(gradients, axis=0), np.sum(values, axis=0)


@dataclass(frozen=True)
class Discretisation(ShellPoints):
    """The undeformed shell, and energy, gradient and stiffness of any deformed one.

    Attributes:
        threads: that assemble the stiffness, each its share of the elements; plain numpy has
            one. The answer of several differs from that of one by round-off.
    """

    threads: int = 1

    @cached_property
    def surface(self) -> LimitSurface:
        """The limit surface of the control mesh."""
        return LimitSurface(self.mesh)

    def stiffened(self, factor: float) -> Discretisation:
        """The same shell with `factor` times the modulus, to which the wall is proportional."""
        return replace(self, membrane=factor * self.membrane, bending=factor * self.bending)

    @property
    def start(self) -> Array:
        """All unknowns of the undeformed shell, rows of three: here its control points [m]."""
        return self.mesh.vertices

    @property
    def places(self) -> Array:
        """(rows, 3) where the unknowns are, for orderings [m]."""
        return self.mesh.vertices

    @property
    def stiffest(self) -> float:
        """Largest wall stiffness [N/m]: what round-off of the strains is multiplied by."""
        return float(self.membrane[:, 0, 0].max())

    @property
    def idle_dofs(self) -> Index:
        """Unknowns that nothing depends on."""
        return np.zeros(0, dtype=np.int64)

    def extended_modes(self, modes: Array) -> Array:
        """Rigid motions (3 n, k) of the control points as motions of all unknowns."""
        return modes

    def continued(self, other: Discretisation, positions: Array) -> Array:
        """Unknowns of this shell at a state of `other`, another discretisation of the same one."""
        return positions

    def lost_place(self, positions: Array) -> Array | None:
        """Where (3,) [m] of the undeformed wall it has no equilibrium; None where all has."""
        return None

    def settled(self, positions: Array) -> Array:
        """The unknowns with what is found point by point brought up to date after a step."""
        return positions

    def outer_face(self, positions: Array) -> Array:
        """(n, 3) points of the outer face over the limit positions of the vertices [m]."""
        surface = self.surface
        half = 0.5 * np.asarray(self._vertex_wall)[:, None]
        return surface.limit_positions(positions) + half * surface.vertex_normals(positions)

    @property
    def _vertex_wall(self) -> Array:
        """(n,) wall thickness at the vertices, from the nearest quadrature points [m]."""
        matrix = self.value_matrix().T
        total = np.asarray(matrix.sum(axis=1)).ravel()
        return np.asarray(matrix @ self.thickness) / np.where(total > 0, total, 1.0)

    def derivatives(self, positions: Array) -> Array:
        """Derivative vectors q (p, 5, 3) of control positions (n, 3) at every point."""
        return plain.derivatives(self, positions)

    def energy(self, theory: str, positions: Array) -> float:
        """Strain energy [J] of control positions (n, 3)."""
        return self.gradient(theory, positions)[0]

    def gradient(self, theory: str, positions: Array) -> tuple[float, Array]:
        """Strain energy [J] and its gradient (n, 3) [N]."""
        if not HAVE_NUMBA:
            return plain.shell_gradient(self, theory, positions)
        positions = np.ascontiguousarray(positions)
        gradient = np.zeros_like(positions)
        code = THEORIES[theory].code
        arguments: Any = (
            code,
            *self._volume_arguments()[:5],
            *self._wall_arguments(),
            positions,
            gradient,
        )
        return kernels.shell_gradient(*arguments), gradient

    def tangent(
        self, theory: str, positions: Array, pressure: float = 0.0
    ) -> tuple[float, Array, Array]:
        """Strain energy [J], gradient (n, 3) [N] and stiffness values [N/m] of `pattern`.

        The stiffness contains that of a gas under `pressure` [Pa]: minus the pressure times the
        second derivative of the volume.
        """
        if not HAVE_NUMBA:
            return plain.shell_tangent(self, theory, positions, pressure)
        positions = np.ascontiguousarray(positions)
        elements = len(self.node_offsets) - 1
        bounds = [elements * i // self.threads for i in range(self.threads + 1)]

        def part(number: int) -> tuple[float, Array, Array]:
            return self._tangent_of(
                bounds[number], bounds[number + 1], theory, positions, pressure
            )

        return summed(part, self.threads)

    def _tangent_of(
        self, first: int, last: int, theory: str, positions: Array, pressure: float
    ) -> tuple[float, Array, Array]:
        """`tangent` of the elements from `first` up to `last` alone."""
        gradient = np.zeros_like(positions)
        data = np.zeros(len(self.pattern.indices))
        pattern = self.pattern
        arguments: Any = (
            THEORIES[theory].code,
            float(pressure),
            self.node_offsets[first : last + 1],
            self.nodes,
            self.point_offsets[first : last + 1],
            self.row_offsets,
            self.rows,
            self.values,
            *self._wall_arguments(),
            positions,
            gradient,
            pattern.block_offsets[first:],
            pattern.block_start,
            np.ascontiguousarray(pattern.indptr[:-1:3]),
            pattern.row_length,
            pattern.indices,
            data,
        )
        return kernels.shell_tangent(*arguments), gradient, data

    def volume(self, positions: Array) -> tuple[float, Array]:
        """Volume inside the middle surface [m^3] and its gradient (n, 3) [m^2].

        An open surface encloses none: zero, and the load of a unit pressure on its wall.
        """
        if not self.mesh.is_closed:
            return 0.0, plain.pressure_load(self, positions)
        if not HAVE_NUMBA:
            return plain.volume_gradient(self, positions)
        positions = np.ascontiguousarray(positions)
        gradient = np.zeros_like(positions)
        arguments: Any = (*self._volume_arguments(), positions, gradient)
        return kernels.volume_gradient(*arguments), gradient

    def _wall_arguments(self) -> Any:
        reference = self.reference
        return (
            reference.tangents,
            reference.second,
            reference.curvature,
            self.weights,
            self.membrane,
            self.bending,
        )

    def _volume_arguments(self) -> Any:
        return (
            self.node_offsets,
            self.nodes,
            self.point_offsets,
            self.row_offsets,
            self.rows,
            self.values,
            self.weights,
        )


def discretise(
    mesh: ControlMesh,
    material: Material,
    thickness: float | Array,
    basis: QuadratureBasis | None = None,
) -> Discretisation:
    """Discretise the limit surface of `mesh` as a wall of `thickness` [m].

    `thickness` is one number or one per control vertex (n,). `basis` defaults to three points per
    triangle, with the irregular ones refined.
    """
    basis = basis if basis is not None else quadrature_basis(mesh, 3, refine_irregular=2)
    element = np.asarray(basis.element, dtype=np.int64)
    if np.any(np.diff(element) < 0):
        raise ValueError('quadrature points must be sorted by element')
    rows_of = np.diff(basis.row_offsets)
    values, first, second = basis.values, basis.first, basis.second
    row_offsets = np.asarray(basis.row_offsets, dtype=np.int64)
    nodes = np.asarray(basis.nodes, dtype=np.int64)
    node_offsets = np.asarray(basis.node_offsets, dtype=np.int64)
    global_nodes = np.concatenate([nodes[node_offsets[e] : node_offsets[e + 1]] for e in element])
    point_of_row = np.repeat(np.arange(len(element)), rows_of)
    size = (len(element), len(mesh.vertices))

    def surface(row_values: Array) -> Array:
        matrix = sp.csr_matrix((row_values, global_nodes, row_offsets), shape=size)
        return np.asarray(matrix @ mesh.vertices)

    parameter_first = np.stack([surface(first[:, i]) for i in range(2)], axis=2)
    coefficients = frame_coefficients(parameter_first)
    rows = frame_rows(first, second, coefficients[point_of_row])
    q = np.stack([surface(rows[:, i]) for i in range(5)], axis=1)
    area = np.linalg.norm(np.cross(parameter_first[..., 0], parameter_first[..., 1]), axis=1)
    wall = np.broadcast_to(np.asarray(thickness, dtype=float), (len(mesh.vertices),))
    h = np.asarray(sp.csr_matrix((values, global_nodes, row_offsets), shape=size) @ wall)
    law = material.plane_stress
    return Discretisation(
        mesh=mesh,
        node_offsets=node_offsets,
        nodes=nodes,
        point_offsets=np.searchsorted(element, np.arange(len(node_offsets))).astype(np.int64),
        row_offsets=row_offsets,
        values=np.ascontiguousarray(values),
        rows=rows,
        reference=reference_points(q, area),
        weights=basis.weight * area,
        thickness=h,
        membrane=h[:, None, None] * law,
        bending=h[:, None, None] ** 3 / 12.0 * law,
    )
