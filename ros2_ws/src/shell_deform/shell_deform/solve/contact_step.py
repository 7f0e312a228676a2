# SPDX-License-Identifier: Apache-2.0
"""One load step with rigid bodies in contact: Newton's method on who touches and who sticks.

A factorisation serves as long as the residual shrinks. It is symmetric; that the friction of what
slips grows with the pressure, which it leaves out, is put into each of its solutions by GMRES.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.contact_field import ContactField, Press
from shell_deform.factor.analysis import FactorError
from shell_deform.factor.bordered import BorderedFactor
from shell_deform.model import Tangent
from shell_deform.solve.borders import Borders
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.solve.prediction import StepLoads
from shell_deform.solve.step_system import Known, StepSystem

Array = NDArray[np.float64]

# Iterations in one load step.
MOST_ITERATIONS = 60
# Where who touches and sticks stays, iterations that shrink the residual less ask for a new
# factorisation: friction bounds that follow the pressure slow them down.
SLOW = 0.6
# What the tangent leaves out is put into a solution until this share is missing, or so often.
UNCOUPLED, MOST_COUPLED = 0.05, 12
# Bodies that press with less than this share of what they did have lost what they held.
TOUCHING = 1e-6
# After some iterations, in which contact regions find their place, a step that turns the work of
# the forces along it to less than minus this share is cut, at most so often and to no less than
# this share at a time, unless the residual is below the last number.
FREE_ITERATIONS = 6
OVERSHOOT, MOST_CUTS, SMALLEST_CUT, UNCUT_BELOW = 0.5, 5, 0.1, 1e-3


class ContactStep:
    """One load step from a state; `run` takes it."""

    def __init__(
        self, solver: StepSystem, bordering: Borders, field: ContactField, loads: StepLoads
    ) -> None:
        self._solver, self._bordering, self._field, self._loads = solver, bordering, field, loads
        self._model, self._options = solver.model, solver.options
        self._wall = float(self._model.shell.thickness.max())
        self._iterations = self._factorisations = 0
        self._border = np.zeros(0)
        driven = bordering.driven
        self._fixed_push = bordering.push[:, ~driven] @ loads.force[~driven] + loads.dead

    def run(self, present: Equilibrium, guess: Array | None = None) -> Equilibrium:
        """The state under the loads, or `present`, not converged, with the reason."""
        positions = present.unknowns if guess is None else guess
        self._free = (positions - self._model.start).reshape(-1)
        depth = self._field.start(self._loads.moved, present.displacement)
        press = self._press(depth)
        if guess is None:
            if self._carried(present, press):
                return replace(present, iterations=0, factorisations=0)
            self._free = self._free + self._begun(present, depth)
            press = self._press(depth)
        message = self._iterate(press) or self._thrown_out(present)
        if not message:
            return self._state()
        return replace(
            present,
            converged=False,
            message=message,
            iterations=self._iterations,
            factorisations=self._factorisations,
        )

    def _begun(self, present: Equilibrium, depth: Array) -> Array:
        """How the unknowns (N,) begin to follow bodies that turn back or aside: all of it sticks.

        Bodies that draw back further than they overlap the face would else touch nothing, and
        where everything slips a free object resists no further turn.
        """
        none, loads, bordering = np.zeros_like(self._free), self._loads, self._bordering
        if present.motion is None or not present.touches:
            return none
        field = self._field.sticking
        press = field.press(present.unknowns, present.displacement, loads.force, present.motion)
        if not any(len(touch.pressure) for touch in press.touches):
            return none
        moved = self._free.reshape(-1, 3)
        tangent = touched_tangent(
            self._model.tangent(present.unknowns, loads.target, moved), field, press
        )
        unbalanced = self._fixed_push - tangent.gradient - press.eliminated(press)
        unbalanced += field.carried(press, depth, loads.motion)
        lacking = (loads.moved - bordering.measure.T @ self._free)[bordering.driven]
        below = np.concatenate([lacking, -bordering.held.T @ self._free])
        self._factorisations += 1
        try:
            step = self._solver.system(tangent, bordering).solve(unbalanced, below)[0]
        except FactorError:
            return none
        largest = float(np.abs(step).max(initial=0.0))
        return step if largest <= self._options.largest_move * self._wall else none

    def _thrown_out(self, present: Equilibrium) -> str:
        """Why the state that was found is none of a grasp, or nothing.

        An iteration may throw a free object out from between bodies that hold it: it rests
        wherever nothing touches it.
        """
        loads, noise = self._loads, self._solver.noise_force(self._free)
        left = float(np.abs(self._final.force).max(initial=0.0))
        if self._model.held is not None or len(self._field.bodies) < len(loads.force):
            return ''
        if left > max(noise, TOUCHING * float(np.abs(present.force).max(initial=0.0))):
            return ''
        depth = self._field.start(loads.moved, present.displacement)
        before = self._field.press(present.unknowns, depth, loads.force, loads.motion)
        pushing = float(np.abs(before.force).max(initial=0.0)) > noise
        held = pushing and sum(bool(len(touch.pressure)) for touch in before.touches) > 1
        return 'the object slips out from between the bodies' if held else ''

    def _carried(self, present: Equilibrium, press: Press) -> bool:
        """Whether the state is in equilibrium as it is: held loads move nothing, ever."""
        bordering, loads, rigid = self._bordering, self._loads, self._field.contacts
        self._border = np.concatenate([present.force[bordering.driven], present.multipliers])
        lacking = (loads.moved - bordering.measure.T @ self._free)[bordering.driven]
        if (
            not present.converged
            or present.motion is None
            or not np.array_equal(press.depth[rigid], present.displacement[rigid])
            or not np.array_equal(loads.motion, present.motion)
            or np.abs(lacking).max(initial=0.0) > self._options.settled_move * self._wall
        ):
            return False
        # A state taken as settled was so with the residual that it had then.
        within = max(self._options.tolerance, (1.0 + 1e-3) * present.residual)
        return self._residual(press)[0] < within + self._noise

    def _press(self, depth: Array) -> Press:
        loads = self._loads
        return self._field.press(self._positions, depth, loads.force, loads.motion)

    @property
    def _positions(self) -> Array:
        return self._model.start + self._free.reshape(-1, 3)

    def _iterate(self, press: Press) -> str:
        """Iterate to the end; why there was none, or nothing."""
        options = self._options
        system: BorderedFactor | None = None
        pressed, previous, gradient = press, 1.0, np.zeros(0)
        while self._iterations < MOST_ITERATIONS:
            self._solver.beat()
            if system is None:
                if self._factorisations == options.pad_factorisations:
                    break
                tangent = self._tangent(press)
                if not np.all(np.isfinite(tangent.gradient)):
                    return self._solver.folded(self._positions)
                gradient, pressed = tangent.gradient, press
                self._factorisations += 1
                try:
                    system = self._solver.system(tangent, self._bordering)
                except FactorError as error:
                    return str(error)
                self._solver.known = Known(tangent, system.factor, press)
            step, why = self._solved(system, gradient, pressed, press)
            if why:
                return why
            press, residual, gradient = self._along(step, gradient, pressed, press)
            if not np.isfinite(residual):
                return self._solver.folded(self._positions)
            largest = float(np.abs(step).max(initial=0.0))
            balanced = residual < options.tolerance + self._noise or (
                largest < options.settled_move * self._wall and residual < options.chord_residual
            )
            if balanced:
                self._final = press
                return ''
            same = _contact_state(press) == _contact_state(pressed)
            wanted = SLOW if same else options.contraction
            if residual > min(wanted * previous, options.chord_residual):
                system = None
            previous = residual
        return 'Newton iterations did not converge'

    def _tangent(self, press: Press) -> Tangent:
        """The shell's tangent with the bodies' part."""
        tangent = self._model.tangent(
            self._positions, self._loads.target, self._free.reshape(-1, 3)
        )
        return touched_tangent(tangent, self._field, press)

    def _solved(
        self, system: BorderedFactor, gradient: Array, pressed: Press, press: Press
    ) -> tuple[Array, str]:
        """Take one iteration: the step (N,), and why it cannot be taken, or nothing."""
        bordering = self._bordering
        lacking = (self._loads.moved - bordering.measure.T @ self._free)[bordering.driven]
        below = np.concatenate([lacking, -bordering.held.T @ self._free])
        unbalanced = self._fixed_push - gradient - pressed.eliminated(press)
        if pressed.slips:
            unbalanced += self._field.grown(pressed, np.zeros_like(unbalanced), press.missing)
        step, self._border = system.solve(unbalanced, below, refinements=1)
        if pressed.slips:
            step = self._coupled(system, pressed, step, np.zeros_like(below))
        self._iterations += 1
        if not np.all(np.isfinite(step)):
            return step, 'the stiffness is singular'
        largest = float(np.abs(step).max(initial=0.0))
        if largest > self._options.largest_move * self._wall:
            return step, f'an iteration moved the surface by {1e3 * largest:.1f} mm'
        return step, ''

    def _coupled(self, system: BorderedFactor, pressed: Press, step: Array, none: Array) -> Array:
        """The solution (N,) with the growth of friction that the factor leaves out.

        Least residual in the space of what that growth does to the step, again and again (GMRES
        with the factor as preconditioner): around a rod friction grows along the strip as a series
        of exp(mu theta) does, which simple iterations follow only while its terms fall.
        """
        size = float(np.linalg.norm(step))
        if not 0.0 < size < np.inf:
            return step
        basis, images, borders = [step / size], [], []
        given = np.zeros_like(pressed.missing)
        while True:
            grown = self._field.grown(pressed, basis[-1], given)
            further, border = system.solve(grown, none, refinements=0)
            if not np.all(np.isfinite(further)):
                return step
            images.append(basis[-1] - further)
            borders.append(border)
            share, left = np.linalg.lstsq(np.stack(images, axis=1), step, rcond=None)[:2]
            missing = float(np.sqrt(left[0])) / size if len(left) else 0.0
            if not missing > UNCOUPLED or len(basis) == MOST_COUPLED:
                self._border = self._border + share @ np.array(borders)
                return np.asarray(share @ np.array(basis))
            for known in basis:
                further = further - (known @ further) * known
            basis.append(further / np.linalg.norm(further))

    def _along(
        self, step: Array, gradient: Array, pressed: Press, press: Press
    ) -> tuple[Press, float, Array]:
        """Go along a step, no further than where the energy of contact and wall stops to fall."""
        start, share = self._free, 1.0
        depth = pressed.follow(step, press.missing)
        before = float((self._fixed_push - gradient) @ step + press.missing @ depth)
        for _ in range(MOST_CUTS):
            self._free = self._with_pressures(start + share * step)
            now = self._press(press.depth + share * depth)
            residual, gradient = self._residual(now)
            after = float((self._fixed_push - gradient) @ step + now.missing @ depth)
            if (
                self._iterations <= FREE_ITERATIONS
                or not before > 0.0
                or after > -OVERSHOOT * before
                or residual < UNCUT_BELOW
            ):
                break
            share *= max(SMALLEST_CUT, before / (before - after))
        return now, residual, gradient

    def _with_pressures(self, free: Array) -> Array:
        """The motion with the pressures under pins that a thick wall finds in whole steps."""
        positions = self._model.start + free.reshape(-1, 3)
        settled = self._model.shell.settled(positions)
        return free if settled is positions else (settled - self._model.start).reshape(-1)

    def _residual(self, press: Press) -> tuple[float, Array]:
        """Unbalanced force over the loads, and the gradient (N,) it comes from."""
        bordering, loads = self._bordering, self._loads
        moved = self._free.reshape(-1, 3)
        self._energy, gradient = self._model.gradient(self._positions, loads.target, moved)
        gradient = gradient + press.gradient.reshape(-1)
        self._pushes = np.where(bordering.driven, 0.0, loads.force)
        self._pushes[bordering.driven] = self._border[: int(bordering.driven.sum())]
        held = bordering.held @ self._border[int(bordering.driven.sum()) :]
        carried = bordering.push @ self._pushes + loads.dead
        noise = self._solver.noise_force(self._free)
        scale = max(
            float(np.linalg.norm(carried)),
            float(np.linalg.norm(held)),
            float(np.linalg.norm(press.gradient)),
            self._solver.support_force(moved, loads.target),
            noise,
        )
        self._noise = noise / scale
        loose = float(np.linalg.norm(gradient - carried + held))
        self._last = float(np.hypot(loose, np.linalg.norm(press.missing))) / scale
        return self._last, gradient

    def _state(self) -> Equilibrium:
        bordering, press, count = self._bordering, self._final, len(self._model.rest)
        force, depth = self._pushes.copy(), bordering.measure.T @ self._free
        contacts = self._field.contacts
        force[contacts], depth[contacts] = press.force[contacts], press.depth[contacts]
        return Equilibrium(
            converged=True,
            message='',
            positions=self._positions[:count],
            wall=self._positions[count:],
            shell=self._model.shell,
            force=force,
            displacement=depth,
            multipliers=self._border[int(bordering.driven.sum()) :],
            unbalance=np.zeros(6),
            energy=self._energy,
            gas_pressure=self._solver.gas_pressure(self._positions, False),
            residual=self._last,
            iterations=self._iterations,
            factorisations=self._factorisations,
            dead_load=self._loads.dead[: 3 * count],
            grip_motion=self._loads.grip_motion,
            pad_load=-press.gradient[:count].reshape(-1),
            pressed_points=tuple(len(touch.pressure) for touch in press.touches),
            touches=press.touches,
            memory=self._field.remembered(press, self._positions),
            motion=self._loads.motion,
        )


def touched_tangent(tangent: Tangent, field: ContactField, press: Press) -> Tangent:
    """The shell's tangent with the bodies' part."""
    data = tangent.stiffness.data.copy()
    field.add(press, data)
    return replace(
        tangent,
        gradient=tangent.gradient + press.gradient.reshape(-1),
        stiffness=field.face.shell.pattern.matrix(data),
        pad_rows=press.rows,
        pad_corner=press.corner,
    )


def _contact_state(press: Press) -> list[tuple[bytes, bytes]]:
    """Which points of each body touch, and which of them stick."""
    return [(touch.face.at.tobytes(), touch.sticking.tobytes()) for touch in press.touches]
