# SPDX-License-Identifier: Apache-2.0
"""What a hold and a turn have gone through: forces over time, torque over angle.

Both are kept with so few points that a hold of hours stays small: a hold even in the logarithm of
time, as what is held relaxes, a turn even in the angle since it last turned back.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .poses import Floats
from .scene_model import CONTACT, Contacts

AWAY_S = 1.0
"""Fingers that were away longer begin another hold."""

NEXT = 1.02
"""A moment is kept when it is so many times as late as the last one."""

FIRST_S = 0.01
MOST_TURNS = 400
TURN_BACK = 0.03
"""A grip that goes back by this share of its way begins another curve."""

LEAST_TURN = np.radians(0.01)
"""Turns below are none [rad]."""


@dataclass(frozen=True)
class Later:
    """One message of `deformation/later_force`: r rows of what fingers will feel if they stay.

    Attributes:
        finger, later, force, sigma: (r,), later [s] from now, forces [N].
    """

    finger: Floats
    later: Floats
    force: Floats
    sigma: Floats


@dataclass(frozen=True)
class GripState:
    """A grip in one message of `deformation/grips`.

    Attributes:
        turn: (3,) since it took hold [rad]. force, torque: (3,) on the object [N], [N m].
        friction, capacity: torque of the fingers about the axis of the turn, and what friction
            allows [N m]; NaN where none is known.
    """

    number: int
    turn: Floats
    force: Floats
    torque: Floats
    friction: float
    capacity: float


@dataclass
class HoldCurve:
    """Forces of the fingers since they touched."""

    began: float | None = None
    last: float = 0.0
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    later: Later | None = None

    def add(self, contacts: Contacts) -> None:
        """The sample that came last; a time before the last one starts anew."""
        stamp = contacts.stamp
        on = contacts.flags & CONTACT > 0
        if self.began is not None and not 0.0 <= stamp - self.last <= AWAY_S:
            self.began, self.rows, self.later = None, [], None
        if not on.any():
            return
        if self.began is None:
            self.began, self.rows, self.later = stamp, [], None
        self.last = stamp
        age = stamp - self.began
        if age < FIRST_S or (self.rows and age < NEXT * self.rows[-1][0]):
            return
        size = np.linalg.norm(contacts.forces, axis=1)
        pushes = [float(size[on & (contacts.finger == finger)].sum()) for finger in (1, 2, 3)]
        self.rows.append((age, *pushes))  # type: ignore[arg-type]

    @property
    def age(self) -> float:
        """How long the fingers have touched [s]."""
        return 0.0 if self.began is None else self.last - self.began


@dataclass
class TurnCurve:
    """The grip that has turned furthest, since it last turned back.

    Rows: angle [degrees], torque, friction's share of it and what friction allows [N m].
    """

    grip: int = -1
    rows: list[tuple[float, float, float, float]] = field(default_factory=list)

    def add(self, grips: tuple[GripState, ...]) -> None:
        """The grips of one message."""
        if not grips:
            return
        grip = max(grips, key=lambda one: float(np.linalg.norm(one.turn)))
        size = float(np.linalg.norm(grip.turn))
        if size < LEAST_TURN:
            return
        if grip.number != self.grip:
            self.grip, self.rows = grip.number, []
        # One axis for the whole turn, of the side on which its larger part lies.
        axis = grip.turn / size
        axis = axis * (1.0 if axis[int(np.abs(axis).argmax())] > 0.0 else -1.0)
        angle = float(np.degrees(grip.turn @ axis))
        row = (angle, float(grip.torque @ axis), grip.friction, grip.capacity)
        way = abs(self.rows[-1][0] - self.rows[0][0]) if self.rows else 0.0
        if len(self.rows) > 1:
            ahead = np.sign(self.rows[-1][0] - self.rows[0][0]) * (angle - self.rows[-1][0])
            if ahead < -TURN_BACK * way:
                self.rows = self.rows[-1:]
            elif ahead < way / MOST_TURNS:
                if ahead >= 0.0:
                    self.rows[-1] = row
                return
        self.rows.append(row)

    @property
    def slips(self) -> bool:
        """Whether the fingers are about to slip."""
        return bool(self.rows) and share(self.rows[-1]) > WARN_FROM


WARN_FROM = 0.8
"""Share of friction from which a slip is near, as the reports have it."""


def share(row: tuple[float, float, float, float]) -> float:
    """How much of what friction allows is used; 0 where nothing is known of it."""
    _, _, friction, capacity = row
    known = np.isfinite(friction) and np.isfinite(capacity) and capacity > 0.0
    return abs(friction) / capacity if known else 0.0


@dataclass
class Curves:
    """Both curves of a page."""

    hold: HoldCurve = field(default_factory=HoldCurve)
    turn: TurnCurve = field(default_factory=TurnCurve)
