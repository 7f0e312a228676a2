# SPDX-License-Identifier: Apache-2.0
"""An emulated BH8-280: four motor controllers on a CAN bus, frames in, frames out.

Identifiers, property numbers and packing after what is known of the maker's bus; the inner-link
encoder, the mode numbers and the self-preservation after the maker's support pages. It refuses
what those forbid, and keeps a sentence of each refusal: motion before HI has ended since power-up,
the spread's HI before the fingers' or while one moves, modes and commands that are none, speeds
beyond MV, properties that its firmware does not have, values for what a puck measures. HSG ends
movement commands, as documented, and nothing else; a stall time (TSTOP) ends velocity mode under
load; without one HI never ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from barrett_hand_bridge.emulator.mechanics import SPREAD, HandMechanics

FIRST_NODE = 11
CELLS = 24
HAND_GROUP = 5
ENCODER_COUNTS_PER_TURN = 4096
SELF_PRESERVATION = (667, 3460)
SELF_PRESERVATION_OFF, SELF_PRESERVATION_ON = 10000, 10001
RELIEF_COUNTS_PER_S = 60_000.0
# Properties that came with a firmware: gauge, HSG and LSG, inner encoder, touch cells.
OLDEST_FIRMWARE = {25: 61, 71: 182, 72: 182, 96: 125, 98: 125, 106: 142, 107: 145}
MEASURED = frozenset({0, 9, 20, 21, 22, 23, 24, 25, 107})
MODES = frozenset({0, 2, 3, 4, 5})
INITIALISE, CLOSE, MOVE, OPEN, TERMINATE, HOME = 13, 18, 19, 20, 21, 7
COMMANDS = frozenset({INITIALISE, 14, 15, 16, 17, CLOSE, MOVE, OPEN, TERMINATE, HOME})
DEFAULT_MAX_TORQUE = 2200
# A loaded motor slower than this (counts per ms) counts as stalled after TSTOP ms.
STALL_SPEED = 2.0
RESET_STATE, READY_STATE = 0, 2
IDLE, POSITION, VELOCITY, TRAPEZOID = 0, 3, 4, 5

POSITION_PROPERTY = 48
LONG_PROPERTIES = (48, 50, 52, 54, 56, 58, 66, 68, 74, 88, 96, 98)


@dataclass(frozen=True)
class OutgoingFrame:
    """A frame of the hand."""

    identifier: int
    data: bytes


@dataclass
class Puck:
    """One motor controller: its own copy of every property it has been told."""

    node: int
    awake: bool = False
    mode: int = 0
    values: dict[int, int] = field(default_factory=dict)
    guarded: bool = True
    relieving: bool = False
    touch_mode: int = 0
    homed: bool = False
    zero_counts: int = 0
    slow_s: float = 0.0


class CanHand:
    """A BH8-280 behind its CAN plug. Feed it frames, advance its time, take its answers."""

    def __init__(
        self,
        mechanics: HandMechanics,
        *,
        firmware: int = 190,
        touch: bool = True,
        first_node: int = FIRST_NODE,
    ) -> None:
        """A hand just switched on: all four controllers wait in their monitor (STAT 0)."""
        self.mechanics = mechanics
        self.firmware = firmware
        self.pucks = {motor: Puck(first_node + motor - 1) for motor in (1, 2, 3, 4)}
        self.refusals: list[str] = []
        self.touch = touch
        self.pressures: dict[int, list[float]] = {motor: [0.0] * CELLS for motor in (1, 2, 3, 4)}
        self.pressing: list[tuple[int, int, float]] = []
        self.touch_offsets: dict[int, list[float]] = {}
        self.touch_broken: set[int] = set()
        self.temperature_c = 32
        self._output: list[OutgoingFrame] = []
        self._initialising: list[int] = []
        self._gauge_property = 25 if firmware >= 61 else 56
        self._hold_property, self._enable_property = (
            (94, 77) if 65 <= firmware <= 131 else (77, 94)
        )

    def take(self) -> list[OutgoingFrame]:
        """Everything the hand has sent since the last call."""
        frames, self._output = self._output, []
        return frames

    def press(self) -> None:
        """Press the cells of `pressing`: finger, cell and pressure in N/cm2 each."""
        for finger, cell, pressure in self.pressing:
            self.pressures[finger][cell] = pressure

    def power_cycle(self) -> None:
        """A brown-out: motors stop, all controllers are back in their monitor."""
        for puck in self.pucks.values():
            puck.awake, puck.mode, puck.values, puck.homed = False, IDLE, {}, False
        for number, puck in self.pucks.items():
            # The encoders count from where the motors stand now.
            puck.zero_counts = self.mechanics.encoder_counts(number)
            self.mechanics.torque_share[number] = 1.0
        for motor in self.mechanics.motors.values():
            motor.stop()
        self._initialising.clear()

    def receive(self, identifier: int, data: bytes) -> None:
        """A frame from the host."""
        if identifier >> 5 & 0x1F != 0 or not data:
            return
        destination = identifier & 0x1F
        for motor, puck in self.pucks.items():
            if identifier & 0x400:
                if destination in (0, 7, puck.values.get(28, HAND_GROUP)):
                    self._serve(motor, puck, data)
            elif destination == puck.node:
                self._serve(motor, puck, data)

    def _serve(self, motor: int, puck: Puck, data: bytes) -> None:
        number = data[0] & 0x7F
        if data[0] & 0x80:
            if len(data) in (4, 6):
                self._set(motor, puck, number, int.from_bytes(data[2:], 'little', signed=True))
        elif len(data) == 1:
            self._get(motor, puck, number)

    def _set(self, motor: int, puck: Puck, number: int, value: int) -> None:
        if number == 5:
            puck.awake = value == READY_STATE
            return
        if not puck.awake:
            return
        if self._lacks(number):
            return
        if number in MEASURED:
            self.refusals.append(f'a value for property {number}, which is measured')
            return
        if number not in LONG_PROPERTIES:
            # A short property keeps the lower 16 bits of what it is told.
            value = (value + 0x8000) % 0x10000 - 0x8000
        if number == 8:
            self._change_mode(motor, puck, value)
        elif number == 44:
            puck.values[44] = value
            if puck.mode == VELOCITY and motor not in self._initialising:
                self._run(motor, puck)
        elif number == 29:
            self._command(motor, puck, value)
        elif number == 71 and value in (SELF_PRESERVATION_OFF, SELF_PRESERVATION_ON):
            puck.guarded = value == SELF_PRESERVATION_ON
        elif number == 106:
            puck.touch_mode = value
            if value == 3:
                self.touch_offsets[motor] = list(self.pressures[motor])
            if value == 2:
                self._send_touch(motor, puck)
        else:
            puck.values[number] = value
            if number == 43:
                self.mechanics.torque_share[motor] = max(value, 0) / DEFAULT_MAX_TORQUE

    def _lacks(self, number: int) -> bool:
        """Whether this firmware does not have a property; that it was asked for is kept."""
        if self.firmware >= OLDEST_FIRMWARE.get(number, 0):
            return False
        self.refusals.append(f'property {number} in firmware {self.firmware}')
        return True

    def _change_mode(self, motor: int, puck: Puck, mode: int) -> None:
        if mode not in MODES:
            self.refusals.append(f'mode {mode} of node {puck.node}, which is none')
            return
        if mode != IDLE and not puck.homed:
            self.refusals.append(f'mode {mode} of node {puck.node} before HI')
            return
        puck.mode = mode
        puck.slow_s = 0.0
        if motor in self._initialising:
            self._initialising.remove(motor)
        if mode == IDLE:
            self.mechanics.motors[motor].stop()
        elif mode == VELOCITY:
            self._run(motor, puck)

    def _run(self, motor: int, puck: Puck) -> None:
        """Run at V, at most at MV."""
        state = self.mechanics.motors[motor]
        highest = puck.values.get(45, 50 if motor == SPREAD else 200)
        speed = puck.values.get(44, 0)
        if abs(speed) > highest:
            self.refusals.append(f'V {speed} of node {puck.node} beyond MV {highest}')
            speed = max(min(speed, highest), -highest)
        state.drive(speed * 1000.0) if speed else state.stop()

    def _command(self, motor: int, puck: Puck, command: int) -> None:
        state = self.mechanics.motors[motor]
        speed = puck.values.get(45, 50 if motor == SPREAD else 200) * 1000.0
        if command not in COMMANDS:
            self.refusals.append(f'command {command} of node {puck.node}, which is none')
        elif command not in (INITIALISE, TERMINATE) and not puck.homed:
            self.refusals.append(f'command {command} of node {puck.node} before HI')
        elif command == INITIALISE and motor == SPREAD and not self._fingers_stand():
            self.refusals.append(f'HI of node {puck.node} before that of the fingers has ended')
        elif command in (INITIALISE, OPEN, HOME):
            puck.mode = VELOCITY if command == INITIALISE else TRAPEZOID
            # Broken off, it leaves a motor that does not know where it stands.
            puck.homed = puck.homed and command != INITIALISE
            state.drive(-speed, 0.0)
            self._initialising.append(motor)
        elif command == CLOSE:
            puck.mode = TRAPEZOID
            state.drive(speed, float(puck.values.get(56, 35950 if motor == SPREAD else 195000)))
            self._initialising.append(motor)
        elif command == MOVE:
            goal = float(puck.values.get(58, 0))
            puck.mode = TRAPEZOID
            state.drive(speed if goal > state.position else -speed, goal)
            self._initialising.append(motor)
        elif command == TERMINATE:
            puck.mode = IDLE
            state.stop()

    def _fingers_stand(self) -> bool:
        """Whether all three fingers have found their zeros and none is on its way."""
        return all(
            self.pucks[finger].homed and not self.mechanics.motors[finger].moving
            for finger in (1, 2, 3)
        )

    def _get(self, motor: int, puck: Puck, number: int) -> None:
        if number == 5:
            self._reply(puck, number, READY_STATE if puck.awake else RESET_STATE)
            return
        if not puck.awake or self._lacks(number):
            return
        if number == POSITION_PROPERTY:
            self._send_position(motor, puck)
        elif number == 106:
            self._send_touch(motor, puck)
        elif number == self._gauge_property:
            spread = motor == SPREAD
            self._reply(puck, number, 2900 if spread else self.mechanics.gauges[motor].counts)
        else:
            self._reply(puck, number, self._value(motor, puck, number))

    def _value(self, motor: int, puck: Puck, number: int) -> int:
        if number == 0:
            return self.firmware
        if number == 1:
            gauge = motor != SPREAD and self.mechanics.gauges[motor].fitted
            return 5 | 0x0200 | (0x0800 if gauge else 0) | (0x1000 if self.touch else 0)
        if number == 2:
            return 2800 + motor
        if number == 3:
            return puck.node
        if number == 8:
            return puck.mode
        if number in (9, 10, 20):
            return self.temperature_c
        if number == 107:
            return -2 if motor in self.touch_broken else 1
        stored = {
            self._hold_property: 1 if motor == SPREAD else 0,
            21: 48,
            28: HAND_GROUP,
            43: DEFAULT_MAX_TORQUE,
            45: 50 if motor == SPREAD else 200,
            56: 35_950 if motor == SPREAD else 195_000,
            78: 150 if motor == SPREAD else 50,
        }
        if number in stored:
            return puck.values.get(number, stored[number])
        return puck.values.get(number, 0)

    def _reply(self, puck: Puck, number: int, value: int) -> None:
        size = 4 if number in LONG_PROPERTIES else 2
        data = bytes((number | 0x80, 0)) + value.to_bytes(size, 'little', signed=True)
        self._output.append(OutgoingFrame(0x400 | puck.node << 5 | 6, data))

    def _send_position(self, motor: int, puck: Puck) -> None:
        data = _packed(self.mechanics.encoder_counts(motor) - puck.zero_counts)
        if motor != SPREAD and self.firmware >= 125:
            inner, _ = self.mechanics.angles(motor)
            counts = inner * 50.0 * ENCODER_COUNTS_PER_TURN / (2.0 * math.pi)
            data += _packed(math.floor(counts + 0.5))
        self._output.append(OutgoingFrame(0x400 | puck.node << 5 | 3, data))

    def _send_touch(self, motor: int, puck: Puck) -> None:
        offsets = self.touch_offsets.get(motor, [0.0] * CELLS)
        cells = [
            max(pressure - offset, 0.0)
            for pressure, offset in zip(self.pressures[motor], offsets, strict=True)
        ]
        if puck.touch_mode == 2:
            for part in range(5):
                word = part
                for value in (*cells, 0.0)[5 * part : 5 * part + 5]:
                    word = word << 12 | min(max(int(value * 256.0), 0), 0xFFF)
                frame = OutgoingFrame(0x400 | puck.node << 5 | 9, word.to_bytes(8, 'big'))
                self._output.append(frame)
        elif puck.touch_mode == 1:
            strongest = sorted(range(CELLS), key=lambda cell: -cells[cell])[:10]
            marked = sorted(cell for cell in strongest if cells[cell] > 0.0)
            word = 0
            for cell in marked:
                word |= 1 << (63 - cell)
            for place, cell in enumerate(marked):
                word |= min(int(cells[cell]), 15) << (36 - 4 * place)
            self._output.append(OutgoingFrame(0x400 | puck.node << 5 | 8, word.to_bytes(8, 'big')))

    def advance(self, seconds: float) -> None:
        """Let time pass: motors run, fingers protect their gauges, gauges drift."""
        left = seconds
        while left > 1e-12:
            passing = min(left, 0.005)
            self.mechanics.advance(passing)
            left -= passing
            self._watch(passing)

    def _watch(self, seconds: float) -> None:
        for motor in tuple(self._initialising):
            puck = self.pucks[motor]
            if self.mechanics.motors[motor].moving:
                continue
            if puck.mode == VELOCITY:
                if puck.values.get(78, 1) == 0:
                    # HI feels its end by a stall: without a stall time it drives on.
                    continue
                puck.zero_counts, puck.homed = 0, True
            self._initialising.remove(motor)
            # The spread holds its position under control, a finger's worm gear needs none.
            puck.mode = POSITION if motor == SPREAD else IDLE
        for motor, puck in self.pucks.items():
            self._stall(motor, puck, seconds)
        for motor in (1, 2, 3):
            self._protect(motor, self.pucks[motor])

    def _protect(self, motor: int, puck: Puck) -> None:
        """Drive back above the gauge's own limits, and above HSG when one is set."""
        counts = self.mechanics.gauges[motor].counts
        state = self.mechanics.motors[motor]
        limit = puck.values.get(71, 0)
        # Documented for movement commands, and at rest; velocity mode is in neither list.
        over = limit > 0 and counts > limit and puck.mode != VELOCITY
        if puck.guarded:
            over = over or counts > SELF_PRESERVATION[1]
        if over and self.mechanics.gauges[motor].fitted:
            puck.relieving = True
            state.drive(-RELIEF_COUNTS_PER_S)
        elif puck.relieving:
            puck.relieving = False
            puck.mode = IDLE
            state.stop()

    def _stall(self, motor: int, puck: Puck, seconds: float) -> None:
        """A loaded motor in velocity mode that hardly moves for TSTOP ms goes idle."""
        state = self.mechanics.motors[motor]
        stop_ms = puck.values.get(78, 150 if motor == SPREAD else 50)
        if puck.mode != VELOCITY or motor in self._initialising or stop_ms == 0:
            return
        loaded = motor != SPREAD and self.mechanics.truth(motor).force_n > 0.5
        slow = state.stalled or (loaded and abs(state.velocity) < STALL_SPEED * 1000.0)
        puck.slow_s = puck.slow_s + seconds if slow else 0.0
        if puck.slow_s * 1000.0 >= stop_ms:
            puck.mode = IDLE
            state.stop()


def _packed(value: int) -> bytes:
    """A position in three bytes: mark, then 22 bits two's complement, most significant first."""
    raw = value & 0x3FFFFF
    return bytes((0x80 | raw >> 16, raw >> 8 & 0xFF, raw & 0xFF))
