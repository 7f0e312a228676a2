# SPDX-License-Identifier: Apache-2.0
"""Fingertips, pads and plates as contacts of a grasp: from what they do to the points they press.

A thin shell carries a flat finger on a ring near its rim (Essenburg, J. Appl. Mech. 29:481, 1962),
so the arm of the spin torque is that of the pressure itself, never that of an even disc.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.contact_field import Touch
from shell_deform.contact.loads import ContactPatch
from shell_deform.grasp.contacts import GraspContacts, contacts
from shell_deform.grasp.reading import HELD_ROWS, finger_force, held_contacts, outer_feet
from shell_deform.model import ShellModel
from shell_deform.solve.equilibrium import Equilibrium

Array = NDArray[np.float64]


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
        rubs = patch.body is not None and patch.body.friction > 0.0
        held = np.zeros(HELD_ROWS)
        if not (rubs or patch.slides):
            held = state.multipliers[row : row + HELD_ROWS]
            row += HELD_ROWS
        if patch.body is None:
            place = outer_feet(model, (patch,)).at(state.positions)
            pushed = state.force[i : i + 1]
            found.append(held_contacts((patch,), *place, pushed, held, friction))
        else:
            own = patch.body.friction if rubs else friction
            found.append(_touched(patch, next(touches), held, own))
    names = GraspContacts.__dataclass_fields__
    return GraspContacts(
        *(np.concatenate([getattr(one, name) for one in found]) for name in names)
    )


def _touched(patch: ContactPatch, touch: Touch, held: Array, friction: float) -> GraspContacts:
    """One body as a contact where its pressure is centred, along the mean of its pressure.

    `held` (3,): multipliers of what keeps the patch of a body without friction from sliding.
    """
    pressure = touch.weights * touch.pressure
    total = float(pressure.sum())
    if not total > 0.0:
        return contacts(patch.point, patch.axis, 0.0, friction)
    place = touch.face.position
    # Along the normals of the body, which are those of the wall where it lies flat on it.
    pressed = touch.weights @ (touch.traction - touch.friction)
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
