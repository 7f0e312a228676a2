# SPDX-License-Identifier: Apache-2.0
"""Fingertips, pads and plates as contacts of a grasp: from what they do to the points they press.

A thin shell carries a flat finger on a ring near its rim (Essenburg, J. Appl. Mech. 29:481, 1962),
so the arm of the spin torque is that of the pressure itself, never that of an even disc.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.bodies import Body
from shell_deform.contact.contact_field import Face, Press, Touch
from shell_deform.contact.loads import ContactPatch
from shell_deform.contact.outer_face import FacePoints
from shell_deform.contact.thick_face import ThickFacePoints
from shell_deform.grasp import reading
from shell_deform.grasp.contacts import GraspContacts, contacts
from shell_deform.grasp.reading import (
    HELD_ROWS,
    SMALL_LOAD,
    Response,
    body_loads,
    body_mass,
    finger_force,
    held_contacts,
    holds_still,
    outer_feet,
    unheld,
)
from shell_deform.grasp.slip import Sharing, Slipping
from shell_deform.model import ShellModel
from shell_deform.solve.borders import borders
from shell_deform.solve.contact_step import touched_tangent
from shell_deform.solve.equilibrium import Equilibrium, displaced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

MOST_RUBBED = 0.1
"""Of a push: rubbing carries less, and a tangent that says more is that of a loose grasp."""

SMALL_CHANGE = 1e-3
"""Of what a contact carries: so much is changed at most where the turn of normals is taken."""


def read_grasp(
    model: ShellModel, patches: tuple[ContactPatch, ...], state: Equilibrium, friction: float
) -> GraspContacts:
    """The contacts of an equilibrium, pins and rigid bodies in the order of their patches.

    `friction` for contacts that bring none of their own. A body that touches nothing does not
    push.
    """
    found: list[GraspContacts] = []
    touches = iter(state.touches)
    row = 0
    for i, patch in enumerate(patches):
        held = np.zeros(HELD_ROWS)
        if _is_held(patch):
            held = state.multipliers[row : row + HELD_ROWS]
            row += HELD_ROWS
        if patch.body is None:
            place = outer_feet(model, (patch,)).at(state.positions)
            pushed = state.force[i : i + 1]
            found.append(held_contacts((patch,), *place, pushed, held, friction))
        else:
            own = patch.body.friction or friction
            found.append(_touched(patch, patch.body, next(touches), held, own))
    names = GraspContacts.__dataclass_fields__
    return GraspContacts(
        *(np.concatenate([getattr(one, name) for one in found]) for name in names)
    )


def _is_held(patch: ContactPatch) -> bool:
    """Whether an equilibrium holds this patch: what rubs holds it by itself."""
    return not patch.slides and not (patch.body is not None and patch.body.friction > 0.0)


def _touched(
    patch: ContactPatch, body: Body, touch: Touch, held: Array, friction: float
) -> GraspContacts:
    """One body as a contact where its pressure is centred, along the mean of its pressure.

    `held` (3,): multipliers of what keeps the patch of a body without friction from sliding.
    """
    pressure = touch.weights * touch.pressure
    total = float(pressure.sum())
    if not total > 0.0:
        return contacts(patch.point, patch.axis, 0.0, friction)
    place = touch.face.position
    # Along the normals of the body, which are those of the wall where it lies flat on it.
    pressed = pressure @ touch.pose.distance(body.shape, place).normal
    normal = pressed / np.linalg.norm(pressed)
    centre = pressure @ place / total
    away = place - centre
    across = away - (away @ normal)[:, None] * normal
    arm = float(pressure @ np.linalg.norm(across, axis=1)) / total
    force = touch.force + finger_force(patch, np.zeros(1), held[:, None])[:, 0]
    spin = float(touch.moment(centre) @ normal) - float(held[-1]) * patch.radius
    return contacts(
        centre, normal, float(force @ normal), friction, arm, force[None], np.array([spin])
    )


def read_response(
    solver: EquilibriumSolver,
    patches: tuple[ContactPatch, ...],
    state: Equilibrium,
    grasp: GraspContacts,
) -> Response:
    """How the tangent at `state` shares out wrenches while pins and bodies stand still.

    Points of a body that stick go on sticking, and those that slip slip on: the tangent of the
    state. `grasp`: its contacts.
    """
    if all(patch.body is None for patch in patches):
        return reading.read_response(solver, patches, state, grasp)
    model = solver.model.on_contacts(patches)
    if model is not solver.model:
        solver = EquilibriumSolver(model)
    centre, wrenches = body_loads(body_mass(model), state.positions)
    if not holds_still(model, patches, grasp):
        return unheld(centre, len(patches))
    case = replace(displaced(patches, state.displacement), motion=state.motion)
    bordering = borders(model, case)
    assert bordering.field is not None
    press = Press(
        state.touches, np.zeros_like(state.unknowns), state.force, state.displacement,
        np.zeros((state.unknowns.size, 0)), np.zeros(0), np.zeros(0, np.int64),
        np.zeros(len(patches)),
    )  # fmt: skip
    tangent = touched_tangent(model.tangent(state.unknowns), bordering.field, press)
    loads = standing_loads(bordering.field.face, state.touches, wrenches, state.unknowns.size)
    standing = Standing(centre, wrenches, *solver.system(tangent, bordering).solve(loads))
    return touched_response(model, patches, state, grasp, standing)


def standing_loads(face: Face, touches: tuple[Touch, ...], wrenches: Array, size: int) -> Array:
    """Loads (N, 7) of `Standing` on N unknowns: `wrenches` (3 n, 6), then what ends the rubbing.

    Pressed in, a region rubs outward from its middle, which carries part of the push and holds
    its pressure together. What slips across has no friction left for that: of the friction of each
    body only its resultant stays, spread as the pressure is.
    """
    loads = np.zeros((size, wrenches.shape[1] + 1))
    loads[: len(wrenches), :-1] = wrenches
    for touch in touches:
        pressed = touch.weights * touch.pressure
        total = float(pressed.sum())
        if total > 0.0:
            rubbed = touch.weights[:, None] * touch.friction
            rubbed = rubbed - np.outer(pressed / total, rubbed.sum(axis=0))
            loads[:, -1] += face.forces(touch.face, rubbed).reshape(-1)
    return loads


@dataclass(frozen=True)
class Standing:
    """What a shell does under `standing_loads` while pins and bodies stand still.

    Attributes:
        centre: (3,) [m] of the unit wrenches. loads: (3 n, 6) nodal forces of the wrenches.
        motion: (N, 7) of all unknowns. border: pushes of the pins, then multipliers of what is
            held, (b, 7).
    """

    centre: Array
    loads: Array
    motion: Array
    border: Array


def touched_response(
    model: ShellModel,
    patches: tuple[ContactPatch, ...],
    state: Equilibrium,
    grasp: GraspContacts,
    standing: Standing,
) -> Response:
    """What that motion changes of each contact: its push, its place, its friction, its normal."""
    *wrenched, relieved = zip(standing.motion.T, standing.border.T, strict=True)
    small = np.array([_small_load(model, state, motion) for motion, _ in wrenched])
    around = [
        read_grasp(model, patches, _moved(model, patches, state, load, *columns), 0.0)
        for load, columns in zip(small.tolist(), wrenched, strict=True)
    ]
    push, across, spin = (
        np.stack([(getattr(one, name) - getattr(grasp, name)) for one in around], axis=-1) / small
        for name in ('push', 'tangential', 'spin')
    )
    before = grasp.push[:, None] * grasp.normal + grasp.tangential
    force = np.stack(
        [one.push[:, None] * one.normal + one.tangential - before for one in around], axis=-1
    )
    compliance = standing.loads.T @ standing.motion[: len(standing.loads), :-1]
    load = _small_load(model, state, relieved[0])
    after = _moved(model, patches, state, load, *relieved).touches
    slipping = _slipping(patches, state.touches, after, load, grasp)
    return Response(
        standing.centre, force / small, Sharing(push, across, spin), compliance, slipping
    )


def _slipping(
    patches: tuple[ContactPatch, ...],
    touches: tuple[Touch, ...],
    relieved: tuple[Touch, ...],
    load: float,
    grasp: GraspContacts,
) -> Slipping:
    """What the contacts `grasp` of `touches` have without friction, to first order.

    `relieved`: the touches once so much (`load`) of the friction that rubs is gone.
    """
    share, arm = np.ones(grasp.count), grasp.arm.copy()
    both = zip(touches, relieved, strict=True)
    for i, patch in enumerate(patches):
        if patch.body is None:
            continue
        now, then = (_bare(patch, patch.body, touch) for touch in next(both))
        if not (patch.body.friction > 0.0 and grasp.push[i] > 0.0):
            continue
        push = now.push[0] + (then.push[0] - now.push[0]) / load
        kept = float(push / grasp.push[i])
        if abs(kept - 1.0) < MOST_RUBBED:
            share[i], arm[i] = kept, now.arm[0] + (then.arm[0] - now.arm[0]) / load
    return Slipping(share, arm)


def _bare(patch: ContactPatch, body: Body, touch: Touch) -> GraspContacts:
    """A body as a contact by its pressure alone."""
    if not len(touch.pressure):
        return contacts(patch.point, patch.axis, 0.0, 0.0)
    normal = touch.pose.distance(body.shape, touch.face.position).normal
    bare = replace(touch, traction=touch.pressure[:, None] * normal)
    return _touched(patch, body, bare, np.zeros(HELD_ROWS), 0.0)


def _small_load(model: ShellModel, state: Equilibrium, motion: Array) -> float:
    """A load [N, N m], whose unit moves the unknowns (N,), that changes little of any contact.

    A body that only just touches is soon lifted off, and a grasp with a loose direction goes far.
    """
    face: Face = model.outer_face
    step, largest = motion.reshape(-1, 3), 0.0
    for touch in state.touches:
        carried = float(touch.weights @ touch.pressure)
        if carried > 0.0:
            moved = face.moved(touch.face, step)
            force = touch.weights[:, None] * np.einsum('pij,pj->pi', touch.stiffness, moved)
            largest = max(largest, float(np.linalg.norm(force, axis=1).sum()) / carried)
    return min(SMALL_LOAD, SMALL_CHANGE / largest) if largest > 0.0 else SMALL_LOAD


def _moved(
    model: ShellModel,
    patches: tuple[ContactPatch, ...],
    state: Equilibrium,
    load: float,
    motion: Array,
    border: Array,
) -> Equilibrium:
    """The state after a load whose unit moves the unknowns (N,) and the borders (b,)."""
    step = load * motion.reshape(-1, 3)
    pins = np.array([patch.body is None for patch in patches])
    force, held = state.force.copy(), state.multipliers.copy()
    force[pins] += load * border[: pins.sum()]
    # Behind them the state may have held what is rigid, which standing bodies hold themselves.
    rows = HELD_ROWS * sum(map(_is_held, patches))
    held[:rows] += load * border[pins.sum() :][:rows]
    bodies = [patch.body for patch in patches if patch.body is not None]
    return replace(
        state,
        positions=state.positions + step[: len(state.positions)],
        force=force,
        multipliers=held,
        touches=tuple(
            _pressed_on(body, touch, model.outer_face.at(state.unknowns + step, touch.face.at))
            for body, touch in zip(bodies, state.touches, strict=True)
        ),
    )


def _pressed_on(body: Body, touch: Touch, face: FacePoints | ThickFacePoints) -> Touch:
    """A touch after its points have moved a little, to `face`."""
    if not len(touch.pressure):
        return touch
    before = touch.pose.distance(body.shape, touch.face.position).value
    value = touch.pose.distance(body.shape, face.position).value
    moved = face.position - touch.face.position
    return replace(
        touch,
        face=face,
        pressure=touch.pressure * np.maximum(value / before, 0.0),
        traction=touch.traction - np.einsum('pij,pj->pi', touch.stiffness, moved),
    )
