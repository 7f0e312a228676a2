# SPDX-License-Identifier: Apache-2.0
"""Equilibrium of a shell model under a load case: Newton's method with adaptive load steps.

A step that does not converge is halved.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.factor.base import FactorError
from shell_deform.solve.borders import Borders, borders, negative_directions
from shell_deform.solve.contact_step import touched_tangent
from shell_deform.solve.continuation import carried_on
from shell_deform.solve.equilibrium import End, Equilibrium, LoadCase, PathState
from shell_deform.solve.newton_step import StepSolver
from shell_deform.solve.prediction import StepLoads, control_of, predicted
from shell_deform.solve.step_system import NewtonOptions
from shell_deform.supports.grips import carried_as_one, longest_share, poses_and_wrenches
from shell_deform.theory import is_linear

__all__ = ['EquilibriumSolver', 'NewtonOptions']

Array = NDArray[np.float64]

ARC_LENGTH_BELOW = 1.0 / 32.0
"""Where pushes alone are prescribed, arc length takes over from smaller load steps."""

LEAST_FILLED = 1e-6
"""A share of its own pressures that every object stands: these may be stated much too large."""

SNAPPED = 'the shell snaps and no state behind the snap was found'


class EquilibriumSolver(StepSolver):
    """Solves load case after load case of one model; the symbolic factorisation is kept."""

    def solve(self, case: LoadCase, start: Equilibrium | None = None) -> Equilibrium:
        """Equilibrium under `case`, from `start` (default: rest), by as few steps as converge.

        Where a dent has outgrown the shear around its contacts, once more with more of it.
        """
        self.take(self.model.on_contacts(case.contacts))
        if is_linear(self.model.theory) and not case.padded.any():
            return self._solve_linear(case)
        start = start or self.rest()
        bordering = borders(self.model, case)
        present = self._on_contacts(start, case, bordering)
        bordering = bordering.started(present)
        first = self._loads_of(present, case)
        goal = StepLoads(
            np.where(case.driven, 0.0, case.force),
            np.where(case.driven, case.displacement, 0.0),
            bordering.dead,
            case.motions,
            case.grip_motions(len(self.model.grips)),
        )
        still = np.array_equal(goal.grip_motion, first.grip_motion) and first.filled == 1.0
        pushed = np.any(goal.force != first.force) or np.any(goal.dead != first.dead)
        by_force = still and pushed and not case.padded.any() and not case.driven.any()
        smallest = ARC_LENGTH_BELOW if by_force else self.options.smallest_step
        if first.filled < 1.0:
            smallest = LEAST_FILLED
        whole = self.model
        fraction, step = 0.0, 1.0
        iterations = factorisations = 0
        message = ''
        together = self._carried_along(present, goal) is not None
        longest = longest_share(present.grip_motion, goal.grip_motion, together)
        while fraction < 1.0 - 1e-12:
            step = min(step, longest)
            trial = min(1.0, fraction + step)
            loads = first.towards(goal, trial)
            control = control_of(case, loads)
            guess = predicted(present.history, control)
            if (along := self._carried_along(present, loads)) is not None:
                guess = along
            self.take(whole.filled(loads.filled))
            found = self.step(bordering, loads, present, guess)
            iterations += found.iterations
            factorisations += found.factorisations
            if found.converged:
                passed = PathState(control, found.unknowns)
                history = (*present.history, passed)[-3:]
                present = replace(found, history=history, filled=loads.filled)
                bordering = bordering.started(present)
                fraction = trial
                step *= 1.6
                continue
            message = found.message
            step = 0.5 * (trial - fraction)
            if step < smallest:
                break
        done, end = fraction >= 1.0 - 1e-12, End.CARRIED
        if done and (wider := self.model.widened(present.displacement)) is not self.model:
            self.take(wider)
            return self.solve(case, present)
        if not done and by_force:
            present, done, fraction, end = self._by_arc_length(bordering, present, goal, fraction)
        if not done:
            message = SNAPPED if end is End.SNAP else message
        self.take(whole.filled(present.filled))
        balanced = self._balanced(bordering, present, case)
        negative = self._counted(bordering, present, case)
        self.take(whole)
        return replace(
            balanced,
            converged=done,
            message='' if done else f'{message} (at {100 * fraction:.1f} % of the load case)',
            iterations=iterations,
            factorisations=factorisations,
            load_fraction=fraction,
            end=end if done or end is End.SNAP else End.LOST,
            negative_modes=negative,
        )

    def _counted(self, bordering: Borders, state: Equilibrium, case: LoadCase) -> int | None:
        """Negative modes where the options ask for them."""
        wanted = self.options.stability
        if wanted is None:
            wanted = bool(case.padded.any())
        return self.negative_modes(bordering, state) if wanted else None

    def _by_arc_length(
        self, bordering: Borders, present: Equilibrium, goal: StepLoads, fraction: float
    ) -> tuple[Equilibrium, bool, float, End]:
        """Carry on where load steps ended: the state, whether under `goal`, the share carried."""
        try:
            present, share, snaps = carried_on(self, bordering, present, goal)
        except FactorError:
            return present, False, fraction, End.LOST
        end = End.SNAP if snaps else End.CARRIED
        return present, share == 1.0, fraction + share * (1.0 - fraction), end

    def sweep(self, cases: list[LoadCase], start: Equilibrium | None = None) -> list[Equilibrium]:
        """Equilibria of a list of load cases, each started from the ones before it."""
        results: list[Equilibrium] = []
        present = start
        for case in cases:
            present = self.solve(case, present)
            results.append(present)
            if not present.converged:
                break
        return results

    def tangent_columns(self, case: LoadCase, state: Equilibrium) -> tuple[Array, Array]:
        """Response to unit pushes at `state`: displacements (n, 3, k) [m/N], centres (k, k).

        Every contact counts as forced here; the second result is the motion of each contact's
        centre along its axis under each push.
        """
        case.refuse_pads('the response to unit pushes')
        bordering = borders(
            self.model,
            replace(
                case,
                force=np.zeros(len(case.contacts)),
                displacement=np.full(len(case.contacts), np.nan),
            ),
        )
        columns = self.respond(state, bordering, bordering.push)
        return columns.reshape(-1, 3, columns.shape[1]), bordering.measure.T @ columns

    def _solve_linear(self, case: LoadCase) -> Equilibrium:
        bordering = borders(self.model, case)
        zero = self.rest()
        present = self._on_contacts(zero, case, bordering)
        loads = StepLoads(
            case.force,
            case.displacement,
            bordering.dead,
            case.motions,
            case.grip_motions(len(self.model.grips)),
        )
        found = self.step(bordering, loads, present, linear=True)
        return self._balanced(bordering, found, case)

    def _loads_of(self, present: Equilibrium, case: LoadCase) -> StepLoads:
        """What the state `present` carries, seen with the contacts of `case`."""
        dead = np.zeros(3 * len(self.model.start))
        dead[: len(present.dead_load)] = present.dead_load
        return StepLoads(
            np.where(case.driven, 0.0, present.force),
            np.where(case.driven, present.displacement, 0.0),
            dead,
            np.zeros((len(case.contacts), 6)) if present.motion is None else present.motion,
            present.grip_motion,
            filled=present.filled,
        )

    def _carried_along(self, present: Equilibrium, loads: StepLoads) -> Array | None:
        """All unknowns carried along where the grips are all that holds and move as one."""
        if self.model.supports is not None or len(present.wall) or len(present.force):
            return None
        motions = present.grip_motion, loads.grip_motion
        return carried_as_one(self.model.grips, *motions, present.positions)

    def _on_contacts(self, start: Equilibrium, case: LoadCase, bordering: Borders) -> Equilibrium:
        """The start state seen with the contacts of `case`."""
        start = self.met(start)
        moved = bordering.measure.T @ (start.unknowns - self.model.start).reshape(-1)
        same = len(start.force) == len(case.contacts)
        return replace(
            start,
            displacement=np.where(case.padded, start.displacement, moved) if same else moved,
            grip_motion=start.grip_motion
            if len(start.grip_motion)
            else np.zeros((len(self.model.grips), 6)),
            force=start.force if same else np.zeros(len(case.contacts)),
            motion=start.motion if same else None,
            multipliers=start.multipliers
            if same and len(start.multipliers) == bordering.held.shape[1]
            else np.zeros(bordering.held.shape[1]),
        )

    def _balanced(self, bordering: Borders, state: Equilibrium, case: LoadCase) -> Equilibrium:
        """The state with what its loads leave to supports, and what its grips do."""
        push = bordering.push if bordering.pattern is None else bordering.pattern
        carried = push @ state.force + bordering.dead[: len(push)]
        if len(state.pad_load):
            carried = carried + state.pad_load
        carried = carried.reshape(-1, 3)
        moment = np.cross(state.positions, carried).sum(axis=0)
        unbalance = np.concatenate([carried.sum(axis=0), moment])
        model, motions = self.model, state.grip_motion
        if not len(motions):
            return replace(state, unbalance=unbalance)
        for grip, force in zip(model.grips, case.grip_forces(len(motions)), strict=True):
            carried = carried - grip.load(force)
        held = (bordering.held @ state.multipliers)[: carried.size].reshape(-1, 3)
        reaction = model.wall_force(state.unknowns)[: len(carried)] - carried + held
        poses, wrenches = poses_and_wrenches(
            model.grips, model.rest, state.positions, reaction, motions
        )
        return replace(state, unbalance=unbalance, grip_pose=poses, grip_wrench=wrenches)

    def negative_modes(self, bordering: Borders, state: Equilibrium) -> int:
        """Negative directions of the stiffness among motions the constraints allow.

        From the inertia of the symmetric bordered matrix: every independent constraint adds one
        negative and one positive.
        """
        symmetric = replace(bordering, measure=-bordering.push)
        tangent = self.model.tangent(state.unknowns)
        if bordering.field is not None:
            motion = np.zeros((len(state.force), 6)) if state.motion is None else state.motion
            touch = bordering.field.press(state.unknowns, state.displacement, state.force, motion)
            tangent = touched_tangent(tangent, bordering.field, touch)
        return negative_directions(self.system(tangent, symmetric), symmetric)
