# SPDX-License-Identifier: Apache-2.0
"""An emulated BH8-262: bytes in, bytes out, time given from outside.

Supervisory commands and RealTime mode after the BH8-series manual for firmware 4.3x (pages 28 to
41) and the BH8-262 manual for firmware 4.4 (pages 40 to 58). Texts of banner, VERS, ? and
the lists are this emulator's own: the maker's are not known here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from barrett_hand_bridge.emulator.mechanics import SPREAD, HandMechanics
from barrett_hand_bridge.emulator.serial_loop import LoopSession
from barrett_hand_bridge.emulator.serial_parameters import (
    ALIASES,
    BAUD_CODES,
    GLOBAL_PARAMETERS,
    MOTORS,
    ParameterStore,
)
from barrett_hand_bridge.emulator.serial_state import NO_GAUGE, SerialState
from barrett_hand_bridge.emulator.serial_status import (
    INTERRUPTED,
    INVALID_VALUE,
    NOT_INITIALISED,
    OVER_TEMPERATURE,
    POSITION_NOT_REACHED,
    PREFIX_NOT_ALLOWED,
    TOO_MANY_ARGUMENTS,
    UNKNOWN_COMMAND,
    UNKNOWN_PARAMETER,
    RefusedError,
    check_value,
    name_value_pairs,
)

PROMPT = b'=> '
LINE_END = b'\n\r'
CARRIAGE_RETURN = 0x0D
CONTROL_C = 0x03

MOTIONS = ('HI', 'HOME', 'C', 'O', 'M', 'IC', 'IO', 'TC', 'TO')


class SerialHand(SerialState):
    """A BH8-262 behind its RS-232 plug. Feed it bytes, advance its time, take its answers."""

    def __init__(
        self,
        mechanics: HandMechanics,
        *,
        firmware: tuple[int, int, int] = (4, 4, 0),
        serial_number: int = 262001,
        sample_period_s: float = 0.01,
    ) -> None:
        """A hand just switched on: its banner waits to be taken."""
        super().__init__(mechanics, firmware, serial_number, sample_period_s)
        self.loop: LoopSession | None = None
        self.loop_error: int | None = None
        self._line = bytearray()
        self._output = bytearray()
        self._moving: dict[int, float | None] = {}
        self._initialising: list[tuple[int, ...]] = []
        self._banner()

    @property
    def baud(self) -> int:
        """Present line speed in bit/s."""
        return self.parameters.hand['BAUD'] * 100

    @property
    def moving(self) -> bool:
        """Whether a Supervisory motion is under way."""
        return bool(self._moving or self._initialising)

    def take(self) -> bytes:
        """Everything the hand has sent since the last call."""
        data = bytes(self._output)
        self._output.clear()
        return data

    def power_cycle(self, *, keep_parameters: bool = True) -> None:
        """A brown-out: motors stop, the loop ends, the banner comes again at 9600 bit/s."""
        self._stop_motors()
        self.loop = None
        self._moving.clear()
        self._initialising.clear()
        self._line.clear()
        if not keep_parameters:
            self.parameters = ParameterStore()
        self.parameters.hand['BAUD'] = 96
        self.initialised = dict.fromkeys(MOTORS, False)
        self.switched_on_s = self.mechanics.time_s
        self._banner()

    def feed(self, data: bytes) -> None:
        """Bytes from the host, in order."""
        for byte in data:
            if self.loop is not None:
                self._loop_byte(byte)
            elif self.moving:
                if byte == CONTROL_C:
                    self._interrupt()
            elif byte == CARRIAGE_RETURN:
                line = self._line.decode('latin-1').strip().upper()
                self._line.clear()
                self._execute(line)
            elif byte == CONTROL_C:
                self._line.clear()
                self._output += LINE_END + PROMPT
            else:
                self._line.append(byte)
                self._output.append(byte)

    def advance(self, seconds: float) -> None:
        """Let time pass: motors run, motions end, gauges drift."""
        left = seconds
        while left > 1e-12:
            passing = min(left, 0.01)
            self.mechanics.advance(passing)
            left -= passing
            self._guard_strain()
            if self.moving:
                self._watch_motion()

    def _banner(self) -> None:
        version = '.'.join(str(part) for part in self.firmware)
        self._output += (
            b'Barrett Technology, Inc.'
            + LINE_END
            + b'BH8-262 (emulated)'
            + LINE_END
            + b'BarrettHand Firmware'
            + LINE_END
            + f'Version {version}'.encode()
            + LINE_END
            + PROMPT
        )

    def _execute(self, line: str) -> None:
        if not line:
            self._output += LINE_END + PROMPT
            return
        try:
            values = self._command(line)
        except RefusedError as refused:
            self._answer(refused.status)
            return
        if values is not None:
            self._answer(0, values)

    def _answer(self, status: int, values: Sequence[int | str] = ()) -> None:
        self._output += LINE_END
        if status:
            self._output += f'ERR {status}'.encode() + LINE_END
        elif values:
            self._output += ' '.join(str(value) for value in values).encode() + LINE_END
        self._output += PROMPT

    def _command(self, line: str) -> Sequence[int | str] | None:
        """Run one command line. None: the answer comes later or has been given."""
        words = line.split()
        match = re.fullmatch(r'([1-4SG]*)(.*)', words[0])
        assert match is not None
        prefix, name = match.group(1), match.group(2)
        handlers: dict[str, Callable[[str, list[str]], Sequence[int | str] | None]] = {
            'FGET': self._get_motor,
            'FSET': self._set_motor,
            'FDEF': self._restore,
            'FLIST': lambda own, _: self.motor_listing(self._motors(own), values=False),
            'FLISTV': lambda own, _: self.motor_listing(self._motors(own), values=True),
            'PLIST': lambda *_: self.global_listing(values=False),
            'PLISTV': lambda *_: self.global_listing(values=True),
            'ERR': lambda *_: [self._total_status()],
            '?': lambda *_: [*handlers, *MOTIONS],
            'FLOAD': self._nothing,
            'FSAVE': self._nothing,
            'PGET': self._get_global,
            'PSET': self._set_global,
            'PDEF': self._restore,
            'PLOAD': self._nothing,
            'PSAVE': self._nothing,
            'VERS': self._version,
            'RESET': self._reset,
            'T': self._terminate,
            'LOOP': self._enter_loop,
        }
        if name.startswith(('P', 'V', 'R', 'ERR', '?')) and prefix:
            raise RefusedError(PREFIX_NOT_ALLOWED)
        if name in MOTIONS:
            self._motion(name, prefix, words[1:])
            return None
        if name not in handlers:
            raise RefusedError(UNKNOWN_COMMAND)
        return handlers[name](prefix, words[1:])

    def _motors(self, prefix: str) -> tuple[int, ...]:
        if not prefix:
            return tuple(m for m in MOTORS if self.parameters.motor[m]['EN'])
        chosen: set[int] = set()
        for letter in prefix:
            chosen |= {1, 2, 3} if letter == 'G' else {4} if letter == 'S' else {int(letter)}
        return tuple(sorted(chosen))

    def _nothing(self, prefix: str, words: list[str]) -> list[int | str]:
        return []

    def _restore(self, prefix: str, words: list[str]) -> list[int | str]:
        for motor in self._motors(prefix):
            self.parameters.restore_motor(motor)
        self.parameters.restore_hand()
        return []

    def _version(self, prefix: str, words: list[str]) -> list[int | str]:
        return ['BarrettHand', 'Firmware', 'Version', '.'.join(map(str, self.firmware))]

    def _reset(self, prefix: str, words: list[str]) -> None:
        self.power_cycle()

    def _terminate(self, prefix: str, words: list[str]) -> list[int | str]:
        self._stop_motors()
        return []

    def _get_motor(self, prefix: str, words: list[str]) -> list[int | str]:
        if not words:
            raise RefusedError(UNKNOWN_PARAMETER)
        values: list[int | str] = []
        for word in words:
            name = ALIASES.get(word, word)
            if self.motor_limits(name) is None:
                raise RefusedError(UNKNOWN_PARAMETER)
            values += [self.motor_value(motor, name) for motor in self._motors(prefix)]
        return values

    def _set_motor(self, prefix: str, words: list[str]) -> list[int | str]:
        for name, value in name_value_pairs(words):
            name = ALIASES.get(name, name)
            check_value(self.motor_limits(name), value)
            for motor in self._motors(prefix):
                self.parameters.motor[motor][name] = value
        return []

    def _get_global(self, prefix: str, words: list[str]) -> list[int | str]:
        values: list[int | str] = []
        for word in words:
            if word not in GLOBAL_PARAMETERS:
                raise RefusedError(UNKNOWN_PARAMETER)
            values.append(self.global_value(word))
        return values

    def _set_global(self, prefix: str, words: list[str]) -> list[int | str]:
        for name, value in name_value_pairs(words):
            check_value(GLOBAL_PARAMETERS.get(name), value)
            if name == 'BAUD' and value not in BAUD_CODES:
                raise RefusedError(INVALID_VALUE)
            self.parameters.hand[name] = value
        return []

    def _motion(self, name: str, prefix: str, words: list[str]) -> None:
        if len(words) > 1:
            raise RefusedError(TOO_MANY_ARGUMENTS)
        if words and not re.fullmatch(r'\d{1,5}', words[0]):
            raise RefusedError(INVALID_VALUE)
        if self.temperature_c * 10 > self.parameters.hand['OTEMP']:
            raise RefusedError(OVER_TEMPERATURE)
        motors = self._motors(prefix)
        self.status = dict.fromkeys(MOTORS, 0)
        if name in ('HI', 'HOME'):
            # Fingers first, the spread last: fingers could meet while they are closed.
            fingers = tuple(m for m in motors if m != SPREAD)
            stages = [fingers, tuple(m for m in motors if m == SPREAD)]
            self._initialising = [stage for stage in stages if stage]
            if name == 'HI':
                self.initialised.update(dict.fromkeys(motors, True))
            elif not all(self.initialised[m] for m in motors):
                self._initialising = []
                raise RefusedError(NOT_INITIALISED)
            self._start_stage()
            return
        if not all(self.initialised[m] for m in motors):
            raise RefusedError(NOT_INITIALISED)
        for motor in motors:
            self._drive(name, motor, int(words[0]) if words else None)

    def _start_stage(self) -> None:
        for motor in self._initialising[0]:
            self._drive('O', motor, 0)

    def _drive(self, name: str, motor: int, value: int | None) -> None:
        state = self.mechanics.motors[motor]
        own = self.parameters.motor[motor]
        position = self.mechanics.encoder_counts(motor)
        step = own['DS'] if value is None else value
        goal: float | None = {
            'O': float(own['OT']),
            'C': float(own['CT']),
            'M': float(own['DP'] if value is None else value),
            'IC': float(position + step),
            'IO': float(position - step),
            'TC': None,
            'TO': None,
        }[name]
        opens = name in ('O', 'TO') or (goal is not None and goal < position)
        speed = self.velocity(motor, own['MOV'] if opens else own['MCV'])
        state.drive(-speed if opens else speed, goal)
        self._moving[motor] = goal if name == 'M' else None

    def _guard_strain(self) -> None:
        """Stop a motor that closes against the strain limit (HSG) or opens against LSG.

        With SGFLIP the reading falls as the finger closes, and the two change their parts.
        """
        for motor in (1, 2, 3):
            state = self.mechanics.motors[motor]
            own = self.parameters.motor[motor]
            over = own['HSG'] < NO_GAUGE and self.strain(motor) > own['HSG']
            under = self.strain(motor) < own['LSG']
            if own['SGFLIP']:
                over, under = under, over
            if (state.velocity > 0 and over) or (state.velocity < 0 and under):
                state.stop()

    def _watch_motion(self) -> None:
        for motor in tuple(self._moving):
            state = self.mechanics.motors[motor]
            if not state.moving:
                goal = self._moving.pop(motor)
                error = self.parameters.motor[motor]['MPE']
                if goal is not None and abs(state.position - goal) > error:
                    self.status[motor] |= POSITION_NOT_REACHED
        if self._moving:
            return
        if self._initialising:
            self._initialising.pop(0)
            if self._initialising:
                self._start_stage()
                return
        self._answer(self._total_status())

    def _total_status(self) -> int:
        total = 0
        for motor in MOTORS:
            total |= self.status[motor]
        return total

    def _interrupt(self) -> None:
        for motor in self._moving:
            self.status[motor] |= INTERRUPTED
        for stage in self._initialising:
            self.initialised.update(dict.fromkeys(stage, False))
        self._stop_motors()
        self._moving.clear()
        self._initialising.clear()
        self._answer(INTERRUPTED)

    def _stop_motors(self) -> None:
        for motor in self.mechanics.motors.values():
            motor.stop()

    def _enter_loop(self, prefix: str, words: list[str]) -> None:
        motors = self._motors(prefix)
        if not all(self.initialised[m] for m in motors):
            raise RefusedError(NOT_INITIALISED)
        self.loop = LoopSession(self, motors)
        self._output += b'*'

    def _loop_byte(self, byte: int) -> None:
        assert self.loop is not None
        if byte == CONTROL_C:
            self._leave_loop(0)
            return
        status = self.loop_error or 0
        self.loop_error = None
        if status == 0:
            status = self.loop.take_byte(byte, self._output)
            self._guard_strain()
        if status:
            self._leave_loop(status)

    def _leave_loop(self, status: int) -> None:
        self._stop_motors()
        self.loop = None
        self._answer(status)
