# SPDX-License-Identifier: Apache-2.0
"""A shell by name, squeezed by force or displacement, and what it then looks like.

    ball = load('tennis_ball')
    squeezed = ball.squeeze(displacement=2e-3)
    squeezed.contact_force, squeezed.points, squeezed.stresses.von_mises
    squeezed.figure().savefig('ball.png')

The parts behind it (load cases, solver options, supports) are those of `building`, `solve` and
`readout`; this module only joins them.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.contact.body_file import load_body
from shell_deform.contact.loads import ContactPatch
from shell_deform.contact.region import pressed_areas
from shell_deform.contact.taxels import FingerReading, finger_reading
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject, load_object
from shell_deform.picture import surface_figure
from shell_deform.readout import Readout, mesh_warning, read_out, thickness_warning, von_mises
from shell_deform.solve.equilibrium import End, Equilibrium, LoadCase, displaced, forced
from shell_deform.solve.first_touch import first_touch
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.theory import DEFAULT_THEORY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

UNBALANCED_SHARE = 0.01
"""An unbalanced moment below this share of the pushes times the object's size is not told."""

FEWEST_POINTS = 10
"""Quadrature points that a contact patch needs before its size means anything."""


class SqueezeError(ValueError):
    """A squeeze that was not asked for in one way, or that no equilibrium carries.

    `reached`: the states of a sweep up to there.
    """

    reached: tuple[Squeezed, ...] = ()


@dataclass(frozen=True)
class Stresses:
    """Plane stresses of both faces at p quadrature points, in a tangent frame of each.

    Attributes:
        points: (p, 3) on the deformed middle surface [m].
        outer, inner: (p, 3) s_11, s_22, s_12 of the faces [Pa].
    """

    points: Array
    outer: Array
    inner: Array

    @property
    def von_mises(self) -> Array:
        """(p,) equivalent stress [Pa], of the face where it is larger."""
        return np.maximum(von_mises(self.outer), von_mises(self.inner))


@dataclass(frozen=True, eq=False, repr=False)
class Squeezed:
    """A shell in equilibrium under its k contacts.

    Attributes:
        shell: what was squeezed. state: the equilibrium, with everything the solver tells of it.
    """

    shell: Shell
    state: Equilibrium

    @property
    def model(self) -> ShellModel:
        """The model of which this is an equilibrium: a thick wall carries its pins."""
        return self.shell.model.of(self.state.shell)

    @property
    def contact_force(self) -> Array:
        """(k,) push of each contact along its inward axis [N]."""
        return self.state.force

    @property
    def contact_displacement(self) -> Array:
        """(k,) motion of each contact's centre, or pad, along that axis from first touch [m]."""
        return self.state.displacement - self.shell.first_touch

    @property
    def control_points(self) -> Array:
        """(n, 3) deformed control points of the middle surface [m]."""
        return self.state.positions

    @cached_property
    def points(self) -> Array:
        """(n, 3) deformed points of the middle surface [m], those of `shell.points`."""
        return self.shell.model.surface.limit_positions(self.state.positions)

    @cached_property
    def outer_points(self) -> Array:
        """(n, 3) deformed points of the outer face [m], over `points`."""
        return self.model.shell.outer_face(self.state.unknowns)

    @property
    def faces(self) -> NDArray[np.int64]:
        """(m, 3) triangles between the points."""
        return self.shell.faces

    @property
    def displacement(self) -> Array:
        """(n, 3) motion of the points [m]."""
        return self.points - self.shell.points

    @property
    def max_displacement(self) -> float:
        """Largest motion of a point [m]."""
        return float(np.linalg.norm(self.displacement, axis=1).max())

    @cached_property
    def fingers(self) -> tuple[FingerReading, ...]:
        """What the rigid bodies feel: contact region, its part that sticks, forces on cells."""
        return finger_readings(self.shell.description, self.model, self.state)

    @property
    def energy(self) -> float:
        """Strain and gas energy [J]."""
        return self.state.energy

    @property
    def stable(self) -> bool:
        """Whether no direction of negative stiffness is left under these controls."""
        return self.state.stable is not False

    @cached_property
    def readout(self) -> Readout:
        """Strains, stresses and energy density at the quadrature points."""
        limit = self.shell.description.yield_stress_pa
        return read_out(self.model, self.state.unknowns, limit)

    @property
    def stresses(self) -> Stresses:
        """Stresses of both faces."""
        return Stresses(self.readout.points, self.readout.outer_stress, self.readout.inner_stress)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what the numbers are not good for."""
        return warnings_of(self.model, self.state, self.readout)

    def figure(self) -> Figure:
        """A matplotlib figure of the surface coloured by displacement."""
        return surface_figure(self.points, self.faces, self.displacement, str(self))

    def compare(self, scan: Any, **options: Any) -> Any:
        """Compare a scan (a file, or points (s, 3) [m]) with the outer face.

        Returns the `Comparison` of `scan_compare.compare`, which takes the options and must be
        installed.
        """
        from scan_compare import compare

        return compare(scan, self, **options)

    def __str__(self) -> str:
        force, moved = np.mean(self.contact_force), np.max(self.contact_displacement, initial=0.0)
        return f'{self.shell.name}: {force:.3g} N per contact, {1e3 * moved:.3g} mm'

    def __repr__(self) -> str:
        return f'<Squeezed {self}>'

    def _repr_html_(self) -> str:
        """The picture with its numbers, for a notebook."""
        picture = io.BytesIO()
        self.figure().savefig(picture, bbox_inches='tight')
        data = base64.b64encode(picture.getvalue()).decode()
        notes = ''.join(f'<p>{escape(note)}</p>' for note in self.warnings)
        return f'<img alt="{escape(str(self))}" src="data:image/png;base64,{data}">{notes}'


@dataclass(frozen=True, eq=False)
class Sweep(Sequence[Squeezed]):
    """Squeezed states of one shell, one after the other."""

    states: tuple[Squeezed, ...]

    @property
    def contact_force(self) -> Array:
        """(s, k) pushes [N]."""
        return np.array([state.contact_force for state in self.states])

    @property
    def contact_displacement(self) -> Array:
        """(s, k) displacements of the contacts [m]."""
        return np.array([state.contact_displacement for state in self.states])

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: Any) -> Any:
        return self.states[index]

    def __iter__(self) -> Iterator[Squeezed]:
        return iter(self.states)


@dataclass(frozen=True, eq=False, repr=False)
class Shell:
    """A shell with its contacts, ready to be squeezed.

    Attributes:
        description: the object file. model: its mesh, theory, supports and gas.
        contacts: k places where it is touched.
    """

    description: ShellObject
    model: ShellModel
    contacts: tuple[ContactPatch, ...]
    _solver: EquilibriumSolver

    def __repr__(self) -> str:
        return f'<Shell {self}>'

    @property
    def name(self) -> str:
        """Name of the object."""
        return self.description.name

    @cached_property
    def points(self) -> Array:
        """(n, 3) points of the undeformed middle surface [m], one per control vertex."""
        return self.model.surface.limit_positions(self.model.rest)

    @cached_property
    def first_touch(self) -> Array:
        """(k,) displacement of each contact from the undeformed surface at first touch [m].

        Not zero where gas has blown the object up.
        """
        return first_touch(self._solver, self.contacts)[1]

    @property
    def faces(self) -> NDArray[np.int64]:
        """(m, 3) triangles between the points."""
        mesh = self.model.shell.mesh
        return np.asarray(mesh.triangles[mesh.active], np.int64)

    def squeeze(
        self,
        *,
        force: npt.ArrayLike | None = None,
        displacement: npt.ArrayLike | None = None,
        start: Squeezed | None = None,
    ) -> Squeezed:
        """The equilibrium under forces [N] or displacements [m]: one number, or one per contact.

        `start`: a state to go on from. Raises SqueezeError where there is no equilibrium, or not
        exactly one of force and displacement is given.
        """
        case, asked = self._case(force, displacement)
        found = self._solver.solve(case, None if start is None else start.state)
        if not found.converged:
            way = 'prescribe the displacement' if force is not None else 'go there in a sweep'
            raise SqueezeError(f'{self.name}: no equilibrium at {asked}: {found.message}; {way}')
        return Squeezed(self, found)

    def sweep(
        self,
        *,
        force: npt.ArrayLike | None = None,
        displacement: npt.ArrayLike | None = None,
    ) -> Sweep:
        """Equilibria at s forces or displacements, (s,) or (s, k), each from the one before it.

        Raises SqueezeError like `squeeze`.
        """
        _one_of(force, displacement)
        states: list[Squeezed] = []
        for value in np.asarray(displacement if force is None else force, dtype=float):
            asked = {'displacement' if force is None else 'force': value}
            try:
                states.append(self.squeeze(**asked, start=states[-1] if states else None))
            except SqueezeError as error:
                error.reached = tuple(states)
                raise
        return Sweep(tuple(states))

    def _case(
        self, force: npt.ArrayLike | None, displacement: npt.ArrayLike | None
    ) -> tuple[LoadCase, str]:
        """The load case, and the words for what was asked."""
        _one_of(force, displacement)
        values = np.asarray(displacement if force is None else force, dtype=float)
        count = len(self.contacts)
        if values.shape not in ((), (count,)):
            raise SqueezeError(
                f'{self.name} has {count} contacts: give one number or {count}, not an array of '
                f'shape {values.shape}'
            )
        wanted = np.broadcast_to(values, (count,))
        if force is None:
            case = displaced(self.contacts, self.first_touch + wanted)
        else:
            case = forced(self.contacts, wanted)
        numbers = ', '.join(f'{value:g}' for value in np.atleast_1d(values))
        return case, f'{numbers} {"m" if force is None else "N"}'

    def __str__(self) -> str:
        count, reason = len(self.model.rest), self.model.reason
        why = f' ({reason})' if reason else ''
        return f'{self.name}: {self.model.theory} theory{why}, {count} control vertices'


def load(
    name: str | Path,
    *,
    theory: str = DEFAULT_THEORY,
    control_vertices: int | None = None,
    pin_radius: float | None = None,
    young_modulus: float | None = None,
    poisson_ratio: float | None = None,
    thickness: float | None = None,
    gas: Literal['none', 'open', 'sealed'] | None = None,
) -> Shell:
    """A shipped object by name (see `object_names`) or an object file, meshed and discretised.

    `theory`: see `building.build_model`. `control_vertices`: about so many, else the file's.
    `pin_radius` [m] and the material [Pa], [-], [m] stand in for those of the file. Raises
    ObjectError for an object that cannot be read or built, or has no contacts.
    """
    description = with_material(
        load_object(str(name)), young_modulus, poisson_ratio, thickness, gas
    )
    model = build_model(description, theory, control_vertices, refine_radius=pin_radius)
    contacts = object_contacts(description, model, pin_radius)
    return Shell(
        description, model, contacts, EquilibriumSolver(model, NewtonOptions(stability=True))
    )


def finger_readings(
    description: ShellObject, model: ShellModel, state: Equilibrium
) -> tuple[FingerReading, ...]:
    """What each fingertip or pad of an object feels at a state of its model, in their order."""
    fingers = [contact.finger for contact in description.contacts if contact.is_rigid]
    cells = [
        np.zeros((0, 3)) if finger is None else load_body(finger.body, finger.unit).cells
        for finger in fingers
    ]
    if state.memory is None:
        return ()
    return tuple(
        finger_reading(
            touch, pressed_areas(model.outer_face, state.memory, touch), cells[touch.body]
        )
        for touch in state.touches
    )


def warnings_of(model: ShellModel, state: Equilibrium, readout: Readout) -> tuple[str, ...]:
    """Sentences on what the numbers of an equilibrium are not good for."""
    found = [thickness_warning(model), mesh_warning(model.shell.mesh)]
    if state.end is End.SNAP:
        found.append('the shell snaps on the way: a jump under dead load may land elsewhere')
    fewest = min((count for count in state.pressed_points if count), default=FEWEST_POINTS)
    if fewest < FEWEST_POINTS:
        found.append(
            f'a contact patch holds {fewest} quadrature points, fewer than {FEWEST_POINTS}: its '
            'size and pressure are a guess, its depth and force coarse; take more control vertices'
        )
    moment = float(np.linalg.norm(state.unbalance[3:]))
    arm = UNBALANCED_SHARE * float(np.ptp(model.rest, axis=0).max())
    if model.held is None and moment > arm * float(np.abs(state.force).sum()):
        found.append(
            f'the pushes are not in line: a moment of {moment:.3g} N m is left unbalanced and held'
        )
    return (*(warning for warning in found if warning), *readout.warnings)


def _one_of(force: npt.ArrayLike | None, displacement: npt.ArrayLike | None) -> None:
    if (force is None) == (displacement is None):
        raise SqueezeError('give exactly one of force [N] and displacement [m]')
