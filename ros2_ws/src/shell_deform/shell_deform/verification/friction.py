# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies with friction: a sphere between plates against a solid, and exact identities."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.building import build_model
from shell_deform.contact.bodies import RoundBar
from shell_deform.contact.loads import ContactPatch
from shell_deform.contact.region import pressed_areas
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium, displaced
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.verification import capstan
from shell_deform.verification.plates import kept_solution, squeezed_sphere
from shell_deform.verification.problem import Verified, stopwatch

Array = NDArray[np.float64]

# Load steps for half a wall: friction remembers its way.
STEPS = 5
# The squeeze [walls] and the turn [rad] of the plate that slips all over.
TWISTED, TURNS = 0.4, (3e-3, 1e-2, 3e-2)
SPIN_FRICTION = 0.3
GOAL, RADIUS_GOAL = 0.01, 0.03


def kept_friction() -> dict[str, Any]:
    """Forces of the solid with friction, see `bags/solid_plates.py`."""
    return dict(json.loads((Path(__file__).parent / 'solid_friction.json').read_text()))


def plated(friction: float, control_vertices: int) -> tuple[ShellModel, tuple[ContactPatch, ...]]:
    """The sphere of the kept solution, and two plates with friction at its poles."""
    ball = squeezed_sphere(kept_solution())
    model = build_model(ball, control_vertices=control_vertices)
    bar = RoundBar(ball.contacts[0].radius_m)
    return model, tuple(
        model.touched_by(bar, np.array(contact.at_m), contact.radius_m, friction=friction)
        for contact in ball.contacts
    )


def squeezed(
    solver: EquilibriumSolver, contacts: tuple[ContactPatch, ...], depths: Array
) -> list[Equilibrium]:
    """States at depths [m] of both plates, one from the other."""
    return solver.sweep([displaced(contacts, [depth, depth]) for depth in depths])


def problems(control_vertices: int = 650) -> Iterator[Verified]:
    """Forces with every friction and depth of the kept solution, a plate that spins, a strip."""
    kept = kept_friction()
    for number in range(len(kept['friction'])):
        yield from _squeezed(kept, number, control_vertices)
    yield from spin(control_vertices)
    yield from capstan.problems()


def _squeezed(kept: dict[str, Any], number: int, control_vertices: int) -> Iterator[Verified]:
    """Force and radius of contact at every depth, with one friction of the kept solution."""
    depths, friction = np.array(kept['depth_m']), kept['friction'][number]
    with stopwatch() as watch:
        model, contacts = plated(friction, control_vertices)
        step = depths[0] / STEPS
        count = round(depths[-1] / step)
        states = squeezed(EquilibriumSolver(model), contacts, step * np.arange(1, count + 1))
    for k, depth in enumerate(depths.tolist()):
        at = round(depth / step) - 1
        state = states[at] if at < len(states) else None
        found = {
            'force': (kept['force_n'], np.nan if state is None else float(state.force[0]), GOAL),
            'radius': (kept['radius_m'], _radius(model, state), RADIUS_GOAL),
        }
        for what, (wanted, value, goal) in found.items():
            yield Verified(
                f'plates_with_friction_{friction:g}', f'{what} at {1e3 * depth:g} mm',
                wanted[number][k], kept['source'], value, len(model.rest),
                watch.seconds / len(depths), goal,
            )  # fmt: skip


def _radius(model: ShellModel, state: Equilibrium | None) -> float:
    """Outer radius [m] of the disc or ring that one plate touches; NaN for no state.

    That of a ring with the same area A and polar moment J: b^2 = J / A + A / (2 pi). Deeper than
    a wall the flattened cap rests on its rim alone.
    """
    if state is None or state.memory is None:
        return np.nan
    touch = state.touches[0]
    areas = pressed_areas(model.outer_face, state.memory, touch)
    area, arms = float(areas.sum()), np.linalg.norm(touch.face.position[:, :2], axis=1)
    return float(np.sqrt(areas @ arms**2 / area + area / (2.0 * np.pi)))


def spin(control_vertices: int = 650) -> Iterator[Verified]:
    """Moment of a plate that slips all over, against mu times the integral of its arm."""
    with stopwatch() as watch:
        model, contacts = plated(SPIN_FRICTION, control_vertices)
        solver = EquilibriumSolver(model)
        depth = TWISTED * float(model.shell.thickness.max())
        state = squeezed(solver, contacts, depth * np.linspace(0.25, 1.0, 4))[-1]
        for turn in TURNS:
            motion = np.zeros((2, 6))
            motion[0, 5] = turn
            state = solver.solve(
                replace(displaced(contacts, [depth, depth]), motion=motion), state
            )
    touch = state.touches[0]
    arm = np.linalg.norm(touch.face.position[:, :2], axis=1)
    push = touch.pressure * touch.weights
    yield Verified(
        'spin_of_a_slipping_plate', 'moment [N m]', SPIN_FRICTION * float(push @ arm),
        'friction coefficient times the integral of pressure and arm: exact',
        float(touch.moment(np.zeros(3))[2]), len(model.rest), watch.seconds, GOAL,
    )  # fmt: skip
