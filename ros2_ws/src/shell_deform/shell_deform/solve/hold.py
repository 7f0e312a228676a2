# SPDX-License-Identifier: Apache-2.0
"""Equilibria in time of a shell whose wall relaxes: steps, ramps and holds.

Each load case stands at a time. Over a step the elastic stress of the wall is taken as linear in
time, which is exact for steps and ramps of the strain and second order else; the steps of a hold
grow with the time since it began, as relaxation slows down.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.held import HeldWall, elastic_stress
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, LoadCaseError
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory import is_linear
from shell_deform.theory.relaxation import Heredity, Relaxation, step_of, unloaded

Array = NDArray[np.float64]

STEPS_PER_DECADE = 10
FIRST_STEP = 0.25
"""Of the shortest time of the law: where the steps of a hold begin."""


class TimedSolver:
    """Follows load cases of one set of contacts through time and remembers the wall's past.

    The solver's model is left as it was found.
    """

    def __init__(
        self, solver: EquilibriumSolver, law: Relaxation, case: LoadCase, start: Equilibrium
    ) -> None:
        """`start`: an equilibrium at the contacts of `case` that has long been there."""
        if is_linear(solver.model.theory):
            raise LoadCaseError(
                'linear theory takes no holds: at constant travel its force falls as the law '
                'says; choose a nonlinear theory'
            )
        solver.take(solver.model.on_contacts(case.contacts))
        self._solver, self._law, self._contacts = solver, law, case.contacts
        self._elastic: ShellModel = solver.model
        self.state = solver.met(start)
        self._memory: Heredity = unloaded(law, self._stress())

    def _stress(self) -> Array:
        model = self._elastic
        return elastic_stress(model.shell, model.theory, self.state.unknowns)

    def to(self, case: LoadCase, duration: float) -> Equilibrium:
        """The equilibrium under `case`, reached evenly over `duration` [s]; 0 for a step.

        Where none is found the state and the memory stay those before. Raises RelaxationError
        where time runs back.
        """
        if case.contacts is not self._contacts:
            raise LoadCaseError('a hold keeps its contacts; begin another one')
        step = step_of(self._law, duration)
        model = self._elastic
        past = self._memory.held(step)
        solver = self._solver
        solver.take(model.holding(HeldWall(model.shell, model.theory, step.now, past)))
        try:
            found = solver.solve(case, replace(self.state, history=()))
        finally:
            solver.take(model)
        if found.converged:
            self.state = found
            self._memory = self._memory.after(step, self._stress())
        return found


def hold_times(law: Relaxation, seconds: float) -> Array:
    """Times [s] since a step at which a hold of so many seconds is solved, 0 first."""
    first = min(FIRST_STEP * float(law.times[0]), 0.5 * seconds)
    count = int(np.ceil(STEPS_PER_DECADE * np.log10(seconds / first))) + 1
    return np.concatenate([[0.0], np.geomspace(first, seconds, max(count, 2))])
