# SPDX-License-Identifier: Apache-2.0
"""Following an equilibrium while its load case changes a little at a time.

The factorised tangent of the last state serves the accelerated chord iterations to the next one,
and the tangent that the condensed columns need there anyway becomes the factor of the step after:
one factorisation per refresh. A step the chord does not carry is halved, with a new tangent each
time a part of it is reached.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.pin_pressures import PressureEquations
from shell_deform.live.background.condensed import (
    Condensed,
    CondensedSystem,
    ContactRows,
    SprungFactor,
    factorise_sprung,
)
from shell_deform.live.background.tracked_state import Loose, State, Target
from shell_deform.model import ShellModel, Tangent
from shell_deform.solve.anderson import AndersonMixing
from shell_deform.solve.equilibrium import Equilibrium, PathState
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.prediction import predicted
from shell_deform.supports.grips import carried_as_one, longest_share

Array = NDArray[np.float64]

SMALLEST_STEP = 1.0 / 256.0

PATH = 6
"""States behind the present one that are kept: some of them may be too near to lead on."""

NEAR_TANGENT = 0.02
"""While newer load cases wait, a tangent gives the columns of states within this share of the wall
thickness. It may be that of an iteration without balance: its stresses, and by them the stiffness,
are off by some percent."""

BALANCED = 1e-12
"""Unbalanced force, over that of the shell, which is round-off."""


@dataclass(frozen=True)
class TrackingOptions:
    """How hard to try.

    Attributes:
        residual: relative residual force that ends the iterations.
        step: or a last correction below this share of the wall thickness.
        iterations: per step. contraction: iterations slower than this, so many in a row as
            `patience` tells, ask for a new tangent; so does one that is `growth` times as long.
        tangents: at most so many new tangents per advance; tangents_per_step: per step.
        largest_move: correction in wall thicknesses beyond which a step is halved; longer ones
            may land on another branch of a shell that has several.
    """

    residual: float = 1e-7
    step: float = 2e-5
    iterations: int = 25
    contraction: float = 0.7
    patience: int = 3
    growth: float = 4.0
    tangents: int = 24
    tangents_per_step: int = 3
    largest_move: float = 1.0


class EquilibriumTracker:
    """One shell, its present state, and the factorised tangent there."""

    def __init__(self, model: ShellModel, options: TrackingOptions | None = None) -> None:
        self.model = model
        self.options = options or TrackingOptions()
        self._solver = EquilibriumSolver(model)
        self._wall = float(model.shell.thickness.max())
        self._noise_force = 1e-7 * float(model.shell.membrane[:, 0, 0].max()) * self._wall
        self._bare = model
        self._bare_rest: tuple[Tangent, SprungFactor] | None = None
        self._tangent: Tangent | None = None
        self._tangent_at = np.zeros(0)
        self._pressures: PressureEquations | None = None
        self._factor: SprungFactor | None = None
        self._budget = self.options.tangents
        self._system: CondensedSystem | None = None
        self.factorisations = 0
        self.iterations = 0
        self.tried = 0
        """Iterations of the last advance: how far the tangent had to be stretched."""
        self.message = ''
        self.beat: Callable[[], None] = lambda: None
        """Called in every iteration: whoever watches sees that this gets on."""
        self._rest: tuple[Tangent, SprungFactor] | None = None
        self.reset()

    def reset(self) -> None:
        """Back to the undeformed state without contacts."""
        self._use(self._bare)
        empty = np.zeros(0)
        still = np.zeros((len(self.model.grips), 6))
        energy, gradient, missing = self._balance(self.model.start, still)
        moved = np.zeros(self.model.start.size)
        self.state = State(moved, empty, empty, energy, gradient, missing, 0.0, still)
        self.rows: ContactRows | None = None
        self._target: Target | None = None
        self._path: tuple[PathState, ...] = ()
        self._fresh = False
        self._tangent = None
        self._system = None

    @property
    def unknowns(self) -> Array:
        """All unknowns of the present state, rows of three."""
        return self.model.start + self.state.moved.reshape(-1, 3)

    @property
    def positions(self) -> Array:
        """(n, 3) control points of the present state."""
        return self.unknowns[: len(self.model.rest)]

    def start_from(self, found: Equilibrium) -> None:
        """Go on from an equilibrium without contacts."""
        self._go_on_at(self.model.shell.continued(found.shell or self.model.shell, found.unknowns))

    def take(self, model: ShellModel) -> None:
        """Go on, in the present shape, with this model of the same shell under other contacts."""
        if model is self.model:
            return
        unknowns = model.shell.continued(self.model.shell, self.unknowns)
        self._use(model)
        self._go_on_at(unknowns)

    def _go_on_at(self, unknowns: Array) -> None:
        energy, gradient, missing = self._balance(unknowns, self.state.grips)
        moved = (unknowns - self.model.start).reshape(-1)
        self.state = replace(
            self.state, moved=moved, energy=energy, gradient=gradient, missing=missing
        )

    def _use(self, model: ShellModel) -> None:
        if model is not self.model:
            self.model, self._rest = model, None
            self._solver.take(model)
            self._tangent = self._factor = self._system = None
            self._fresh = False

    def set_contacts(self, rows: ContactRows, force: Array) -> None:
        """Continue from the present shape with another set of contacts and these pushes [N]."""
        self.rows = rows
        count = rows.constraints.shape[1]
        self.state = replace(
            self.state, force=np.asarray(force, float), multipliers=np.zeros(count)
        )
        self._target = None
        # Where the last contacts were going says nothing of these.
        self._path = ()
        self._system = None

    def forget_tangent(self) -> None:
        """The state was replaced: its tangent is another one."""
        self._path = ()
        self._fresh = False
        self._renew()

    def rest_tangent(self, positions: Array) -> tuple[Tangent, SprungFactor]:
        """Tangent at the unloaded control `positions` (n, 3) with its factor, kept.

        That of the shell without contacts, which a thick wall carries as unknowns.
        """
        if self._bare_rest is None:
            solver = self._solver if self.model is self._bare else EquilibriumSolver(self._bare)
            tangent = self._bare.tangent(self._bare.shell.continued(self._bare.shell, positions))
            self._bare_rest = tangent, factorise_sprung(solver, tangent)
        return self._bare_rest

    def rest_system(self, positions: Array, rows: ContactRows) -> CondensedSystem:
        """The system of these contacts at the unloaded control `positions` (n, 3)."""
        if self.model is self._bare:
            self._rest = self.rest_tangent(positions)
        elif self._rest is None:
            tangent = self.model.tangent(self.unloaded(positions))
            self._rest = tangent, factorise_sprung(self._solver, tangent)
        tangent, factor = self._rest
        return CondensedSystem(factor, tangent, rows)

    def unloaded(self, positions: Array) -> Array:
        """All unknowns at the unloaded control `positions` (n, 3)."""
        return self.model.shell.continued(self._bare.shell, positions)

    def present(self, driven: NDArray[np.bool_]) -> Target:
        """The present values of everything that can be prescribed."""
        rows = self._rows()
        values = rows.constraints.T @ self.state.moved
        split = rows.held.shape[1]
        return Target(
            self.state.force,
            rows.measure.T @ self.state.moved,
            driven,
            values[split:],
            values[:split],
            self.state.grips,
        )

    def system(self) -> CondensedSystem:
        """The factorised tangent at or near the present state."""
        if self._system is None:
            self._fresh = self._fresh or self._tangent is None
            self._linearise(self.unknowns, self.state.grips)
        assert self._system is not None
        return self._system

    def _linearise(self, positions: Array, grips: Array) -> None:
        """Factorise the tangent at these unknowns and motions of `grips`, unless one is kept."""
        if self._tangent is None or self._factor is None:
            # The old factor goes first: two of them are the largest thing in memory.
            self._factor = self._system = None
            self._tangent = self.model.tangent(positions, self.model.held_target(grips))
            self._tangent_at = (positions - self.model.start).reshape(-1)
            self._pressures = self.model.pressure_equations(positions)
            self._factor = factorise_sprung(self._solver, self._tangent)
            self.factorisations += 1
        self._system = CondensedSystem(self._factor, self._tangent, self._rows())

    @property
    def is_near_tangent(self) -> bool:
        """Whether the tangent at hand was taken next to the present state."""
        if self._tangent is None:
            return False
        return bool(np.abs(self.state.moved - self._tangent_at).max() < NEAR_TANGENT * self._wall)

    def condense(self, exactly: bool = True) -> Condensed:
        """Columns about the present state; not `exactly`: by the tangent at hand.

        A new factor also takes the Newton step that the chord iterations left over.
        """
        if exactly:
            self._renew()
        system = self.system()
        if self._target is not None:
            self._polish(self._target)
        return system.condense()

    def _balance(self, unknowns: Array, grips: Array) -> tuple[float, Array, Array]:
        """Energy [J], gradient (N,) [N] and gaps under pins (c,) [m^3] at all `unknowns`.

        `grips`: (g, 6) their motions.
        """
        energy, gradient = self.model.gradient(unknowns, self.model.held_target(grips))
        now = self.model.pressure_equations(unknowns)
        if now is None:
            return energy, gradient, np.zeros(0)
        # The gradient has the gaps closed by this state's equations; iterations close them by
        # those of their tangent.
        return energy, gradient - now.pull(now.missing, gradient.size), now.missing

    def _closed(self, state: State, loose: Loose) -> Array:
        """(N,) gradient of a state with the gaps under its pins closed as the tangent does."""
        if self._pressures is None or not len(state.missing):
            return state.gradient
        return state.gradient + self._pressures.pull(
            state.missing - loose.gaps, state.gradient.size
        )

    def _moved(self, state: State, step: Array, loose: Loose) -> Array:
        """(N,) displacement after a step by the tangent at hand, with the pressures' own step."""
        if self._pressures is not None and len(state.missing):
            step = self._pressures.followed(step, state.missing - loose.gaps)
        return state.moved + step

    def _polish(self, target: Target) -> None:
        """One Newton step, if it is as short as the iterations promised."""
        state, tangent = self.state, self._tangent
        assert tangent is not None
        nothing = Loose(np.zeros_like(state.moved), np.zeros_like(state.missing))
        step, multipliers, force = self._step(target, state, nothing)
        if not np.abs(step).max() < self.options.step * self._wall:
            return
        change = tangent.stiffness @ step
        change += tangent.gas_stiffness * tangent.gas_row * (tangent.gas_row @ step)
        gradient = self._closed(state, nothing)
        self.state = replace(
            state,
            moved=self._moved(state, step, nothing),
            force=force,
            multipliers=multipliers,
            energy=state.energy + float((gradient + 0.5 * change) @ step),
            gradient=gradient + change,
            missing=np.zeros_like(state.missing),
        )

    def within(self, target: Target, reach: float) -> tuple[Target, float]:
        """A target on the way that moves no contact further than `reach` [m], and which share."""
        start = self.present(target.driven)
        moved = target.displacement - start.displacement
        if not target.driven.all():
            soft = self.system().compliance @ np.where(
                target.driven, 0.0, target.force - start.force
            )
            moved = np.where(target.driven, moved, soft)
        size = float(np.abs(moved).max(initial=0.0))
        if not size > reach:
            return target, 1.0
        return start.towards(target, reach / size), reach / size

    def advance(self, target: Target, tangents: int | None = None) -> float:
        """Go towards `target` by as few steps as converge; returns the share that was reached.

        It may take so many new `tangents`, and not more than the options say. A share below one
        leaves the tracker at an equilibrium on the way and says why in `message`.
        """
        start = self.present(target.driven)
        loose = self._loose()
        reached, step, self.tried = 0.0, 1.0, 0
        most = self.options.tangents
        self._budget = most if tangents is None else min(tangents, most)
        self.message = ''
        together = self._carried_along(target) is not None
        longest = longest_share(start.grips, target.grips, together)
        while reached < 1.0:
            step = min(step, longest)
            trial = min(1.0, reached + step)
            goal = start.towards(target, trial)
            self._path = (*self._path, self._passed(target.driven))[-PATH:]
            found = self._iterate(goal, loose.part(1.0 - trial))
            if found is not None:
                self.state = found
                self._target = goal if trial == 1.0 else None
                self._fresh = False
                reached = trial
                step *= 1.5
                continue
            self._renew()
            step = 0.5 * (trial - reached)
            if self._budget <= 0 or step < SMALLEST_STEP:
                self.message = self.message or 'the load case changes faster than the solver'
                return reached
        self.message = ''
        return 1.0

    def _rows(self) -> ContactRows:
        assert self.rows is not None, 'set_contacts comes first'
        return self.rows

    def _renew(self) -> None:
        """Ask for a tangent at the present state."""
        if not self._fresh:
            self._tangent = None
            self._system = None

    def _loose(self) -> Loose:
        """What keeps the present state but is no longer there."""
        rows, state = self._rows(), self.state
        held = rows.constraints @ state.multipliers
        return Loose(state.gradient - rows.push @ state.force + held, state.missing)

    def _step(self, target: Target, state: State, loose: Loose) -> tuple[Array, Array, Array]:
        """Newton step (N,) from `state` by the tangent at hand, new multipliers and pushes."""
        rows, system, driven = self._rows(), self.system(), target.driven
        prescribed = np.concatenate([target.held, target.rigid])
        held, carried = rows.constraints @ state.multipliers, rows.push @ state.force
        gradient = self._closed(state, loose)
        unbalanced = carried + loose.force - held - gradient
        # What a Newton step left in balance is not worth the triangular solves.
        if np.linalg.norm(unbalanced) < BALANCED * np.linalg.norm(gradient):
            unbalanced = np.zeros_like(unbalanced)
        step, multipliers = system.solve(unbalanced, prescribed - rows.constraints.T @ state.moved)
        more = np.where(driven, 0.0, target.force - state.force)
        if driven.any():
            missing = target.displacement - rows.measure.T @ (state.moved + step)
            missing = (missing - system.compliance @ more)[driven]
            more[driven] = np.linalg.lstsq(
                system.compliance[np.ix_(driven, driven)], missing, rcond=None
            )[0]
        return (
            step + system.push_fields @ more,
            state.multipliers + multipliers + system.push_multipliers @ more,
            state.force + more,
        )

    def _passed(self, driven: NDArray[np.bool_]) -> PathState:
        """The present state as one of those through which a parabola leads on."""
        state = self.state
        moved = self._rows().measure.T @ state.moved
        vector = np.concatenate([state.moved, state.force, state.multipliers])
        control = np.where(driven, moved, state.force)
        return PathState(np.concatenate([control, state.grips.ravel()]), vector)

    def _ahead(self, target: Target, loose: Loose) -> State:
        """Where the path through the last states leads; where the grips are if it says nothing."""
        state = self.state
        control = np.where(target.driven, target.displacement, target.force)
        control = np.concatenate([control, target.grips.ravel()])
        along = self._carried_along(target)
        vector = (
            predicted(self._path, control) if not loose.force.any() and along is None else None
        )
        if vector is None:
            return state if np.array_equal(state.grips, target.grips) else self._at(target, along)
        moved, force, multipliers = np.split(
            vector, np.cumsum([len(state.moved), len(state.force)])
        )
        positions = self.model.start + moved.reshape(-1, 3)
        energy, gradient, missing = self._balance(positions, target.grips)
        if not np.isfinite(energy):
            return self._at(target, None)
        return State(moved, force, multipliers, energy, gradient, missing, np.inf, target.grips)

    def _carried_along(self, target: Target) -> Array | None:
        """(n, 3) the shell where grips are all that holds it and move as one, or None."""
        model, state = self.model, self.state
        thin = len(model.start) == len(model.rest)
        if model.supports is not None or len(state.force) or not thin:
            return None
        return carried_as_one(model.grips, state.grips, target.grips, self.positions)

    def _at(self, target: Target, along: Array | None) -> State:
        """The present state, or `along` (n, 3), with the grips where `target` has them."""
        unknowns = self.unknowns
        if along is not None:
            # The stiffness turns with it; that of before would say nothing of it.
            unknowns, self._fresh, self._tangent = along, False, None
            self._linearise(along, target.grips)
        energy, gradient, missing = self._balance(unknowns, target.grips)
        return replace(
            self.state,
            moved=(unknowns - self.model.start).reshape(-1),
            energy=energy,
            gradient=gradient,
            missing=missing,
            grips=target.grips,
        )

    def _reach(self, target: Target) -> float:
        """How far the grips carry what they hold [m], and so may a first step."""
        model, now_held = self.model, self.state.grips
        if np.array_equal(now_held, target.grips):
            return 0.0
        ways = [
            after.target(model.rest, now) - after.target(model.rest, before)
            for after, now, before in zip(model.grips, target.grips, now_held, strict=True)
        ]
        return (1.0 + len(ways)) * max(float(np.abs(way).max()) for way in ways)

    def _iterate(self, target: Target, loose: Loose) -> State | None:
        """The state under `target` and what is still `loose`, or None.

        Accelerated chord iterations on the tangent at hand; where they contract too slowly, a new
        tangent.
        """
        options, state = self.options, self._ahead(target, loose)
        mixing = AndersonMixing(len(state.moved))
        reach = self._reach(target)
        before, slow, tangents = np.inf, 0, options.tangents_per_step
        for _ in range(options.iterations):
            self.beat()
            step, multipliers, force = self._step(target, state, loose)
            self.iterations += 1
            self.tried += 1
            largest = float(np.abs(step).max(initial=0.0))
            if not largest < options.largest_move * self._wall + reach:
                self.message = f'an iteration moved the surface by {1e3 * largest:.1f} mm'
                return None
            slow = slow + 1 if largest > options.contraction * before else 0
            renew = slow == options.patience or largest > options.growth * before
            if renew and (tangents == 0 or self._budget <= 0):
                self.message = 'the iterations did not converge'
                return None
            at = np.concatenate([state.moved, state.force, state.multipliers])
            reached = np.concatenate([self._moved(state, step, loose), force, multipliers])
            onward = mixing.next(at, reached - at)
            found = self._judged(target, onward, loose)
            if found is None:
                self.message = 'the surface folded onto itself'
                return None
            state = found
            if state.residual < options.residual or largest < options.step * self._wall:
                return state
            before, reach = largest, 0.0
            if renew:
                tangents -= 1
                self._budget -= 1
                self._fresh, self._tangent = False, None
                self._linearise(self.model.start + state.moved.reshape(-1, 3), target.grips)
                mixing.forget()
                before, slow = np.inf, 0
        self.message = 'the iterations did not converge'
        return None

    def _judged(self, target: Target, onward: Array, loose: Loose) -> State | None:
        """The state with these displacements, pushes and multipliers; None where it is none."""
        rows = self._rows()
        split = len(onward) - rows.contacts - rows.constraints.shape[1]
        moved, force, multipliers = np.split(onward, [split, split + rows.contacts])
        positions = self.model.start + moved.reshape(-1, 3)
        energy, gradient, missing = self._balance(positions, target.grips)
        held, carried = rows.constraints @ multipliers, rows.push @ force
        scale = max(float(np.linalg.norm(carried)), float(np.linalg.norm(held)), self._noise_force)
        state = State(moved, force, multipliers, energy, gradient, missing, np.inf, target.grips)
        unbalanced = self._closed(state, loose) - carried - loose.force + held
        residual = float(np.linalg.norm(unbalanced)) / scale
        return replace(state, residual=residual) if np.isfinite(residual) else None
