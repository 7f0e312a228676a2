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
from barrett_hand_bridge.tare import ExpectedZero, TareOutcome, take_zero
from barrett_hand_bridge.touch import touch_cells, touch_contacts
from barrett_hand_bridge.zero import DRIFT_8_BIT, DriftModel, ZeroTracker

NEAR_SATURATION = 0.9
FACING_COSINE = 0.5
QUANTISATION_COUNTS = 1.0 / math.sqrt(12.0)


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
    flags: int
    near: bool


class HandObserver:
    """Keeps zeros, drift and touches; turns each sample into an `Observation`."""

    def __init__(self, settings: ObserverSettings) -> None:
        """Nothing tared, nothing touched."""
        self.settings = settings
        self.zeros = {finger: ZeroTracker(settings.drift) for finger in FINGERS}
        self.touches = {finger: TouchTracker(settings.touch) for finger in FINGERS}
        self._tare_weight_nm = dict.fromkeys(FINGERS, 0.0)
        self._weight_nm = dict.fromkeys(FINGERS, 0.0)
        self._cells = touch_cells(settings.geometry)
        self._gravity: Array = np.asarray(settings.gravity, dtype=float)

    def set_gravity(self, direction: Array) -> None:
        """Direction of gravity in the hand frame, unit vector (3,), as the arm turns the hand."""
        self._gravity = direction

    def forget_zeros(self) -> None:
        """The hand was away: contacts are not to be trusted before the next tare."""
        for finger in FINGERS:
            self.zeros[finger].forget()
            self.touches[finger].reset()

    def tare(self, samples: list[HandSample]) -> TareOutcome:
        """Take new zeros from samples at rest, or say why not."""
        expected: dict[int, ExpectedZero] = {}
        for finger in FINGERS:
            zero = self.zeros[finger]
            known = zero.counts + self._weight_counts(finger) if zero.tared else None
            expected[finger] = ExpectedZero(
                known, zero.sigma_counts, self.touches[finger].touching
            )
        outcome = take_zero(samples, self._calibrations(), expected)
        for finger, zero_taken in outcome.zeros.items():
            self._tare_weight_nm[finger] = self._weight_nm[finger]
            self.zeros[finger].tare(
                zero_taken.counts, zero_taken.sigma_counts, samples[-1].stamp_ns * 1e-9
            )
            self.touches[finger].reset()
        return outcome

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

    def observe(self, sample: HandSample) -> Observation:
        """Digest one sample."""
        s = self.settings
        time_s = sample.stamp_ns * 1e-9
        angles = joint_angles(sample, s.encoder)
        torques: dict[int, _Torque] = {}
        frames: dict[int, FingerFrames] = {}
        ends: dict[int, Array] = {}
        for index, finger in enumerate(FINGERS):
            outer = angles.outer[finger]
            rigid = finger_frames(s.geometry, finger, angles.spread, angles.inner[finger], outer)
            self._weight_nm[finger] = gravity_torque(s.geometry, rigid, self._gravity)
            torque = self._torque(finger, sample.gauge_counts[index], time_s)
            torques[finger] = torque
            # The tendons give way under the torque: the link stands behind its encoder.
            bent = outer - s.tendon_compliance_rad_per_nm * torque.value_nm
            frames[finger] = finger_frames(
                s.geometry, finger, angles.spread, angles.inner[finger], bent
            )
            ends[finger] = pin_end(frames[finger], s.pins[finger])
        readings: dict[int, FingerReading] = {}
        for index, finger in enumerate(FINGERS):
            readings[finger] = self._reading(
                finger, sample.gauge_counts[index], torques[finger], frames[finger], ends, time_s
            )
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
            return _Torque(0.0, math.inf, math.inf, FLAG_NO_GAUGE, False)
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
        slow = math.hypot(zero_slope * zero_sigma, gauge.residual_nm)
        sigma = math.hypot(white, slow, gauge.relative_sigma * whole)
        near = abs(whole) > NEAR_SATURATION * gauge.valid_torque_nm
        return _Torque(whole - weight, sigma, white, flags, near)

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
        travel, sigma_travel = 0.0, 0.0
        touching = False
        if math.isfinite(torque.white_nm) and math.isfinite(force.sigma_n):
            touching = self.touches[finger].update(point, force.force_n, torque.white_nm / arm)
            if touching:
                flags |= FLAG_CONTACT
                travel, sigma_origin = self.touches[finger].travel(point, normal)
                stretch = math.hypot(
                    s.tendon_sigma_rad_per_nm * torque.value_nm,
                    s.tendon_compliance_rad_per_nm * torque.sigma_nm,
                )
                encoder = s.encoder.finger_rad_per_count * QUANTISATION_COUNTS * 2.0 * reach
                sigma_travel = math.hypot(sigma_origin, arm * stretch, encoder)
            self._follow_zero(finger, counts, touching, time_s)
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
            sigma_point_m=math.hypot(pin.position_sigma_m, 0.13 * s.backlash_sigma_rad),
            sigma_direction_rad=sigma_direction,
        )
        return FingerReading(
            gauge_counts=counts,
            zero_counts=zero.counts,
            zero_sigma_counts=zero.sigma_counts,
            torque_nm=torque.value_nm,
            sigma_torque_nm=torque.sigma_nm,
            near_saturation=torque.near,
            frames=frames,
            arm_m=arm,
            contact=contact,
        )

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

    def _follow_zero(self, finger: int, counts: int | None, touching: bool, time_s: float) -> None:
        zero = self.zeros[finger]
        if touching or counts is None or not self.settings.follow_drift:
            zero.interrupt()
            return
        noise = self.settings.calibrations[finger].noise_counts
        zero.free_reading(counts - self._weight_counts(finger), noise, time_s)
