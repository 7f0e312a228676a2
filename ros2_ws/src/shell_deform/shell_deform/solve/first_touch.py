# SPDX-License-Identifier: Apache-2.0
"""An object before anything touches it, under its own pressure, and where contacts only touch.

That is the zero of every depth that a gauge or a user counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.solve.borders import borders
from shell_deform.solve.equilibrium import Equilibrium, forced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

# Steps of Newton's method on the depth of a pad; its gap is convex and nearly linear.
STEPS = 20

NARROW, MOST_TRIALS = 0.02, 30
"""The pressure at which an object buckles is told within this share, after so many trials."""


class FirstTouchError(ValueError):
    """The object alone, without any contact, finds no equilibrium."""


def alone(solver: EquilibriumSolver) -> Equilibrium:
    """The object as it is before anything touches it: blown up or pressed together by its own
    pressures, else undeformed.

    Raises FirstTouchError where it cannot stand under them, with what it can.
    """
    model = solver.model
    if not model.own_pressure:
        return solver.rest()
    nothing = forced((), [])
    bare = borders(model, nothing)
    found = solver.solve(nothing)

    def stands(state: Equilibrium) -> bool:
        return solver.negative_modes(bare, state) == 0

    most, why = found.filled, found.message
    solver.take(model.filled(most))
    buckles = most > 0.0 and not stands(found)
    if buckles:
        state, least, why = solver.rest(), 0.0, 'it buckles'
        for _ in range(MOST_TRIALS):
            if most - least < NARROW * most:
                break
            share = 0.5 * (least + most)
            solver.take(model.filled(share))
            trial = solver.solve(nothing, state)
            if trial.converged and stands(trial):
                state, least = trial, share
            else:
                most = share
    solver.take(model)
    if found.converged and not buckles:
        return found
    raise FirstTouchError(
        f'the object alone stands about {most * model.own_pressure:.3g} Pa inside over outside, '
        f'not its own {model.own_pressure:.6g} Pa: {why}; give less pressure, a thicker wall or '
        'more supports'
    )


def first_touch(
    solver: EquilibriumSolver, contacts: tuple[ContactPatch, ...]
) -> tuple[Equilibrium, Array]:
    """The object as it is before anything touches it, and the depth (k,) [m] of first touch.

    A blown-up object is larger than its undeformed surface, from which contacts count: that
    difference is the depth at which a pin's centre has not moved yet and a pad touches the first
    point. Raises FirstTouchError as `alone` does.
    """
    unloaded = alone(solver)
    moved = unloaded.positions - solver.model.rest
    depth = np.zeros(len(contacts))
    for k, contact in enumerate(contacts):
        if contact.body is None:
            depth[k] = float(np.sum(contact.displacement_row() * moved))
            continue
        depth[k] = touch_depth(solver.model, contact, unloaded.unknowns)
    return unloaded, depth


def touch_depth(model: ShellModel, contact: ContactPatch, unknowns: Array) -> float:
    """Depth [m] at which the body of a contact touches the shell of these `unknowns` (n, 3)."""
    depth = 0.0
    for _ in range(STEPS):
        value, normal = _clearance(model, contact, unknowns, depth)
        nearest = int(np.argmin(value))
        step = float(value[nearest] / max(normal[nearest] @ contact.axis, 0.1))
        depth += step
        if abs(step) < 1e-12 * contact.radius:
            break
    return depth


def _clearance(
    model: ShellModel, contact: ContactPatch, control: Array, depth: float
) -> tuple[Array, Array]:
    """Distance (p,) [m] of the outer face from a rigid body at a depth [m], and its gradient."""
    assert contact.body is not None
    face = model.outer_face.positions(control)
    there = contact.body.posed(depth, np.zeros(6)).distance(contact.body.shape, face)
    return there.value, there.normal
