# SPDX-License-Identifier: Apache-2.0
"""The stage of a recording: an emulated hand on a pty, an object between its pins, and the truth.

Everything here lives on simulated time and is fixed by a seed. The hand is the emulator of
`barrett_hand_bridge`; how the object yields comes from the kept solid solutions.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from bags import grasps
from bags.calculix import Array
from bags.grasps import Touch
from bags.relaxing import Fading, FadingHistory
from bags.scanner import Obstacle, generator
from bags.surfaces import BallTruth, ShellTruth
from barrett_hand_bridge.emulator.geometry import MountedPin, finger_pose
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.pty_port import PtyPort
from barrett_hand_bridge.emulator.serial_hand import SerialHand
from barrett_hand_bridge.emulator.squeeze import ForceTable, Pinched, Squeezed, Supported

Truth = BallTruth | ShellTruth

# How far from first touch a finger begins: 500 counts are 4 degrees of joint 2, about 9 mm.
OPEN_COUNTS = 500.0


@dataclass(frozen=True)
class Setting:
    """What stands where: fingers in use, their touches, spread, object and its rest pose (hand).

    `rotation`, `origin`: the frame of the object file in the hand frame at first touch.
    `from_solution`: rotation from the frame of the kept solid solution to that of the object
    file. `pinched`: the object hangs between two pins; otherwise it
    keeps its place, only its height follows the pins (the arm, or the fingers, carry it along).
    `fading`: how its force falls with time; None for an elastic object. `warm_s`: how long the
    gauges have been on, s.
    """

    truth: Truth
    touches: dict[int, Touch]
    spread_rad: float
    rotation: Array
    origin: Array
    pinched: bool
    width_m: float = 0.0
    from_solution: Array = field(default_factory=lambda: np.eye(3))
    fading: Fading | None = None
    warm_s: float = 0.0


@dataclass(frozen=True)
class Imperfections:
    """How far the real hand is from what its bridge is told (one standard deviation)."""

    pin_length_m: float = 0.0002
    pin_lean_rad: float = math.radians(0.3)
    tendon_compliance_rad_per_nm: float = 0.002


class WireHand(SerialHand):
    """The emulated hand, with a running digest of every byte that crosses its plug."""

    def __init__(self, *arguments: object, **options: object) -> None:
        """As `SerialHand`; the digest starts empty."""
        self.digest = hashlib.sha256()
        self.bytes_in = self.bytes_out = 0
        super().__init__(*arguments, **options)  # type: ignore[arg-type]

    def feed(self, data: bytes) -> None:
        """Bytes from the host."""
        self.digest.update(b'>' + data)
        self.bytes_in += len(data)
        super().feed(data)

    def take(self) -> bytes:
        """Bytes to the host."""
        data = super().take()
        if data:
            self.digest.update(b'<' + data)
            self.bytes_out += len(data)
        return data


def force_table(truth: Truth) -> ForceTable:
    """Force against the displacement of the outer face under the pin, which the pin feels."""
    return ForceTable(tuple(truth.outer), tuple(truth.forces), 'kept solid solution')


def mounted(touch: Touch, seed: int, imperfections: Imperfections) -> MountedPin:
    """The pin as it really sits: a little longer or shorter, a little crooked."""
    random = generator(seed, 500, touch.finger)
    return replace(
        touch.pin,
        length_m=touch.pin.length_m + random.normal(0.0, imperfections.pin_length_m),
        lean_rad=touch.pin.lean_rad + random.normal(0.0, imperfections.pin_lean_rad),
    )


@dataclass
class Row:
    """What is true of one sample: per finger force (N) and displacement (m), drift in counts."""

    time_s: float
    force_n: list[float]
    displacement_m: list[float]
    drift_counts: list[float]
    origin: list[float] = field(default_factory=list)


class Stage:
    """Hand, object and clock; `step` moves the fingers and lets time pass."""

    def __init__(self, setting: Setting, seed: int, imperfections: Imperfections) -> None:
        """Fingers open, hand initialised, pty open but silent."""
        self.setting = setting
        self.seed = seed
        self.fingers = tuple(sorted(setting.touches))
        random = generator(seed, 501)
        body = HandBody(
            pins={
                finger: mounted(setting.touches[finger], seed, imperfections)
                if finger in setting.touches
                else MountedPin()
                for finger in (1, 2, 3)
            },
            tendon_compliance_rad_per_nm={
                finger: 0.02 + random.normal(0.0, imperfections.tendon_compliance_rad_per_nm)
                for finger in (1, 2, 3)
            },
        )
        table = force_table(setting.truth)
        squeezed: Squeezed
        if setting.pinched:
            first, second = self.fingers
            squeezed = Pinched((first, second), setting.width_m, table)
        else:
            squeezed = Supported(
                {f: setting.touches[f].point for f in self.fingers},
                {f: setting.touches[f].inward for f in self.fingers},
                table,
            )
        self.fading = None if setting.fading is None else FadingHistory(setting.fading, table)
        self.mechanics = HandMechanics(body, seed, squeezed)
        if setting.warm_s:
            self.mechanics.rest(setting.warm_s, 60.0)
        self.hand = WireHand(self.mechanics, serial_number=seed)
        self.hand.initialised = dict.fromkeys((1, 2, 3, 4), True)
        self.port = PtyPort(self.hand, paced=False, real_time=False)
        self.rows: list[Row] = []
        self.slip = np.eye(3)
        self.time_lapse = 1.0
        self._drop = 0.0
        self._touch_counts = grasps.counts_at(setting.touches, setting.spread_rad)
        self.mechanics.place(self._touch_counts)
        self._touch_height = self._mean_height()
        self._counts = {f: self._touch_counts[f] - OPEN_COUNTS for f in self.fingers}
        self._place(self._counts)

    def _place(self, counts: dict[int, float]) -> None:
        """Put the motors somewhere; a touched object that is not pinched follows the pins."""
        squeezed = self.mechanics.squeezed
        positions = {**counts, 4: self._touch_counts[4]}
        if not isinstance(squeezed, Supported):
            self.mechanics.place(positions)
            return
        self._lift(squeezed, 0.0)
        self.mechanics.place(positions)
        for _ in range(60):
            if all(self.mechanics.truth(finger).force_n == 0.0 for finger in self.fingers):
                self._lift(squeezed, 0.0)
                break
            wanted = self._mean_height() - self._touch_height
            if abs(wanted - self._drop) < 1e-9:
                break
            self._lift(squeezed, wanted)
            self.mechanics.place(positions)

    def _mean_height(self) -> float:
        return float(np.mean([self.mechanics.truth(f).pin_tip[2] for f in self.fingers]))

    def _lift(self, squeezed: Supported, height: float) -> None:
        """Move the supported object to a height above that of the first touch."""
        self._drop = height
        moved = {
            finger: (*touch.point[:2], touch.point[2] + height)
            for finger, touch in self.setting.touches.items()
        }
        dict.update(squeezed.points, moved)  # type: ignore[arg-type]

    @property
    def counts(self) -> dict[int, float]:
        """Present motor positions of the fingers in use, in counts."""
        return dict(self._counts)

    def counts_for(self, force_n: float) -> dict[int, float]:
        """Motor positions at which every finger in use carries a force (0: open).

        The fingers of a pinched object close together; those of a supported one each find their
        own position. Raises ValueError when there is none.
        """
        start = {f: self._touch_counts[f] - OPEN_COUNTS for f in self.fingers}
        if force_n <= 0.0:
            return start
        before = dict(self._counts)
        count = 1 if self.setting.pinched else len(self.fingers)

        def placed(ways: Array) -> dict[int, float]:
            each = np.broadcast_to(ways, len(self.fingers)) if count == 1 else ways
            return {f: start[f] + float(way) for f, way in zip(self.fingers, each, strict=True)}

        def missing(ways: Array) -> Array:
            self._place(placed(ways))
            forces = [float(self.mechanics.truth(f).force_n) for f in self.fingers[:count]]
            return np.array(forces) - force_n

        # An open finger feels nothing: begin well closed, where the force still rises.
        deep = np.full(count, OPEN_COUNTS)
        while missing(deep).min() < 0.0:
            deep = deep + 25.0
        ways, _, _, text = fsolve(missing, deep, full_output=True, xtol=1e-12)
        if abs(missing(ways)).max() > 2e-3:
            raise ValueError(f'no position of the fingers gives {force_n} N: {text}')
        self._place(before)
        return placed(ways)

    def step(self, counts: dict[int, float], seconds: float) -> None:
        """Put the fingers at new positions and let time pass for hand and gauges."""
        self._counts = dict(counts)
        with self.port.lock:
            if self.fading is not None:
                table = self.fading.after(seconds * self.time_lapse)
                squeezed = replace(self.mechanics.squeezed, table=table)  # type: ignore[type-var]
                self.mechanics.squeezed = squeezed
            self._place(counts)
        self.port.advance(seconds)
        if self.time_lapse > 1.0:
            with self.port.lock:
                longer = seconds * (self.time_lapse - 1.0)
                self.mechanics.rest(longer, longer)
        truths = [self.mechanics.truth(finger) for finger in (1, 2, 3)]
        if self.fading is not None:
            self.fading.moved(float(truths[self.fingers[0] - 1].displacement_m))
        self.rows.append(
            Row(
                self.mechanics.time_s,
                [float(truth.force_n) for truth in truths],
                [float(truth.displacement_m) for truth in truths],
                [truth.drift_counts for truth in truths],
                self.pose()[1].tolist(),
            )
        )

    def force(self) -> float:
        """True force of the first finger in use, N."""
        return float(self.mechanics.truth(self.fingers[0]).force_n)

    def elastic_force(self) -> float:
        """The force that dents an elastic object as this one is dented now, N."""
        return self.force() if self.fading is None else self.fading.elastic_n

    def pose(self) -> tuple[Array, Array]:
        """True pose of the object: rotation and origin in the hand frame."""
        rotation, origin = self.grip()
        return rotation @ self.slip, origin

    def grip(self) -> tuple[Array, Array]:
        """The pose the object would have, had it not slipped under the pins since first touch.

        The dents stay under the pins, so the solid solution lives in this frame. Untouched, the
        object rests on its stand; a pinched object then hangs between the pins.
        """
        if self.force() == 0.0:
            return self.setting.rotation, self.setting.origin
        if not self.setting.pinched:
            return self.setting.rotation, self.setting.origin + [0.0, 0.0, self._drop]
        first, second = (np.array(self.mechanics.truth(finger).pin_tip) for finger in self.fingers)
        return along_pins(first, second), 0.5 * (first + second)

    def obstacles(self) -> list[Obstacle]:
        """Links and pins where they now are, as the scanner meets them."""
        found = {}
        for finger in (1, 2, 3):
            truth = self.mechanics.truth(finger)
            pose = finger_pose(
                self.mechanics.body.dimensions,
                self.mechanics.body.pins[finger],
                finger,
                self.mechanics.spread_rad,
                truth.inner_rad,
                truth.outer_rad,
            )
            dimensions = self.mechanics.body.dimensions
            foot = (
                np.array(pose.outer_joint)
                + (dimensions.outer_link_m + self.mechanics.body.pins[finger].forward_m)
                * np.array(pose.along)
                + dimensions.pad_height_m * np.array(pose.pad_normal)
            )
            tip = np.array(pose.pin_tip) if finger in self.fingers else foot
            found[finger] = (np.array(pose.knuckle), np.array(pose.outer_joint), foot, tip)
        return grasps.obstacles(found)


def along_pins(first: Array, second: Array) -> Array:
    """Rotation that carries x onto the line from the first pin to the second, y kept level."""
    x = (second - first) / np.linalg.norm(second - first)
    y = np.array([0.0, 1.0, 0.0]) - x[1] * x
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def quaternion(rotation: Array) -> list[float]:
    """x y z w of a rotation matrix."""
    found = Rotation.from_matrix(rotation).as_quat()
    return [float(value) for value in (found if found[3] >= 0 else -found)]
