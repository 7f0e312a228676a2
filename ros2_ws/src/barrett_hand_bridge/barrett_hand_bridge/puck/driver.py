# SPDX-License-Identifier: Apache-2.0
"""Driver of a BH8-280 or BH8-282 over CAN: Puck 2 properties polled by group messages."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import can

from barrett_hand_bridge.hand import (
    ENCODER_280,
    FINGERS,
    SPREAD,
    Guard,
    HandError,
    HandFacts,
    HandNotInitialisedError,
    HandSample,
)
from barrett_hand_bridge.puck import homing, properties
from barrett_hand_bridge.puck.frames import FrameError, HandAddresses
from barrett_hand_bridge.puck.pucks import MOTORS_ALL, SILENCE, Pucks
from barrett_hand_bridge.puck.replies import (
    HIGHEST_GAUGE_COUNT,
    MONITORED,
    Cycle,
    ReplyReader,
)
from barrett_hand_bridge.puck.velocity import VelocityCommands, speed_step_rad_s

INNER_RAD_PER_COUNT = 2.0 * math.pi / 4096 / 50.0
WAKE_SILENCE_S = 1.0
REFRESH_CYCLES = 25
# One monitored property of all motors in so many cycles: each comes about once a second.
MONITOR_CYCLES = 80
# MT of the maker's own driver.
MOTOR_TORQUE = 2200
# A slow adapter's answer is late, not lost: so much longer it is waited for before asking again.
SLOW_S = 0.03
# How long to wait for an answer each time that it is asked for again, and for the bus to be quiet.
RETRIES_S = (0.1, 0.2, 0.7)
QUIET_S = 0.003
# Published as stale before three periods of the promised 500 cycles per second are over.
LATE_S = 0.005
# Two group requests, four gauge and four position replies: 47 bits and 8 per byte at 1 Mbit/s.
CYCLE_WIRE_S = 806e-6
NOT_INITIALISED = (
    'the hand is not known to be initialised since it was switched on: call hand/initialize '
    '(its fingers will open)'
)


@dataclass(frozen=True)
class PuckOptions:
    """What a hand has and what it is asked for.

    Attributes:
        touch: `none`, `top10` or `full`, asked for in every `touch_every`-th cycle.
        addresses: of the pucks on the bus.
        inner_encoders: false where those of the inner links do not work, as on some hands.
        motor_torque: MT, the highest torque of a motor, in the puck's own units.
    """

    touch: str = 'none'
    touch_every: int = 10
    addresses: HandAddresses = field(default_factory=HandAddresses)
    inner_encoders: bool = True
    motor_torque: int = MOTOR_TORQUE


class CanHand:
    """A BH8-280 or BH8-282. One thread uses it; `abort` may come from another."""

    def __init__(
        self,
        open_line: Callable[[], can.BusABC],
        *,
        clock_ns: Callable[[], int] = time.time_ns,
        options: PuckOptions | None = None,
        prefetch: bool = True,
        late_s: float = LATE_S,
        guard: Callable[[], Guard] | None = None,
    ) -> None:
        """A driver that is not connected yet."""
        options = options or PuckOptions()
        self.late: Callable[[], None] = lambda: None
        self._open_line = open_line
        self._clock_ns = clock_ns
        self._options = options
        self._commands = VelocityCommands(options.motor_torque)
        self._prefetch = prefetch
        self._late_s = late_s
        self._make_guard = guard
        self._guard: Guard | None = None
        self._pucks: Pucks | None = None
        self._initialised = False
        self._aborting = False
        self._asked = False
        self._cycle_count = 0
        self._touch_motors: tuple[int, ...] = ()
        self._gauge_fitted: dict[int, bool] = dict.fromkeys(FINGERS, True)
        self._limits: dict[int, int | None] = dict.fromkeys(FINGERS)
        self._replies: ReplyReader | None = None
        self.strange_frames = 0

    def _connected(self) -> Pucks:
        if self._pucks is None:
            raise HandError('the hand is not connected')
        return self._pucks

    def connect(self) -> HandFacts:
        """Find the four pucks, wake them where needed, read what they are.

        Raises:
            HandError: no bus, pucks that do not answer, or no hand.
        """
        self.close()
        pucks = self._pucks = Pucks(self._open_line(), self._options.addresses)
        try:
            facts = self._introduce(pucks)
        except (HandError, properties.PropertyError) as error:
            self._shut()
            raise HandError(f'no BarrettHand answers on the CAN bus: {error}') from error
        if self._make_guard is not None:
            self._guard = self._make_guard()
        return facts

    def _introduce(self, pucks: Pucks) -> HandFacts:
        pucks.drain()
        self._wake(pucks)
        versions = {motor: pucks.get(motor, 'VERS') for motor in MOTORS_ALL}
        roles = {motor: pucks.get(motor, 'ROLE') for motor in MOTORS_ALL}
        if None in versions.values() or None in roles.values():
            raise HandError('a node woke up but does not say what it is')
        pucks.firmware = min(version for version in versions.values() if version is not None)
        for motor, role in roles.items():
            if (role or 0) & properties.ROLE_PRODUCT != properties.ROLE_HAND:
                raise HandError(f'{pucks.name(motor)} is not part of a hand (ROLE {role})')
            pucks.set(motor, 'GRPC', self._options.addresses.group)
        self._gauge_fitted = {
            finger: bool((roles[finger] or 0) & properties.ROLE_GAUGE) for finger in FINGERS
        }
        self._replies = ReplyReader(self._options.addresses, pucks.number)
        self._initialised = homing.homed(pucks)
        warnings = self._read_limits(pucks)
        settings = _stored(pucks, versions)
        self._commands.prepare(pucks)
        if self._options.touch != 'none':
            warnings += self._begin_touch(pucks, roles)
        return HandFacts(
            model='BH8-280',
            firmware=str(pucks.firmware),
            serial_number=str(pucks.get(1, 'SN') or 0),
            encoder=ENCODER_280,
            highest_gauge_count=4095,
            ceiling_hz=1.0 / CYCLE_WIRE_S,
            speed_step_rad_s=speed_step_rad_s(1),
            warnings=tuple(warnings),
            settings=settings,
        )

    def _wake(self, pucks: Pucks) -> None:
        states = {motor: pucks.get(motor, 'STAT') for motor in MOTORS_ALL}
        silent = [
            str(self._options.addresses.node(motor))
            for motor, state in states.items()
            if state is None
        ]
        if silent:
            raise HandError(
                f'node {", ".join(silent)} does not answer ({pucks.bus_state()}): {SILENCE}'
            )
        asleep = [motor for motor, state in states.items() if state == properties.STATUS_RESET]
        for motor in asleep:
            pucks.set(motor, 'STAT', properties.STATUS_READY)
        if asleep:
            # Traffic while transceivers come up can drive the host off the bus.
            time.sleep(WAKE_SILENCE_S)
            pucks.drain()

    def _read_limits(self, pucks: Pucks) -> list[str]:
        """Read the strain limits; says where there are none."""
        self._limits = dict.fromkeys(FINGERS)
        if not pucks.has('HSG'):
            return [
                f'firmware {pucks.firmware} has no strain limit HSG (from '
                f'{properties.OLDEST_STRAIN_LIMIT} on): only the motor torque MT bounds a squeeze '
                'when this process is late'
            ]
        self._limits = {finger: pucks.get(finger, 'HSG') or None for finger in FINGERS}
        return []

    def _begin_touch(self, pucks: Pucks, roles: Mapping[int, int | None]) -> list[str]:
        """Start the touch cells of the motors that have some; says which do not work."""
        mode = properties.TOUCH_FULL if self._options.touch == 'full' else properties.TOUCH_TOP_10
        warnings = []
        working = []
        for motor in MOTORS_ALL:
            if not (roles[motor] or 0) & properties.ROLE_TOUCH:
                continue
            pucks.set(motor, 'TACT', properties.TOUCH_NONE)
            identity = pucks.get(motor, 'TACTID') if pucks.has('TACTID') else None
            if identity == properties.TOUCH_FAILED:
                warnings.append(
                    f'the touch cells of {pucks.name(motor)} did not start (TACTID -2)'
                )
                continue
            working.append(motor)
            pucks.set(motor, 'TACT', mode)
        self._touch_motors = tuple(working)
        if not working:
            warnings.append(f'parameter touch is {self._options.touch!r}, but no touch cells work')
        return warnings

    def tare_touch(self) -> None:
        """What the touch cells feel now is nothing from now on.

        Raises:
            HandError: the bus takes no frames.
        """
        mode = properties.TOUCH_FULL if self._options.touch == 'full' else properties.TOUCH_TOP_10
        for motor in self._touch_motors:
            self._connected().set(motor, 'TACT', properties.TOUCH_TARE)
            self._connected().set(motor, 'TACT', mode)

    def initialize(self) -> None:
        """Let fingers, then the spread, find their zero, and the touch cells. Takes seconds.

        Raises:
            HandError: a motor does not finish in time, or `abort` was called; all are idle then.
        """
        pucks = self._connected()
        pucks.drain()
        self._asked = False
        self._commands.forget()
        self._aborting = False
        self._initialised = False
        homing.home(pucks, lambda: self._aborting)
        self._initialised = True
        self.tare_touch()

    def watch_guard(self) -> bool:
        """See `Hand`."""
        return self._guard is not None and self._guard.watch()

    def sample(self, velocities: Mapping[int, float] | None) -> HandSample:
        """One cycle: gauges and positions of all motors by two group requests.

        Raises:
            HandNotInitialisedError: the hand wants to be initialised first.
            HandError: the bus is gone or a puck no longer answers.
        """
        if not self._initialised:
            raise HandNotInitialisedError(NOT_INITIALISED)
        if not self._asked:
            self._request(velocities)
        self._asked = False
        cycle = Cycle()
        stamp_ns = self._gather(cycle, self._late_s)
        if not cycle.complete():
            self.late()
            late_ns = self._gather(cycle, SLOW_S)
            stamp_ns = stamp_ns or late_ns
        if not cycle.complete():
            stamp_ns = self._gather_again(cycle) or stamp_ns
        if not cycle.complete():
            missing = cycle.missing()
            pucks = self._connected()
            pucks.drain()
            self._initialised = homing.homed(pucks)
            raise HandError(
                f'no reply from {missing}: is it asleep or unplugged? ({pucks.bus_state()})'
            )
        if self._prefetch:
            self._request(velocities)
            self._asked = True
        return self._sample(cycle, stamp_ns)

    def _request(self, velocities: Mapping[int, float] | None) -> None:
        pucks = self._connected()
        self._cycle_count += 1
        if velocities is not None:
            refresh = self._cycle_count % REFRESH_CYCLES == 0
            self._commands.send(pucks, velocities, refresh=refresh)
        pucks.ask_all('SG')
        pucks.ask_all('P')
        turn, rest = divmod(self._cycle_count - 1, MONITOR_CYCLES)
        if rest == 0:
            pucks.ask_all(MONITORED[turn % len(MONITORED)])
        if self._touch_motors and self._cycle_count % self._options.touch_every == 0:
            pucks.ask_all('TACT')

    def _gather_again(self, cycle: Cycle) -> int:
        """Ask for what a late or lost frame should have brought; returns the first one's time."""
        stamp_ns = 0
        for patience_s in RETRIES_S:
            self._request(None)
            stamp_ns = self._gather(cycle, patience_s) or stamp_ns
            if cycle.complete():
                # Answers to both requests come: what is left belongs to no later cycle.
                self._connected().drain(QUIET_S)
                break
        return stamp_ns

    def _gather(self, cycle: Cycle, timeout_s: float) -> int:
        """Collect replies until the cycle is complete; returns the time of the first one."""
        pucks = self._connected()
        assert self._replies is not None
        deadline = time.monotonic() + timeout_s
        stamp_ns = 0
        while not cycle.complete():
            left = deadline - time.monotonic()
            if left <= 0:
                break
            frame = pucks.receive(left)
            if frame is None:
                break
            stamp_ns = stamp_ns or self._clock_ns()
            try:
                self._replies.take(frame, cycle)
            except FrameError:
                self.strange_frames += 1
        return stamp_ns

    def _sample(self, cycle: Cycle, stamp_ns: int) -> HandSample:
        assert self._replies is not None
        limits = self._limits
        gauges = [cycle.gauges[f] if self._gauge_fitted[f] else None for f in FINGERS]
        inner = [
            cycle.positions[finger][1] if self._options.inner_encoders else None
            for finger in FINGERS
        ]
        clutches = [
            self._replies.clutch_open(cycle.positions[finger][0], counts)
            for finger, counts in zip(FINGERS, inner, strict=True)
        ]
        angles = [None if counts is None else counts * INNER_RAD_PER_COUNT for counts in inner]
        relieving = [
            g is not None and _gives_way(g, limits[finger])
            for finger, g in zip(FINGERS, gauges, strict=True)
        ]
        return HandSample(
            stamp_ns=stamp_ns,
            finger_counts=(cycle.positions[1][0], cycle.positions[2][0], cycle.positions[3][0]),
            spread_counts=cycle.positions[SPREAD][0],
            gauge_counts=(gauges[0], gauges[1], gauges[2]),
            inner_rad=(angles[0], angles[1], angles[2]),
            temperature_c=self._replies.hottest_c(),
            strain_limits=(limits[1], limits[2], limits[3]),
            relieving=(relieving[0], relieving[1], relieving[2]),
            tactile_n_per_cm2=self._replies.pressures(),
            clutch_open=(clutches[0], clutches[1], clutches[2]),
            motors=self._replies.motors(),
        )

    def open_by_itself(self, speeds: Mapping[int, float]) -> bool:
        """See `Hand`: a movement command of the motor controllers.

        Raises:
            HandError: the bus takes no frames.
        """
        self._commands.open(self._connected(), speeds)
        return True

    def limit_force(self, counts: Mapping[int, int | None]) -> None:
        """Set HSG per finger, where the firmware has it: above it the finger gives way by itself.

        Raises:
            HandError: the bus takes no frames.
        """
        if not self._connected().has('HSG'):
            return
        for finger, limit in counts.items():
            value = 0 if limit is None else min(max(limit, 1), HIGHEST_GAUGE_COUNT)
            self._connected().set(finger, 'HSG', value)
            self._limits[finger] = value or None

    def stop(self) -> None:
        """All motors idle; the worm gears hold the position.

        Raises:
            HandError: the bus takes no frames.
        """
        self._commands.forget()
        self._connected().idle()

    @staticmethod
    def stop_all(bus: can.BusABC, addresses: HandAddresses) -> None:
        """All motors of the hand idle, over a bus that nobody else uses; then let go of it."""
        pucks = Pucks(bus, addresses)
        pucks.idle()
        pucks.shut()

    def abort(self) -> None:
        """End `initialize` of another thread."""
        self._aborting = True

    def close(self) -> None:
        """Stop the motors and let go of the bus."""
        if self._pucks is not None:
            with contextlib.suppress(HandError):
                self.stop()
        self._shut()

    def _shut(self) -> None:
        pucks, self._pucks = self._pucks, None
        guard, self._guard = self._guard, None
        if guard is not None:
            guard.dismiss()
        self._commands.forget()
        self._asked, self._cycle_count, self._touch_motors = False, 0, ()
        if pucks is not None:
            pucks.shut()


def _gives_way(counts: int, limit: int | None) -> bool:
    """Whether a finger with this reading drives itself back: beyond HSG, or its gauge's ends."""
    low, high = properties.SELF_PRESERVATION_COUNTS
    return not low <= counts <= min(high, high if limit is None else limit)


def _stored(pucks: Pucks, versions: Mapping[int, int | None]) -> dict[str, str]:
    """Firmware of every motor controller, and what it has stored for velocities and torques."""
    settings = {}
    for motor in MOTORS_ALL:
        settings[f'{pucks.name(motor)} firmware'] = str(versions[motor])
        for name in ('MT', 'MV', 'TSTOP', 'HOLD', 'OTEMP'):
            settings[f'{pucks.name(motor)} {name} found'] = str(pucks.get(motor, name))
    return settings
