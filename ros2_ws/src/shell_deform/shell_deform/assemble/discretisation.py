# SPDX-License-Identifier: Apache-2.0
"""Strain energy, its gradient and its tangent stiffness over a whole Loop surface.

A `Discretisation` is the undeformed shell at its quadrature points (`shell_points.py`) with what a
deformed one answers, by compiled kernels or their numpy twins. Positions are control points (n, 3)
[m].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble import plain
from shell_deform.assemble.pin_pressures import PressureEquations
from shell_deform.assemble.shell_points import ShellPoints
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.compiled.halves import in_halves
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


NO_VALUES = np.zeros(0)
Sums = tuple[float, Array, Array]
"""Energy, gradient, stiffness values."""


@dataclass(frozen=True)
class Discretisation(ShellPoints):
    """The undeformed shell, and energy, gradient and stiffness of any deformed one."""

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

    def pressure_equations(self, positions: Array) -> PressureEquations | None:
        """Equations of unknowns that the stiffness has eliminated; None where there are none."""
        return None

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

        def part(first: int, last: int) -> Sums:
            gradient = np.zeros_like(positions)
            arguments: Any = (
                THEORIES[theory].code,
                *self.surface_elements(first, last),
                self.rows,
                *self._wall_arguments(),
                positions,
                gradient,
            )
            return kernels.shell_gradient(*arguments), gradient, NO_VALUES

        return self.summed(part)[:2]

    def point_energies(self, theory: str, positions: Array) -> Array:
        """(p,) strain energy [J] of the area of every quadrature point."""
        if not HAVE_NUMBA:
            return plain.point_energies(self, theory, positions)
        positions, energies = np.ascontiguousarray(positions), np.zeros(len(self.weights))

        def part(first: int, last: int) -> None:
            arguments: Any = (
                THEORIES[theory].code,
                *self.surface_elements(first, last),
                self.rows,
                *self._wall_arguments(),
                positions,
                energies,
            )
            kernels.point_energies(*arguments)

        in_halves(part, self._middle_element, len(self.node_offsets) - 1)
        return energies

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
        pattern = self.pattern

        def part(first: int, last: int) -> Sums:
            gradient, data = np.zeros_like(positions), np.zeros(len(pattern.indices))
            arguments: Any = (
                THEORIES[theory].code,
                float(pressure),
                *self.surface_elements(first, last),
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

        return self.summed(part)

    def summed(self, part: Callable[[int, int], Sums]) -> Sums:
        """Sums over all elements of what `part` gives from a first up to a last one.

        Two halves of the points at the same time, on any machine: sums keep their order.
        """
        one, other = in_halves(part, self._middle_element, len(self.node_offsets) - 1)
        for mine, more in zip(one[1:], other[1:], strict=True):
            mine += more
        return one[0] + other[0], one[1], one[2]

    @cached_property
    def _middle_element(self) -> int:
        """Elements before this one have half of the points: those under a pin have many."""
        return int(np.searchsorted(self.point_offsets, self.point_offsets[-1] // 2))

    def volume(self, positions: Array) -> tuple[float, Array]:
        """Volume inside the middle surface [m^3] and its gradient (n, 3) [m^2].

        An open surface encloses none: zero, and the load of a unit pressure on its wall. Unknowns
        beside the control points, of a thick wall, take no part.
        """
        if not self.mesh.is_closed:
            load = np.zeros_like(positions)
            count = len(self.mesh.vertices)
            load[:count] = plain.pressure_load(self, positions[:count])
            return 0.0, load
        if not HAVE_NUMBA:
            return plain.volume_gradient(self, positions)
        positions = np.ascontiguousarray(positions)

        def part(first: int, last: int) -> Sums:
            gradient = np.zeros_like(positions)
            arguments: Any = (
                *self.surface_elements(first, last),
                self.rows,
                self.values,
                self.weights,
                positions,
                gradient,
            )
            return kernels.volume_gradient(*arguments), gradient, NO_VALUES

        return self.summed(part)[:2]

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

    def surface_elements(self, first: int, last: int) -> Any:
        """Elements from `first` up to `last` as the kernels take them."""
        return (
            self.node_offsets[first : last + 1],
            self.nodes,
            self.point_offsets[first : last + 1],
            self.row_offsets,
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
