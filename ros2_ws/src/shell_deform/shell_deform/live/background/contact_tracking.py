"""Which material patch each finger presses, while fingers touch, slide and leave.

A held contact keeps its material point. When a finger has moved sideways by more than a share of
its radius, turned, or is new, its patch is laid again where the finger now is on the deformed
surface; the lateral motion that point already has is where it is then held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.loads import ContactPatch, contact_patch
from shell_deform.live.background.condensed import HELD_ROWS
from shell_deform.model import ShellModel

Array = NDArray[np.float64]

SLIDE_SHARE = 0.25
TURN = np.cos(np.radians(8.0))
STEEPEST = np.cos(np.radians(60.0))
RADIUS_CHANGE = 0.25


@dataclass(frozen=True)
class Touch:
    """What one finger reports, in the object's frame.

    Attributes:
        finger: its number. point: (3,) on the outer face [m]. normal: (3,) inward.
        radius: of the patch [m]. force: push [N]. travel: since first touch [m], NaN if unknown.
        displacement: the estimator's absolute displacement of the patch [m], NaN if none.
    """

    finger: int
    point: Array
    normal: Array
    radius: float
    force: float
    travel: float
    displacement: float

    @property
    def first_point(self) -> Array:
        """Where the finger first touched (3,) [m], as far as its travel is known."""
        return self.point - (self.travel if np.isfinite(self.travel) else 0.0) * self.normal


@dataclass(frozen=True)
class HeldContact:
    """A patch in use.

    Attributes:
        finger: who presses. patch: the material patch. touched: (3,) where the finger was [m].
        held: (3,) lateral motion and spin the patch is held at.
        travel_offset: displacement of the patch minus the travel of the finger [m].
        bias: displacement minus the depth of the pin inside the shell at rest [m]: what pose and
            first touch are off by; it stays while the finger slides.
    """

    finger: int
    patch: ContactPatch
    touched: Array
    held: Array
    travel_offset: float
    bias: float

    def still_good(self, touch: Touch) -> bool:
        """Whether the finger still presses this patch."""
        moved = touch.point - self.touched
        sideways = moved - (moved @ self.patch.axis) * self.patch.axis
        return bool(
            np.linalg.norm(sideways) <= SLIDE_SHARE * self.patch.radius
            and self.axis_of(touch) @ self.patch.axis >= TURN
            and abs(touch.radius - self.patch.radius) <= RADIUS_CHANGE * self.patch.radius
        )

    def axis_of(self, touch: Touch) -> Array:
        """The push direction that counts for `touch`."""
        return touch.normal if touch.normal @ self.patch.axis > STEEPEST else self.patch.axis


class ContactTracker:
    """The patches of one shell, by finger."""

    def __init__(self, model: ShellModel) -> None:
        self.model = model
        self.contacts: tuple[HeldContact, ...] = ()
        self._half_wall = 0.5 * float(model.shell.thickness.mean())

    @property
    def patches(self) -> tuple[ContactPatch, ...]:
        """The patches in use, in the order of the fingers."""
        return tuple(contact.patch for contact in self.contacts)

    def reset(self) -> None:
        """Forget all contacts."""
        self.contacts = ()

    def update(self, touches: tuple[Touch, ...], positions: Array) -> bool:
        """Take what the fingers report at control `positions` (n, 3); True if patches changed."""
        known = {contact.finger: contact for contact in self.contacts}
        fresh = not self.contacts
        updated = []
        for touch in sorted(touches, key=lambda touch: touch.finger):
            old = known.get(touch.finger)
            if old is not None and old.still_good(touch):
                updated.append(old)
            else:
                updated.append(self._lay(touch, old, positions, fresh))
        changed = len(updated) != len(self.contacts) or any(
            new is not old for new, old in zip(updated, self.contacts, strict=True)
        )
        self.contacts = tuple(updated)
        return changed

    def _lay(
        self, touch: Touch, old: HeldContact | None, positions: Array, fresh: bool
    ) -> HeldContact:
        """A new patch where the finger is."""
        surface = self.model.surface
        # Someone who joins late still knows where the finger first touched the shell at rest.
        at = touch.first_point if fresh else touch.point
        found = surface.closest_point(positions, at[None], offset=self._half_wall)
        material = surface.evaluate(self.model.rest, found.triangle, found.parameters)
        inward = -found.normal[0]
        axis = touch.normal if touch.normal @ inward > STEEPEST else inward
        patch = contact_patch(surface, material.position[0], touch.radius, axis)
        moved = (positions - self.model.rest).reshape(-1)
        held = patch.held_rows().reshape(HELD_ROWS, -1) @ moved
        travel = touch.travel if np.isfinite(touch.travel) else 0.0
        depth = self._depth(patch, touch)
        if old is None:
            bias = travel + float(patch.displacement_row().reshape(-1) @ moved) - depth
        else:
            bias = old.bias
        return HeldContact(
            touch.finger, patch, touch.point.copy(), held, bias + depth - travel, bias
        )

    def _depth(self, patch: ContactPatch, touch: Touch) -> float:
        """How far the pin stands inside the outer face at rest, at a patch [m]."""
        outer = patch.point - self._half_wall * patch.axis
        return float((touch.point - outer) @ patch.axis)
