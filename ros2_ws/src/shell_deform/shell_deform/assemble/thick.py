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
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation, Sums, discretise
from shell_deform.assemble.pin_pressures import PressureEquations
from shell_deform.assemble.shear_nodes import (
    SHEAR_REACH,
    ElementUnknowns,
    element_unknowns,
    sheared_vertices,
    used_vertices,
)
from shell_deform.assemble.shell_points import StiffnessPattern, stiffness_pattern
from shell_deform.assemble.stamps import (
    Stamp,
    StampPoints,
    WallError,
    pins_before,
    stamp_points,
    stamp_splits,
)
from shell_deform.assemble.thick_outer_face import ThickOuterFace
from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.compiled.halves import in_halves
from shell_deform.surface.control_mesh import ControlMesh
from shell_deform.surface.frames import lateral_vectors
from shell_deform.surface.loop_basis import QuadratureBasis, quadrature_basis
from shell_deform.theory.koiter import cross_matrix
from shell_deform.theory.material import Material
from shell_deform.theory.reference import sharpest_curvature

if HAVE_NUMBA:
    from shell_deform.assemble import thick_kernels, thick_state_kernels

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOST_INCOMPRESSIBLE = 0.4999
"""Largest Poisson's ratio: J = 1 at two heights has no solution in some states of a bent wall."""

EXTRA_COMPLIANCE = 1e-2
"""Compliance of a pin's face over that of the wall, h / E. A nearly incompressible wall cannot be
squeezed in this theory, where a solid still gives way around the pin: its pressures would be as
stiff as its bulk modulus, and Newton's method find them only in the smallest steps. It moves a pin
by this share of h P / E: force and travel of the mission's ball by 0.7 % at 0.25 mm, 0.3 % from
3.6 mm on."""


FOLDED_SPOT = 1.0
"""A wall is refused where more of it than so many squares of its thickness reaches its centre of
curvature: single points beside irregular vertices are sharper than the surface."""

FOLDED = 0.95
"""Where more of its points than all but this share do, no other theory stands in for that."""


@dataclass(frozen=True, kw_only=True)
class ThickShell(Discretisation):
    """See the module docstring; n control points, m shear nodes, k stamps.

    Attributes:
        material: of the wall. basis: quadrature, split under the stamps. wall: (n,) thickness.
        stamps: the pins. sheared: (m,) control vertices with shear.
        pressed: what the pins touch. elements: all unknowns of each element.
        everywhere: whether every vertex has shear. bodies: where others than pins may touch: the
            wall shears there, too. reach: of the shear around them, in sqrt(R h).
    """

    material: Material
    basis: QuadratureBasis
    wall: Array
    stamps: tuple[Stamp, ...]
    sheared: Index
    pressed: StampPoints
    elements: ElementUnknowns
    everywhere: bool
    bodies: tuple[Stamp, ...] = ()
    reach: float = SHEAR_REACH

    def stiffened(self, factor: float) -> ThickShell:
        """The same shell with `factor` times the modulus; pressures are unknowns over E / h."""
        return replace(
            self,
            membrane=factor * self.membrane,
            bending=factor * self.bending,
            material=replace(self.material, young_modulus=factor * self.material.young_modulus),
        )

    def with_stamps(self, stamps: Sequence[Stamp], bodies: Sequence[Stamp] = ()) -> ThickShell:
        """The same wall under other pins, and where other bodies may touch it."""
        if _alike(stamps, self.stamps) and _alike(bodies, self.bodies):
            return self
        return thick_shell(self.mesh, self.material, self.wall, stamps, self.everywhere, bodies)

    def widened(self, depth: float) -> ThickShell:
        """The same wall, sheared as far as contacts that are `depth` [m] deep need it.

        A deep dent bends most in a ridge at sqrt(R depth) from its middle, sqrt(depth / h) of what
        the reach counts in; where the wall cannot shear there it is too stiff. The reach doubles,
        so that few depths change the unknowns.
        """
        ridge = np.sqrt(max(depth, 0.0) / float(self.wall.mean()))
        if ridge <= self.reach or len(self.sheared) == len(used_vertices(self.mesh)):
            return self
        doublings = np.ceil(np.log2(ridge / self.reach))
        return thick_shell(
            self.mesh, self.material, self.wall, self.stamps, False, self.bodies,
            self.reach * 2.0**doublings,
        )  # fmt: skip

    # ---- unknowns

    @cached_property
    def start(self) -> Array:
        """All unknowns of the undeformed shell: control points, then zeros."""
        more = len(self.sheared) + len(self.stamps) + -(-self.pressed.cells // 3)
        return np.concatenate([self.mesh.vertices, np.zeros((more, 3))])

    @property
    def first_pin(self) -> int:
        """Row of the first pin."""
        return len(self.mesh.vertices) + len(self.sheared)

    @property
    def stiffest(self) -> float:
        """Largest stiffness [N/m]: of the wall against a change of volume, or under a pin."""
        shear, bulk = self.kernel_arguments[3][:2]
        squeezed = max((stamp.radius**2 for stamp in self.stamps), default=0.0)
        reach = max(float(self.thickness.max()), squeezed / float(self.thickness.min()))
        return float((bulk + 4.0 / 3.0 * shear) * reach)

    @cached_property
    def idle_dofs(self) -> Index:
        """Numbers that nothing depends on: the third component of every shear node, and the
        tilts of pins that keep their direction.
        """
        third = 3 * (len(self.mesh.vertices) + np.arange(len(self.sheared))) + 2
        steady = 3 * (self.first_pin + np.flatnonzero(~self.pressed.tilts))
        return np.concatenate([third, steady + 1, steady + 2])

    @cached_property
    def places(self) -> Array:
        """(rows, 3) where the unknowns are, for orderings [m]."""
        centres = np.array([stamp.centre for stamp in self.stamps]).reshape(-1, 3)
        result = np.zeros_like(self.start)
        n, pin = len(self.mesh.vertices), self.first_pin
        result[:n] = self.mesh.vertices
        result[n:pin] = self.mesh.vertices[self.sheared]
        result[pin : pin + len(centres)] = centres
        if self.pressed.cells:
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
            [np.tile(np.eye(3), (n, 1)), -cross_matrix(arms).reshape(-1, 3)],
            axis=1,
        )
        motion = np.linalg.lstsq(ones, modes, rcond=None)[0]
        for k, stamp in enumerate(self.stamps):
            outer = stamp.centre + 0.5 * self.pressed.wall[k] * self.pressed.outward[k] - centre
            velocity = motion[:3] + np.cross(motion[3:].T, outer).T
            result[self.first_pin + k, 0] = stamp.axis @ velocity
            if not self.pressed.tilts[k]:
                continue
            for i, lateral in enumerate(lateral_vectors(stamp.axis)):
                turn = np.cross(motion[3:].T, lateral) @ stamp.axis
                result[self.first_pin + k, 1 + i] = stamp.radius * turn
        orthonormal, _ = np.linalg.qr(result.reshape(-1, count))
        return orthonormal

    @cached_property
    def pattern(self) -> StiffnessPattern:
        """Sparsity of the tangent stiffness of all unknowns."""
        return stiffness_pattern(self.elements.offsets, self.elements.nodes, len(self.start))

    # ---- the wall

    @cached_property
    def _enclosed_wall(self) -> float:
        """Volume [m^3] between the middle surface and the undeformed inner face."""
        h, (mean, gauss) = self.thickness, self.reference.mean_and_gauss
        trace, determinant = -2.0 * mean, gauss
        return float(self.weights @ (0.5 * h - trace * h**2 / 8.0 + determinant * h**3 / 24.0))

    def volume(self, positions: Array) -> tuple[float, Array]:
        """Volume inside the inner face [m^3] and its gradient [m^2].

        The part of the wall inside the middle surface is taken to keep its volume. An open surface
        encloses none.
        """
        volume, gradient = super().volume(positions)
        return volume - self._enclosed_wall if self.mesh.is_closed else 0.0, gradient

    def gradient(self, theory: str, positions: Array) -> tuple[float, Array]:
        """Strain energy [J] and its gradient by all unknowns [N]; `theory` is always thick."""
        energy, gradient, _ = self._assembled(False, positions, 0.0)
        return energy, gradient

    def tangent(
        self, theory: str, positions: Array, pressure: float = 0.0
    ) -> tuple[float, Array, Array]:
        """Strain energy [J], gradient [N] and stiffness values of `pattern`."""
        return self._assembled(True, positions, pressure)

    def _assembled(
        self, stiff: bool, positions: Array, pressure: float
    ) -> tuple[float, Array, Array]:
        self._refuse_others(positions)
        positions = np.ascontiguousarray(positions)
        pattern = self.pattern

        def part(first: int, last: int) -> Sums:
            gradient = np.zeros_like(positions)
            data = np.zeros(len(pattern.indices) if stiff else 0)
            _, points, stamps, material = self.kernel_arguments
            arguments: Any = (
                stiff, float(pressure), self.thick_elements(first, last), points, stamps,
                material, positions, gradient, pattern.block_offsets[first:],
                pattern.block_start, np.ascontiguousarray(pattern.indptr[:-1:3]),
                pattern.row_length, pattern.indices, data,
            )  # fmt: skip
            return float(thick_kernels.thick_tangent(*arguments)), gradient, data

        energy, gradient, data = self.summed(part)
        if not np.isfinite(energy):
            gradient = np.full_like(gradient, np.nan)
        return energy, gradient, data

    def continued(self, other: Discretisation, positions: Array) -> Array:
        """Unknowns under these pins at a state of the same wall under others.

        Shear stays where it is known; pins that stay keep travel and pressures; one that has slid
        lies on the face as that is now, and presses on where it has pressed; a new one has no
        pressure.
        """
        assert isinstance(other, ThickShell)
        n = len(self.mesh.vertices)
        result = self.start.copy()
        result[:n] = positions[:n]
        _, here, there = np.intersect1d(self.sheared, other.sheared, return_indices=True)
        result[n + here] = positions[n + there]
        stays, before = pins_before(self.stamps, other.stamps)
        result[self.first_pin + np.flatnonzero(stays)] = positions[other.first_pin + before[stays]]
        flat, old_flat = result.reshape(-1), positions.reshape(-1)
        old_cells = dict(zip(other._cell_keys, other._pressure_dofs, strict=True))
        for (element, k), dof in zip(self._cell_keys, self._pressure_dofs, strict=True):
            old = old_cells.get((element, int(before[k])))
            flat[dof] = 0.0 if old is None else old_flat[old]
        return self._laid(result, np.flatnonzero(~stays))

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
        element = self._pressed_elements.tolist()
        return list(zip(element, self.pressed.stamp.tolist(), strict=True))

    def settled(self, positions: Array) -> Array:
        """The unknowns with the contact pressures of the step that was just taken."""
        equations = self.pressure_equations(positions)
        if equations is None:
            return positions
        flat = np.zeros(positions.size)
        return positions + equations.followed(flat, equations.missing).reshape(-1, 3)

    def pressure_equations(self, positions: Array) -> PressureEquations | None:
        """Those of the cells; None without pins, or where a pressed point has no equilibrium."""
        pressed = self.pressed
        if not len(pressed.point):
            return None
        self._refuse_others(positions)
        positions = np.ascontiguousarray(positions)
        element, count = self._pressed_elements, len(pressed.point)

        def part(first: int, last: int) -> tuple[Array, Array] | None:
            own = slice(first, last)
            gaps, reach = np.zeros((pressed.cells, 2)), np.zeros(self._cell_unknowns.shape)
            arguments: Any = (
                *self.kernel_arguments, positions, pressed.point[own], element[own],
                pressed.cell[own], gaps, reach,
            )  # fmt: skip
            return (gaps, reach) if thick_state_kernels.cell_equations(*arguments) else None

        one, other = in_halves(part, count // 2, count)
        if one is None or other is None:
            return None
        gaps, reach = one[0] + other[0], one[1] + other[1]
        dofs = self._first_cell + np.arange(pressed.cells)
        return PressureEquations(
            gaps[:, 0], gaps[:, 1], reach, self._cell_unknowns, dofs, self.pressure_unit
        )

    @cached_property
    def _pressed_elements(self) -> Index:
        """(g,) element of each pressed point."""
        found = np.searchsorted(self.point_offsets, self.pressed.point, side='right') - 1
        return found.astype(np.int64)

    @cached_property
    def _cell_unknowns(self) -> Index:
        """(c, w) unknowns of the element of each cell, the rest 0."""
        offsets, nodes = self.elements.offsets, self.elements.nodes
        owner = np.zeros(self.pressed.cells, dtype=np.int64)
        owner[self.pressed.cell] = self._pressed_elements
        sizes = offsets[owner + 1] - offsets[owner]
        result = np.zeros((len(owner), 3 * int(sizes.max())), dtype=np.int64)
        for cell, element in enumerate(owner.tolist()):
            own = nodes[offsets[element] : offsets[element + 1]]
            result[cell, : 3 * len(own)] = (3 * own[:, None] + np.arange(3)).ravel()
        return result

    def lost_place(self, positions: Array) -> Array | None:
        """The first place (3,) [m] of the undeformed surface whose wall has no equilibrium."""
        middle = self.value_matrix() @ self.mesh.vertices
        points = np.arange(len(self.weights))
        for part in np.array_split(points, max(1, len(points) // 100)):
            if self.point_states(positions, part) is None:
                for point in part:
                    if self.point_states(positions, part[part == point]) is None:
                        return np.asarray(middle[point])
        return None

    def point_states(self, positions: Array, points: Index) -> Array | None:
        """(c, 17) of the points (c,), see `thick_state_kernels`; None where one fails."""
        self._refuse_others(positions)
        out = np.zeros((len(points), 17))
        element = np.searchsorted(self.point_offsets, points, side='right') - 1
        chosen, positions = np.asarray(points, np.int64), np.ascontiguousarray(positions)

        def part(first: int, last: int) -> bool:
            own = slice(first, last)
            arguments: Any = (
                *self.kernel_arguments, positions, chosen[own], element[own].astype(np.int64),
                out[own],
            )  # fmt: skip
            return bool(thick_state_kernels.point_states(*arguments))

        return out if all(in_halves(part, len(points) // 2, len(points))) else None

    def _refuse_others(self, positions: Array) -> None:
        """Raise ValueError for unknowns that are not this shell's: kernels would read beyond."""
        if positions.shape != self.start.shape:
            raise ValueError(
                f'{positions.shape} unknowns for a thick shell that has {self.start.shape}'
            )

    def thick_elements(self, first: int, last: int) -> Any:
        """Elements from `first` up to `last`, with all their unknowns."""
        elements, *_ = self.kernel_arguments
        offsets, nodes, controls, shears, point_offsets, row_offsets = elements
        return (
            offsets[first : last + 1], nodes, controls[first:last], shears[first:last],
            point_offsets[first : last + 1], row_offsets,
        )  # fmt: skip

    @property
    def pressure_unit(self) -> float:
        """Pressure of one unit of its unknown, E / h [Pa/m]."""
        return self.material.young_modulus / float(self.wall.mean())

    @cached_property
    def _pressure_dofs(self) -> Index:
        return self._first_cell + self.pressed.cell

    @property
    def _first_cell(self) -> int:
        """Number of the first pressure among all unknowns."""
        return 3 * (self.first_pin + len(self.stamps))

    @cached_property
    def _curvature(self) -> Array:
        """(p, 3) rest curvature K_ab = A_a . N,b: minus the second fundamental form."""
        return -self.reference.curvature

    @cached_property
    def kernel_arguments(self) -> Any:
        """What the compiled loops take: elements, points, stamps, material."""
        pressed = self.pressed
        of_point = np.full(len(self.weights), -1, dtype=np.int64)
        of_point[pressed.point] = np.arange(len(pressed.point))
        e = self.material.young_modulus
        nu = min(self.material.poisson_ratio, MOST_INCOMPRESSIBLE)
        return (
            (
                self.elements.offsets, self.elements.nodes, np.diff(self.node_offsets),
                self.elements.shear_counts, self.point_offsets, self.row_offsets,
            ),
            (
                self.rows, self.values, self.weights, self._curvature, self.thickness,
                self.elements.shear_offsets, self.elements.shear_rows,
            ),
            (of_point, pressed.axis, pressed.height, pressed.arm, self._pressure_dofs),
            (
                0.5 * e / (1.0 + nu), e / 3.0 / (1.0 - 2.0 * nu), self.pressure_unit,
                EXTRA_COMPLIANCE * float(self.wall.mean()) / e,
            ),
        )  # fmt: skip

    def outer_face(self, positions: Array) -> Array:
        """(n, 3) points of the outer face over the limit positions of the vertices [m]."""
        states = self.point_states(positions, np.arange(len(self.weights)))
        heights = 0.5 * self.thickness
        if states is not None:
            heights = self.thickness * (0.5 * states[:, 0] + 0.25 * states[:, 1])
        return self._outer_face.at(positions, heights)

    @cached_property
    def _outer_face(self) -> ThickOuterFace:
        return ThickOuterFace(self, self.basis, self.wall, self.sheared)


def thick_shell(
    mesh: ControlMesh,
    material: Material,
    thickness: float | Array,
    stamps: Sequence[Stamp] = (),
    everywhere: bool = False,
    bodies: Sequence[Stamp] = (),
    reach: float = SHEAR_REACH,
) -> ThickShell:
    """Discretise the limit surface of `mesh` as a thick wall of `thickness` [m] under pins.

    `thickness`: one number or one per control vertex. `everywhere`: shear at every vertex, not
    only within `reach` sqrt(R h) of the pins. Raises WallError where the wall reaches its centre
    of curvature, but for single points.
    """
    if not HAVE_NUMBA:
        raise WallError('theory thick needs numba: install it or choose theory koiter')
    n = len(mesh.vertices)
    wall = np.array(np.broadcast_to(np.asarray(thickness, dtype=float), (n,)))
    stamps = tuple(stamps)
    basis = quadrature_basis(mesh, 3, 2, stamp_splits(mesh, stamps))
    base = discretise(mesh, material, wall, basis)
    surface = base.surface
    points = np.asarray(base.value_matrix() @ mesh.vertices)
    _refuse_folded(base, points)
    if everywhere:
        sheared = used_vertices(mesh)
    else:
        sheared = sheared_vertices(base, surface, points, (*stamps, *bodies), reach)
    pressed = stamp_points(base, surface, points, stamps)
    own = {name: getattr(base, name) for name in base.__dataclass_fields__}
    return ThickShell(
        **own, material=material, basis=basis, wall=wall,
        stamps=stamps, sheared=sheared, pressed=pressed, everywhere=everywhere,
        bodies=tuple(bodies), reach=reach,
        elements=element_unknowns(base, surface, sheared, pressed, float(np.mean(wall))),
    )  # fmt: skip


def _alike(some: Sequence[Stamp], others: Sequence[Stamp]) -> bool:
    """Whether both lists name the same places."""
    return len(some) == len(others) and all(a.like(b) for a, b in zip(some, others, strict=True))


def folded_place(shell: Discretisation) -> Array | None:
    """Where (3,) [m] a wall reaches furthest beyond its centre of curvature, if it does.

    None, too, where more than single points do: such a wall is refused as a whole.
    """
    ratio, _ = _half_walls(shell)
    if ratio.max() < 1.0 or np.quantile(ratio, FOLDED) >= 1.0:
        return None
    return np.asarray((shell.value_matrix() @ shell.mesh.vertices)[int(np.argmax(ratio))])


def _half_walls(shell: Discretisation) -> tuple[Array, Array]:
    """(p,) half the wall over the smaller radius of curvature, and its largest curvature."""
    largest = sharpest_curvature(*shell.reference.mean_and_gauss)
    return 0.5 * shell.thickness * largest, largest


def _refuse_folded(shell: Discretisation, points: Array) -> None:
    ratio, largest = _half_walls(shell)
    if shell.weights[ratio >= 1.0].sum() > FOLDED_SPOT * float(shell.thickness.mean()) ** 2:
        point = int(np.argmax(ratio))
        place = points[point]
        raise WallError(
            f'the wall of {1e3 * shell.thickness[point]:.3g} mm reaches beyond its centre of '
            f'curvature, {1e3 / largest[point]:.3g} mm away, at {np.round(1e3 * place, 2)} mm; '
            f'give a thinner wall'
        )
