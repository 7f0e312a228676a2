# SPDX-License-Identifier: Apache-2.0
"""Replies of the pucks, gathered into cycles and touch pictures (no bus in here)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from barrett_hand_bridge.hand import FINGERS, SPREAD
from barrett_hand_bridge.puck.frames import (
    CELLS,
    FULL_FRAMES,
    GROUP_FULL,
    GROUP_POSITION,
    GROUP_PROPERTY,
    GROUP_TOP_10,
    Frame,
    FrameError,
    HandAddresses,
    decode_address,
    decode_full_frame,
    decode_position,
    decode_property,
    decode_top_10,
)
from barrett_hand_bridge.puck.pucks import MOTORS_ALL

# What each motor controller is asked for in turn, one property of all four at a time.
MONITORED = ('TEMP', 'THERM', 'VBUS', 'IMOTOR', 'MODE', 'ERROR')
TEMPERATURES = ('TEMP', 'THERM')
# An outer link stands beside its inner one by so many motor counts when the clutch has let go.
BREAKAWAY_COUNTS = 9_500
MOTOR_PER_INNER_COUNT = 2.5
HIGHEST_FINGER_COUNTS = 215_000
HIGHEST_SPREAD_COUNTS = 40_000
HIGHEST_GAUGE_COUNT = 4095
TEMPERATURES_C = range(-40, 151)


@dataclass
class Cycle:
    """Replies of one cycle as they come in: gauges and positions by motor."""

    gauges: dict[int, int] = field(default_factory=dict)
    positions: dict[int, tuple[int, int | None]] = field(default_factory=dict)

    def complete(self) -> bool:
        """Whether all motors and gauges have answered."""
        return len(self.positions) == len(MOTORS_ALL) and all(
            finger in self.gauges for finger in FINGERS
        )

    def missing(self) -> str:
        """Who has not answered, in words."""
        lost = [
            'spread' if motor == SPREAD else f'finger {motor}'
            for motor in MOTORS_ALL
            if motor not in self.positions or (motor != SPREAD and motor not in self.gauges)
        ]
        return ', '.join(lost)


class ReplyReader:
    """Sorts frames into a cycle, and the frames of touch pictures into whole pictures."""

    def __init__(self, addresses: HandAddresses, number: Callable[[str], int]) -> None:
        """Replies from `addresses`; `number` gives the number of a property. No picture yet."""
        self._addresses = addresses
        self._gauge = number('SG')
        self._monitored = {number(name): name for name in MONITORED}
        self._parts: dict[int, dict[int, tuple[float, ...]]] = {}
        self._pressures: dict[int, tuple[float, ...]] = {}
        self._motors: dict[int, dict[str, int]] = {motor: {} for motor in MOTORS_ALL}

    def hottest_c(self) -> float | None:
        """The newest temperature of the hottest motor or controller; None before the first."""
        told = [
            value
            for properties in self._motors.values()
            for name, value in properties.items()
            if name in TEMPERATURES
        ]
        return float(max(told)) if told else None

    def motors(self) -> dict[int, dict[str, int]]:
        """The newest monitored properties by motor and name."""
        return {motor: dict(properties) for motor, properties in self._motors.items()}

    def pressures(self) -> dict[int, tuple[float, ...]] | None:
        """The newest whole picture per motor in N/cm2; None before the first."""
        return dict(self._pressures) if self._pressures else None

    def take(self, frame: Frame, cycle: Cycle) -> None:
        """Take one frame.

        Raises:
            FrameError: it cannot be right.
        """
        address = decode_address(frame.identifier)
        motor = self._addresses.motor(address.sender)
        if motor is None or not address.group:
            return
        if address.destination == GROUP_PROPERTY:
            number, value = decode_property(frame.data)
            if number == self._gauge and motor != SPREAD:
                if not 0 <= value <= HIGHEST_GAUGE_COUNT:
                    raise FrameError(f'gauge reading {value} beyond 12 bits')
                cycle.gauges[motor] = value
            elif (name := self._monitored.get(number)) is not None:
                if name in TEMPERATURES and value not in TEMPERATURES_C:
                    raise FrameError(f'{name} {value} beyond what a motor stands')
                self._motors[motor][name] = value
        elif address.destination == GROUP_POSITION:
            position, inner = decode_position(frame.data)
            highest = HIGHEST_SPREAD_COUNTS if motor == SPREAD else HIGHEST_FINGER_COUNTS
            if not -0.05 * highest <= position <= highest:
                raise FrameError(f'position {position} beyond the travel of motor {motor}')
            cycle.positions[motor] = (position, inner)
        elif address.destination == GROUP_TOP_10:
            self._pressures[motor] = decode_top_10(frame.data)
        elif address.destination == GROUP_FULL:
            self._take_part(motor, frame.data)

    @staticmethod
    def clutch_open(position: int, inner: int | None) -> bool | None:
        """Whether a finger broke away, from motor and inner-link counts; None without those."""
        if inner is None:
            return None
        return position - MOTOR_PER_INNER_COUNT * inner > BREAKAWAY_COUNTS

    def _take_part(self, motor: int, data: bytes) -> None:
        part, values = decode_full_frame(data)
        parts = self._parts.setdefault(motor, {})
        if part == 0:
            parts.clear()
        parts[part] = values
        if len(parts) == FULL_FRAMES:
            cells = [value for number in range(FULL_FRAMES) for value in parts[number]]
            self._pressures[motor] = tuple(cells[:CELLS])
            parts.clear()
