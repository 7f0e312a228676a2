# SPDX-License-Identifier: Apache-2.0
"""Which material patch each finger presses, while fingers touch, slide and leave.

A held contact keeps its material point. When a finger has moved sideways by more than a share of
its radius, turned, or is new, its patch is laid again where the finger now is on the deformed
surface; the lateral motion that point already has is where it is then held.

What pose and first touch are off by at a place is remembered while anything touches: a finger that
comes back there, under its own number or another one, with the travel it had, makes the dent it
made. A finger that slid to where the shell cannot be followed is left on the patch it had, until
it has slid further.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.bodies import frame_of
from shell_deform.contact.cell_load import CellShape, shaped_by_cells
from shell_deform.contact.loads import ContactPatch, contact_patch
from shell_deform.live.background.coarseness import coarseness
from shell_deform.live.background.condensed import HELD_ROWS
from shell_deform.live.pose import Pose
from shell_deform.model import ShellModel

Array = NDArray[np.float64]

SLIDE_SHARE = 0.25
TURN = np.cos(np.radians(8.0))
STEEPEST = np.cos(np.radians(60.0))
RADIUS_CHANGE = 0.25

SHAPE_CHANGE = 0.1
"""A push of which more lies on other touch cells than when the patch was laid is laid anew."""

LONGEST_SLIDE = 4.0
"""A finger that has moved sideways by more radii touches anew [radii]; at least..."""

SHORTEST_JUMP = 8e-3
"""... this far [m]: fingers that slide fast between two load cases do not jump."""

SAME_PLACE = 0.5
"""First touches within this share of the radius are one."""

REMEMBERED = 64
"""Places of first touch that are remembered."""


@dataclass(frozen=True)
class Touch:
    """What one finger reports, in the object's frame.

    Attributes:
        finger: its number. point: (3,) on the outer face [m]. normal: (3,) inward.
        radius: of the patch [m]. force: push [N]. travel: since first touch [m], NaN if unknown.
        displacement: the estimator's absolute displacement of the patch [m], NaN if none.
        along: (3,) to the tip of the finger, NaN if unknown.
        shape: where its touch cells feel the push; None: evenly over the radius.
    """

    finger: int
    point: Array
    normal: Array
    radius: float
    force: float
    travel: float
    displacement: float
    along: Array = field(default_factory=lambda: np.full(3, np.nan))
    shape: CellShape | None = None

    @property
    def first_point(self) -> Array:
        """Where the finger first touched (3,) [m], as far as its travel is known."""
        return self.point - (self.travel if np.isfinite(self.travel) else 0.0) * self.normal

    def seen_from(self, pose: Pose) -> Touch:
        """The same in the frame of an object, of a touch in the contacts' frame."""
        return replace(
            self,
            point=pose.to_object(self.point),
            normal=self.normal @ pose.rotation,
            along=self.along @ pose.rotation,
        )


@dataclass(frozen=True)
class HeldContact:
    """A patch in use.

    Attributes:
        finger: who presses. patch: the material patch. touched: (3,) where the finger was [m].
        held: (3,) lateral motion and spin the patch is held at.
        travel_offset: displacement of the patch minus the travel of the finger [m].
        bias: displacement minus the depth of the pin inside the shell at rest [m]: what pose and
            first touch are off by; it stays while the finger slides.
        first: (3,) where the finger first touched, as far as its travel is known [m].
        coarseness: relative stiffness error of the mesh there.
        shape: of the push, as of a `Touch`.
        tried: (3,) to where the finger has slid and was not followed [m], or None.
    """

    finger: int
    patch: ContactPatch
    touched: Array
    held: Array
    travel_offset: float
    bias: float
    first: Array
    coarseness: float
    shape: CellShape | None = None
    tried: Array | None = None

    def still_good(self, touch: Touch) -> bool:
        """Whether the finger still presses this patch, as far as anyone can follow."""
        moved = touch.point - (self.touched if self.tried is None else self.tried)
        sideways = moved - (moved @ self.patch.axis) * self.patch.axis
        return bool(
            np.linalg.norm(sideways) <= SLIDE_SHARE * self.patch.radius
            and self.axis_of(touch) @ self.patch.axis >= TURN
            and self.has_radius_of(touch)
            and self._has_shape_of(touch)
        )

    def has_radius_of(self, touch: Touch) -> bool:
        """Whether the finger presses with about the radius of this patch."""
        return abs(touch.radius - self.patch.radius) <= RADIUS_CHANGE * self.patch.radius

    def _has_shape_of(self, touch: Touch) -> bool:
        if self.shape is None or touch.shape is None:
            return self.shape is touch.shape
        return self.shape.differs(touch.shape) <= SHAPE_CHANGE

    def slides_to(self, touch: Touch) -> bool:
        """Whether the finger can have come to `touch` without letting go."""
        moved = touch.point - self.touched
        sideways = moved - (moved @ self.patch.axis) * self.patch.axis
        reach = max(LONGEST_SLIDE * self.patch.radius, SHORTEST_JUMP)
        steep = float(touch.normal @ self.patch.axis) <= STEEPEST
        return float(np.linalg.norm(sideways)) < reach and not steep

    def axis_of(self, touch: Touch) -> Array:
        """The push direction that counts for `touch`."""
        return touch.normal if touch.normal @ self.patch.axis > STEEPEST else self.patch.axis


class ContactTracker:
    """The patches of one shell, by finger."""

    def __init__(
        self, model: ShellModel, unloaded: Array, at_rest: bool = False, slides: bool = False
    ) -> None:
        """`unloaded`: control points (n, 3) [m] where first contacts are laid; all `at_rest`.

        `slides`: whether nothing holds them sideways.
        """
        self.model = model
        self._slides = slides
        self._unloaded = unloaded
        self.contacts: tuple[HeldContact, ...] = ()
        self.laid: frozenset[int] = frozenset()
        """Fingers that touched anew in the last update."""
        self.slid: frozenset[int] = frozenset()
        """Fingers that were followed to another patch in the last update."""
        self._at_rest = at_rest
        self._half_wall = 0.5 * float(model.shell.thickness.mean())
        self._memory: list[HeldContact] = []

    @property
    def patches(self) -> tuple[ContactPatch, ...]:
        """The patches in use, in the order of the fingers."""
        return tuple(contact.patch for contact in self.contacts)

    def reset(self) -> None:
        """Forget all contacts."""
        self.contacts = ()
        self._memory.clear()

    def exchanged(self, touches: tuple[Touch, ...]) -> bool:
        """Whether others have come where some fingers stay and some have gone, all at once.

        Who comes back to a place that is remembered does not count as one who comes.
        """
        known = {contact.finger: contact for contact in self.contacts}
        stay = [
            (old := known.get(touch.finger)) is not None
            and (old.still_good(touch) or old.slides_to(touch))
            for touch in touches
        ]
        come = any(
            not stays and self._remembered(touch) is None
            for touch, stays in zip(touches, stay, strict=True)
        )
        return come and 0 < sum(stay) < len(self.contacts)

    def update(self, touches: tuple[Touch, ...], positions: Array, moved: bool = False) -> bool:
        """Take what the fingers report at control `positions` (n, 3); True if patches changed.

        `moved`: something else than fingers has deformed the shell before they came.
        """
        known = {contact.finger: contact for contact in self.contacts}
        at_rest = self._at_rest or not (self.contacts or moved)
        updated, laid, slid = [], [], []
        for touch in sorted(touches, key=lambda touch: touch.finger):
            old = known.get(touch.finger)
            if old is not None and old.still_good(touch):
                updated.append(old)
                continue
            if old is None or not old.slides_to(touch):
                old = None
                laid.append(touch.finger)
            elif old.has_radius_of(touch):
                slid.append(touch.finger)
            back = self._remembered(touch) if old is None else None
            updated.append(back or self._lay(touch, old, positions, at_rest))
        changed = len(updated) != len(self.contacts) or any(
            new is not old for new, old in zip(updated, self.contacts, strict=True)
        )
        self.contacts, self.laid = tuple(updated), frozenset(laid)
        self.slid = frozenset(slid)
        return changed

    def stay(self, before: tuple[HeldContact, ...], touches: tuple[Touch, ...]) -> None:
        """Leave the fingers that slid in the last update on the patches `before` it."""
        point = {touch.finger: touch.point for touch in touches}
        self.contacts = tuple(
            replace(old, tried=point[old.finger].copy()) if old.finger in self.slid else old
            for old in before
        )
        self.slid = frozenset()

    def _lay(
        self, touch: Touch, old: HeldContact | None, positions: Array, at_rest: bool
    ) -> HeldContact:
        """A new patch where the finger is."""
        surface = self.model.surface
        positions = self._unloaded if at_rest else positions
        # Someone who joins late still knows where the finger first touched the shell at rest.
        at = touch.first_point if at_rest else touch.point
        found = surface.closest_point(positions, at[None], offset=self._half_wall)
        material = surface.evaluate(self.model.rest, found.triangle, found.parameters)
        inward = -found.normal[0]
        axis = touch.normal if touch.normal @ inward > STEEPEST else inward
        place = found.triangle, found.parameters
        patch = contact_patch(surface, material.position[0], touch.radius, axis, place=place)
        patch = replace(patch, slides=self._slides)
        if touch.shape is not None:
            frame = at, frame_of(touch.normal, touch.along)
            patch = shaped_by_cells(patch, surface, positions, frame, touch.shape)
        moved = (positions - self.model.rest).reshape(-1)
        held = patch.held_rows().reshape(HELD_ROWS, -1) @ moved
        travel = touch.travel if np.isfinite(touch.travel) else 0.0
        depth = self._depth(patch, touch)
        now = travel + float(patch.displacement_row().reshape(-1) @ moved) - depth
        bias = now if old is None else old.bias
        coarse = coarseness(surface.mesh, 2.0 * self._half_wall, int(found.triangle[0]), material)
        laid = HeldContact(
            touch.finger, patch, touch.point.copy(), held, bias + depth - travel, bias,
            touch.first_point, coarse, touch.shape,
        )  # fmt: skip
        self._memory.append(laid)
        del self._memory[:-REMEMBERED]
        return laid

    def _remembered(self, touch: Touch) -> HeldContact | None:
        """The contact at the place where this finger, or another one, first touched before."""
        if not np.isfinite(touch.travel):
            return None
        for contact in reversed(self._memory):
            same = np.linalg.norm(contact.first - touch.first_point) < SAME_PLACE * touch.radius
            if same and contact.still_good(touch):
                depth = self._depth(contact.patch, touch)
                return replace(
                    contact,
                    finger=touch.finger,
                    travel_offset=contact.bias + depth - touch.travel,
                )
        return None

    def _depth(self, patch: ContactPatch, touch: Touch) -> float:
        """How far the pin stands inside the outer face at rest, at a patch [m]."""
        outer = patch.point - self._half_wall * patch.axis
        return float((touch.point - outer) @ patch.axis)
