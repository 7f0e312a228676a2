# SPDX-License-Identifier: Apache-2.0
"""One load step by Newton's method with few factorisations.

One factorisation serves several iterations as long as each shrinks the residual well (the chord
method). Contacts whose displacement is prescribed carry their force as an unknown, so limit points
in force are no obstacle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.thick import ThickShell
from shell_deform.factor.analysis import (
    Factor,
    FactorError,
    SymbolicFactor,
    analyse,
    factorise,
)
from shell_deform.factor.bordered import BorderedFactor
from shell_deform.model import ShellModel, Tangent
from shell_deform.solve.borders import Borders, bordered
from shell_deform.solve.contact_step import ContactStep, Known
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.solve.prediction import StepLoads

Array = NDArray[np.float64]

# One linear solve leaves round-off of the stiffest support spring; a singular one leaves all.
LINEAR_RESIDUAL = 1e-4
FOLDED = 'the surface folded onto itself'


@dataclass(frozen=True)
class NewtonOptions:
    """How hard to try.

    Attributes:
        tolerance: residual force relative to the loads [-].
        factorisations: at most so many in one load step before it is halved.
        pad_factorisations: the same with rigid pads, where finding who touches takes more.
        contraction: a residual shrinking less than this per iteration asks for a new stiffness.
        chord_residual: above this residual every iteration takes a new stiffness [-].
        smallest_step: give up below this share of the load case.
        largest_move: displacement change [in wall thicknesses] beyond which a step is halved.
        settled_move: displacement change [in wall thicknesses] below which an iteration has
            nothing left to correct but round-off.
        stability: whether to count negative modes at the end; None: with rigid pads alone, since
            a flattened cap has more than one equilibrium.
    """

    tolerance: float = 1e-9
    factorisations: int = 9
    pad_factorisations: int = 16
    contraction: float = 0.25
    chord_residual: float = 0.05
    smallest_step: float = 1.0 / 256.0
    largest_move: float = 8.0
    settled_move: float = 1e-9
    stability: bool | None = None


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


class StepSolver:
    """Takes single load steps of one model; the symbolic factorisation is kept."""

    def __init__(self, model: ShellModel, options: NewtonOptions | None = None) -> None:
        self.model = model
        self.options = options or NewtonOptions()
        self._symbolic: SymbolicFactor | None = None
        self.known: Known | None = None
        """The last factorised tangent under rigid bodies."""
        self._wall = float(model.shell.thickness.max())

    def met(self, start: Equilibrium) -> Equilibrium:
        """The state with the unknowns beside its control points that this model has.

        Under other pins, or with shear elsewhere, a thick wall keeps what it knows of them.
        """
        shell, known, count = self.model.shell, start.shell, len(self.model.rest)
        if known is shell or len(start.wall) == len(self.model.start) - count == 0:
            return start
        unknowns = self.model.start
        if isinstance(shell, ThickShell) and isinstance(known, ThickShell):
            unknowns = shell.continued(known, start.unknowns)
        return replace(start, wall=unknowns[count:], shell=shell, history=())

    def take(self, model: ShellModel) -> None:
        """Go on with this model of the same shell; another discretisation is analysed anew."""
        if model.shell is not self.model.shell:
            self._symbolic = self.known = None
        self.model = model

    def factor(self, matrix: sp.csr_matrix) -> Factor:
        """Factorise a stiffness (springs added), reusing the symbolic analysis."""
        if self._symbolic is None:
            self._symbolic = analyse(matrix, self.model.shell.places, block=3)
        return factorise(self._symbolic, matrix)

    def system(self, tangent: Tangent, bordering: Borders) -> BorderedFactor:
        """The factorised system of a tangent: sparse stiffness and all borders of a load case."""
        return bordered(self.model, tangent, bordering, self.factor)

    def rest(self) -> Equilibrium:
        """The undeformed state, as a start."""
        empty = np.zeros(0)
        rest = Equilibrium(
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
        return self.met(rest)

    def respond(self, state: Equilibrium, bordering: Borders, loads: Array) -> Array:
        """Displacements (N, k) per unit of the loads (N, k), by the tangent at `state`."""
        system = self.system(self.model.tangent(state.unknowns), bordering)
        return system.solve(loads)[0]

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

    def aimed(self, loads: StepLoads) -> StepLoads:
        """The loads with where they move the springs of the model to."""
        return replace(loads, target=self.model.held_target(loads.grip_motion))

    def support_force(self, moved: Array, target: Array | None) -> float:
        """Force [N] of the supports on the surface moved by (n, 3), towards `target`."""
        held = self.model.held
        return 0.0 if held is None else float(np.linalg.norm(held.force(moved, target)))

    def folded(self, positions: Array) -> str:
        """Why all unknowns `positions` have no energy, and where a thick wall lost its own."""
        place = self.model.shell.lost_place(positions)
        if place is None:
            return FOLDED
        return f'{FOLDED}: its wall has no equilibrium at {np.round(1e3 * place, 2).tolist()} mm'

    def noise_force(self, free: Array) -> float:
        """Force [N] that round-off leaves unbalanced at displacements (N,)."""
        digit = 16.0 * float(np.finfo(float).eps)
        extent = float(np.ptp(self.model.rest, axis=0).max())
        noise = digit * self.model.shell.stiffest * extent
        if self.model.held is not None:
            spring = float(self.model.held.stiffness.max())
            noise += digit * spring * float(np.abs(free).max(initial=0.0))
        return noise

    def gas_pressure(self, positions: Array, linear: bool) -> float:
        """Overpressure [Pa] at all unknowns, linearised or not."""
        model = self.model
        if not (model.gas.is_sealed or model.pressure):
            return 0.0
        if linear:
            rest = model.rest_tangent
            change = float(rest.gas_row @ (positions - model.start).reshape(-1))
            return rest.gas_pressure - rest.gas_stiffness * change
        return model.overpressure(model.shell.volume(positions)[0])
