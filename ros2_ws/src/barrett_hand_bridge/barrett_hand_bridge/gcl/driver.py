# SPDX-License-Identifier: Apache-2.0
"""Driver of a BH8-262 over RS-232: Supervisory set-up, then RealTime cycles."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import serial

from barrett_hand_bridge.gcl import language
from barrett_hand_bridge.gcl.language import (
    CONTROL_C,
    LOOP_ACCEPTED,
    HandLinkError,
    HandRefusedError,
)
from barrett_hand_bridge.gcl.line import LOST_MEMORY, Line
from barrett_hand_bridge.gcl.port import Port
from barrett_hand_bridge.gcl.realtime import (
    ACKNOWLEDGE,
    HEADER_FEEDBACK,
    BlockError,
    Feedback,
    check_position,
    decode_feedback,
    encode_control,
    layout_for,
    temperature_bytes,
)
from barrett_hand_bridge.hand import (
    ENCODER_262,
    FINGERS,
    SPREAD,
    Guard,
    HandDisturbedError,
    HandError,
    HandFacts,
    HandNotInitialisedError,
    HandSample,
)

NOT_INITIALISED = 4
INITIALISE_TIMEOUT_S = 20.0
NO_GAUGE_COUNTS = 255
# HSG from 255 on never acts.
HIGHEST_LIMIT = 254
NO_LIMIT = 256
# How long a late block is waited for before the hand is looked for again.
PATIENCE_S = 1.0
# Velocities on the line have four bits behind the point.
VELOCITY_UNITS = 16.0
# What is late after so many cycles is published as stale before the third one is over.
LATE_PERIODS = 2.5


class SerialHand:
    """A BH8-262. One thread uses it; `abort` may come from another."""

    def __init__(
        self,
        open_line: Callable[[], Port],
        *,
        clock_ns: Callable[[], int] = time.time_ns,
        baud: int = 38400,
        servo_sample_s: float = 0.01,
        feedback: Sequence[str] = ('strain', 'position'),
        prefetch: bool = True,
        late_s: float | None = None,
        guard: Callable[[Port], Guard] | None = None,
    ) -> None:
        """A driver that is not connected yet.

        `prefetch`: ask for the next block as soon as one is complete, so that it travels while the
        last one is digested; commands then take effect one cycle later. `late_s`: wall time after
        which an answer is called late; None: `LATE_PERIODS` cycles of the line.

        `servo_sample_s`: the period to which the hand's velocities in counts per sample refer.
        `feedback`: what every block brings, of `realtime.FEEDBACK`.

        Raises:
            HandError: a line speed or a feedback that the hand does not know.
        """
        if baud not in language.BAUD_RATES:
            raise HandError(f'baud {baud}: the hand knows 9600, 19200 and 38400')
        try:
            self.layout = layout_for(feedback)
        except ValueError as error:
            raise HandError(str(error)) from error
        self.late: Callable[[], None] = lambda: None
        self._open_line = open_line
        self._clock_ns = clock_ns
        self._baud = baud
        self._servo_sample_s = servo_sample_s
        self._line: Line | None = None
        self._temperature = 'temperature' in feedback
        self._prefetch = prefetch
        self._late_s = late_s
        self._make_guard = guard
        self._guard: Guard | None = None
        self._asked = False
        self._asked_at = 0.0
        self._looping = False
        self._flipped = dict.fromkeys(FINGERS, False)
        self._seen_gauge = dict.fromkeys(FINGERS, False)
        self._limits: dict[int, int | None] = dict.fromkeys(FINGERS)
        self._positions: dict[int, int] = {}
        self._broken: dict[int, int] = dict.fromkeys(FINGERS, 0)
        self._aborting = False
        self.resynchronisations = 0

    @property
    def cycle_s(self) -> float:
        """Time of one cycle on the wire, a request and its feedback in strict alternation."""
        return (1 + self.layout.feedback_bytes) * 10.0 / self._baud

    def _connected(self) -> Line:
        if self._line is None:
            raise HandError('the hand is not connected')
        return self._line

    def connect(self) -> HandFacts:
        """Find the hand at any line speed, set the wanted one, read what it is.

        Raises:
            HandError: no port, or no hand that answers on it.
        """
        self.close()
        port = self._open_line()
        line, answers = Line(port), False
        try:
            speeds = (9600, *(speed for speed in (self._baud, 38400, 19200) if speed != 9600))
            line.find_speed(tuple(dict.fromkeys(speeds)))
            answers = True
            line.change_speed(self._baud)
            firmware = language.parse_firmware(line.command('VERS').values)
            if self._temperature:
                self.layout = replace(self.layout, temperature_bytes=temperature_bytes(firmware))
            serial_number = line.command('PGET SN').integers(1)[0]
            flips = line.per_finger('SGFLIP')
            self._flipped = {finger: bool(flips[finger - 1]) for finger in FINGERS}
            limits = line.per_finger('HSG', NO_LIMIT)
            self._limits = {
                f: limits[f - 1] if limits[f - 1] <= HIGHEST_LIMIT and not flips[f - 1] else None
                for f in FINGERS
            }
            self._configure(line, firmware)
        except (HandLinkError, ValueError, serial.SerialException, OSError) as error:
            with contextlib.suppress(serial.SerialException, OSError):
                port.close()
            hint = f'. {LOST_MEMORY}' if answers and not isinstance(error, OSError) else ''
            raise HandError(f'no usable BarrettHand on the serial line: {error}{hint}') from error
        self._line = line
        if self._make_guard is not None:
            self._guard = self._make_guard(port)
        self._seen_gauge = dict.fromkeys(FINGERS, False)
        return HandFacts(
            model='BH8-262',
            firmware='.'.join(str(part) for part in firmware),
            serial_number=str(serial_number),
            encoder=ENCODER_262,
            highest_gauge_count=255,
            ceiling_hz=1.0 / self.cycle_s,
            speed_step_rad_s=self._speed_step_rad_s(),
        )

    def _speed_step_rad_s(self) -> float:
        """Velocities are sixteenths of LCVC, in counts per servo sample."""
        step = self.layout.velocity_coefficient / VELOCITY_UNITS
        return step * ENCODER_262.finger_rad_per_count / self._servo_sample_s

    def _configure(self, line: Line, firmware: tuple[int, int]) -> None:
        for motor, block in self.layout.motors.items():
            flags = block.parameters(firmware)
            pairs = ' '.join(f'{name} {value}' for name, value in flags.items())
            coefficient = self.layout.velocity_coefficient
            line.command(f'{motor}FSET {pairs} LCVC {coefficient} LFDPC 1')
        line.command(f'PSET LFT {int(self.layout.temperature_bytes > 0)} LFDPD 0')

    def initialize(self) -> None:
        """Run HI: all motors find their zero. Takes seconds.

        Raises:
            HandError: the hand reports an error or does not finish.
        """
        try:
            self._leave_loop()
            self._connected().command('HI', INITIALISE_TIMEOUT_S)
        except (HandLinkError, serial.SerialException, OSError) as error:
            raise HandError(f'initialisation failed: {error}') from error
        finally:
            self._aborting = False

    def sample(self, velocities: Mapping[int, float] | None) -> HandSample:
        """One RealTime cycle; enters RealTime mode first where needed.

        Raises:
            HandNotInitialisedError: the hand wants HI first.
            HandDisturbedError: garbage or loss on the line, overcome: call again.
            HandError: the link is lost or the hand ended RealTime mode: `connect` again.
        """
        try:
            if not self._looping:
                self._enter_loop()
            request = (
                HEADER_FEEDBACK
                if velocities is None
                else encode_control(
                    self.layout,
                    {motor: self._per_sample(motor, v) for motor, v in velocities.items()},
                )
            )
            return self._cycle(request)
        except HandRefusedError as refused:
            self._looping = False
            if refused.status & NOT_INITIALISED:
                raise HandNotInitialisedError(
                    'the hand is not initialised: call hand/initialize (its fingers will open)'
                ) from refused
            raise HandError(f'the hand ended RealTime mode: {refused}') from refused
        except (HandLinkError, BlockError) as error:
            self._recover()
            raise HandDisturbedError(f'resynchronised with the hand after: {error}') from error
        except (serial.SerialException, OSError, TypeError) as error:
            # pyserial answers a TypeError when another thread closes the port under a read.
            self._looping = False
            raise HandError(f'the serial line is gone: {error}') from error

    def _per_sample(self, motor: int, velocity_rad_s: float) -> float:
        scale = ENCODER_262
        per_count = scale.spread_rad_per_count if motor == SPREAD else scale.finger_rad_per_count
        highest = self.layout.highest_velocity
        counts = velocity_rad_s / per_count * self._servo_sample_s
        return min(max(counts, -highest), highest)

    def _enter_loop(self) -> None:
        line = self._connected()
        motors = sorted(self.layout.motors)
        prefix = ''.join(str(motor) for motor in motors)
        # Changes of position count from the last one reported, which this is.
        positions = line.command(f'{prefix}FGET P').integers(len(motors))
        self._positions = dict(zip(motors, positions, strict=True))
        # Where blocks do not bring it, a clutch that let go is known from here only.
        broken = line.per_finger('BP')
        self._broken = {finger: broken[finger - 1] for finger in FINGERS}
        command = f'{prefix}LOOP'
        line.port.write(command.encode() + b'\r')
        line.port.timeout = 1.0
        answer = line.port.read(len(command) + 1)
        if answer != command.encode() + LOOP_ACCEPTED:
            answer += line.until_prompt()
            reply = language.parse_reply(command, answer)
            raise HandRefusedError(command, reply.status or NOT_INITIALISED)
        self._looping, self._asked = True, False

    def _cycle(self, request: bytes) -> HandSample:
        line = self._connected()
        if not self._asked:
            self._ask(line.port, request)
        self._asked = False
        if self._prefetch:
            # The block is still on its way: one sleep instead of a wake-up for every byte.
            time.sleep(max(self._asked_at + 0.9 * self.cycle_s - time.monotonic(), 0.0))
        data, stamp_ns = self._block(line)
        if data and data[0] != ACKNOWLEDGE:
            raise HandRefusedError('LOOP', language.parse_loop_end(line.until_prompt(begun=data)))
        size = self.layout.feedback_bytes
        if len(data) < size:
            raise HandLinkError(f'{len(data)} of {size} bytes of a feedback block came')
        if line.port.in_waiting:
            raise HandLinkError('bytes nobody asked for follow a feedback block')
        if self._prefetch:
            self._ask(line.port, request)
            self._asked = True
        return self._sample(decode_feedback(self.layout, data), stamp_ns)

    def _block(self, line: Line) -> tuple[bytes, int]:
        """A feedback block, or what came instead, and the time of its first byte in ns."""
        size = self.layout.feedback_bytes
        late_s = LATE_PERIODS * self.cycle_s if self._late_s is None else self._late_s
        data, stamp_ns = b'', 0
        for patience_s in (self._asked_at + late_s - time.monotonic(), PATIENCE_S):
            line.port.timeout = max(patience_s, line.byte_s)
            if not self._prefetch and not data:
                data, stamp_ns = line.port.read(1), self._clock_ns()
            if self._prefetch or data:
                data += line.port.read(size - len(data))
            if len(data) == size or (data and data[0] != ACKNOWLEDGE):
                break
            if patience_s != PATIENCE_S:
                self.late()
        if self._prefetch:
            # Bytes of a block follow one another: its first one came that much earlier.
            # Simulated time may still stand at zero, and no message holds a time before it.
            stamp_ns = max(self._clock_ns() - round(1e9 * (size - 1) * line.byte_s), 0)
        return data, stamp_ns

    def _ask(self, port: Port, request: bytes) -> None:
        port.write(request)
        self._asked_at = time.monotonic()

    def _sample(self, feedback: Feedback, stamp_ns: int) -> HandSample:
        for motor, own in feedback.motors.items():
            if own.position is not None:
                self._positions[motor] = own.position
            elif own.delta is not None:
                self._positions[motor] += own.delta
                check_position(motor, 'position', self._positions[motor])
        gauges = [self._gauge(n, feedback.motors[n].strain) for n in FINGERS]
        for finger in FINGERS:
            breakaway = feedback.motors[finger].breakaway
            if breakaway is not None:
                self._broken[finger] = breakaway
        broken = [self._broken[finger] or None for finger in FINGERS]
        return HandSample(
            stamp_ns=stamp_ns,
            finger_counts=(self._positions[1], self._positions[2], self._positions[3]),
            spread_counts=self._positions[SPREAD],
            gauge_counts=(gauges[0], gauges[1], gauges[2]),
            breakaway_counts=(broken[0], broken[1], broken[2]),
            clutch_open=(bool(broken[0]), bool(broken[1]), bool(broken[2])),
            temperature_c=feedback.temperature_c,
            strain_limits=(self._limits[1], self._limits[2], self._limits[3]),
        )

    def _gauge(self, finger: int, strain: int | None) -> int | None:
        """The reading with rising counts for rising torque; None while nothing but 255 came.

        255 means "no gauge fitted" as well as "saturated": a gauge that has once shown less is
        fitted, and its 255 is then a saturation.
        """
        if strain is None:
            return None
        if strain != NO_GAUGE_COUNTS:
            self._seen_gauge[finger] = True
        if not self._seen_gauge[finger]:
            return None
        return NO_GAUGE_COUNTS - strain if self._flipped[finger] else strain

    def _leave_loop(self) -> None:
        if self._looping:
            self._looping = False
            self._connected().resynchronise()

    def _recover(self) -> None:
        """Back to a prompt after garbage; the motors stop with RealTime mode."""
        self._looping = False
        self.resynchronisations += 1
        try:
            self._connected().resynchronise()
        except (HandLinkError, serial.SerialException, OSError, TypeError) as error:
            raise HandError(f'the hand no longer answers: {error}') from error

    def open_by_itself(self, speeds: Mapping[int, float]) -> bool:
        """See `Hand`: RealTime mode knows velocities only."""
        return False

    def limit_force(self, counts: Mapping[int, int | None]) -> None:
        """Set HSG per finger, LSG for flipped gauges: the hand itself stops closing there.

        Raises:
            HandError: the hand refuses or does not answer.
        """
        try:
            self._leave_loop()
            for finger, limit in counts.items():
                value = NO_LIMIT if limit is None else min(max(limit, 0), HIGHEST_LIMIT)
                name = 'HSG'
                if self._flipped[finger]:
                    name, value = 'LSG', max(NO_GAUGE_COUNTS - value, 0)
                self._connected().command(f'{finger}FSET {name} {value}')
                self._limits[finger] = limit
        except (HandLinkError, serial.SerialException, OSError) as error:
            raise HandError(f'the strain limit cannot be set: {error}') from error

    def tare_touch(self) -> None:
        """A BH8-262 has no touch cells."""

    def watch_guard(self) -> bool:
        """See `Hand`."""
        return self._guard is not None and self._guard.watch()

    def stop(self) -> None:
        """Leave RealTime mode: the motors stop, the prompt returns.

        Raises:
            HandError: the hand does not answer.
        """
        self._recover()

    def abort(self) -> None:
        """Send Ctrl-C from another thread: a motion or RealTime mode ends at once."""
        line = self._line
        self._aborting = True
        if line is not None:
            with contextlib.suppress(serial.SerialException, OSError, TypeError):
                line.port.write(CONTROL_C)

    def close(self) -> None:
        """Stop the motors and let go of the port."""
        line, self._line, self._looping = self._line, None, False
        guard, self._guard = self._guard, None
        if line is None:
            return
        with contextlib.suppress(HandLinkError, serial.SerialException, OSError, TypeError):
            line.port.write(CONTROL_C)
            line.drain()
        if guard is not None:
            guard.dismiss()
        with contextlib.suppress(serial.SerialException, OSError, TypeError):
            line.port.close()
