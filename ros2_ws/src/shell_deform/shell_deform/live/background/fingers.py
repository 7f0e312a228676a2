# SPDX-License-Identifier: Apache-2.0
"""The rigid bodies that fingers carry, on a shell: where they first touched, where they are now.

A body touches for the first time where its finger does, on the shell as it is then. From there on
its travel is a depth along the axis it had, and all else of its motion a shift and a turn. It
keeps its place on the shell by friction alone, so nothing is laid anew while it slides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shell_deform.contact.bodies import Body, BodyError, RoundBar, frame_of
from shell_deform.contact.body_file import FingerBody
from shell_deform.contact.loads import ContactPatch, contact_patch
from shell_deform.live.background.coarseness import coarseness
from shell_deform.live.background.contact_tracking import STEEPEST, Touch
from shell_deform.model import ShellModel
from shell_deform.solve.first_touch import touch_depth

Array = NDArray[np.float64]

START_INSIDE = 0.25
"""A finger that first touches further inside the object than this share of its face's half width
touches no object of this shape, in this pose."""


@dataclass(frozen=True, eq=False)
class Finger:
    """A body on the shell; in the object's frame.

    Attributes:
        number: of the finger. carried: what it carries. contact: where that touches.
        pin: an even push at the same place, for linear theory. first: (3,) where its frame was at
            first touch, as the hand says [m]. turn: (3, 3) its axes then.
        offset: depth of first touch [m]. coarseness: relative stiffness error of the mesh there.
        touch: what the finger reports now. now: (3, 3) the axes of its frame now.
    """

    number: int
    carried: FingerBody
    contact: ContactPatch
    pin: ContactPatch
    first: Array
    turn: Array
    offset: float
    coarseness: float
    touch: Touch
    now: Array

    @property
    def body(self) -> Body:
        """The body before it moves."""
        assert self.contact.body is not None
        return self.contact.body

    def moved(self, touch: Touch, friction: float) -> Finger:
        """The same where the finger now reports."""
        contact = self.contact
        if self.body.friction != friction:
            contact = replace(contact, body=replace(self.body, friction=friction))
        now = frame_of(touch.normal, _along(touch, self.now[:, 0]))
        return replace(self, contact=contact, touch=touch, now=now)

    def depth(self, tendon: float) -> float:
        """Along its axis [m], NaN where its travel is unknown; `tendon` [m/N] stretches."""
        return self.touch.travel + self.offset - tendon * self.touch.force

    @property
    def motion(self) -> Array:
        """(6,) its shift [m] and turn [rad] beside the depth."""
        shift = self.touch.point - self.first
        shift = shift - (shift @ self.contact.axis) * self.contact.axis
        turn = Rotation.from_matrix(self.now @ self.turn.T).as_rotvec()
        return np.concatenate([shift, turn])


def laid(
    model: ShellModel, unknowns: Array, touch: Touch, carried: FingerBody | None, friction: float
) -> Finger:
    """A finger that touches the shell of these `unknowns` (N, 3) of `model` for the first time.

    One that carries nothing known is a pin with a flat round end. Raises BodyError for one that
    cannot touch there so.
    """
    if carried is None:
        shape = RoundBar(touch.radius)
        carried = FingerBody('pin', shape, touch.radius, np.zeros((0, 3)))
    control = unknowns[: len(model.rest)]
    half_wall = 0.5 * float(model.shell.thickness.mean())
    at = touch.first_point
    found = model.surface.closest_point(control, at[None], offset=half_wall)
    who = f'finger {touch.finger}'
    inside = -float(found.distance[0])
    if inside > START_INSIDE * carried.size:
        raise BodyError(
            f'{who} starts {inside:.3g} m inside the object; correct its travel, or the pose of '
            'the object'
        )
    if -inside > 2.0 * carried.size:
        raise BodyError(
            f'{who} touches {-inside:.3g} m away from the object; correct its place, or the pose '
            'of the object'
        )
    if not touch.normal @ -found.normal[0] > STEEPEST:
        raise BodyError(f'{who} does not face the object where it touches')
    material = model.surface.evaluate(model.rest, found.triangle, found.parameters)
    place = found.triangle, found.parameters
    at_rest = material.position[0]
    held = model.held_radius(carried.size)
    patch = contact_patch(model.surface, at_rest, held, touch.normal, place=place)
    pin = contact_patch(model.surface, at_rest, touch.radius, touch.normal, place=place)
    turn = frame_of(touch.normal, _along(touch, None))
    body = Body(carried.shape, found.position[0], turn, touch.normal, friction)
    contact = replace(patch, body=body)
    offset = touch_depth(model, contact, unknowns)
    coarse = coarseness(model.surface.mesh, 2.0 * half_wall, int(found.triangle[0]), material)
    return Finger(touch.finger, carried, contact, pin, at, turn, offset, coarse, touch, turn)


def _along(touch: Touch, before: Array | None) -> Array | None:
    """Direction to the tip of a finger: what it reports, else as it was before."""
    return touch.along if np.isfinite(touch.along).all() else before
