# SPDX-License-Identifier: Apache-2.0
"""The hold after the load cases of shell_solve: what the wall does while it relaxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_common.terminal import complain, fixed, print_table, significant, tracked
from shell_deform.commands.console import CommandError
from shell_deform.objects import ShellObject
from shell_deform.solve.equilibrium import Equilibrium, LoadCase
from shell_deform.solve.hold import TimedSolver, hold_times
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.relaxation import Relaxation

Array = NDArray[np.float64]

SHOWN_PER_DECADE = 2


@dataclass(frozen=True)
class Held:
    """A moment of a hold.

    Attributes:
        time: since the step [s]. depth: mean of the contacts from first touch [m].
        sigma: relative, of the modulus.
    """

    time: float
    state: Equilibrium
    depth: float
    sigma: float

    def row(self) -> dict[str, float]:
        """As in the JSON document."""
        return {
            'time_s': self.time,
            'displacement_m': self.depth,
            'force_n': float(np.mean(self.state.force)),
            'gas_pressure_pa': self.state.gas_pressure,
            'relative_sigma': self.sigma,
        }


def relaxation_of(shell_object: ShellObject) -> Relaxation:
    """The object's law. Raises CommandError where it has none."""
    if shell_object.relaxation is None:
        raise CommandError(
            f'{shell_object.name}: --hold needs relaxation: in the object file, such as '
            'relaxation: {kind: log, share_per_decade: 0.03, from_s: 0.1, to_s: 1000}'
        )
    return shell_object.relaxation


def hold(
    solver: EquilibriumSolver,
    law: Relaxation,
    case: LoadCase,
    first_touch: tuple[Equilibrium, Array],
    seconds: float,
) -> tuple[list[Held], str]:
    """States of a hold of `case`, stepped to from first touch, and why it ended early, or ''."""
    began, touch = first_touch
    beyond = law.beyond(seconds)
    if beyond:
        complain('shell_solve', f'note: {beyond}')
    longer = law.covering(seconds)
    found: list[Held] = []
    timed, now = TimedSolver(solver, longer, case, began), 0.0
    for time in tracked(hold_times(longer, seconds).tolist(), 'hold'):
        state = timed.to(case, time - now)
        if not state.converged:
            return found, f'no equilibrium {time:.3g} s into the hold: {state.message}'
        now = time
        depth = float(np.mean(state.displacement - touch))
        sigma = float(law.sigma_of(time, law.reference or law.first))
        found.append(Held(time, state, depth, sigma))
    return found, ''


def print_hold(held: list[Held]) -> None:
    """A table with a few times of each decade and the last one."""
    rows = [one.row() for one in held]
    shown = [0]
    for i, row in enumerate(rows[1:], start=1):
        later = rows[shown[-1]]['time_s'] * 10.0 ** (1.0 / SHOWN_PER_DECADE)
        if row['time_s'] >= 0.999 * later or i == len(rows) - 1:
            shown.append(i)
    largest = max(abs(row['force_n']) for row in rows)
    print_table(
        ('time [s]', 'displacement [mm]', 'force [N]', 'sigma [%]'),
        [
            [
                f'{rows[i]["time_s"]:.3g}',
                fixed(1e3 * rows[i]['displacement_m'], 4),
                significant(rows[i]['force_n'], 5, largest),
                f'{100.0 * rows[i]["relative_sigma"]:.2g}',
            ]
            for i in shown
        ],
        'Hold',
    )
