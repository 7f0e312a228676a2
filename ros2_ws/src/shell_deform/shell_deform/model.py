# SPDX-License-Identifier: Apache-2.0
"""A shell with its theory, supports and gas: everything an equilibrium is searched for in."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.assemble.held import HeldWall
from shell_deform.assemble.pin_pressures import PressureEquations
from shell_deform.assemble.stamps import Stamp
from shell_deform.assemble.thick import ThickShell
from shell_deform.contact.bodies import Body, BodyError, RoundBar, Shape, frame_of
from shell_deform.contact.contact_field import WallStiffness, wall_stiffness
from shell_deform.contact.loads import ContactPatch, LoadError, contact_patch
from shell_deform.contact.outer_face import OuterFace, outer_face
from shell_deform.contact.thick_face import ThickFace, thick_face
from shell_deform.supports import (
    SupportRows,
    free_rigid_modes,
    isostatic_dofs,
    joined,
    rigid_modes,
)
from shell_deform.supports.grips import Grip, refuse_overlap
from shell_deform.surface.limit import LimitSurface
from shell_deform.theory import THEORY_NAMES, THICK, is_linear
from shell_deform.theory.gas import Gas

Array = NDArray[np.float64]

# A control point with less stiffness than this share of the median carries no surface.
IDLE_STIFFNESS = 1e-7
# A plate that begins this share of the object's size inside it was meant to touch it.
START_INSIDE = 1e-2
# A pad is held in the middle, over this share of the root of the surface's area.
HELD_SHARE = 0.1


@dataclass(frozen=True)
class Tangent:
    """The shell's response at a state; N = 3 n dofs, control point by control point.

    Attributes:
        energy: strain, support and gas energy [J]. gradient: (N,) its derivative [N].
        stiffness: (N, N) sparse part of the second derivative [N/m].
        gas_row: (N,) derivative of the volume [m^2]. gas_stiffness: [Pa/m^3], 0 without gas.
        gas_pressure: overpressure [Pa].
        pad_rows: (N, f), pad_corner: (f,) of pads under given force, see `contact_field.Press`.
    """

    energy: float
    gradient: Array
    stiffness: sp.csr_matrix
    gas_row: Array
    gas_stiffness: float
    gas_pressure: float
    pad_rows: Array | None = None
    pad_corner: Array | None = None


@dataclass(frozen=True)
class ShellModel:
    """A discretised shell, how it is strained, held and filled.

    Attributes:
        shell: the discretisation of the undeformed middle surface.
        theory: name in `THEORIES`.
        gas: air inside; only a closed mesh may be sealed.
        supports: springs that hold parts of it in place; None for none.
        grips: rigid bodies that hold parts of it and may move.
        pressure: follower overpressure inside, kept constant [Pa]; on the wall of an open
            surface, whatever closes it, where its work is not part of the energy.
        remembering: what the wall remembers in a step of time; None for an elastic one. Linear
            theory has no use for it.
        reason: a sentence why `auto` took this theory; empty where it was asked for.
    """

    shell: Discretisation
    theory: str = 'koiter'
    gas: Gas = field(default_factory=Gas)
    supports: SupportRows | None = None
    grips: tuple[Grip, ...] = ()
    pressure: float = 0.0
    remembering: HeldWall | None = None
    reason: str = ''

    def __post_init__(self) -> None:
        if self.theory not in THEORY_NAMES:
            raise ValueError(f'theory is {self.theory!r}; choose one of {list(THEORY_NAMES)}')
        if (self.theory == THICK) != isinstance(self.shell, ThickShell):
            raise ValueError('theory thick takes a thick shell, every other theory a thin one')
        if self.gas.is_sealed and not self.shell.mesh.is_closed:
            raise ValueError(
                'an open surface holds neither sealed gas nor liquid; use gas kind none or open'
            )
        refuse_overlap(self.grips, self.supports)

    @cached_property
    def held(self) -> SupportRows | None:
        """Supports, then grips: all springs in the unknowns of the shell; None for a free body."""
        parts = [] if self.supports is None else [self.supports]
        rows = joined([*parts, *(grip.rows for grip in self.grips)])
        return None if rows is None else rows.on(self.shell)

    def held_target(self, motion: Array) -> Array | None:
        """Where all springs are moved to [m] by the grips' `motion` (g, 6), None for nowhere."""
        if not np.any(motion):
            return None
        still = np.zeros(0 if self.supports is None else len(self.supports.stiffness))
        moves = zip(self.grips, motion, strict=True)
        return np.concatenate([still, *(grip.target(self.rest, by) for grip, by in moves)])

    @property
    def own_pressure(self) -> float:
        """Pressure inside over that outside at the undeformed shape [Pa]."""
        return self.pressure + (self.gas.gauge_pressure if self.gas.is_sealed else 0.0)

    def filled(self, share: float) -> ShellModel:
        """This model under a share of its own pressures: constant one, gauge pressure inside."""
        if share == 1.0:
            return self
        result = copy(self)
        gas = replace(self.gas, gauge_pressure=share * self.gas.gauge_pressure)
        object.__setattr__(result, 'gas', gas)
        object.__setattr__(result, 'pressure', share * self.pressure)
        return result

    @property
    def surface(self) -> LimitSurface:
        """The limit surface of the control mesh."""
        return self.shell.surface

    @property
    def rest(self) -> Array:
        """Undeformed control points (n, 3) [m]."""
        return self.shell.mesh.vertices

    @property
    def start(self) -> Array:
        """All unknowns of the undeformed shell, rows of three; the control points come first."""
        return self.shell.start

    def on_contacts(self, contacts: Sequence[ContactPatch]) -> ShellModel:
        """This model where the contacts of a load case are part of the discretisation.

        A thick wall carries its pins as unknowns of its own, and shears where bodies touch it;
        other walls stay as they are.
        """
        if not isinstance(self.shell, ThickShell):
            return self
        pins: list[Stamp] = []
        bodies: list[Stamp] = []
        for contact in contacts:
            place = Stamp(contact.point, contact.axis, contact.radius)
            (pins if contact.body is None else bodies).append(place)
        shell = self.shell.with_stamps(pins, bodies)
        return self if shell is self.shell else replace(self, shell=shell)

    def of(self, shell: Discretisation | None) -> ShellModel:
        """This model with the discretisation that a state is of; None for its own.

        A solver goes on to other pins and more shear; the states before stay what they are.
        """
        return self if shell is None or shell is self.shell else replace(self, shell=shell)

    def widened(self, depth: Array) -> ShellModel:
        """This model, with a thick wall that shears as far as depths (k,) [m] of contacts need."""
        if not isinstance(self.shell, ThickShell):
            return self
        shell = self.shell.widened(float(np.max(depth, initial=0.0)))
        return self if shell is self.shell else replace(self, shell=shell)

    @cached_property
    def outer_face(self) -> OuterFace | ThickFace:
        """Where rigid bodies may touch the wall."""
        if isinstance(self.shell, ThickShell):
            return thick_face(self.shell)
        return outer_face(self.shell)

    @cached_property
    def wall_stiffness(self) -> WallStiffness:
        """What contacts of bodies are stiff against."""
        return wall_stiffness(self.outer_face)

    @cached_property
    def rest_volume(self) -> float:
        """Volume inside the undeformed middle surface [m^3]."""
        return self.shell.volume(self.rest)[0]

    def contact(
        self, at: Array, radius: float, axis: Array | None = None, profile: str = 'uniform'
    ) -> ContactPatch:
        """Contact patch of `radius` [m] nearest to `at` (3,) [m], pushed along `axis`."""
        return contact_patch(self.surface, at, radius, axis, profile)

    def pad(
        self,
        at: Array,
        radius: float,
        curvature_radius: float | None = None,
        friction: float = 0.0,
    ) -> ContactPatch:
        """Rigid pad that touches the outer face nearest to `at` (3,) [m], its axis the normal.

        `radius` [m] of its rim; its face is flat, or a cap of a sphere of `curvature_radius` [m].
        What is held of it is the middle of the patch it first lies on. Raises LoadError for a
        radius that no pad can have.
        """
        if not (np.isfinite(radius) and radius > 0):
            raise LoadError(f'pad radius is {radius} m; it must be positive')
        if curvature_radius is not None and not curvature_radius >= radius:
            raise LoadError(
                f'the face of the pad has a radius of {curvature_radius} m, less than that of its '
                f'rim, {radius} m'
            )
        patch, apex = self._first_touched(at, radius)
        curvature = 0.0 if curvature_radius is None else 1.0 / curvature_radius
        shape = RoundBar(float(radius), curvature)
        return replace(patch, body=Body(shape, apex, frame_of(patch.axis), patch.axis, friction))

    def touched_by(
        self,
        shape: Shape,
        at: Array,
        size: float,
        along: Array | None = None,
        friction: float = 0.0,
        towards: Array | None = None,
    ) -> ContactPatch:
        """Rigid body that touches the outer face nearest to `at` (3,) [m] with its origin.

        Its z axis is the inward normal there, its x axis as near to `along` (3,) as that allows.
        Where it is said to face `towards` (3,) its z axis is that, and its origin `at` itself: a
        body may touch beside it. `size` [m]: of its face; where no friction holds it, the middle
        of the patch it first lies on is held instead. Raises BodyError for a body that cannot be.
        """
        patch, origin = self._first_touched(at, size)
        axis = patch.axis
        if towards is not None:
            origin, axis = np.asarray(at, dtype=float), towards / np.linalg.norm(towards)
        body = Body(shape, origin, frame_of(axis, along), axis, friction)
        return replace(patch, axis=axis, body=body)

    def plate(
        self, at: Array, radius: float, towards: Array, friction: float = 0.0
    ) -> ContactPatch:
        """Rigid flat plate of `radius` [m] about `at` (3,) [m] that moves `towards` (3,).

        It starts where it first touches the outer face, or an edge. Nothing is held across its
        way. Raises BodyError where it misses the object or starts inside it.
        """
        axis = np.asarray(towards, dtype=float) / np.linalg.norm(towards)
        away = self.outer_face.positions(self.start) - at
        height = away @ axis
        ahead = np.linalg.norm(away - height[:, None] * axis, axis=1) <= radius
        if not ahead.any():
            raise BodyError('the plate misses the object: nothing lies ahead of its face')
        first = float(height[ahead].min())
        if first < -START_INSIDE * float(np.ptp(self.rest, axis=0).max()):
            raise BodyError(
                f'the plate starts {-first:.3g} m inside the object; move it out by that, to '
                'where it only touches, or let it move the other way'
            )
        origin = np.asarray(at, dtype=float) + first * axis
        nearest = self.outer_face.positions(self.start)[ahead][int(np.argmin(height[ahead]))]
        patch, _ = self._first_touched(nearest, radius)
        body = Body(RoundBar(float(radius)), origin, frame_of(axis), axis, friction)
        return replace(patch, axis=axis, body=body, slides=True)

    def held_radius(self, size: float) -> float:
        """Radius [m] of the patch that stands for a body of this size [m]."""
        return float(min(size, HELD_SHARE * np.sqrt(self.shell.area)))

    def _first_touched(self, at: Array, size: float) -> tuple[ContactPatch, Array]:
        """The patch of a body of this size [m], and the point (3,) of the outer face under it."""
        patch = contact_patch(self.surface, at, self.held_radius(size))
        wall = self.shell.thickness[
            np.argmin(np.linalg.norm(self.shell.value_matrix() @ self.rest - patch.point, axis=1))
        ]
        return patch, patch.point - 0.5 * wall * patch.axis

    @cached_property
    def _fixed_values(self) -> Array:
        """Stiffness values that never change: supports, and springs on idle control points.

        Control points beyond an edge may touch the surface barely or not at all: they are kept in
        place, which moves nothing and leaves the stiffness regular.
        """
        shell = self.shell
        values = np.zeros(len(shell.pattern.indices))
        if self.held is not None:
            values += self.held.stiffness_values(shell)
        spring = IDLE_STIFFNESS * float(np.median(self._own_stiffness))
        matrix = shell.pattern.matrix(values)
        idle = (3 * self._idle[:, None] + np.arange(3)).ravel()
        for dof in [*idle, *self.shell.idle_dofs]:
            values[diagonal_entry(matrix, int(dof))] += spring
        return values

    @cached_property
    def _own_stiffness(self) -> Array:
        """(n,) stiffness of each control point by itself, at rest [N/m]."""
        values = self.shell.tangent('koiter', self.start)[2]
        return np.asarray(self.shell.pattern.matrix(values).diagonal()).reshape(-1, 3).sum(axis=1)

    @cached_property
    def _idle(self) -> NDArray[np.int64]:
        """Control points that carry no surface to speak of."""
        own = self._own_stiffness
        return np.flatnonzero(own < IDLE_STIFFNESS * np.median(own))

    @cached_property
    def free_modes(self) -> Array:
        """Orthonormal rigid motions (N, k) that no support prevents."""
        modes = self.shell.extended_modes(rigid_modes(self.rest))
        if self.held is None:
            return modes
        return free_rigid_modes(modes, self.held.dense(len(self.start)))

    @cached_property
    def springs(self) -> NDArray[np.int64]:
        """Dofs that, once fixed, leave no rigid motion."""
        modes = self.free_modes.copy().reshape(len(self.start), 3, -1)
        modes[self._idle] = 0.0
        modes[len(self.rest) :] = 0.0
        return isostatic_dofs(modes.reshape(3 * len(self.start), -1))

    @cached_property
    def rest_tangent(self) -> Tangent:
        """Tangent at the undeformed shape: all that linear theory needs."""
        return self._nonlinear_tangent(self.start)

    def tangent(
        self, positions: Array, target: Array | None = None, moved: Array | None = None
    ) -> Tangent:
        """Energy, gradient and stiffness at control positions (n, 3).

        `target`: where support conditions are moved to [m], None to keep them in place. `moved`
        (n, 3): positions - rest, where it is known to more digits than the difference has: stiff
        support springs feel them.
        """
        if not is_linear(self.theory):
            return self._nonlinear_tangent(positions, target, moved)
        rest = self.rest_tangent
        energy, gradient = self._linear_gradient(positions, target)
        return Tangent(
            energy, gradient, rest.stiffness, rest.gas_row, rest.gas_stiffness, rest.gas_pressure
        )

    def gradient(
        self, positions: Array, target: Array | None = None, moved: Array | None = None
    ) -> tuple[float, Array]:
        """Energy [J] and gradient (N,) [N] at control positions, without the stiffness.

        `target` and `moved` as in `tangent`.
        """
        if is_linear(self.theory):
            return self._linear_gradient(positions, target)
        energy, gradient = self._wall_gradient(positions)
        if self.gas.is_sealed or self.pressure:
            volume, row = self.shell.volume(positions)
            energy += self._gas_energy(volume)
            gradient -= self.overpressure(volume) * row
        if self.held is not None:
            moved = positions - self.start if moved is None else moved
            energy += self.held.energy(moved, target)
            gradient += self.held.force(moved, target)
        return energy, gradient.reshape(-1)

    @cached_property
    def floated(self) -> Array:
        """(N, f) what free shifts of grips take off the sparse stiffness: minus V V^T."""
        size = len(self.start)
        return np.zeros((3 * size, 0)) if self.held is None else self.held.floated(size)

    def wall_force(self, positions: Array) -> Array:
        """Nodal forces (n, 3) [N] that wall and gas need to stay at all unknowns `positions`.

        Without the springs of what holds it: it keeps its digits however stiff these are.
        """
        elastic = self._wall_gradient(positions)[1]
        if self.gas.is_sealed or self.pressure:
            volume, row = self.shell.volume(positions)
            elastic -= self.overpressure(volume) * row
        return elastic

    def pressure_equations(self, positions: Array) -> PressureEquations | None:
        """Those of a thick wall under pins, see `pin_pressures`; None where there are none."""
        found = self.shell.pressure_equations(positions)
        if found is None or self.remembering is None:
            return found
        return replace(found, share=self.remembering.now)

    def _wall_gradient(self, positions: Array) -> tuple[float, Array]:
        if self.remembering is not None:
            return self.remembering.gradient(positions)
        return self.shell.gradient(self.theory, positions)

    def overpressure(self, volume: float) -> float:
        """Pressure inside minus outside [Pa] at an enclosed volume [m^3]."""
        if not self.gas.is_sealed:
            return self.pressure
        return self.pressure + self.gas.pressure(volume / self.rest_volume)

    def _gas_energy(self, volume: float) -> float:
        if not self.shell.mesh.is_closed:
            return 0.0
        change = volume - self.rest_volume
        if not self.gas.is_sealed:
            return -self.pressure * change
        ratio = volume / self.rest_volume
        return self.rest_volume * self.gas.energy_density(ratio) - self.pressure * change

    def _linear_gradient(self, positions: Array, target: Array | None) -> tuple[float, Array]:
        rest = self.rest_tangent
        moved = (positions - self.rest).reshape(-1)
        start = rest.gradient
        if self.held is not None and target is not None:
            start = start + self.held.force(np.zeros_like(self.rest), target).reshape(-1)
        force = rest.stiffness @ moved + rest.gas_stiffness * rest.gas_row * (rest.gas_row @ moved)
        force -= self.floated @ (self.floated.T @ moved)
        energy = float(0.5 * moved @ force + start @ moved)
        return energy, start + force

    def _nonlinear_tangent(
        self, positions: Array, target: Array | None = None, moved: Array | None = None
    ) -> Tangent:
        row = np.zeros_like(positions)
        volume, stiffness, pressure = self.rest_volume, 0.0, 0.0
        filled = self.gas.is_sealed or bool(self.pressure)
        if filled:
            volume, row = self.shell.volume(positions)
            pressure = self.overpressure(volume)
            if self.gas.is_sealed:
                ratio = volume / self.rest_volume
                stiffness = -self.gas.pressure_slope(ratio) / self.rest_volume
        if self.remembering is None:
            energy, gradient, data = self.shell.tangent(self.theory, positions, pressure)
        else:
            energy, gradient, data = self.remembering.tangent(positions, pressure)
        if filled:
            gradient -= pressure * row
            energy += self._gas_energy(volume)
        if self.held is not None:
            moved = positions - self.start if moved is None else moved
            energy += self.held.energy(moved, target)
            gradient += self.held.force(moved, target)
        data += self._fixed_values
        matrix = self.shell.pattern.matrix(data)
        return Tangent(energy, gradient.reshape(-1), matrix, row.reshape(-1), stiffness, pressure)

    def holding(self, held: HeldWall | None) -> ShellModel:
        """The same shell in a step of time; what is known of it at rest stays known."""
        result = copy(self)
        object.__setattr__(result, 'remembering', held)
        return result

    def with_theory(self, theory: str, **changes: Any) -> ShellModel:
        """The same shell under another theory."""
        values = {
            'shell': self.shell,
            'gas': self.gas,
            'supports': self.supports,
            'grips': self.grips,
            'pressure': self.pressure,
            **changes,
        }
        return ShellModel(theory=theory, **values)


def diagonal_entry(matrix: sp.csr_matrix, dof: int) -> int:
    """Where the diagonal value of `dof` stands in the values of a CSR matrix."""
    start, end = matrix.indptr[dof], matrix.indptr[dof + 1]
    return int(start + np.searchsorted(matrix.indices[start:end], dof))
