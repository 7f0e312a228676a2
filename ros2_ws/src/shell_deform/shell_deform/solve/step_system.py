# SPDX-License-Identifier: Apache-2.0
"""The linear systems of one model's load steps, and what balance means there.

The symbolic factorisation is kept from one step to the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shell_deform.assemble.thick import ThickShell
from shell_deform.contact.contact_field import Press
from shell_deform.factor.analysis import (
    Factor,
    SymbolicFactor,
    analyse,
    factorise,
)
from shell_deform.factor.bordered import BorderedFactor
from shell_deform.model import ShellModel, Tangent
from shell_deform.solve.borders import Borders, bordered
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.solve.prediction import StepLoads

Array = NDArray[np.float64]

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


@dataclass(frozen=True)
class Known:
    """A factorised tangent of a shell that bodies touch, near a state.

    Attributes:
        tangent: with the bodies' part. factor: of its stiffness, springs added. press: what the
            bodies do there.
    """

    tangent: Tangent
    factor: Factor
    press: Press


class StepSystem:
    """Systems of one model, factorised one after the other."""

    def __init__(self, model: ShellModel, options: NewtonOptions | None = None) -> None:
        self.model = model
        self.options = options or NewtonOptions()
        self._symbolic: SymbolicFactor | None = None
        self.known: Known | None = None
        """The last factorised tangent under rigid bodies."""
        self.beat: Callable[[], None] = lambda: None
        """Called at every iteration, so that a watcher knows a long solve from one that hangs."""
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
            filled=0.0 if self.model.own_pressure else 1.0,
        )
        return replace(self.met(rest), shell=self.model.shell)

    def respond(self, state: Equilibrium, bordering: Borders, loads: Array) -> Array:
        """Displacements (N, k) per unit of the loads (N, k), by the tangent at `state`."""
        system = self.system(self.model.tangent(state.unknowns), bordering)
        return system.solve(loads)[0]

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
