# SPDX-License-Identifier: Apache-2.0
"""What is asked of a shell, and what comes back: load cases and equilibria."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.contact.contact_field import Memory, Touch
from shell_deform.contact.loads import ContactPatch

Array = NDArray[np.float64]


ONE_PLACE = 1e-9
"""Pins nearer to each other than this [m] press the same points, which move only one way."""


class End(str, Enum):
    """How the way to a load case ended."""

    CARRIED = 'carried'
    SNAP = 'snap'
    """The load had to fall on the way: converged behind a snap, or not at all."""
    LOST = 'lost'
    """No equilibrium was found and no snap was seen either."""


class LoadCaseError(ValueError):
    """A load case that cannot be applied."""


@dataclass(frozen=True)
class LoadCase:
    """Contacts with what is prescribed at each, and dead loads.

    Attributes:
        contacts: k contact patches.
        force: (k,) push along each axis [N]; NaN where the displacement is prescribed.
        displacement: (k,) motion along its axis [m] of each pin's centre on the middle surface,
            and of each rigid pad; NaN where the force is prescribed.
        lateral: (k, 3) dead force beside the push [N], or None.
        held: whether the mean lateral motion and spin of every patch are kept at zero.
        dead_load: (n, 3) other nodal forces [N], or None.
        motion: (k, 6) shift [m] and turn [rad] of rigid bodies beside their depth, or None.
        grip_motion: (g, 6) the same of the model's grips, or None.
        grip_force: (g, 3) force of the grips along the axes in which they are free [N], or None.
    """

    contacts: tuple[ContactPatch, ...]
    force: Array
    displacement: Array
    lateral: Array | None = None
    held: bool = True
    dead_load: Array | None = None
    motion: Array | None = None
    grip_motion: Array | None = None
    grip_force: Array | None = None

    def __post_init__(self) -> None:
        count = len(self.contacts)
        if self.force.shape != (count,) or self.displacement.shape != (count,):
            raise LoadCaseError(
                f'{count} contacts need {count} forces and displacements, got shapes '
                f'{self.force.shape} and {self.displacement.shape}'
            )
        if np.any(np.isnan(self.force) == np.isnan(self.displacement)):
            raise LoadCaseError(
                'prescribe exactly one of force [N] and displacement [m] at every contact; '
                f'got forces {self.force.tolist()}, displacements {self.displacement.tolist()}'
            )
        if np.any(np.isinf(self.force)) or np.any(np.isinf(self.displacement)):
            raise LoadCaseError('prescribed forces and displacements must be finite')
        if self.motion is not None and not (
            self.motion.shape == (count, 6) and np.all(np.isfinite(self.motion))
        ):
            raise LoadCaseError(f'motion must be {count} x 6 finite numbers')
        for what, values in (('pose', self.grip_motion), ('force', self.grip_force)):
            if values is not None and not np.all(np.isfinite(values)):
                raise LoadCaseError(
                    f'the {what} of a grip is not finite: {np.asarray(values).tolist()}'
                )
        self._refuse_two_ways()

    def _refuse_two_ways(self) -> None:
        """Pins in one place that are to move differently: neither could be obeyed."""
        pins = np.flatnonzero(self.driven & ~self.padded)
        for a, first in enumerate(pins):
            for second in pins[a + 1 :]:
                ways = self.displacement[[first, second]]
                apart = self.contacts[first].point - self.contacts[second].point
                if abs(ways[0] - ways[1]) > ONE_PLACE > np.linalg.norm(apart):
                    raise LoadCaseError(
                        f'contacts {first + 1} and {second + 1} are in one place, which cannot '
                        f'move by {ways[0]:g} m and by {ways[1]:g} m; move one of them'
                    )

    @property
    def driven(self) -> NDArray[np.bool_]:
        """(k,) contacts whose displacement is prescribed."""
        return ~np.isnan(self.displacement)

    @property
    def padded(self) -> NDArray[np.bool_]:
        """(k,) contacts that are rigid bodies."""
        rigid = [c.body is not None for c in self.contacts]
        return np.array(rigid, dtype=bool)

    @property
    def motions(self) -> Array:
        """(k, 6) of the rigid bodies beside their depth, zero where none is given."""
        return np.zeros((len(self.contacts), 6)) if self.motion is None else self.motion

    def grip_motions(self, count: int) -> Array:
        """(count, 6) of the grips, zero where none is given."""
        return self._of_grips('motion', self.grip_motion, (count, 6))

    def grip_forces(self, count: int) -> Array:
        """(count, 3) of the grips, zero where none is given."""
        return self._of_grips('force', self.grip_force, (count, 3))

    def _of_grips(self, what: str, values: Array | None, shape: tuple[int, int]) -> Array:
        if values is None:
            return np.zeros(shape)
        if values.shape != shape:
            raise LoadCaseError(
                f'{shape[0]} grips need a {what} of {shape[0]} x {shape[1]} numbers, got shape '
                f'{values.shape}'
            )
        return values

    def refuse_pads(self, method: str) -> None:
        """Raise LoadCaseError where a contact is a pad, which `method` cannot treat."""
        if self.padded.any():
            raise LoadCaseError(f'{method} takes pins, no rigid pads; use Newton steps for pads')


def forced(contacts: tuple[ContactPatch, ...], force: Array | list[float]) -> LoadCase:
    """Load case with the push [N] prescribed at every contact."""
    values = np.asarray(force, dtype=float)
    return LoadCase(contacts, values, np.full(len(values), np.nan))


def displaced(contacts: tuple[ContactPatch, ...], displacement: Array | list[float]) -> LoadCase:
    """Load case with the centre displacement [m] prescribed at every contact."""
    values = np.asarray(displacement, dtype=float)
    return LoadCase(contacts, np.full(len(values), np.nan), values)


def gripped(motion: Array, force: Array | None = None) -> LoadCase:
    """Load case of grips alone: their `motion` (g, 6), and `force` (g, 3) where they are free."""
    return LoadCase((), np.zeros(0), np.zeros(0), grip_motion=motion, grip_force=force)


@dataclass(frozen=True)
class PathState:
    """A passed state: what was prescribed (k,) [m] or [N], and all its unknowns [m]."""

    control: Array
    positions: Array


@dataclass(frozen=True, repr=False)
class Equilibrium:
    """An equilibrium, or, where `converged` is false, the last good state on the way to it.

    Attributes:
        converged: whether the whole load case is carried.
        message: why not, in one sentence; empty when converged.
        positions: (n, 3) control points of the middle surface [m].
        force: (k,) push of each contact [N]. displacement: (k,) of each centre or pad [m].
        multipliers: (m,) reactions of held contacts and free rigid motions [N].
        unbalance: (6,) resultant force [N] and moment [N m] about the origin that the applied
            loads leave to supports and rigid-motion constraints.
        energy: strain and gas energy [J]. gas_pressure: overpressure [Pa].
        filled: share of the model's own pressures that it carries, 1 when converged.
        residual: unbalanced nodal force relative to the loads [-].
        iterations: linear solves. factorisations: stiffness factorisations.
        load_fraction: share of the load case that is carried, 1 when converged.
        end: how the way there ended. A converged state with `End.SNAP` is the next one on the
            equilibrium path; a jump under dead load may land on another.
        negative_modes: directions of negative stiffness under these controls, None if not asked.
        dead_load: (3 n,) other load carried [N]; empty for none.
        pad_load: (3 n,) what the rigid pads push with [N]; empty for none.
        grip_motion: (g, 6) of the grips, as prescribed; empty without grips.
        grip_pose: (g, 6) the same with what is free of it. grip_wrench: (g, 6) force [N] on the
            object, and torque [N m] about the point about which it turns, where that has moved to.
        pressed_points: how many quadrature points each rigid pad or body presses.
        touches: what each rigid body does to the points that it presses.
        memory: what the bodies' contacts remember for the next state, None without bodies.
        motion: (k, 6) of the bodies beside their depth, as in the load case, or None.
        history: up to three states that led here, this one last.
        wall: (., 3) unknowns beside the control points, see `ThickShell`; none in a thin wall.
        shell: whose unknowns these are; its contacts decide what stands where in `wall`.
    """

    converged: bool
    message: str
    positions: Array
    force: Array
    displacement: Array
    multipliers: Array
    unbalance: Array
    energy: float
    gas_pressure: float
    residual: float
    iterations: int
    factorisations: int
    load_fraction: float = 1.0
    filled: float = 1.0
    end: End = End.CARRIED
    negative_modes: int | None = None
    dead_load: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    pad_load: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    grip_motion: Array = field(default_factory=lambda: np.zeros((0, 6)), repr=False)
    grip_pose: Array = field(default_factory=lambda: np.zeros((0, 6)))
    grip_wrench: Array = field(default_factory=lambda: np.zeros((0, 6)))
    pressed_points: tuple[int, ...] = ()
    touches: tuple[Touch, ...] = field(default=(), repr=False)
    memory: Memory | None = field(default=None, repr=False)
    motion: Array | None = field(default=None, repr=False)
    history: tuple[PathState, ...] = field(default=(), repr=False)
    wall: Array = field(default_factory=lambda: np.zeros((0, 3)), repr=False)
    shell: Discretisation | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        end = self.end.value if self.converged else self.message
        return (
            f'<Equilibrium {end}: force {self.force} N, displacement {self.displacement} m, '
            f'energy {self.energy:.6g} J>'
        )

    @property
    def unknowns(self) -> Array:
        """All unknowns, rows of three; the control points come first."""
        return np.concatenate([self.positions, self.wall])

    @property
    def stable(self) -> bool | None:
        """Whether no direction of negative stiffness is left; None when it was not asked."""
        return None if self.negative_modes is None else self.negative_modes == 0
