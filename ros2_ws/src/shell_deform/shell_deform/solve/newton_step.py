# SPDX-License-Identifier: Apache-2.0
"""One load step by Newton's method with few factorisations.

One factorisation serves several iterations as long as each shrinks the residual well (the chord
method). Contacts whose displacement is prescribed carry their force as an unknown, so limit points
in force are no obstacle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.factor.analysis import (
    FactorError,
)
from shell_deform.factor.bordered import BorderedFactor
from shell_deform.model import Tangent
from shell_deform.solve.borders import Borders
from shell_deform.solve.contact_step import ContactStep
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.solve.prediction import StepLoads
from shell_deform.solve.step_system import StepSystem

Array = NDArray[np.float64]

# One linear solve leaves round-off of the stiffest support spring; a singular one leaves all.
LINEAR_RESIDUAL = 1e-4


class StepLost(Exception):
    """A load step that leads nowhere; the message says why."""


@dataclass(frozen=True)
class Iterate:
    """A state on the way to equilibrium; N = 3 n dofs.

    Attributes:
        positions: (n, 3) control points [m]. moved: (N,) from rest [m], to more digits.
        energy: [J]. gradient: (N,) of it [N].
    """

    positions: Array
    moved: Array
    energy: float
    gradient: Array


@dataclass(frozen=True)
class Correction:
    """What one linear solve asks for.

    Attributes:
        step: (N,) [m]. pushes: (k,) of the contacts [N]. multipliers: (m,) of the held rows [N].
    """

    step: Array
    pushes: Array
    multipliers: Array

    @property
    def largest(self) -> float:
        """Largest component of the step [m]."""
        return float(np.abs(self.step).max(initial=0.0))


@dataclass(frozen=True)
class Judgement:
    """Unbalanced force over the loads [-], and whether the loads are carried."""

    residual: float
    balanced: bool


class StepSolver(StepSystem):
    """Takes single load steps of one model."""

    def step(
        self,
        borders: Borders,
        loads: StepLoads,
        start: Equilibrium,
        guess: Array | None = None,
        linear: bool = False,
    ) -> Equilibrium:
        """One load step from `start`, without halving; `guess` (n, 3): control points to begin at.

        `linear` takes one solve with the tangent at the undeformed shape for the answer.
        """
        if borders.field is not None:
            return ContactStep(self, borders, borders.field, self.aimed(loads)).run(start, guess)
        options = self.options
        loads = self.aimed(loads)
        now = self._first(borders, loads, start, guess)
        system: BorderedFactor | None = None
        previous, iterations, factorisations = 1.0, 0, 0
        message = 'Newton iterations did not converge'
        try:
            while system is not None or factorisations < options.factorisations:
                self.beat()
                if system is None:
                    now, tangent = self._linearised(borders, loads, now)
                    factorisations += 1
                    system = self.system(tangent, borders)
                found = self._correction(system, borders, loads, now)
                iterations += 1
                self._refuse_leap(found, linear)
                now = self._corrected(loads, now, found)
                judged = self._judged(borders, loads, now, found)
                if judged.balanced or linear:
                    state = self._equilibrium(borders, loads, now, found, judged, linear)
                    return replace(state, iterations=iterations, factorisations=factorisations)
                if judged.residual > min(options.contraction * previous, options.chord_residual):
                    system = None
                previous = judged.residual
        except (FactorError, StepLost) as error:
            message = str(error)
        return replace(
            start,
            converged=False,
            message=message,
            iterations=iterations,
            factorisations=factorisations,
        )

    def _first(
        self, borders: Borders, loads: StepLoads, start: Equilibrium, guess: Array | None
    ) -> Iterate:
        """Where the iteration begins."""
        positions = start.unknowns if guess is None else guess
        moved = (positions - self.model.start).reshape(-1)
        return Iterate(positions, moved, 0.0, np.zeros_like(moved))

    def _linearised(
        self, borders: Borders, loads: StepLoads, now: Iterate
    ) -> tuple[Iterate, Tangent]:
        """The iterate with the gradient there, and the tangent. Raises StepLost."""
        tangent = self.model.tangent(now.positions, loads.target, now.moved.reshape(-1, 3))
        if not np.all(np.isfinite(tangent.gradient)):
            raise StepLost(self.folded(now.positions))
        return replace(now, gradient=tangent.gradient), tangent

    def _correction(
        self,
        system: BorderedFactor,
        borders: Borders,
        loads: StepLoads,
        now: Iterate,
    ) -> Correction:
        """The residual forces and constraints solved with the tangent at hand."""
        given = ~borders.driven
        unbalanced = borders.push[:, given] @ loads.force[given] + loads.dead - now.gradient
        missing = (loads.moved - borders.measure.T @ now.moved)[borders.driven]
        constraints = np.concatenate([missing, -borders.held.T @ now.moved])
        step, unknowns = system.solve(unbalanced, constraints, refinements=1)
        pushes = np.where(borders.driven, 0.0, loads.force)
        count = int(borders.driven.sum())
        pushes[borders.driven] = unknowns[:count]
        return Correction(step, pushes, unknowns[count:])

    def _refuse_leap(self, found: Correction, linear: bool) -> None:
        """Raise StepLost where a correction leads nowhere."""
        if not np.all(np.isfinite(found.step)):
            raise StepLost('the stiffness is singular')
        if found.largest > self.options.largest_move * self._wall and not linear:
            raise StepLost(f'an iteration moved the surface by {1e3 * found.largest:.1f} mm')

    def _corrected(self, loads: StepLoads, now: Iterate, found: Correction) -> Iterate:
        """The iterate after a correction, with the gradient there."""
        moved = now.moved + found.step
        positions = self.model.start + moved.reshape(-1, 3)
        settled = self.model.shell.settled(positions)
        if settled is not positions:
            positions, moved = settled, (settled - self.model.start).reshape(-1)
        energy, gradient = self.model.gradient(positions, loads.target, moved.reshape(-1, 3))
        return Iterate(positions, moved, energy, gradient)

    def _judged(
        self, borders: Borders, loads: StepLoads, now: Iterate, found: Correction
    ) -> Judgement:
        """How far forces are from balance, and whether that is near enough. Raises StepLost."""
        options = self.options
        carried = borders.push @ found.pushes + loads.dead
        held = borders.held @ found.multipliers
        unbalanced = now.gradient - carried + held
        noise = self.noise_force(now.moved)
        scale = max(
            float(np.linalg.norm(carried)),
            float(np.linalg.norm(held)),
            self.support_force(now.moved.reshape(-1, 3), loads.target),
            noise,
        )
        residual = float(np.linalg.norm(unbalanced)) / scale
        small = found.largest < options.settled_move * self._wall
        settled = small and residual < options.chord_residual
        balanced = residual < options.tolerance + noise / scale or settled
        if not np.isfinite(residual):
            raise StepLost(self.folded(now.positions))
        return Judgement(residual, balanced)

    def _equilibrium(
        self,
        borders: Borders,
        loads: StepLoads,
        now: Iterate,
        found: Correction,
        judged: Judgement,
        linear: bool,
    ) -> Equilibrium:
        """The iterate as the answer of the step."""
        singular = linear and judged.residual >= LINEAR_RESIDUAL
        return Equilibrium(
            converged=not singular,
            message='the linear system is singular' if singular else '',
            positions=now.positions[: len(self.model.rest)],
            wall=now.positions[len(self.model.rest) :],
            shell=self.model.shell,
            force=found.pushes,
            displacement=borders.measure.T @ now.moved,
            multipliers=found.multipliers,
            unbalance=np.zeros(6),
            energy=now.energy,
            gas_pressure=self.gas_pressure(now.positions, linear),
            residual=judged.residual,
            iterations=0,
            factorisations=0,
            dead_load=loads.dead[: 3 * len(self.model.rest)],
            grip_motion=loads.grip_motion,
        )
