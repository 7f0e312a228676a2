# SPDX-License-Identifier: Apache-2.0
"""Where contacts only touch: the zero of every depth that a gauge or a user counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium, forced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

# Steps of Newton's method on the depth of a pad; its gap is convex and nearly linear.
STEPS = 20


class FirstTouchError(ValueError):
    """The object alone, without any contact, finds no equilibrium."""


def first_touch(
    solver: EquilibriumSolver, contacts: tuple[ContactPatch, ...]
) -> tuple[Equilibrium, Array]:
    """The object as it is before anything touches it, and the depth (k,) [m] of first touch.

    A blown-up object is larger than its undeformed surface, from which contacts count: that
    difference is the depth at which a pin's centre has not moved yet and a pad touches the first
    point. Raises FirstTouchError where the gas alone leaves no equilibrium.
    """
    model = solver.model
    alone = solver.rest()
    if alone.gas_pressure or model.pressure:
        alone = solver.solve(forced((), []))
    if not alone.converged:
        raise FirstTouchError(f'the object under its own gas: {alone.message}')
    moved = alone.positions - model.rest
    depth = np.zeros(len(contacts))
    for k, contact in enumerate(contacts):
        if contact.body is None:
            depth[k] = float(np.sum(contact.displacement_row() * moved))
            continue
        depth[k] = touch_depth(solver.model, contact, alone.unknowns)
    return alone, depth


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
