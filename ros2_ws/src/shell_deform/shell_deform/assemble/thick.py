# SPDX-License-Identifier: Apache-2.0
"""A shell whose wall shears and changes its thickness, and the pins that press on its outer face.

A `ThickShell` is a `Discretisation` with more unknowns than control points. All of them are rows
of three numbers, in this order: the control points [m]; shear nodes, which give control vertices
near the contacts (or everywhere) two components of transverse shear in their tangent plane, times
the wall thickness [m]; pins, each a rigid stamp on the outer face with its travel into the object
and two tilts times its radius [m]; and the contact pressures under the pins, three to a row,
divided by E / h [m]. A pressure is the same over the part of an element that the pin covers: one
at every quadrature point would ask more of the surface than its control points can give, and
oscillate. `settled` brings them up to date after every step; no equation of the stiffness contains
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation, discretise
from shell_deform.assemble.shell_points import StiffnessPattern, stiffness_pattern
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.limit import LimitSurface
from shell_deform.surface.loop_basis import QuadratureBasis, quadrature_basis
from shell_deform.theory.material import Material

if HAVE_NUMBA:
    from shell_deform.assemble import thick_kernels

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOST_INCOMPRESSIBLE = 0.4999
"""Largest Poisson's ratio: J = 1 at two heights has no solution in some states of a bent wall."""

SHEAR_REACH = 2.0
"""Shear unknowns within so many sqrt(R h) of a pin: at 12 mm (1.4) on a ball of R/h 12.5 a dent of
four walls is 4 % too stiff, from 1.7 on within 1 % of shear everywhere."""

POINTS_ACROSS = 1
"""Triangles under a pin are split until so many of their parts span its radius."""

MOST_SPLITS = 5

EXTRA_COMPLIANCE = 1e-2
"""Compliance of a pin's face over that of the wall, h / E. A nearly incompressible wall cannot be
squeezed in this theory, where a solid still gives way around the pin: its pressures would be as
stiff as its bulk modulus, and Newton's method find them only in the smallest steps. It moves a pin
by this share of h P / E: force and travel of the mission's ball by 0.7 % at 0.25 mm, 0.3 % from
3.6 mm on."""


class WallError(ValueError):
    """A wall for which the thick theory has no meaning."""


@dataclass(frozen=True)
class Stamp:
    """A rigid pin on the outer face: what lies under it moves alike along its axis, and slides.

    Attributes:
        centre: (3,) on the undeformed middle surface [m]. axis: (3,) unit direction of the push,
            into the object. radius: of the pressed patch, along the outer face [m].
    """

    centre: Array
    axis: Array
    radius: float

    def like(self, other: Stamp) -> bool:
        """Whether both are the same pin."""
        return (
            self.radius == other.radius
            and np.array_equal(self.centre, other.centre)
            and np.array_equal(self.axis, other.axis)
        )


@dataclass(frozen=True)
class StampPoints:
    """Quadrature points under the stamps, g of them.

    Attributes:
        point: (g,) number of each. stamp: (g,) the stamp it lies under. cell: (g,) the pressure
            that acts on it, one an element. axis: (g, 3) out of the wall. height: (g,) of the
            undeformed outer face along it [m]. arm: (g, 2) offset from the stamp's centre along
            its two lateral vectors, over its radius.
    """

    point: Index
    stamp: Index
    cell: Index
    axis: Array
    height: Array
    arm: Array


@dataclass(frozen=True)
class ThickShell(Discretisation):
    """See the module docstring; n control points, m shear nodes, k stamps, g pressed points.

    Attributes:
        material: of the wall. basis: quadrature, split under the stamps. wall: (n,) thickness.
        stamps: the pins. sheared: (m,) control vertices with shear. pressed: what the pins touch.
        element_offsets, element_nodes: all unknowns of each element. shear_counts: (e,) of them.
        shear_offsets: (p + 1,) first shear row of each point. shear_rows: (., 12) shear and its
            derivatives (6) per component (2) of each shear node.
    """

    material: Material = None  # type: ignore[assignment]
    basis: QuadratureBasis = None  # type: ignore[assignment]
    wall: Array = None  # type: ignore[assignment]
    stamps: tuple[Stamp, ...] = ()
    sheared: Index = None  # type: ignore[assignment]
    pressed: StampPoints = None  # type: ignore[assignment]
    element_offsets: Index = None  # type: ignore[assignment]
    element_nodes: Index = None  # type: ignore[assignment]
    shear_counts: Index = None  # type: ignore[assignment]
    shear_offsets: Index = None  # type: ignore[assignment]
    shear_rows: Array = None  # type: ignore[assignment]
    everywhere: bool = False

    def stiffened(self, factor: float) -> ThickShell:
        """The same shell with `factor` times the modulus; pressures are unknowns over E / h."""
        return replace(
            self,
            membrane=factor * self.membrane,
            bending=factor * self.bending,
            material=replace(self.material, young_modulus=factor * self.material.young_modulus),
        )

    def with_stamps(self, stamps: Sequence[Stamp]) -> ThickShell:
        """The same wall under other pins."""
        same = len(stamps) == len(self.stamps) and all(
            a.like(b) for a, b in zip(stamps, self.stamps, strict=True)
        )
        if same:
            return self
        return thick_shell(
            self.mesh, self.material, self.wall, stamps, self.everywhere, self.threads
        )

    # ---- unknowns

    @cached_property
    def start(self) -> Array:
        """All unknowns of the undeformed shell: control points, then zeros."""
        more = len(self.sheared) + len(self.stamps) + -(-self._cells // 3)
        return np.concatenate([self.mesh.vertices, np.zeros((more, 3))])

    @property
    def _cells(self) -> int:
        return int(self.pressed.cell.max(initial=-1)) + 1

    @property
    def first_pin(self) -> int:
        """Row of the first pin."""
        return len(self.mesh.vertices) + len(self.sheared)

    @property
    def stiffest(self) -> float:
        """Largest stiffness [N/m]: of the wall against a change of volume, or under a pin."""
        shear, bulk = self._arguments[3][:2]
        squeezed = max((stamp.radius**2 for stamp in self.stamps), default=0.0)
        reach = max(float(self.thickness.max()), squeezed / float(self.thickness.min()))
        return float((bulk + 4.0 / 3.0 * shear) * reach)

    @cached_property
    def idle_dofs(self) -> Index:
        """Numbers that nothing depends on: the third component of every shear node."""
        return 3 * (len(self.mesh.vertices) + np.arange(len(self.sheared))) + 2

    @cached_property
    def places(self) -> Array:
        """(rows, 3) where the unknowns are, for orderings [m]."""
        centres = np.array([stamp.centre for stamp in self.stamps]).reshape(-1, 3)
        result = np.zeros_like(self.start)
        n, pin = len(self.mesh.vertices), self.first_pin
        result[:n] = self.mesh.vertices
        result[n:pin] = self.mesh.vertices[self.sheared]
        result[pin : pin + len(centres)] = centres
        if self._cells:
            owner = np.zeros(3 * (len(result) - pin - len(centres)), dtype=np.int64)
            owner[self.pressed.cell] = self.pressed.stamp
            result[pin + len(centres) :] = centres[owner[::3]]
        return result

    def extended_modes(self, modes: Array) -> Array:
        """Rigid motions (3 n, k) of the control points with what the pins then do, orthonormal."""
        count = modes.shape[1]
        n = len(self.mesh.vertices)
        result = np.zeros((*self.start.shape, count))
        result[:n] = modes.reshape(n, 3, count)
        centre = self.mesh.vertices.mean(axis=0)
        arms = self.mesh.vertices - centre
        # A rigid motion u = t + w x (X - centre), found from its values at the control points.
        ones = np.concatenate(
            [np.tile(np.eye(3), (n, 1)), np.concatenate([-_cross_matrix(arm) for arm in arms])],
            axis=1,
        )
        motion = np.linalg.lstsq(ones, modes, rcond=None)[0]
        normals = self.stamp_normals
        for k, stamp in enumerate(self.stamps):
            outer = stamp.centre + 0.5 * self._stamp_wall[k] * normals[k] - centre
            velocity = motion[:3] + np.cross(motion[3:].T, outer).T
            result[self.first_pin + k, 0] = stamp.axis @ velocity
            for i, lateral in enumerate(_lateral(stamp.axis)):
                turn = np.cross(motion[3:].T, lateral) @ stamp.axis
                result[self.first_pin + k, 1 + i] = stamp.radius * turn
        orthonormal, _ = np.linalg.qr(result.reshape(-1, count))
        return orthonormal

    @cached_property
    def stamp_normals(self) -> Array:
        """(k, 3) outward unit normals of the undeformed surface at the stamps."""
        return _at_stamps(self)[0]

    @cached_property
    def _stamp_wall(self) -> Array:
        return _at_stamps(self)[1]

    @cached_property
    def pattern(self) -> StiffnessPattern:
        """Sparsity of the tangent stiffness of all unknowns."""
        return stiffness_pattern(self.element_offsets, self.element_nodes, len(self.start))

    # ---- the wall

    @cached_property
    def _enclosed_wall(self) -> float:
        """Volume [m^3] between the middle surface and the undeformed inner face."""
        h, (k_11, k_12, k_22) = self.thickness, self._curvature.T
        trace, determinant = k_11 + k_22, k_11 * k_22 - k_12**2
        return float(self.weights @ (0.5 * h - trace * h**2 / 8.0 + determinant * h**3 / 24.0))

    def volume(self, positions: Array) -> tuple[float, Array]:
        """Volume inside the inner face [m^3] and its gradient [m^2].

        The part of the wall inside the middle surface is taken to keep its volume.
        """
        volume, gradient = super().volume(positions)
        return volume - self._enclosed_wall, gradient

    def gradient(self, theory: str, positions: Array) -> tuple[float, Array]:
        """Strain energy [J] and its gradient by all unknowns [N]; `theory` is always thick."""
        positions = np.ascontiguousarray(positions)
        gradient = np.zeros_like(positions)
        elements = len(self.element_offsets) - 1
        energy = self._kernel(False, 0, elements, positions, 0.0, gradient, np.zeros(0))
        return energy, gradient if np.isfinite(energy) else np.full_like(gradient, np.nan)

    def tangent(
        self, theory: str, positions: Array, pressure: float = 0.0
    ) -> tuple[float, Array, Array]:
        """Strain energy [J], gradient [N] and stiffness values of `pattern`."""
        positions = np.ascontiguousarray(positions)
        elements = len(self.element_offsets) - 1
        bounds = [elements * i // self.threads for i in range(self.threads + 1)]

        def part(number: int) -> tuple[float, Array, Array]:
            gradient = np.zeros_like(positions)
            data = np.zeros(len(self.pattern.indices))
            energy = self._kernel(
                True, bounds[number], bounds[number + 1], positions, pressure, gradient, data
            )
            return energy, gradient, data

        if self.threads == 1:
            energy, gradient, data = part(0)
        else:
            with ThreadPoolExecutor(self.threads) as pool:
                energies, gradients, values = zip(
                    *pool.map(part, range(self.threads)), strict=True
                )
            energy = sum(energies)
            gradient, data = np.sum(gradients, axis=0), np.sum(values, axis=0)
        if not np.isfinite(energy):
            gradient = np.full_like(gradient, np.nan)
        return energy, gradient, data

    def continued(self, other: Discretisation, positions: Array) -> Array:
        """Unknowns under these pins at a state of the same wall under others.

        Shear stays where it is known; pins that stay keep travel and pressures; a new one lies on
        the face as that is now, without pressure.
        """
        assert isinstance(other, ThickShell)
        n = len(self.mesh.vertices)
        result = self.start.copy()
        result[:n] = positions[:n]
        _, here, there = np.intersect1d(self.sheared, other.sheared, return_indices=True)
        result[n + here] = positions[n + there]
        stays = np.full(len(self.stamps), -1)
        for k, stamp in enumerate(self.stamps):
            same = [i for i, old in enumerate(other.stamps) if stamp.like(old)]
            if same:
                stays[k] = same[0]
                result[self.first_pin + k] = positions[other.first_pin + same[0]]
        flat, old_flat = result.reshape(-1), positions.reshape(-1)
        old_cells = dict(zip(other._cell_keys, other._pressure_dofs, strict=True))
        for (element, k), dof in zip(self._cell_keys, self._pressure_dofs, strict=True):
            if stays[k] >= 0:
                flat[dof] = old_flat[old_cells.get((element, int(stays[k])), 0)]
                flat[dof] *= (element, int(stays[k])) in old_cells
        return self._laid(result, np.flatnonzero(stays < 0))

    def _laid(self, positions: Array, stamps: Index) -> Array:
        """The unknowns with `stamps` laid on the outer face as it is."""
        states = self.point_states(positions, self.pressed.point) if len(stamps) else None
        if states is None:
            return positions
        for k in stamps.tolist():
            own = self.pressed.stamp == k
            arms = np.column_stack([np.ones(int(own.sum())), self.pressed.arm[own]])
            positions[self.first_pin + k] -= np.linalg.lstsq(arms, states[own, 2], rcond=None)[0]
        return positions

    @property
    def _cell_keys(self) -> list[tuple[int, int]]:
        """(element, stamp) of the pressure on every pressed point."""
        element = np.searchsorted(self.point_offsets, self.pressed.point, side='right') - 1
        return list(zip(element.tolist(), self.pressed.stamp.tolist(), strict=True))

    def settled(self, positions: Array) -> Array:
        """The unknowns with the contact pressures of the step that was just taken."""
        if not len(self.pressed.point):
            return positions
        states = self.point_states(positions, self.pressed.point)
        if states is None:
            return positions
        compliance = self._arguments[3][3]
        height, squeeze, push = states[:, 2], states[:, 3], states[:, 4]
        cell, weight = self.pressed.cell, self.weights[self.pressed.point]
        missing = np.bincount(cell, weight * (height - compliance * push))
        soft = np.bincount(cell, weight * (squeeze + compliance))
        result = np.array(positions)
        first = 3 * (self.first_pin + len(self.stamps))
        result.reshape(-1)[first : first + self._cells] += missing / soft / self._pressure_unit
        return result

    def point_states(self, positions: Array, points: Index) -> Array | None:
        """(c, 17) of the points (c,), see `thick_kernels.point_states`; None where one fails."""
        self._refuse_others(positions)
        out = np.zeros((len(points), 17))
        element = np.searchsorted(self.point_offsets, points, side='right') - 1
        arguments: Any = (
            *self._arguments, np.ascontiguousarray(positions), np.asarray(points, np.int64),
            element.astype(np.int64), out,
        )  # fmt: skip
        return out if thick_kernels.point_states(*arguments) else None

    def _refuse_others(self, positions: Array) -> None:
        """Raise ValueError for unknowns that are not this shell's: kernels would read beyond."""
        if positions.shape != self.start.shape:
            raise ValueError(
                f'{positions.shape} unknowns for a thick shell that has {self.start.shape}'
            )

    def _kernel(
        self, stiff: bool, first: int, last: int, positions: Array, pressure: float,
        gradient: Array, data: Array,
    ) -> float:  # fmt: skip
        pattern = self.pattern
        self._refuse_others(positions)
        elements, points, stamps, material = self._arguments
        offsets, nodes, controls, shears, point_offsets, row_offsets = elements
        part = (
            offsets[first : last + 1], nodes, controls[first:last], shears[first:last],
            point_offsets[first : last + 1], row_offsets,
        )  # fmt: skip
        arguments: Any = (
            stiff, float(pressure), part, points, stamps, material, positions, gradient,
            pattern.block_offsets[first:], pattern.block_start,
            np.ascontiguousarray(pattern.indptr[:-1:3]), pattern.row_length, pattern.indices, data,
        )  # fmt: skip
        return float(thick_kernels.thick_tangent(*arguments))

    @property
    def _pressure_unit(self) -> float:
        return self.material.young_modulus / float(self.wall.mean())

    @cached_property
    def _pressure_dofs(self) -> Index:
        first = 3 * (self.first_pin + len(self.stamps))
        return first + self.pressed.cell

    @cached_property
    def _curvature(self) -> Array:
        """(p, 3) rest curvature K_ab = A_a . N,b: minus the second fundamental form."""
        return -self.reference.curvature

    @cached_property
    def _arguments(self) -> Any:
        pressed = self.pressed
        of_point = np.full(len(self.weights), -1, dtype=np.int64)
        of_point[pressed.point] = np.arange(len(pressed.point))
        e = self.material.young_modulus
        nu = min(self.material.poisson_ratio, MOST_INCOMPRESSIBLE)
        return (
            (
                self.element_offsets, self.element_nodes, np.diff(self.node_offsets),
                self.shear_counts, self.point_offsets, self.row_offsets,
            ),
            (
                self.rows, self.values, self.weights, self._curvature, self.thickness,
                self.shear_offsets, self.shear_rows,
            ),
            (of_point, pressed.axis, pressed.height, pressed.arm, self._pressure_dofs),
            (
                0.5 * e / (1.0 + nu), e / 3.0 / (1.0 - 2.0 * nu), self._pressure_unit,
                EXTRA_COMPLIANCE * float(self.wall.mean()) / e,
            ),
        )  # fmt: skip

    # ---- its faces

    def face_metric(self, states: Array, side: float) -> Array:
        """(p, 3) right Cauchy-Green components (11, 22, 12) at height `side` h / 2, all points.

        `states` (p, 17) are those of all points.
        """
        h, z = self.thickness, 0.5 * side * self.thickness
        zeta = (states[:, 0] * z + states[:, 1] * z**2 / h)[:, None]
        metric = states[:, 6:9] + 2.0 * zeta * states[:, 9:12] + zeta**2 * states[:, 12:15]
        k_11, k_12, k_22 = self._curvature.T
        shifter = np.stack([1.0 + z * k_11, z * k_12, z * k_12, 1.0 + z * k_22], axis=1)
        inverse = np.linalg.inv(shifter.reshape(-1, 2, 2))
        full = np.stack([metric[:, 0], metric[:, 2], metric[:, 2], metric[:, 1]], axis=1)
        turned = inverse @ full.reshape(-1, 2, 2) @ inverse
        return np.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], axis=1)

    def outer_face(self, positions: Array) -> Array:
        """(n, 3) points of the outer face over the limit positions of the vertices [m]."""
        surface = LimitSurface(self.mesh)
        n = len(self.mesh.vertices)
        controls = positions[:n]
        place = surface.limit_positions(controls)
        normal = surface.vertex_normals(controls)
        director = normal + self._pushed_shear(surface, positions)
        director /= np.linalg.norm(director, axis=1)[:, None]
        return place + (self._to_vertices @ self._tops(positions))[:, None] * director

    def _tops(self, positions: Array) -> Array:
        """(p,) height of the outer face over the middle surface [m]."""
        states = self.point_states(positions, np.arange(len(self.weights)))
        if states is None:
            return 0.5 * self.thickness
        return self.thickness * (0.5 * states[:, 0] + 0.25 * states[:, 1])

    def _pushed_shear(self, surface: LimitSurface, positions: Array) -> Array:
        """(n, 3) shear of the director at the vertices, in the deformed tangent planes."""
        n = len(self.mesh.vertices)
        first, second = surface.vertex_tangents(self.mesh.vertices)
        rest = np.stack([first, second], axis=2)
        field = np.zeros((n, 3))
        first_frame, second_frame = self._shear_frames
        w = positions[n : self.first_pin] / float(self.wall.mean())
        field[self.sheared] = w[:, :1] * first_frame + w[:, 1:2] * second_frame
        components = np.einsum('nai,ni->na', np.linalg.pinv(rest), surface.limit_positions(field))
        moved_first, moved_second = surface.vertex_tangents(positions[:n])
        return components[:, :1] * moved_first + components[:, 1:] * moved_second

    @cached_property
    def _shear_frames(self) -> tuple[Array, Array]:
        return shear_frames(self.mesh, self.sheared)

    @cached_property
    def _to_vertices(self) -> sp.csr_matrix:
        """(n, p) means over the points of a vertex's triangles, by area and nearness."""
        basis = self.basis
        corners = self.mesh.triangles[basis.triangle[basis.element]]
        u, v = basis.parameters.T
        share = np.stack([1.0 - u - v, u, v], axis=1) * self.weights[:, None]
        p = np.repeat(np.arange(len(self.weights)), 3)
        shape = (len(self.mesh.vertices), len(self.weights))
        matrix = sp.csr_matrix((share.ravel(), (corners.ravel(), p)), shape=shape)
        total = np.asarray(matrix.sum(axis=1)).ravel()
        return sp.diags(1.0 / np.where(total > 0, total, 1.0)) @ matrix


def thick_shell(
    mesh: ControlMesh,
    material: Material,
    thickness: float | Array,
    stamps: Sequence[Stamp] = (),
    everywhere: bool = False,
    threads: int = 1,
) -> ThickShell:
    """Discretise the limit surface of `mesh` as a thick wall of `thickness` [m] under pins.

    `thickness`: one number or one per control vertex. `everywhere`: shear at every vertex, not
    only near the pins. Raises WallError where the wall reaches its centre of curvature.
    """
    if not HAVE_NUMBA:
        raise WallError('theory thick needs numba: install it or choose theory koiter')
    n = len(mesh.vertices)
    wall = np.array(np.broadcast_to(np.asarray(thickness, dtype=float), (n,)))
    stamps = tuple(stamps)
    basis = quadrature_basis(mesh, 3, 2, _splits(mesh, stamps))
    base = discretise(mesh, material, wall, basis)
    shell = ThickShell(
        **{name: getattr(base, name) for name in base.__dataclass_fields__ if name != 'threads'},
        threads=threads, material=material, basis=basis, wall=wall, stamps=stamps,
        everywhere=everywhere,
    )  # fmt: skip
    _refuse_folded(shell)
    sheared = _sheared_vertices(shell, stamps, everywhere)
    pressed = _stamp_points(shell)
    return replace(shell, sheared=sheared, pressed=pressed, **_elements(shell, sheared, pressed))


def shear_frames(mesh: ControlMesh, vertices: Index) -> tuple[Array, Array]:
    """Two orthonormal tangent vectors (m, 3) of the undeformed surface at each vertex."""
    normal = LimitSurface(mesh).vertex_normals(mesh.vertices)[vertices]
    helper = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normal, first)


def _refuse_folded(shell: ThickShell) -> None:
    b_11, b_12, b_22 = shell.reference.curvature.T
    mean, gauss = 0.5 * (b_11 + b_22), b_11 * b_22 - b_12**2
    largest = np.abs(mean) + np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    ratio = 0.5 * shell.thickness * largest
    # Single points beside irregular vertices are sharper than the surface.
    worst = float(np.quantile(ratio, 0.95))
    if worst >= 1.0:
        point = int(np.argmax(ratio))
        place = np.asarray(shell.value_matrix() @ shell.mesh.vertices)[point]
        raise WallError(
            f'the wall of {1e3 * shell.thickness[point]:.3g} mm reaches beyond its centre of '
            f'curvature, {1e3 / largest[point]:.3g} mm away, at {np.round(1e3 * place, 2)} mm; '
            f'give a thinner wall'
        )


def _splits(mesh: ControlMesh, stamps: Sequence[Stamp]) -> Index:
    """(t,) splits of each triangle so that parts small against the pins lie under them."""
    corners = mesh.vertices[mesh.triangles]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    middle = corners.mean(axis=1)
    splits = np.zeros(len(mesh.triangles), dtype=np.int64)
    for stamp in stamps:
        near = np.linalg.norm(middle - stamp.centre, axis=1) < stamp.radius + 0.7 * edge
        wanted = np.ceil(np.log2(np.maximum(edge * POINTS_ACROSS / stamp.radius, 1.0)))
        splits[near] = np.maximum(splits[near], np.minimum(wanted[near], MOST_SPLITS))
    return splits


def _at_stamps(shell: ThickShell) -> tuple[Array, Array]:
    """Normal (k, 3) and wall (k,) of the undeformed shell at the quadrature point nearest each."""
    points = np.asarray(shell.value_matrix() @ shell.mesh.vertices)
    normals, walls = np.zeros((len(shell.stamps), 3)), np.zeros(len(shell.stamps))
    surface = LimitSurface(shell.mesh)
    for k, stamp in enumerate(shell.stamps):
        found = surface.closest_point(shell.mesh.vertices, stamp.centre[None])
        normals[k] = found.normal[0]
        walls[k] = shell.thickness[np.argmin(np.linalg.norm(points - stamp.centre, axis=1))]
    return normals, walls


def _lateral(axis: Array) -> tuple[Array, Array]:
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def _sheared_vertices(shell: ThickShell, stamps: Sequence[Stamp], everywhere: bool) -> Index:
    """Control vertices with shear: those of triangles within reach of a pin, or all."""
    mesh = shell.mesh
    if everywhere:
        return np.unique(mesh.triangles[mesh.active]).astype(np.int64)
    points = np.asarray(shell.value_matrix() @ mesh.vertices)
    b_11, b_12, b_22 = shell.reference.curvature.T
    mean, gauss = 0.5 * (b_11 + b_22), b_11 * b_22 - b_12**2
    largest = np.abs(mean) + np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    limit = LimitSurface(mesh).limit_positions(mesh.vertices)
    chosen = np.zeros(len(mesh.vertices), dtype=bool)
    for stamp in stamps:
        near = int(np.argmin(np.linalg.norm(points - stamp.centre, axis=1)))
        wall = float(shell.thickness[near])
        around = np.linalg.norm(points - stamp.centre, axis=1) < stamp.radius + 2.0 * wall
        curvature = max(float(np.median(largest[around | (np.arange(len(points)) == near)])), 1e-9)
        reach = SHEAR_REACH * np.sqrt(wall / curvature)
        reach = min(max(reach, stamp.radius + 4.0 * wall), np.sqrt(shell.area))
        chosen |= np.linalg.norm(limit - stamp.centre, axis=1) < reach
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.triangles[mesh.active]] = True
    return np.flatnonzero(chosen & used)


def _stamp_points(shell: ThickShell) -> StampPoints:
    """Points under each stamp: the nearest ones that make up its area on the outer face."""
    points = np.asarray(shell.value_matrix() @ shell.mesh.vertices)
    outer = points + 0.5 * shell.thickness[:, None] * shell.reference.normal
    k_11, k_12, k_22 = (-shell.reference.curvature).T
    half = 0.5 * shell.thickness
    stretch = 1.0 + half * (k_11 + k_22) + half**2 * (k_11 * k_22 - k_12**2)
    area = shell.weights * stretch
    taken = np.full(len(points), -1, dtype=np.int64)
    parts: list[tuple[Index, int]] = []
    normals, walls = _at_stamps(shell)
    for k, stamp in enumerate(shell.stamps):
        centre = stamp.centre + 0.5 * walls[k] * normals[k]
        distance = np.linalg.norm(outer - centre, axis=1)
        near = np.flatnonzero((distance < 1.5 * stamp.radius) & (taken < 0))
        near = near[np.argsort(distance[near], kind='stable')]
        within = np.cumsum(area[near]) - 0.5 * area[near] < np.pi * stamp.radius**2
        own = np.sort(near[within])
        if len(own) < 3:
            raise WallError(
                f'a pin of {1e3 * stamp.radius:.3g} mm at {np.round(1e3 * stamp.centre, 2)} mm '
                f'presses on fewer than three points of the mesh: refine it there'
            )
        taken[own] = k
        parts.append((own, k))
    point = np.concatenate([own for own, _ in parts]) if parts else np.zeros(0, np.int64)
    stamp_of = np.repeat([k for _, k in parts], [len(own) for own, _ in parts]).astype(np.int64)
    axis = np.array([-shell.stamps[k].axis for k in stamp_of]).reshape(-1, 3)
    arm = np.zeros((len(point), 2))
    for k, stamp in enumerate(shell.stamps):
        own = stamp_of == k
        offset = outer[point[own]] - (stamp.centre + 0.5 * walls[k] * normals[k])
        for i, lateral in enumerate(_lateral(stamp.axis)):
            arm[own, i] = offset @ lateral / stamp.radius
    height = np.einsum('gi,gi->g', axis, outer[point])
    element = np.searchsorted(shell.point_offsets, point, side='right') - 1
    cell = np.unique(element, return_inverse=True)[1].reshape(-1).astype(np.int64)
    return StampPoints(point.astype(np.int64), stamp_of, cell, axis, height, arm)


def _elements(shell: ThickShell, sheared: Index, pressed: StampPoints) -> dict[str, Any]:
    """Unknowns of every element and the shear rows of every point."""
    n = len(shell.mesh.vertices)
    number = np.full(n, -1, dtype=np.int64)
    number[sheared] = n + np.arange(len(sheared))
    pin_of = np.full(len(shell.node_offsets) - 1, -1, dtype=np.int64)
    element_of = np.searchsorted(shell.point_offsets, pressed.point, side='right') - 1
    for element, k in zip(element_of.tolist(), pressed.stamp.tolist(), strict=True):
        if pin_of[element] not in (-1, k):
            raise WallError('two pins press on one triangle of the mesh: refine it there')
        pin_of[element] = k
    nodes, counts, shears = [], [], np.zeros(len(pin_of), dtype=np.int64)
    for e in range(len(pin_of)):
        own = shell.nodes[shell.node_offsets[e] : shell.node_offsets[e + 1]]
        extra = number[own]
        extra = extra[extra >= 0]
        shears[e] = len(extra)
        parts = [own, extra]
        if pin_of[e] >= 0:
            parts.append(np.array([n + len(sheared) + pin_of[e]]))
        nodes.append(np.concatenate(parts))
        counts.append(len(nodes[-1]))
    of_point = np.repeat(np.arange(len(pin_of)), np.diff(shell.point_offsets))
    offsets = np.concatenate([[0], np.cumsum(shears[of_point])]).astype(np.int64)
    return {
        'element_offsets': np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        'element_nodes': np.concatenate(nodes).astype(np.int64),
        'shear_counts': shears,
        'shear_offsets': offsets,
        'shear_rows': _shear_rows(shell, sheared, number),
    }


def _shear_rows(shell: ThickShell, sheared: Index, number: Index) -> Array:
    """(., 12) shear W^a and its derivatives W^a,b along the frame, by both components of a node.

    W^a = w . A^a of the field w = sum N_I (w1_I e1_I + w2_I e2_I), so that W^a,b also turns with
    the frame: A^a,b = -Gamma^a_bc A^c + B^a_b N.
    """
    row_nodes = shell.row_nodes
    used = np.flatnonzero(number[row_nodes] >= 0)
    point = np.repeat(np.arange(len(shell.weights)), np.diff(shell.row_offsets))[used]
    which = number[row_nodes[used]] - len(shell.mesh.vertices)
    reference = shell.reference
    tangents, normal = reference.tangents[point], reference.normal[point]
    connection = np.einsum('pvi,pai->pva', reference.second[point], tangents)
    form = reference.curvature[point]
    value, first = shell.values[used], shell.rows[used, :2]
    scale = 1.0 / float(np.mean(shell.wall))
    result = np.zeros((len(used), 6, 2))
    pair = ((0, 1), (1, 2))
    for alpha, frame in enumerate(shear_frames(shell.mesh, sheared)):
        e = frame[which]
        along = np.einsum('rai,ri->ra', tangents, e)
        out = np.einsum('ri,ri->r', normal, e)
        for a in range(2):
            result[:, a, alpha] = value * along[:, a]
            for b in range(2):
                turn = form[:, pair[a][b]] * out
                for c in range(2):
                    turn = turn - connection[:, pair[b][c], a] * along[:, c]
                result[:, 2 + 2 * a + b, alpha] = first[:, b] * along[:, a] + value * turn
    return np.ascontiguousarray(scale * result.reshape(len(used), 12))


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
