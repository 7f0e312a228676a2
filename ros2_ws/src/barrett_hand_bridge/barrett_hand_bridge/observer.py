# SPDX-License-Identifier: Apache-2.0
"""From samples of the hand to what it feels: angles, torques, forces, contacts, uncertainties."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from barrett_hand_bridge.calibration import NO_GAUGE, GaugeCalibration
from barrett_hand_bridge.contacts import (
    FLAG_CONTACT,
    FLAG_FAULT,
    FLAG_NO_GAUGE,
    FLAG_NOT_TARED,
    FLAG_SATURATED,
    Contact,
    TouchSettings,
    TouchTracker,
    normal_force,
    opposed_normals,
)
from barrett_hand_bridge.fit import UNLOADED_NM
from barrett_hand_bridge.hand import ENCODER_262, FINGERS, EncoderScale, HandSample
from barrett_hand_bridge.kinematics import (
    Array,
    FingerFrames,
    HandGeometry,
    JointAngles,
    Pin,
    finger_frames,
    gravity_torque,
    joint_angles,
    length,
    pin_direction,
    pin_end,
    torque_arm,
)
from barrett_hand_bridge.posture import HandPosture, is_open
from barrett_hand_bridge.tare import HYSTERESIS_NM, ExpectedZero, TareOutcome, take_zero
from barrett_hand_bridge.tendon import Squeezing, TendonPlay, lagging
from barrett_hand_bridge.touch import touch_cells, touch_contacts
from barrett_hand_bridge.zero import BLOCK_S, DRIFT_8_BIT, DriftModel, ZeroTracker

NEAR_SATURATION = 0.9
FACING_COSINE = 0.5
QUANTISATION_COUNTS = 1.0 / math.sqrt(12.0)
# A gauge at its end may hide up to half of what it tells, evenly: so much root mean square.
BEYOND_END = 0.5 / math.sqrt(3.0)
# Behind the place of first touch by so much, a pin has left the dent that it had pressed.
WITHDRAWN_M = 0.003


@dataclass(frozen=True)
class ObserverSettings:
    """Everything the observer must know about hand, pins, gauges and mounting. SI units."""

    calibrations: Mapping[int, GaugeCalibration]
    geometry: HandGeometry = field(default_factory=HandGeometry)
    pins: Mapping[int, Pin] = field(default_factory=lambda: dict.fromkeys(FINGERS, Pin()))
    encoder: EncoderScale = ENCODER_262
    highest_gauge_count: int = 255
    drift: DriftModel = DRIFT_8_BIT
    follow_drift: bool = True
    tendon_compliance_rad_per_nm: float = 0.02
    tendon_sigma_rad_per_nm: float = 0.004
    tendon_play_rad: float = 0.0035
    backlash_sigma_rad: float = math.radians(0.1)
    opposed_fingers: tuple[int, int] | None = (1, 2)
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)
    touch: TouchSettings = field(default_factory=TouchSettings)
    touch_threshold_n_per_cm2: float = 0.5


@dataclass(frozen=True)
class FingerReading:
    """One finger: gauge, torque about joint 3 (weight of the link taken off) and contact."""

    gauge_counts: int | None
    zero_counts: float
    zero_sigma_counts: float
    zero_doubt_counts: float
    torque_nm: float
    sigma_torque_nm: float
    near_saturation: bool
    frames: FingerFrames
    arm_m: float
    contact: Contact


@dataclass(frozen=True)
class Observation:
    """Everything known after one sample; `cells` are the pressed touch cells."""

    stamp_ns: int
    angles: JointAngles
    fingers: Mapping[int, FingerReading]
    cells: tuple[Contact, ...] = ()


@dataclass(frozen=True)
class _Torque:
    value_nm: float
    sigma_nm: float
    white_nm: float
    count_nm: float
    flags: int
    near: bool
    at_end: bool = False


class HandObserver:
    """Keeps zeros, drift and touches; turns each sample into an `Observation`.

    The states of a finger and what leads from one to another: README.md, "The zero".
    """

    def __init__(self, settings: ObserverSettings) -> None:
        """Nothing tared, nothing touched."""
        self.settings = settings
        self.zeros = {finger: ZeroTracker(settings.drift) for finger in FINGERS}
        # What the gauge of each finger, without its link's weight, read when the finger was open.
        self._seen_open = {finger: ZeroTracker(settings.drift) for finger in FINGERS}
        self.touches = {finger: TouchTracker(settings.touch) for finger in FINGERS}
        self.posture = HandPosture(settings.encoder)
        self.tendons = TendonPlay(
            settings.tendon_play_rad,
            settings.tendon_sigma_rad_per_nm / max(settings.tendon_compliance_rad_per_nm, 1e-9),
        )
        # By how much each outer link stands behind its encoder.
        self._bend_rad = dict.fromkeys(FINGERS, 0.0)
        # When a touch of a finger at rest began, by itself.
        self._came_at_rest_s = dict.fromkeys(FINGERS, -math.inf)
        self._tare_weight_nm = dict.fromkeys(FINGERS, 0.0)
        self._weight_nm = dict.fromkeys(FINGERS, 0.0)
        self._cells = touch_cells(settings.geometry)
        self._gravity: Array = np.asarray(settings.gravity, dtype=float)

    def set_gravity(self, direction: Array) -> None:
        """Direction of gravity in the hand frame, unit vector (3,), as the arm turns the hand."""
        self._gravity = direction

    def forget_zeros(self) -> None:
        """The hand was away: contacts are not to be trusted before the next tare."""
        self.posture.forget()
        for finger in FINGERS:
            self.zeros[finger].forget()
            self._seen_open[finger].forget()
            self.touches[finger].reset()

    def tare(self, samples: list[HandSample]) -> TareOutcome:
        """Take new zeros from samples at rest, or say why not; their weights are taken along."""
        for sample in samples:
            self.posture.see(sample)
        angles = joint_angles(samples[-1], self.settings.encoder)
        time_s = samples[-1].stamp_ns * 1e-9
        weights = {finger: self._link_weight(finger, angles) for finger in FINGERS}
        expected = {
            finger: self._expected_zero(finger, angles, weights[finger], time_s)
            for finger in FINGERS
        }
        outcome = take_zero(samples, self._calibrations(), expected)
        for finger, taken in outcome.zeros.items():
            self._tare_weight_nm[finger] = weights[finger]
            self.zeros[finger].tare(taken.counts, taken.sigma_counts, time_s, taken.doubt_counts)
            self.touches[finger].reset()
        return outcome

    def _expected_zero(
        self, finger: int, angles: JointAngles, weight_nm: float, time_s: float
    ) -> ExpectedZero:
        """What is known of a finger's zero before a tare at these angles."""
        gauge = self.settings.calibrations.get(finger, NO_GAUGE)
        opened = is_open(angles.inner, finger)
        zero, seen = self.zeros[finger], self._seen_open[finger]
        if zero.tared and gauge.kind != 'none':
            zero.advance(time_s)
            moved = (weight_nm - self._tare_weight_nm[finger]) / gauge.slope(
                zero.counts, zero.counts
            )
            return ExpectedZero(
                zero.counts + moved,
                zero.drift_sigma_counts,
                self.touches[finger].touching and not self._questionable(finger),
                opened,
                doubt_counts=zero.doubt_counts,
            )
        if seen.tared and gauge.kind != 'none':
            seen.advance(time_s)
            known = seen.counts + weight_nm / gauge.slope(seen.counts, seen.counts)
            return ExpectedZero(known, seen.sigma_counts, False, opened, tared=False)
        return ExpectedZero(None, 0.0, False, opened, tared=False)

    def strain_limits(self, torque_nm: float) -> dict[int, int | None]:
        """The reading per finger above which the hand itself must stop closing."""
        limits: dict[int, int | None] = {}
        for finger in FINGERS:
            gauge = self.settings.calibrations.get(finger, NO_GAUGE)
            zero = (
                self.zeros[finger].counts if self.zeros[finger].tared else gauge.reference_counts
            )
            limits[finger] = None
            if gauge.kind != 'none':
                readings = range(int(zero), self.settings.highest_gauge_count + 1)
                limits[finger] = next(
                    (count for count in readings if gauge.torque(count, zero) > torque_nm), None
                )
        return limits

    def _calibrations(self) -> Mapping[int, GaugeCalibration]:
        return {f: self.settings.calibrations.get(f, NO_GAUGE) for f in FINGERS}

    def _weight_counts(self, finger: int) -> float:
        """Counts by which the link's weight moves the zero from the taring pose to this one."""
        gauge = self.settings.calibrations.get(finger, NO_GAUGE)
        if gauge.kind == 'none':
            return 0.0
        zero = self.zeros[finger].counts
        slope = gauge.slope(zero, zero)
        return (self._weight_nm[finger] - self._tare_weight_nm[finger]) / slope

    def _link_weight(self, finger: int, angles: JointAngles) -> float:
        """Torque of the outer link's weight about joint 3 in N m, the tendons taken as rigid."""
        geometry = self.settings.geometry
        rigid = finger_frames(
            geometry, finger, angles.spread, angles.inner[finger], angles.outer[finger]
        )
        return gravity_torque(geometry, rigid, self._gravity)

    def observe(self, sample: HandSample) -> Observation:
        """Digest one sample."""
        s = self.settings
        time_s = sample.stamp_ns * 1e-9
        angles = joint_angles(sample, s.encoder)
        self.posture.see(sample)
        torques: dict[int, _Torque] = {}
        frames: dict[int, FingerFrames] = {}
        ends: dict[int, Array] = {}
        for index, finger in enumerate(FINGERS):
            outer = angles.outer[finger]
            self._weight_nm[finger] = self._link_weight(finger, angles)
            torque = self._torque(finger, sample.gauge_counts[index], time_s)
            torques[finger] = torque
            # The tendons give way under the torque: the link stands behind its encoder.
            bend = lagging(
                self._bend_rad[finger], self._stretch(torque.value_nm), self.tendons.half_width_rad
            )
            self._bend_rad[finger] = bend
            frames[finger] = finger_frames(
                s.geometry, finger, angles.spread, angles.inner[finger], outer - bend
            )
            ends[finger] = pin_end(frames[finger], s.pins[finger])
            if is_open(angles.inner, finger):
                self._see_open(finger, sample.gauge_counts[index], time_s)
        readings: dict[int, FingerReading] = {}
        for index, finger in enumerate(FINGERS):
            readings[finger] = self._reading(
                finger, sample.gauge_counts[index], torques[finger], frames[finger], ends, time_s
            )
        self._see_squeeze(readings)
        cells: list[Contact] = []
        if sample.tactile_n_per_cm2 is not None:
            cells = touch_contacts(
                sample.tactile_n_per_cm2,
                {finger: frames[finger].joint_3 for finger in FINGERS},
                self._cells,
                s.touch_threshold_n_per_cm2,
            )
        return Observation(sample.stamp_ns, angles, readings, tuple(cells))

    def _torque(self, finger: int, counts: int | None, time_s: float) -> _Torque:
        gauge = self.settings.calibrations.get(finger, NO_GAUGE)
        zero = self.zeros[finger]
        if gauge.kind == 'none' or counts is None:
            return _Torque(0.0, math.inf, math.inf, math.inf, FLAG_NO_GAUGE, False)
        flags = 0
        if zero.tared:
            zero.advance(time_s)
            zero_counts, zero_sigma = zero.counts, zero.sigma_counts
        else:
            flags |= FLAG_NOT_TARED
            zero_counts = gauge.reference_counts
            zero_sigma = 0.5 * (gauge.no_load_counts[1] - gauge.no_load_counts[0])
        weight = self._weight_nm[finger] - (self._tare_weight_nm[finger] if zero.tared else 0.0)
        whole = gauge.torque(float(counts), zero_counts)
        at_end = counts <= 0 or counts >= self.settings.highest_gauge_count
        if at_end or abs(whole) > gauge.valid_torque_nm:
            flags |= FLAG_SATURATED
        slope = abs(gauge.slope(float(counts), zero_counts))
        white = slope * math.hypot(gauge.noise_counts, QUANTISATION_COUNTS)
        zero_slope = abs(gauge.slope(zero_counts, zero_counts))
        # The law scatters at the reading and at the zero it is taken from.
        slow = math.hypot(zero_slope * zero_sigma, math.sqrt(2.0) * gauge.residual_nm)
        sigma = math.hypot(white, slow, gauge.relative_sigma * whole)
        near = abs(whole) > NEAR_SATURATION * gauge.valid_torque_nm
        return _Torque(whole - weight, sigma, white, slope, flags, near, at_end)

    def _reading(
        self,
        finger: int,
        counts: int | None,
        torque: _Torque,
        frames: FingerFrames,
        ends: Mapping[int, Array],
        time_s: float,
    ) -> FingerReading:
        s = self.settings
        pin = s.pins[finger]
        point = ends[finger]
        normal, sigma_direction = self._normal(finger, frames, ends)
        arm = torque_arm(frames, point, normal)
        reach = length(point - frames.joint_3[:3, 3])
        sigma_arm = math.hypot(pin.position_sigma_m, reach * sigma_direction)
        flags = torque.flags
        force = normal_force(torque.value_nm, torque.sigma_nm, arm, sigma_arm)
        travel, sigma_travel, stretch = 0.0, 0.0, 0.0
        if math.isfinite(torque.white_nm) and math.isfinite(force.sigma_n):
            touched = self.touches[finger].touching
            touching = self.touches[finger].update(
                point, force.force_n, torque.white_nm / arm, torque.count_nm / arm
            )
            if touching and not touched:
                at_rest = self._right_at_rest(finger)
                self._came_at_rest_s[finger] = time_s if at_rest else -math.inf
            if touching:
                flags |= FLAG_CONTACT
                travel, sigma_origin = self.touches[finger].travel(point, normal)
                stretch = self._stretch_sigma(torque)
                encoder = s.encoder.finger_rad_per_count * QUANTISATION_COUNTS * 2.0 * reach
                sigma_travel = math.hypot(sigma_origin, arm * stretch, encoder)
            self._follow_zero(finger, counts, point, time_s)
        elif not torque.flags & FLAG_NO_GAUGE:
            flags |= FLAG_FAULT
        zero = self.zeros[finger]
        contact = Contact(
            finger=finger,
            flags=flags,
            point=point,
            normal=normal,
            force=force.force_n * normal,
            sigma_normal_n=force.sigma_n,
            radius_m=pin.radius_m,
            travel_m=travel,
            sigma_travel_m=sigma_travel,
            sigma_point_m=math.hypot(
                pin.position_sigma_m, 0.13 * s.backlash_sigma_rad, reach * stretch
            ),
            sigma_direction_rad=sigma_direction,
            along=frames.tip[:3, 0],
        )
        return FingerReading(
            gauge_counts=counts,
            zero_counts=zero.counts,
            zero_sigma_counts=zero.sigma_counts,
            zero_doubt_counts=zero.doubt_counts,
            torque_nm=torque.value_nm,
            sigma_torque_nm=torque.sigma_nm,
            near_saturation=torque.near,
            frames=frames,
            arm_m=arm,
            contact=contact,
        )

    def _stretch(self, torque_nm: float) -> float:
        """By how much the tendons are longer under a torque, as an angle of the outer link."""
        return self.settings.tendon_compliance_rad_per_nm * torque_nm

    def _stretch_sigma(self, torque: _Torque) -> float:
        """Standard deviation of that angle [rad]; a gauge at its end tells a lower bound."""
        s, sigma = self.settings, torque.sigma_nm
        if torque.at_end:
            sigma = math.hypot(sigma, BEYOND_END * torque.value_nm)
        return math.hypot(
            s.tendon_sigma_rad_per_nm * torque.value_nm,
            s.tendon_compliance_rad_per_nm * sigma,
            self.tendons.lag_sigma(self._stretch(torque.value_nm)),
        )

    def _see_squeeze(self, readings: Mapping[int, FingerReading]) -> None:
        """Let the tendons' play be seen: all fingers that touch, as one squeeze."""
        touching = tuple(f for f in FINGERS if readings[f].contact.flags & FLAG_CONTACT)
        way, push, arms, stretch = 0.0, 0.0, 0.0, 0.0
        for finger in touching:
            reading = readings[finger]
            own = self._stretch(reading.torque_nm)
            # Without the play that is already known: the loop is to show all of it.
            way += reading.contact.travel_m + reading.arm_m * (self._bend_rad[finger] - own)
            push += float(reading.contact.force @ reading.contact.normal) / len(touching)
            arms += reading.arm_m
            stretch += own / len(touching)
        self.tendons.see(touching, Squeezing(push, way, arms, stretch))

    def _normal(
        self, finger: int, frames: FingerFrames, ends: Mapping[int, Array]
    ) -> tuple[Array, float]:
        """Inward normal of the object at this finger, and its uncertainty in rad."""
        opposed = self.settings.opposed_fingers
        pin = self.settings.pins[finger]
        direction = pin_direction(frames, pin)
        if opposed is None or finger not in opposed:
            return direction, pin.direction_sigma_rad
        first, second = ends[opposed[0]], ends[opposed[1]]
        normal = opposed_normals(first, second)[opposed.index(finger)]
        if float(normal @ direction) < FACING_COSINE:
            # The fingers do not face each other in this pose: only the pin itself is left.
            return direction, pin.direction_sigma_rad
        gap = max(length(second - first), 1e-6)
        return normal, math.sqrt(2.0) * pin.position_sigma_m / gap

    def _see_open(self, finger: int, counts: int | None, time_s: float) -> None:
        """Remember what the gauge of an open finger reads, without the weight of its link."""
        gauge = self.settings.calibrations.get(finger, NO_GAUGE)
        if counts is None or gauge.kind == 'none':
            return
        slope = gauge.slope(float(counts), float(counts))
        unloaded = counts - self._weight_nm[finger] / slope
        seen = self._seen_open[finger]
        if not seen.tared:
            seen.tare(unloaded, math.hypot(gauge.noise_counts, QUANTISATION_COUNTS), time_s)
        # Whatever an open finger reads is its zero.
        seen.free_reading(unloaded, gauge.noise_counts, time_s, steps_counts=(-math.inf, math.inf))

    def _follow_zero(self, finger: int, counts: int | None, place: Array, time_s: float) -> None:
        zero, touch = self.zeros[finger], self.touches[finger]
        if (
            counts is None
            or not self.settings.follow_drift
            or (touch.touching and not self._questionable(finger))
        ):
            zero.interrupt()
            return
        stepped = zero.free_reading(
            counts - self._weight_counts(finger),
            self.settings.calibrations[finger].noise_counts,
            time_s,
            steps_counts=self._possible_steps(finger, time_s),
            place=place,
        )
        if stepped:
            touch.reset()

    def _questionable(self, finger: int) -> bool:
        """Whether a touch can be a step of the zero: it came at rest, or the pin has left it."""
        return (
            self._right_at_rest(finger)
            or self._came_at_rest_s[finger] > self.posture.closed_at_s[finger]
            or self.touches[finger].withdrawn_m > WITHDRAWN_M
        )

    def _right_at_rest(self, finger: int) -> bool:
        """Whether the reading was the zero's since the hand last moved: what came, came alone."""
        return self.zeros[finger].agreed_from_s >= self.posture.still_since_s

    def _possible_steps(self, finger: int, time_s: float) -> tuple[float, float]:
        """Steps of the zero down and up, in counts, that the posture allows to be adopted."""
        others = any(
            self.touches[other].touching and not self._questionable(other)
            for other in FINGERS
            if other != finger
        )
        if others or time_s - self.posture.still_since_s < BLOCK_S:
            return (0.0, 0.0)
        zero = self.zeros[finger].counts
        slope = self.settings.calibrations[finger].slope(zero, zero)
        # Nothing pulls a finger closed: down, the whole band of unloaded readings is open.
        free = self.posture.withdrawn(finger) or self._questionable(finger)
        return (-UNLOADED_NM / slope, HYSTERESIS_NM / slope if free else 0.0)
