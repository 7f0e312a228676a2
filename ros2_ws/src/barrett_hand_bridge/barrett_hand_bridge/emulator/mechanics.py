# SPDX-License-Identifier: Apache-2.0
"""Motors, links, tendons and gauges of an emulated hand, stepped in fixed steps of time.

Positions are motor counts as floating-point numbers; the encoder shows whole counts. Scales:
BH8-262 manual for firmware 4.4, page 77 (table 10). The worm drives are not back-drivable: a
stopped motor holds. Everything is deterministic by the seed and the sequence of steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from barrett_hand_bridge.emulator.geometry import (
    FINGERS,
    FingerDimensions,
    FingerPose,
    MountedPin,
    Vector,
    dot,
    finger_pose,
    knuckle_torque,
    opening_torque,
    scale,
    subtract,
    unit,
)
from barrett_hand_bridge.emulator.squeeze import (
    NO_LOAD,
    ContactLoad,
    Pinched,
    Squeezed,
    contact_loads,
)
from barrett_hand_bridge.emulator.strain_gauge import (
    StrainGauge,
    character_8_bit,
    character_12_bit,
)

SPREAD = 4
GRAVITY_M_PER_S2 = 9.80665
# Pads further from facing each other have nothing between them.
FACING_COSINE = 0.3


@dataclass(frozen=True)
class MotorScale:
    """Counts of full travel and the travel in rad, for fingers and spread."""

    finger_counts: float
    spread_counts: float
    finger_travel_rad: float = math.radians(140.0)
    spread_travel_rad: float = math.pi


SCALE_262 = MotorScale(17500.0, 3150.0)
SCALE_280 = MotorScale(199111.1, 35840.0)


@dataclass(frozen=True)
class HandBody:
    """The mechanical truth of one emulated hand."""

    scale: MotorScale = SCALE_262
    dimensions: FingerDimensions = field(default_factory=FingerDimensions)
    pins: Mapping[int, MountedPin] = field(
        default_factory=lambda: {finger: MountedPin() for finger in FINGERS}
    )
    tendon_compliance_rad_per_nm: Mapping[int, float] = field(
        default_factory=lambda: dict.fromkeys(FINGERS, 0.02)
    )
    tendon_play_rad: Mapping[int, float] = field(
        default_factory=lambda: dict.fromkeys(FINGERS, 0.0)
    )
    outer_link_mass_kg: float = 0.1
    outer_link_centre_m: float = 0.025
    gravity_direction: Vector = (0.0, 0.0, -1.0)
    clutch_torque_nm: float = 4.0
    stall_torque_nm: float = 1.8


@dataclass(frozen=True)
class FingerTruth:
    """What really happens at a finger: force (N), displacement (m), torque (N m), angles (rad)."""

    force_n: float
    displacement_m: float
    torque_nm: float
    inner_rad: float
    outer_rad: float
    pin_tip: Vector
    inward: Vector
    drift_counts: float


@dataclass
class Motor:
    """One motor: where it is, where it goes, how fast."""

    position: float
    highest: float
    velocity: float = 0.0
    goal: float | None = None
    stalled: bool = False

    def drive(self, velocity: float, goal: float | None = None) -> None:
        """Run at a velocity in counts per second, up to a goal in counts when one is given."""
        self.velocity, self.goal, self.stalled = velocity, goal, False

    def stop(self) -> None:
        """Hold where it is."""
        self.velocity, self.goal = 0.0, None

    @property
    def moving(self) -> bool:
        """Whether it is being driven."""
        return self.velocity != 0.0

    def next_position(self, seconds: float) -> tuple[float, bool]:
        """Position after `seconds`, and whether a goal or an end of travel is reached there."""
        position = self.position + self.velocity * seconds
        end = self.highest if self.velocity > 0 else 0.0
        stop = end if self.goal is None else min(max(self.goal, 0.0), self.highest)
        past = position >= stop if self.velocity > 0 else position <= stop
        return (stop, True) if past else (position, False)


class HandMechanics:
    """The moving hand: advance it in time, read encoders and gauges, ask for the truth."""

    step_s = 0.0025

    def __init__(self, body: HandBody, seed: int, squeezed: Squeezed | None = None) -> None:
        """A hand with open fingers. `seed` fixes every gauge's traits and noise."""
        self.body = body
        self.squeezed = squeezed
        self.time_s = 0.0
        children = np.random.SeedSequence(seed).spawn(len(FINGERS))
        draw = character_8_bit if body.scale.finger_counts < 1e5 else character_12_bit
        self.gauges: dict[int, StrainGauge] = {}
        for finger, child in zip(FINGERS, children, strict=True):
            generator = np.random.Generator(np.random.PCG64(child))
            self.gauges[finger] = StrainGauge(draw(generator), generator)
        self.motors = {finger: Motor(0.0, body.scale.finger_counts) for finger in FINGERS}
        self.motors[SPREAD] = Motor(0.0, body.scale.spread_counts)
        # How much of its torque each motor may give (MT of a BH8-280).
        self.torque_share: dict[int, float] = dict.fromkeys((*FINGERS, SPREAD), 1.0)
        self.breakaway_counts: dict[int, float | None] = dict.fromkeys(FINGERS)
        self._remainder_s = 0.0
        # The bend of each outer link, whose tendons lag behind where they have play.
        self._bend_rad: dict[int, float] = dict.fromkeys(FINGERS, 0.0)
        self._loads: dict[int, ContactLoad] = {}
        self._torques: dict[int, float] = dict.fromkeys(FINGERS, 0.0)
        self._settle()

    def angles(self, finger: int) -> tuple[float, float]:
        """Encoder-side angles in rad of inner and outer joint, through the clutch."""
        travel = self.body.scale.finger_travel_rad / self.body.scale.finger_counts
        position = self.motors[finger].position
        broken_at = self.breakaway_counts[finger]
        inner = travel * (position if broken_at is None else broken_at)
        # 125:1 to the inner joint, 93.75:1 to the outer link relative to the palm.
        return inner, position * travel * (125.0 / 93.75) - inner

    @property
    def spread_rad(self) -> float:
        """Spread angle in rad."""
        s = self.body.scale
        return self.motors[SPREAD].position * s.spread_travel_rad / s.spread_counts

    def pose(self, finger: int, bent_back_rad: float = 0.0) -> FingerPose:
        """Pose of a finger, its outer link bent back by the stretched tendon."""
        inner, outer = self.angles(finger)
        return finger_pose(
            self.body.dimensions,
            self.body.pins[finger],
            finger,
            self.spread_rad,
            inner,
            outer - bent_back_rad,
        )

    def _bent_pose(self, finger: int, force: float, inward: Vector | None) -> FingerPose:
        pose = self.pose(finger, self._bend(finger, 0.0))
        if inward is None or force == 0.0:
            return pose
        for _ in range(3):
            torque = opening_torque(pose, pose.pin_tip, scale(inward, -force))
            pose = self.pose(finger, self._bend(finger, torque))
        return pose

    def _bend(self, finger: int, torque_nm: float) -> float:
        """Bend in rad under a torque from the object: stretch, and the play it moves within."""
        stretched = self.body.tendon_compliance_rad_per_nm[finger] * torque_nm
        play = self.body.tendon_play_rad[finger]
        return min(max(self._bend_rad[finger], stretched - play), stretched + play)

    def _settle(self) -> None:
        """Find the contact forces for the present motor positions."""

        def tips(
            forces: Mapping[int, float], inward: Mapping[int, Vector]
        ) -> Mapping[int, Vector]:
            return {
                finger: self._bent_pose(finger, forces.get(finger, 0.0), direction).pin_tip
                for finger, direction in inward.items()
            }

        before = max((load.force_n for load in self._loads.values()), default=0.0)
        held = self.squeezed if self._faces_object() else None
        self._loads = contact_loads(held, tips, before)
        for finger in FINGERS:
            load = self._loads.get(finger, NO_LOAD)
            pose = self._bent_pose(finger, load.force_n, load.inward if load.force_n else None)
            loading = opening_torque(pose, pose.pin_tip, load.on_finger)
            self._bend_rad[finger] = self._bend(finger, loading)
            self._torques[finger] = loading + self._weight_torque(pose)

    def _faces_object(self) -> bool:
        """Whether an object can be where it is squeezed: between pins that face each other."""
        if not isinstance(self.squeezed, Pinched):
            return True
        first, second = (self.pose(finger) for finger in self.squeezed.fingers)
        line = unit(subtract(second.pin_tip, first.pin_tip))
        return (
            dot(first.pad_normal, line) > FACING_COSINE
            and dot(second.pad_normal, line) < -FACING_COSINE
        )

    def _weight_torque(self, pose: FingerPose) -> float:
        centre = scale(pose.along, self.body.outer_link_centre_m)
        joint = pose.outer_joint
        point = (joint[0] + centre[0], joint[1] + centre[1], joint[2] + centre[2])
        weight = scale(
            self.body.gravity_direction, self.body.outer_link_mass_kg * GRAVITY_M_PER_S2
        )
        return opening_torque(pose, point, weight)

    def advance(self, seconds: float) -> None:
        """Let time pass, in whole steps of `step_s`; the rest is kept for the next call."""
        self._remainder_s += seconds
        while self._remainder_s >= self.step_s - 1e-9:
            self._remainder_s -= self.step_s
            self._step(self.step_s)

    def rest(self, seconds: float, step_s: float = 1.0) -> None:
        """Let a long time pass with all motors still (gauges drift), in coarse steps."""
        for motor in self.motors.values():
            motor.stop()
        left = seconds
        while left > 0.0:
            passing = min(step_s, left)
            for finger, gauge in self.gauges.items():
                gauge.step(self._torques[finger], passing)
            self.time_s += passing
            left -= passing

    def _step(self, seconds: float) -> None:
        self.time_s += seconds
        moved = False
        for number, motor in self.motors.items():
            if not motor.moving:
                continue
            before = motor.position
            motor.position, ended = motor.next_position(seconds)
            moved = moved or motor.position != before
            if ended:
                motor.stop()
            if number != SPREAD and self._released(number):
                self.breakaway_counts[number] = None
        if moved:
            self._settle()
            self._react()
        for finger, gauge in self.gauges.items():
            gauge.step(self._torques[finger], seconds)

    def _released(self, finger: int) -> bool:
        broken_at = self.breakaway_counts[finger]
        return broken_at is not None and self.motors[finger].position < broken_at

    def _react(self) -> None:
        """Clutches that slip and motors that stall under the present loads."""
        for finger, load in self._loads.items():
            pose = self._bent_pose(finger, load.force_n, load.inward)
            torque = knuckle_torque(pose, pose.pin_tip, load.on_finger)
            if torque > self.body.clutch_torque_nm and self.breakaway_counts[finger] is None:
                self.breakaway_counts[finger] = self.motors[finger].position
            motor = self.motors[finger]
            if motor.velocity > 0 and self._torques[finger] > (
                self.body.stall_torque_nm * self.torque_share[finger]
            ):
                motor.stop()
                motor.stalled = True

    def place(self, positions: Mapping[int, float]) -> None:
        """Put motors at once at positions in counts (no time passes)."""
        for number, position in positions.items():
            motor = self.motors[number]
            motor.stop()
            motor.position = min(max(position, 0.0), motor.highest)
        self._settle()

    def close_to_force(self, force_n: float, fingers: tuple[int, ...]) -> None:
        """Close `fingers` together, at once, until the first of them carries `force_n`.

        The motor position is found to a fraction of a count, so that a prescribed load is met
        exactly; the encoder still shows whole counts.

        Raises:
            ValueError: the fingers reach the end of their travel before that force.
        """
        start = {finger: self.motors[finger].position for finger in fingers}
        room = min(self.motors[finger].highest - start[finger] for finger in fingers)

        def force_at(way: float) -> float:
            self.place({finger: start[finger] + way for finger in fingers})
            return self._loads.get(fingers[0], NO_LOAD).force_n

        low, high = 0.0, 0.0
        while force_at(high) < force_n:
            low, high = high, high + 0.002 * self.body.scale.finger_counts
            if high > room:
                raise ValueError(f'{force_n} N is not reached within the travel of the fingers')
        for _ in range(50):
            middle = 0.5 * (low + high)
            if force_at(middle) < force_n:
                low = middle
            else:
                high = middle
        force_at(high)

    def encoder_counts(self, motor: int) -> int:
        """Whole encoder counts of a motor."""
        return math.floor(self.motors[motor].position + 0.5)

    def truth(self, finger: int) -> FingerTruth:
        """What really happens at a finger now."""
        load = self._loads.get(finger, NO_LOAD)
        pose = self._bent_pose(finger, load.force_n, load.inward if load.force_n else None)
        inner, outer = self.angles(finger)
        torque = opening_torque(pose, pose.pin_tip, load.on_finger)
        return FingerTruth(
            force_n=load.force_n,
            displacement_m=load.displacement_m,
            torque_nm=self._torques[finger],
            inner_rad=inner,
            outer_rad=outer - self._bend(finger, torque),
            pin_tip=pose.pin_tip,
            inward=load.inward,
            drift_counts=self.gauges[finger].drift_counts,
        )
