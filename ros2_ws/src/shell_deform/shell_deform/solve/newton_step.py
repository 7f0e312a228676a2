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
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.solve.pads import pressed_state, pressed_tangent
from shell_deform.solve.prediction import StepLoads

Array = NDArray[np.float64]

# One linear solve leaves round-off of the stiffest support spring; a singular one leaves all.
LINEAR_RESIDUAL = 1e-4


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
        stability: whether to count negative modes at the end; with rigid pads they always are,
            since a flattened cap has more than one equilibrium.
        penetration: of rigid pads, in wall thicknesses.
    """

    tolerance: float = 1e-9
    factorisations: int = 9
    pad_factorisations: int = 16
    contraction: float = 0.25
    chord_residual: float = 0.05
    smallest_step: float = 1.0 / 256.0
    largest_move: float = 8.0
    settled_move: float = 1e-9
    stability: bool = False
    penetration: float = 3e-4


class StepSolver:
    """Takes single load steps of one model; the symbolic factorisation is kept."""

    def __init__(self, model: ShellModel, options: NewtonOptions | None = None) -> None:
        self.model = model
        self.options = options or NewtonOptions()
        self._symbolic: SymbolicFactor | None = None
        self._wall = float(model.shell.thickness.max())

    def met(self, start: Equilibrium) -> Equilibrium:
        """The state with as many unknowns beside its control points as this model has."""
        count = len(self.model.start) - len(self.model.rest)
        if len(start.wall) == count:
            return start
        return replace(start, wall=np.zeros((count, 3)), history=())

    def take(self, model: ShellModel) -> None:
        """Go on with this model of the same shell; another discretisation is analysed anew."""
        if model is not self.model:
            self.model, self._symbolic = model, None

    def factor(self, matrix: sp.csr_matrix) -> Factor:
        """Factorise a stiffness (springs added), reusing the symbolic analysis."""
        if self._symbolic is None:
            self._symbolic = analyse(matrix, self.model.shell.places, block=3)
        return factorise(self._symbolic, matrix)

    def system(self, tangent: Tangent, edge: Borders) -> BorderedFactor:
        """The factorised system of a tangent: sparse stiffness and all borders of a load case."""
        return bordered(self.model, tangent, edge, self.factor)

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

    def respond(self, state: Equilibrium, edge: Borders, loads: Array) -> Array:
        """Displacements (N, k) per unit of the loads (N, k), by the tangent at `state`."""
        system = self.system(self.model.tangent(state.unknowns), edge)
        return system.solve(loads)[0]

    def step(
        self,
        edge: Borders,
        loads: StepLoads,
        here: Equilibrium,
        guess: Array | None = None,
        linear: bool = False,
    ) -> Equilibrium:
        """One load step from `here`, without halving; control points `guess` (n, 3) to start from.

        `linear` takes one solve with the tangent at the undeformed shape for the answer.
        """
        model, options = self.model, self.options
        force, moved, dead = loads.force, loads.moved, loads.dead
        fixed_push = edge.push[:, ~edge.driven] @ force[~edge.driven] + dead
        positions = here.unknowns if guess is None else guess
        free = (positions - model.start).reshape(-1)
        unknown = int(edge.driven.sum())
        state = here
        system: BorderedFactor | None = None
        previous = 1.0
        tangent = None
        iterations = factorisations = 0
        message = 'Newton iterations did not converge'
        reference_move = options.largest_move * self._wall
        pads, press, pressed = edge.pads, None, None
        most = options.factorisations if pads is None else options.pad_factorisations
        if pads is not None:
            press = pads.press(positions, pads.start(moved, here.displacement), force)
        while True:
            if system is None:
                if factorisations == most:
                    break
                tangent = model.tangent(positions, loads.target, free.reshape(-1, 3))
                if pads is not None and press is not None:
                    tangent, pressed = pressed_tangent(tangent, pads, press), press
                if not np.all(np.isfinite(tangent.gradient)):
                    message = 'the surface folded onto itself'
                    break
                gradient = tangent.gradient
                factorisations += 1
                try:
                    system = self.system(tangent, edge)
                except FactorError as error:
                    message = str(error)
                    break
            lacking = (moved - edge.measure.T @ free)[edge.driven]
            below = np.concatenate([lacking, -edge.held.T @ free])
            unbalanced = fixed_push - gradient
            if press is not None and pressed is not None:
                unbalanced -= pressed.eliminated(press)
            step, border = system.solve(unbalanced, below, refinements=1)
            iterations += 1
            if not np.all(np.isfinite(step)):
                message = 'the stiffness is singular'
                break
            largest = float(np.abs(step).max(initial=0.0))
            if largest > reference_move and not linear:
                message = f'an iteration moved the surface by {1e3 * largest:.1f} mm'
                break
            free = free + step
            positions = model.shell.settled(model.start + free.reshape(-1, 3))
            free = (positions - model.start).reshape(-1) if model.start is not model.rest else free
            energy, gradient = model.gradient(positions, loads.target, free.reshape(-1, 3))
            if pads is not None and press is not None and pressed is not None:
                press = pads.press(positions, pressed.follow(press, step), force)
                gradient = gradient + press.gradient.reshape(-1)
            pushes = np.where(edge.driven, 0.0, force)
            pushes[edge.driven] = border[:unknown]
            multipliers = border[unknown:]
            carried = edge.push @ pushes + dead
            noise = self._noise_force(free)
            loose = gradient - carried + edge.held @ multipliers
            scale = max(
                float(np.linalg.norm(carried)),
                float(np.linalg.norm(edge.held @ multipliers)),
                0.0 if press is None else float(np.linalg.norm(press.gradient)),
                self._support_force(free.reshape(-1, 3), loads.target),
                noise,
            )
            missing = 0.0 if press is None else float(np.linalg.norm(press.missing))
            residual = float(np.hypot(np.linalg.norm(loose), missing)) / scale
            settled = (
                largest < options.settled_move * self._wall and residual < options.chord_residual
            )
            if residual < options.tolerance + noise / scale or settled or linear:
                state = Equilibrium(
                    converged=not linear or residual < LINEAR_RESIDUAL,
                    message='the linear system is singular'
                    if linear and residual >= LINEAR_RESIDUAL
                    else '',
                    positions=positions[: len(model.rest)],
                    wall=positions[len(model.rest) :],
                    force=pushes,
                    displacement=edge.measure.T @ free,
                    multipliers=multipliers,
                    unbalance=np.zeros(6),
                    energy=energy,
                    gas_pressure=self._gas_pressure(positions, linear),
                    residual=residual,
                    iterations=iterations,
                    factorisations=factorisations,
                    dead_load=dead[: 3 * len(model.rest)],
                    support_target=loads.target,
                )
                return (
                    state if pads is None or press is None else pressed_state(state, pads, press)
                )
            if not np.isfinite(residual):
                message = 'the surface folded onto itself'
                break
            if residual > min(options.contraction * previous, options.chord_residual):
                system = None
            previous = residual
        return replace(
            here,
            converged=False,
            message=message,
            iterations=iterations,
            factorisations=factorisations,
        )

    def _support_force(self, moved: Array, target: Array | None) -> float:
        supports = self.model.supports
        return 0.0 if supports is None else float(np.linalg.norm(supports.force(moved, target)))

    def _noise_force(self, free: Array) -> float:
        """Force [N] that round-off leaves unbalanced at displacements (N,)."""
        digit = 16.0 * float(np.finfo(float).eps)
        extent = float(np.ptp(self.model.rest, axis=0).max())
        noise = digit * self.model.shell.stiffest * extent
        if self.model.supports is not None:
            spring = float(self.model.supports.stiffness.max())
            noise += digit * spring * float(np.abs(free).max(initial=0.0))
        return noise

    def _gas_pressure(self, positions: Array, linear: bool) -> float:
        model = self.model
        if not (model.gas.is_sealed or model.pressure):
            return 0.0
        if linear:
            rest = model.rest_tangent
            change = float(rest.gas_row @ (positions - model.start).reshape(-1))
            return rest.gas_pressure - rest.gas_stiffness * change
        return model.overpressure(model.shell.volume(positions)[0])
