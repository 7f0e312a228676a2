# SPDX-License-Identifier: Apache-2.0
"""The hold after the load cases of shell_solve: what the wall does while it relaxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp_common.terminal import complain, fixed, print_table, significant, tracked
from shell_deform.commands.console import CommandError
from shell_deform.commands.gripping import GripSweep
from shell_deform.objects import ShellObject
from shell_deform.solve.equilibrium import Equilibrium, LoadCase
from shell_deform.solve.hold import TimedSolver, hold_times
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.relaxation import Relaxation, RelaxationError

SHOWN_PER_DECADE = 2


@dataclass(frozen=True)
class Held:
    """A moment of a hold.

    Attributes:
        time: since the step [s]. depth: mean of the contacts from first touch [m], or how far the
            grips went. sigma: relative, of the modulus.
    """

    time: float
    state: Equilibrium
    depth: float
    sigma: float

    def row(self, sweep: GripSweep | None = None) -> dict[str, Any]:
        """As in the JSON document; `sweep`: what the grips did before."""
        pressed = {
            'displacement_m': self.depth,
            'force_n': float(np.mean(self.state.force)) if len(self.state.force) else 0.0,
        }
        return {
            'time_s': self.time,
            **(pressed if sweep is None else sweep.point(self.depth, self.state)),
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
    cases: Sequence[LoadCase],
    began: Equilibrium,
    depth: Callable[[Equilibrium], float],
    seconds: float,
) -> tuple[list[Held], str]:
    """States of a hold of the last of `cases`, and why it ended early, or ''.

    All of them are stepped through in no time from `began`, an unloaded state. `depth`: the value
    of a row at a state.
    """
    case = cases[-1]
    try:
        longer = law.covering(seconds)
    except RelaxationError as error:
        raise CommandError(f'--hold {seconds:g}: {error}; hold it for less') from error
    beyond = law.beyond(seconds)
    if beyond:
        complain('shell_solve', f'note: {beyond}')
    found: list[Held] = []
    timed, now = TimedSolver(solver, longer, case, began), 0.0
    for before in cases[:-1]:
        state = timed.to(before, 0.0)
        if not state.converged:
            return found, f'no equilibrium on the way to the hold: {state.message}'
    for time in tracked(hold_times(longer, seconds).tolist(), 'hold'):
        state = timed.to(case, time - now)
        if not state.converged:
            return found, f'no equilibrium {time:.3g} s into the hold: {state.message}'
        now = time
        sigma = float(law.sigma_of(time, law.reference or law.first))
        found.append(Held(time, state, depth(state), sigma))
    return found, ''


def print_hold(held: list[Held], sweep: GripSweep | None = None) -> None:
    """A table with a few times of each decade and the last one."""
    shown = [0]
    for i, one in enumerate(held[1:], start=1):
        later = held[shown[-1]].time * 10.0 ** (1.0 / SHOWN_PER_DECADE)
        if one.time >= 0.999 * later or i == len(held) - 1:
            shown.append(i)
    if sweep is None:
        headings: tuple[str, ...] = ('displacement [mm]', 'force [N]')
        largest = max(abs(one.row()['force_n']) for one in held)
        cells = [
            [fixed(1e3 * one.depth, 4), significant(one.row()['force_n'], 5, largest)]
            for one in held
        ]
    else:
        headings = sweep.headings
        wrenches = np.abs([one.state.grip_wrench for one in held])
        most = float(wrenches[..., :3].max()), float(wrenches[..., 3:].max())
        cells = [sweep.row(one.depth, one.state, most) for one in held]
    print_table(
        ('time [s]', *headings, 'sigma [%]'),
        [[f'{held[i].time:.3g}', *cells[i], f'{100.0 * held[i].sigma:.2g}'] for i in shown],
        'Hold',
    )
