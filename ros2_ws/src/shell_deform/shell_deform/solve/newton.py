"""Equilibrium of a shell model: Newton's method with few factorisations and adaptive load steps.

One factorisation serves several iterations as long as each shrinks the residual well (the chord
method); a step that does not converge is halved. Contacts whose displacement is prescribed carry
their force as an unknown, so limit points in force are no obstacle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.model import ShellModel, Tangent, diagonal_entry
from shell_deform.solve.bordered import BorderedSystem
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, PathState
from shell_deform.solve.factor import Factor, SymbolicFactor, analyse, factorise
from shell_deform.supports import free_rigid_modes
from shell_deform.theory import THEORIES

Array = NDArray[np.float64]

# A step longer than this many of the last one is not extrapolated.
LONGEST_PREDICTION = 2.0


@dataclass(frozen=True)
class NewtonOptions:
    """How hard to try.

    Attributes:
        tolerance: residual force relative to the loads [-].
        factorisations: at most so many in one load step before it is halved.
        contraction: a residual shrinking less than this per iteration asks for a new stiffness.
        smallest_step: give up below this share of the load case.
        largest_move: displacement change [in wall thicknesses] beyond which a step is halved.
        stability: whether to count negative modes at the end.
    """

    tolerance: float = 1e-9
    factorisations: int = 9
    contraction: float = 0.25
    smallest_step: float = 1.0 / 256.0
    largest_move: float = 8.0
    stability: bool = False


@dataclass(frozen=True)
class Borders:
    """Dense parts of the system for one load case: what pushes, what measures, what is held."""

    push: Array
    measure: Array
    held: Array
    dead: Array
    driven: NDArray[np.bool_]

    @property
    def unknown_pushes(self) -> Array:
        """(r, d) patterns of the forces that are unknowns."""
        return self.push[:, self.driven]


def borders(model: ShellModel, case: LoadCase) -> Borders:
    """Reduced rows and patterns of a load case, with the rigid motions nothing prevents."""
    contacts = case.contacts
    size = model.rest.shape
    free = model.free_modes.shape[0]
    push = np.zeros((free, len(contacts)))
    measure = np.zeros((free, len(contacts)))
    held = []
    dead = np.zeros(size) if case.dead_load is None else case.dead_load.copy()
    for i, contact in enumerate(contacts):
        push[:, i] = contact.force_pattern(contact.axis).reshape(-1)
        measure[:, i] = contact.displacement_row().reshape(-1)
        if case.held:
            held.extend(row.reshape(-1) for row in contact.held_rows())
        if case.lateral is not None:
            dead += contact.force_pattern(case.lateral[i])
    rows = np.stack(held, axis=1) if held else np.zeros((free, 0))
    rows = _independent(rows)
    left = free_rigid_modes(
        model.free_modes, np.concatenate([rows, measure[:, case.driven]], axis=1)
    )
    return Borders(
        push=push,
        measure=measure,
        held=np.concatenate([rows, left], axis=1),
        dead=dead.reshape(-1),
        driven=case.driven,
    )


def _independent(rows: Array) -> Array:
    """Drop rows that supports already keep at zero."""
    norm = np.linalg.norm(rows, axis=0)
    return rows[:, norm > 1e-9 * max(1.0, float(norm.max(initial=0.0)))]


class EquilibriumSolver:
    """Solves load case after load case of one model; the symbolic factorisation is kept."""

    def __init__(self, model: ShellModel, options: NewtonOptions | None = None) -> None:
        self.model = model
        self.options = options or NewtonOptions()
        self._symbolic: SymbolicFactor | None = None
        self._linear_factor: Factor | None = None
        self._wall = float(model.shell.thickness.max())

    def rest(self) -> Equilibrium:
        """The undeformed state, as a start."""
        empty = np.zeros(0)
        return Equilibrium(
            True,
            '',
            self.model.rest,
            empty,
            empty,
            empty,
            np.zeros(6),
            0.0,
            self.model.gas.gauge_pressure if self.model.gas.is_sealed else 0.0,
            0.0,
            0,
            0,
        )

    def solve(self, case: LoadCase, start: Equilibrium | None = None) -> Equilibrium:
        """Equilibrium under `case`, from `start` (default: rest), by as few steps as converge."""
        if THEORIES[self.model.theory].is_linear:
            return self._solve_linear(case)
        start = start or self.rest()
        edge = borders(self.model, case)
        here = self._on_contacts(start, case, edge)
        target_force = np.where(case.driven, 0.0, case.force)
        target_moved = np.where(case.driven, case.displacement, 0.0)
        first_force = np.where(case.driven, 0.0, here.force)
        first_moved = np.where(case.driven, here.displacement, 0.0)
        fraction, step = 0.0, 1.0
        iterations = factorisations = 0
        message = ''
        while fraction < 1.0 - 1e-12:
            trial = min(1.0, fraction + step)
            force = first_force + trial * (target_force - first_force)
            moved = first_moved + trial * (target_moved - first_moved)
            control = np.where(case.driven, moved, force)
            guess = _predicted(here, control)
            found = self.step(edge, force, moved, trial * edge.dead, here, guess)
            iterations += found.iterations
            factorisations += found.factorisations
            if found.converged:
                passed = PathState(control, found.positions)
                here = replace(found, history=(*here.history, passed)[-3:])
                fraction = trial
                step *= 1.6
                continue
            message = found.message
            step = 0.5 * (trial - fraction)
            if step < self.options.smallest_step:
                break
        done = fraction >= 1.0 - 1e-12
        return replace(
            here,
            converged=done,
            message='' if done else f'{message} (at {100 * fraction:.1f} % of the load case)',
            iterations=iterations,
            factorisations=factorisations,
            load_fraction=fraction,
            unbalance=self._unbalance(edge, here),
            negative_modes=self._negative_modes(edge, here) if self.options.stability else None,
        )

    def sweep(self, cases: list[LoadCase], start: Equilibrium | None = None) -> list[Equilibrium]:
        """Equilibria of a list of load cases, each started from the ones before it."""
        results: list[Equilibrium] = []
        here = start
        for case in cases:
            here = self.solve(case, here)
            results.append(here)
            if not here.converged:
                break
        return results

    def tangent_columns(self, case: LoadCase, state: Equilibrium) -> tuple[Array, Array]:
        """Response to unit pushes at `state`: displacements (n, 3, k) [m/N], centres (k, k).

        Every contact counts as forced here; the second result is the motion of each contact's
        centre along its axis under each push.
        """
        edge = borders(
            self.model,
            replace(
                case,
                force=np.zeros(len(case.contacts)),
                displacement=np.full(len(case.contacts), np.nan),
            ),
        )
        columns = self.respond(state, edge, edge.push)
        return columns.reshape(-1, 3, columns.shape[1]), edge.measure.T @ columns

    def respond(self, state: Equilibrium, edge: Borders, loads: Array) -> Array:
        """Displacements (N, k) per unit of the loads (N, k), by the tangent at `state`."""
        system, _ = self._system(self.model.tangent(state.positions), edge)
        return system.solve(loads, np.zeros((system.schur.shape[0], loads.shape[1])))[0]

    def factor(self, matrix: sp.csr_matrix) -> Factor:
        """Factorise a stiffness (springs added), reusing the symbolic analysis."""
        if self._symbolic is None:
            self._symbolic = analyse(matrix, self.model.rest, block=3)
        return factorise(self._symbolic, matrix)

    def _solve_linear(self, case: LoadCase) -> Equilibrium:
        edge = borders(self.model, case)
        zero = self.rest()
        here = self._on_contacts(zero, case, edge)
        force = np.where(case.driven, 0.0, case.force)
        moved = np.where(case.driven, case.displacement, 0.0)
        found = self.step(edge, force, moved, edge.dead, here, None, linear=True)
        return replace(found, unbalance=self._unbalance(edge, found))

    def _on_contacts(self, start: Equilibrium, case: LoadCase, edge: Borders) -> Equilibrium:
        """The start state seen with the contacts of `case`."""
        moved = edge.measure.T @ (start.positions - self.model.rest).reshape(-1)
        same = len(start.force) == len(case.contacts)
        return replace(
            start,
            displacement=moved,
            force=start.force if same else np.zeros(len(case.contacts)),
            multipliers=np.zeros(edge.held.shape[1]),
        )

    def _system(self, tangent: Tangent, edge: Borders) -> tuple[BorderedSystem, Factor]:
        """Bordered system: unknown pushes, held rows, springs taken back, gas."""
        matrix = tangent.stiffness.copy()
        springs = self.model.springs
        diagonal = matrix.diagonal()
        stiff = float(np.median(diagonal[diagonal > 0])) if len(springs) else 1.0
        for dof in springs:
            matrix.data[diagonal_entry(matrix, int(dof))] += stiff
        factor = self.factor(matrix)
        size = matrix.shape[0]
        columns = [-edge.unknown_pushes, edge.held]
        rows = [edge.measure[:, edge.driven], edge.held]
        corner = [np.zeros(columns[0].shape[1]), np.zeros(edge.held.shape[1])]
        if len(springs):
            pins = np.zeros((size, len(springs)))
            pins[springs, np.arange(len(springs))] = 1.0
            columns.append(pins)
            rows.append(pins)
            corner.append(np.full(len(springs), 1.0 / stiff))
        if tangent.gas_stiffness:
            gas = tangent.gas_row[:, None]
            columns.append(gas)
            rows.append(gas)
            corner.append(np.array([-1.0 / tangent.gas_stiffness]))
        system = BorderedSystem(
            factor,
            matrix,
            np.concatenate(columns, axis=1),
            np.concatenate(rows, axis=1),
            np.diag(np.concatenate(corner)),
        )
        return system, factor

    def step(
        self,
        edge: Borders,
        force: Array,
        moved: Array,
        dead: Array,
        here: Equilibrium,
        guess: Array | None,
        linear: bool = False,
    ) -> Equilibrium:
        """One load step without halving.

        `edge.driven` contacts are moved to `moved`, the others pushed by `force`; `dead` (N,) is
        the other load. `guess` are control points (n, 3) to start from instead of those of `here`.
        """
        model, options = self.model, self.options
        fixed_push = edge.push[:, ~edge.driven] @ force[~edge.driven] + dead
        positions = here.positions if guess is None else guess
        free = (positions - model.rest).reshape(-1)
        unknown, held = int(edge.driven.sum()), edge.held.shape[1]
        state = here
        system: BorderedSystem | None = None
        previous = np.inf
        tangent = None
        iterations = factorisations = 0
        message = 'Newton iterations did not converge'
        reference_move = options.largest_move * self._wall
        while True:
            if system is None:
                if factorisations == options.factorisations:
                    break
                tangent = model.tangent(positions)
                if not np.all(np.isfinite(tangent.gradient)):
                    message = 'the surface folded onto itself'
                    break
                gradient, energy = tangent.gradient, tangent.energy
                system, _ = self._system(tangent, edge)
                factorisations += 1
            below = np.zeros(system.schur.shape[0])
            below[:unknown] = (moved - edge.measure.T @ free)[edge.driven]
            below[unknown : unknown + held] = -edge.held.T @ free
            step, border = system.solve(fixed_push - gradient, below, refinements=1)
            iterations += 1
            if not np.all(np.isfinite(step)):
                message = 'the stiffness is singular'
                break
            largest = float(np.abs(step).max(initial=0.0))
            if largest > reference_move and not linear:
                message = f'an iteration moved the surface by {1e3 * largest:.1f} mm'
                break
            free = free + step
            positions = model.rest + free.reshape(-1, 3)
            energy, gradient = model.gradient(positions)
            pushes = force.copy()
            pushes[edge.driven] = border[:unknown]
            multipliers = border[unknown : unknown + held]
            carried = edge.push @ pushes + dead
            loose = gradient - carried + edge.held @ multipliers
            scale = max(
                float(np.linalg.norm(carried)),
                float(np.linalg.norm(edge.held @ multipliers)),
                self._noise_force(),
            )
            residual = float(np.linalg.norm(loose)) / scale
            if residual < options.tolerance or linear:
                state = Equilibrium(
                    converged=bool(residual < 1e-6 if linear else True),
                    message='' if residual < 1e-6 else 'the linear system is singular',
                    positions=positions,
                    force=pushes,
                    displacement=edge.measure.T @ free,
                    multipliers=multipliers,
                    unbalance=np.zeros(6),
                    energy=energy,
                    gas_pressure=self._gas_pressure(positions, linear),
                    residual=residual,
                    iterations=iterations,
                    factorisations=factorisations,
                )
                return state
            if not np.isfinite(residual):
                message = 'the surface folded onto itself'
                break
            if residual > options.contraction * previous or factorisations == 0:
                system = None
            previous = residual
        return replace(
            here,
            converged=False,
            message=message,
            iterations=iterations,
            factorisations=factorisations,
        )

    def _noise_force(self) -> float:
        """Force [N] below which round-off in the stiffness hides any load."""
        shell = self.model.shell
        membrane = float(shell.membrane[:, 0, 0].max())
        return 1e-7 * membrane * self._wall

    def _gas_pressure(self, positions: Array, linear: bool) -> float:
        model = self.model
        if not (model.gas.is_sealed or model.pressure):
            return 0.0
        if linear:
            rest = model.rest_tangent
            change = float(rest.gas_row @ (positions - model.rest).reshape(-1))
            return rest.gas_pressure - rest.gas_stiffness * change
        return model.overpressure(model.shell.volume(positions)[0])

    def _unbalance(self, edge: Borders, state: Equilibrium) -> Array:
        """Resultant and moment of the applied loads about the origin."""
        carried = (edge.push @ state.force + edge.dead).reshape(-1, 3)
        moment = np.cross(state.positions, carried).sum(axis=0)
        return np.concatenate([carried.sum(axis=0), moment])

    def _negative_modes(self, edge: Borders, state: Equilibrium) -> int:
        """Negative directions of the stiffness among motions the constraints allow.

        Haynsworth: the inertia of the symmetric bordered matrix is that of the factorised part
        plus that of its Schur complement; every independent constraint adds one negative and one
        positive, gas one negative.
        """
        symmetric = replace(edge, measure=-edge.push)
        tangent = self.model.tangent(state.positions)
        system, factor = self._system(tangent, symmetric)
        negative = factor.inertia.negative + int(np.sum(np.linalg.eigvalsh(system.schur) < 0))
        constraints = int(edge.driven.sum()) + edge.held.shape[1]
        return negative - constraints - (1 if tangent.gas_stiffness else 0)


def _predicted(here: Equilibrium, control: Array) -> Array | None:
    """Control points expected at `control` (k,), by the parabola through the last states.

    None where the path behind says nothing: too short, or a step back or aside.
    """
    path = here.history
    if len(path) < 2 or len(path[-1].control) != len(control):
        return None
    last = path[-1].control - path[-2].control
    length = float(last @ last)
    ahead = float((control - path[-1].control) @ last) / length if length > 0 else 0.0
    if not 0.0 < ahead <= LONGEST_PREDICTION:
        return None
    now, then = path[-1].positions, path[-2].positions
    if len(path) < 3 or len(path[-3].control) != len(control):
        return now + ahead * (now - then)
    gap = float((path[-2].control - path[-3].control) @ last) / length
    if gap <= 0.0:
        return now + ahead * (now - then)
    first = (ahead + 1.0) * (ahead + 1.0 + gap) / (1.0 + gap)
    second = -ahead * (ahead + 1.0 + gap) / gap
    third = ahead * (ahead + 1.0) / (gap * (1.0 + gap))
    return first * now + second * then + third * path[-3].positions
