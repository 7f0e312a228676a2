# SPDX-License-Identifier: Apache-2.0
"""Motions of the hand as velocities per cycle: open, close until force, follow a trajectory.

Pure: every motion gets the newest observation and answers the velocities for the next cycle. A
motion ends by itself; whatever ends it, the worker then commands standstill.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from barrett_hand_bridge.contacts import FLAG_CONTACT, FLAG_FAULT, FLAG_NO_GAUGE, FLAG_NOT_TARED
from barrett_hand_bridge.hand import FINGERS, SPREAD
from barrett_hand_bridge.observer import Observation

FINGER_TRAVEL_RAD = math.radians(140.0)
AT_REST_RAD = math.radians(0.05)
STALL_S = 1.0
# More than the fingers reach.
WIDEST_GAP_M = 0.4
# From the command to stand until the force is read: prefetched cycles obey one cycle later.
SETTLE_S = 0.15
LIMIT_OVER_FORCE = 1.15
# What the weight of an outer link can add to its gauge.
WEIGHT_NM = 0.03


class MotionError(ValueError):
    """A motion that cannot be started; the message says why."""


@dataclass(frozen=True)
class MotionResult:
    """How a motion ended."""

    done: bool
    message: str


class Motion(Protocol):
    """A motion under way."""

    def step(self, observation: Observation, time_s: float) -> Mapping[int, float] | MotionResult:
        """Velocities in rad/s by motor for the next cycle, or how it ended."""

    def limit_nm(self, observation: Observation) -> float:
        """Gauge torque at which the hand itself should stop closing, whatever we say."""

    def speeds(self) -> Mapping[str, float]:
        """The constant speeds it runs at, in rad/s by the parameter that says so."""


def slower_than_hand(speeds: Mapping[str, float], step_rad_s: float) -> str:
    """Why a hand with that step of speed cannot run at one of `speeds`; empty when it can."""
    for name, speed in speeds.items():
        if speed < step_rad_s:
            return (
                f'parameter {name} is {speed:g} rad/s, this hand knows no speed between 0 and '
                f'{step_rad_s:.4f} rad/s: set at least that'
            )
    return ''


def joint_position(observation: Observation, motor: int) -> float:
    """Angle in rad of the joint that a motor is counted by: joint 2, or the spread."""
    if motor == SPREAD:
        return observation.angles.spread
    angles = observation.angles
    # The motor is counted by the outer link, which follows it with or without breakaway.
    return (angles.inner[motor] + angles.outer[motor]) * 0.75


def met_limit(observation: Observation, motors: Sequence[int], limit_nm: float) -> str:
    """Which of the fingers that move carries more than `limit_nm`; '' where none does."""
    for finger in FINGERS:
        torque = observation.fingers[finger].torque_nm
        if finger in motors and abs(torque) > limit_nm:
            return f'finger {finger} met {torque:.2f} N m, the limit is {limit_nm:g} N m'
    return ''


def out_of_reach(motor: int, position: float) -> str:
    """Why a joint cannot be brought to `position` (rad); '' where it can."""
    highest = math.pi if motor == SPREAD else FINGER_TRAVEL_RAD
    if math.isfinite(position) and -AT_REST_RAD <= position <= highest + AT_REST_RAD:
        return ''
    return f'motor {motor} at {position} rad, must be 0 to {highest:.3f}'


class StallWatch:
    """Tells when motors that should run have not moved for a while."""

    def __init__(self) -> None:
        self._last: dict[int, float] = {}
        self._moved_s = -math.inf

    def stalled(self, observation: Observation, motors: Sequence[int], time_s: float) -> bool:
        """Whether none of `motors` has moved for STALL_S."""
        positions = {motor: joint_position(observation, motor) for motor in motors}
        moved = any(
            abs(positions[motor] - self._last.get(motor, math.inf)) > AT_REST_RAD
            for motor in motors
        )
        if moved or self._moved_s == -math.inf:
            self._last = positions
            self._moved_s = time_s
        return time_s - self._moved_s > STALL_S


class Opening:
    """Open fingers until they stand at zero or no longer move."""

    def __init__(self, fingers: Sequence[int], speed_rad_s: float) -> None:
        """Open `fingers` at a speed of joint 2."""
        self._fingers = tuple(fingers)
        self._speed = speed_rad_s
        self._watch = StallWatch()

    def step(self, observation: Observation, time_s: float) -> Mapping[int, float] | MotionResult:
        """See `Motion`."""
        closed = [f for f in self._fingers if joint_position(observation, f) > AT_REST_RAD]
        if not closed:
            return MotionResult(True, 'open')
        if self._watch.stalled(observation, closed, time_s):
            names = ', '.join(str(finger) for finger in closed)
            return MotionResult(False, f'finger {names} does not open further')
        return dict.fromkeys(closed, -self._speed)

    def limit_nm(self, observation: Observation) -> float:
        """See `Motion`: opening needs none of its own."""
        return math.inf

    def speeds(self) -> Mapping[str, float]:
        """See `Motion`."""
        return {'open_speed': self._speed}

    def by_finger(self) -> Mapping[int, float]:
        """The speeds in rad/s, for a hand whose fingers open by themselves."""
        return dict.fromkeys(self._fingers, self._speed)


@dataclass(frozen=True)
class CloseSettings:
    """How to close: until which force, how fast before and after touch (joint 2, rad/s)."""

    force_n: float
    torque_limit_nm: float
    approach_rad_s: float
    squeeze_rad_s: float


class Closing:
    """Close fingers slowly until each carries a force; stops at a torque limit in any case.

    The worm drives hold the position, so a finger that has its force stands still. Force comes
    from the gauge, which must be fitted and tared.
    """

    def __init__(self, fingers: Sequence[int], settings: CloseSettings) -> None:
        """Close `fingers` together."""
        self.fingers = tuple(fingers)
        self._settings = settings
        self._arrived: set[int] = set()
        self._standing_s: float | None = None
        self._watch = StallWatch()

    def step(self, observation: Observation, time_s: float) -> Mapping[int, float] | MotionResult:
        """See `Motion`."""
        s = self._settings
        touching = False
        for finger in self.fingers:
            reading = observation.fingers[finger]
            flags = reading.contact.flags
            if flags & (FLAG_NO_GAUGE | FLAG_NOT_TARED | FLAG_FAULT):
                return MotionResult(
                    False, f'finger {finger} has no trustworthy force: hand/tare it, open and free'
                )
            force = float(reading.contact.force @ reading.contact.normal)
            if abs(reading.torque_nm) >= s.torque_limit_nm and force < s.force_n:
                return MotionResult(
                    False,
                    f'finger {finger} reached the torque limit of {s.torque_limit_nm:g} N m at '
                    f'{force:.2f} N, before {s.force_n:g} N',
                )
            if force >= s.force_n:
                self._arrived.add(finger)
            touching = touching or bool(flags & FLAG_CONTACT)
        left = [finger for finger in self.fingers if finger not in self._arrived]
        if not left:
            # What the gauge shows when the motors stand is the answer: a late process overshoots.
            if self._standing_s is None:
                self._standing_s = time_s
            if time_s - self._standing_s < SETTLE_S:
                return {}
            return MotionResult(
                True, f'closed, {self._told(observation)}; {s.force_n:g} N were asked for'
            )
        ended = [
            f for f in left if joint_position(observation, f) > FINGER_TRAVEL_RAD - AT_REST_RAD
        ]
        if ended or self._watch.stalled(observation, left, time_s):
            names = ', '.join(str(finger) for finger in (ended or left))
            return MotionResult(
                False,
                f'finger {names} does not close further, {s.force_n:g} N not reached: '
                f'{self._told(observation)}',
            )
        return dict.fromkeys(left, s.squeeze_rad_s if touching else s.approach_rad_s)

    def limit_nm(self, observation: Observation) -> float:
        """See `Motion`: a little above the wanted force, should this process be late."""
        arm = max(observation.fingers[finger].arm_m for finger in self.fingers)
        wanted = LIMIT_OVER_FORCE * self._settings.force_n * max(arm, 0.0) + WEIGHT_NM
        return min(wanted, self._settings.torque_limit_nm)

    def speeds(self) -> Mapping[str, float]:
        """See `Motion`."""
        s = self._settings
        return {'approach_speed': s.approach_rad_s, 'squeeze_speed': s.squeeze_rad_s}

    def forces(self, observation: Observation) -> dict[int, float]:
        """What the gauges say now in N, by finger."""
        contacts = {finger: observation.fingers[finger].contact for finger in self.fingers}
        return {
            finger: float(contact.force @ contact.normal) for finger, contact in contacts.items()
        }

    def _told(self, observation: Observation) -> str:
        forces = self.forces(observation)
        return ', '.join(f'finger {finger} {force:.2f} N' for finger, force in forces.items())


class ToGap:
    """Bring the pins of two fingers to a distance: closing ends at a force at the latest."""

    def __init__(self, gap_m: float, closing: Closing, opening: Opening) -> None:
        """`closing` names the two fingers.

        Raises:
            MotionError: no distance, or other than two fingers.
        """
        if not 0.0 <= gap_m <= WIDEST_GAP_M:
            raise MotionError(f'gap is {gap_m} m, must be 0 to {WIDEST_GAP_M:g}')
        if len(closing.fingers) != 2:
            raise MotionError('parameter close_fingers names other than two fingers')
        self._gap_m = gap_m
        self._closing, self._opening = closing, opening
        self._closes: bool | None = None
        self.reached = self.stalled = False

    def gap_m(self, observation: Observation) -> float:
        """Distance between the ends of the two pins in m."""
        first, second = (observation.fingers[f].contact.point for f in self._closing.fingers)
        return float(math.dist(first, second))

    def force_n(self, observation: Observation) -> float:
        """The larger of the two forces in N."""
        return max(self._closing.forces(observation).values())

    def step(self, observation: Observation, time_s: float) -> Mapping[int, float] | MotionResult:
        """See `Motion`."""
        gap = self.gap_m(observation)
        if self._closes is None:
            self._closes = gap > self._gap_m
        if gap <= self._gap_m if self._closes else gap >= self._gap_m:
            self.reached = True
            return MotionResult(True, f'the pins stand {1e3 * gap:.1f} mm apart')
        inner = self._closing if self._closes else self._opening
        step = inner.step(observation, time_s)
        if isinstance(step, MotionResult):
            self.stalled = step.done and self._closes
        return step

    def limit_nm(self, observation: Observation) -> float:
        """See `Motion`."""
        return self._closing.limit_nm(observation)

    def speeds(self) -> Mapping[str, float]:
        """See `Motion`."""
        return {**self._closing.speeds(), **self._opening.speeds()}


@dataclass(frozen=True)
class TrajectoryPoint:
    """Positions in rad by motor, to be reached at a time in s after the start."""

    time_s: float
    positions: Mapping[int, float]


class Following:
    """Follow a trajectory of joint 2 and spread angles; straight lines between its points."""

    def __init__(
        self,
        points: Sequence[TrajectoryPoint],
        *,
        fastest_rad_s: float,
        torque_limit_nm: float,
        gain_per_s: float = 10.0,
        tolerance_rad: float = math.radians(0.3),
        patience_s: float = 3.0,
        path_tolerance_rad: Mapping[int, float] | None = None,
    ) -> None:
        """Check the whole trajectory before anything moves.

        `path_tolerance_rad`: how far a motor may be off on its way; more ends the motion.

        Raises:
            MotionError: no points, times that do not rise, angles out of reach, or too fast.
        """
        _check_points(points, fastest_rad_s)
        self._points = tuple(points)
        self.motors = tuple(sorted(points[0].positions))
        self.desired: dict[int, float] = {}
        self.missed_its_goal = False
        self._path_tolerance = dict(path_tolerance_rad or {})
        self._fastest = fastest_rad_s
        self._torque_limit = torque_limit_nm
        self._gain = gain_per_s
        self._tolerance = tolerance_rad
        self._patience_s = patience_s
        self._start: TrajectoryPoint | None = None
        self._start_s = 0.0

    def step(self, observation: Observation, time_s: float) -> Mapping[int, float] | MotionResult:
        """See `Motion`."""
        position = {motor: joint_position(observation, motor) for motor in self.motors}
        if self._start is None:
            self._start, self._start_s = TrajectoryPoint(0.0, position), time_s
            worst = self._fastest_start(position)
            if worst is not None:
                return MotionResult(False, worst)
        met = met_limit(observation, self.motors, self._torque_limit)
        if met:
            return MotionResult(False, met)
        elapsed = time_s - self._start_s
        target, speed = self._reference(elapsed)
        self.desired = target
        errors = {motor: target[motor] - position[motor] for motor in self.motors}
        for motor, most in self._path_tolerance.items():
            if abs(errors.get(motor, 0.0)) > most:
                return MotionResult(
                    False,
                    f'motor {motor} is {math.degrees(errors[motor]):.2f} degrees off its path, '
                    f'{math.degrees(most):.2f} are allowed',
                )
        last = self._points[-1].time_s
        if elapsed >= last and all(abs(error) < self._tolerance for error in errors.values()):
            return MotionResult(True, 'trajectory followed')
        if elapsed > last + self._patience_s:
            self.missed_its_goal = True
            worst_motor = max(errors, key=lambda motor: abs(errors[motor]))
            return MotionResult(
                False,
                f'motor {worst_motor} ended {math.degrees(errors[worst_motor]):.2f} degrees off '
                'its trajectory',
            )
        return {
            motor: min(
                max(speed[motor] + self._gain * errors[motor], -1.5 * self._fastest),
                1.5 * self._fastest,
            )
            for motor in self.motors
        }

    def limit_nm(self, observation: Observation) -> float:
        """See `Motion`."""
        return self._torque_limit

    def speeds(self) -> Mapping[str, float]:
        """See `Motion`: it may stand still on its way."""
        return {}

    def _fastest_start(self, position: Mapping[int, float]) -> str | None:
        first = self._points[0]
        for motor in self.motors:
            way = abs(first.positions[motor] - position[motor])
            if way > AT_REST_RAD * 10 and way > self._fastest * max(first.time_s, 1e-9):
                return (
                    f'motor {motor} stands {math.degrees(way):.1f} degrees from the first point '
                    f'and has {first.time_s:g} s: too fast'
                )
        return None

    def _reference(self, elapsed: float) -> tuple[dict[int, float], dict[int, float]]:
        assert self._start is not None
        before = self._start
        for point in self._points:
            if elapsed < point.time_s:
                share = (elapsed - before.time_s) / (point.time_s - before.time_s)
                span = point.time_s - before.time_s
                target = {
                    m: before.positions[m] + share * (point.positions[m] - before.positions[m])
                    for m in self.motors
                }
                speed = {m: (point.positions[m] - before.positions[m]) / span for m in self.motors}
                return target, speed
            before = point
        return dict(before.positions), dict.fromkeys(self.motors, 0.0)


def _check_points(points: Sequence[TrajectoryPoint], fastest_rad_s: float) -> None:
    if not points:
        raise MotionError('the trajectory has no points')
    before: TrajectoryPoint | None = None
    for number, point in enumerate(points, start=1):
        if not math.isfinite(point.time_s) or point.time_s < 0.0:
            raise MotionError(f'point {number}: time {point.time_s} s')
        for motor, position in point.positions.items():
            refusal = out_of_reach(motor, position)
            if refusal:
                raise MotionError(f'point {number}: {refusal}')
        if before is not None:
            span = point.time_s - before.time_s
            if span <= 0.0:
                raise MotionError(f'point {number}: times must rise')
            for motor, position in point.positions.items():
                speed = abs(position - before.positions[motor]) / span
                if speed > fastest_rad_s:
                    raise MotionError(
                        f'point {number}: motor {motor} would run {speed:.2f} rad/s, the limit is '
                        f'{fastest_rad_s:g} rad/s'
                    )
        before = point
