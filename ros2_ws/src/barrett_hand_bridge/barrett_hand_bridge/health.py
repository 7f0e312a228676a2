# SPDX-License-Identifier: Apache-2.0
"""What /diagnostics says about the hand: one level, one sentence, and the numbers behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from barrett_hand_bridge.calibration import HandCalibration
from barrett_hand_bridge.contacts import (
    FLAG_CONTACT,
    FLAG_FAULT,
    FLAG_NO_GAUGE,
    FLAG_NOT_TARED,
    FLAG_SATURATED,
)
from barrett_hand_bridge.hand import FINGERS, HandFacts, HandSample
from barrett_hand_bridge.observer import HandObserver, Observation
from barrett_hand_bridge.statistics import Delays, Rate

HOT_C = 56.0
# A finger gives way for some hundredths of a second: it is told for longer than that.
RELIEF_SHOWN_S = 5.0
# A cycle takes milliseconds; a driver that says nothing for so long stands.
SILENT_S = 1.0
PROPERTY_NAMES = {
    'TEMP': 'controller (degrees Celsius, TEMP)',
    'THERM': 'winding (degrees Celsius, THERM)',
    'VBUS': 'supply (VBUS)',
    'IMOTOR': 'current (IMOTOR)',
    'MODE': 'mode (MODE)',
    'ERROR': 'error word (ERROR)',
}


class Level(Enum):
    """How well it is."""

    OK = 'ok'
    WARN = 'warn'
    ERROR = 'error'
    STALE = 'stale'


class LinkState(Enum):
    """Where the conversation with the hand stands."""

    NO_HAND = 'no hand'
    LOST = 'lost'
    NOT_INITIALISED = 'not initialised'
    CYCLING = 'cycling'


@dataclass
class Health:
    """Counters and last words of one node's life with its hand."""

    state: LinkState = LinkState.NO_HAND
    reason: str = ''
    last_motion: str = ''
    losses: int = 0
    late_cycles: int = 0
    disturbances: int = 0
    guard_restarts: int = 0
    hottest_c: float = math.inf
    facts: HandFacts | None = None
    calibration: HandCalibration | None = None
    rate: Rate = field(default_factory=Rate)
    delays: Delays = field(default_factory=Delays)
    relief_counts: dict[int, int] = field(default_factory=lambda: dict.fromkeys(FINGERS, 0))
    _last_s: float = -math.inf
    _relieving: tuple[bool, bool, bool] = (False, False, False)
    _relieved_s: dict[int, float] = field(default_factory=dict)

    def take(self, sample: HandSample, time_s: float) -> None:
        """Count a cycle, and the fingers that begin to give way by themselves in it."""
        self.rate.count(time_s)
        self._last_s = time_s
        for index, finger in enumerate(FINGERS):
            if sample.relieving[index]:
                self._relieved_s[finger] = time_s
                self.relief_counts[finger] += not self._relieving[index]
        self._relieving = sample.relieving

    def judge(
        self, observation: Observation | None, sample: HandSample | None, time_s: float
    ) -> tuple[Level, str]:
        """Level and sentence at a time (that of `take`)."""
        if self.state in (LinkState.NO_HAND, LinkState.LOST):
            return Level.ERROR, self.reason or 'no hand yet'
        if self.state is LinkState.NOT_INITIALISED:
            return Level.WARN, self.reason
        if observation is None or sample is None:
            return Level.STALE, 'no cycle yet'
        silent_s = time_s - self._last_s
        if silent_s > SILENT_S:
            return Level.STALE, f'no cycle for {silent_s:.1f} s: the driver or its clock stands'
        for finger, relieved_s in self._relieved_s.items():
            if time_s - relieved_s < RELIEF_SHOWN_S:
                return (
                    Level.ERROR,
                    f'finger {finger} protects its gauge and gives way by itself',
                )
        if sample.temperature_c is not None and sample.temperature_c >= self.hottest_c:
            return Level.ERROR, (
                f'a motor is {sample.temperature_c:.0f} degrees Celsius hot: holding has ended'
            )
        if sample.temperature_c is not None and sample.temperature_c > HOT_C:
            return Level.ERROR, f'the hand is {sample.temperature_c:.0f} degrees Celsius hot'
        return _judge_fingers(observation)

    def values(
        self,
        observation: Observation | None,
        sample: HandSample | None,
        observer: HandObserver | None,
        time_s: float,
    ) -> dict[str, str]:
        """Everything in numbers, as text, for the diagnostic values."""
        values = {
            'state': self.state.value,
            'reason': self.reason,
            'last motion': self.last_motion,
            'cycles per second': f'{self.rate.per_second(time_s):.1f}',
            'cycle to published, median (ms)': f'{1e3 * self.delays.percentile(50):.2f}',
            'cycle to published, p99 (ms)': f'{1e3 * self.delays.percentile(99):.2f}',
            'losses of the link': str(self.losses),
            'late cycles': str(self.late_cycles),
            'resynchronisations': str(self.disturbances),
        }
        values['stop guard restarted (times)'] = str(self.guard_restarts)
        if self.facts is not None:
            values['link ceiling (cycles per second)'] = f'{self.facts.ceiling_hz:.1f}'
            values['firmware'] = self.facts.firmware
            values['slowest speed of joint 2 and its step (rad/s)'] = (
                f'{self.facts.speed_step_rad_s:.4f}'
            )
            values |= self.facts.settings
            values |= {
                f'limitation {number}': text
                for number, text in enumerate(self.facts.warnings, start=1)
            }
        if self.calibration is not None:
            values['calibration'] = self.calibration.source
        if sample is not None and sample.temperature_c is not None:
            values['temperature (degrees Celsius)'] = f'{sample.temperature_c:.1f}'
            values['holding ends at (degrees Celsius)'] = f'{self.hottest_c:g}'
        for finger, times in self.relief_counts.items():
            if times:
                values[f'finger {finger} gave way by itself (times)'] = str(times)
        if sample is not None:
            for finger, limit in zip(FINGERS, sample.strain_limits, strict=True):
                shown = 'none' if limit is None else str(limit)
                values[f'finger {finger} strain limit HSG (counts)'] = shown
        if sample is not None:
            values |= _motor_values(sample)
        if observation is not None:
            values |= _finger_values(observation, observer)
        return values


def _judge_fingers(observation: Observation) -> tuple[Level, str]:
    warning = ''
    for finger, reading in observation.fingers.items():
        flags = reading.contact.flags
        if flags & FLAG_FAULT:
            return Level.ERROR, f'finger {finger}: the pin has no lever arm about joint 3'
        if flags & FLAG_SATURATED:
            return (
                Level.ERROR,
                f'finger {finger}: {reading.torque_nm:.2f} N m is beyond the gauge or its '
                'calibration, the force is not to be trusted',
            )
        if flags & FLAG_NO_GAUGE:
            continue
        if flags & FLAG_NOT_TARED:
            warning = warning or f'finger {finger} is not tared: call hand/tare'
        elif reading.near_saturation:
            warning = warning or f'finger {finger}: {reading.torque_nm:.2f} N m, gauge ends soon'
        elif reading.zero_doubt_counts > 0.0:
            warning = warning or (
                f'finger {finger}: {reading.zero_doubt_counts:.1f} counts of its zero may be a '
                'load that came at rest; move it free by 5 mm, or open the hand and tare'
            )
    if warning:
        return Level.WARN, warning
    touching = [
        str(finger)
        for finger, reading in observation.fingers.items()
        if reading.contact.flags & FLAG_CONTACT
    ]
    return Level.OK, f'fingers in contact: {", ".join(touching)}' if touching else 'free'


def _motor_values(sample: HandSample) -> dict[str, str]:
    """What each motor controller says of itself, and which finger broke away."""
    values = {
        f'motor {motor} {PROPERTY_NAMES.get(name, name)}': str(value)
        for motor, properties in sample.motors.items()
        for name, value in properties.items()
    }
    for finger, loose in zip(FINGERS, sample.clutch_open, strict=True):
        if loose is not None:
            values[f'finger {finger} broke away'] = 'yes' if loose else 'no'
    return values


def _finger_values(observation: Observation, observer: HandObserver | None) -> dict[str, str]:
    values: dict[str, str] = {}
    if observer is not None:
        values['play of the tendons (rad)'] = observer.tendons.told()
    for finger, reading in observation.fingers.items():
        name = f'finger {finger}'
        values[f'{name} gauge (counts)'] = str(reading.gauge_counts)
        if reading.contact.flags & FLAG_NO_GAUGE or observer is None:
            continue
        tared_at_s = observer.zeros[finger].tared_at_s
        age = math.nan if tared_at_s is None else observation.stamp_ns * 1e-9 - tared_at_s
        values[f'{name} zero (counts)'] = f'{reading.zero_counts:.2f}'
        values[f'{name} zero sigma (counts)'] = f'{reading.zero_sigma_counts:.2f}'
        values[f'{name} zero doubt (counts)'] = f'{reading.zero_doubt_counts:.2f}'
        values[f'{name} zero age (s)'] = f'{age:.0f}'
        valid = observer.settings.calibrations[finger].valid_torque_nm
        if reading.arm_m > 0.005:
            values[f'{name} gauge ends at (N)'] = f'{valid / reading.arm_m:.1f}'
    return values
