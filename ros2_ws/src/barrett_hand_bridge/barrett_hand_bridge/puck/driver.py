"""Driver of a BH8-280 or BH8-282 over CAN: Puck 2 properties polled by group messages."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping

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
from barrett_hand_bridge.puck import properties
from barrett_hand_bridge.puck.frames import NODES, FrameError
from barrett_hand_bridge.puck.pucks import Pucks
from barrett_hand_bridge.puck.replies import (
    HIGHEST_GAUGE_COUNT,
    MOTORS_ALL,
    Cycle,
    ReplyReader,
)

INNER_RAD_PER_COUNT = 2.0 * math.pi / 4096 / 50.0
WAKE_SILENCE_S = 1.0
FINGERS_TIMEOUT_S = 6.0
SPREAD_TIMEOUT_S = 4.0
# A motor that has just been told to move may still call itself idle.
STARTING_S = 0.2
REFRESH_CYCLES = 25
TEMPERATURE_CYCLES = 500
# A slow adapter's answer is late, not lost: so much longer it is waited for before asking again.
SLOW_S = 0.03
# How long to wait for an answer each time that it is asked for again, and for the bus to be quiet.
RETRIES_S = (0.1, 0.2, 0.7)
QUIET_S = 0.003
# Published as stale before three periods of the promised 500 cycles per second are over.
LATE_S = 0.005
# Two group requests, four gauge and four position replies: 47 bits and 8 per byte at 1 Mbit/s.
CYCLE_WIRE_S = 806e-6


class CanHand:
    """A BH8-280 or BH8-282. One thread uses it; `abort` may come from another."""

    def __init__(
        self,
        open_line: Callable[[], can.BusABC],
        *,
        clock_ns: Callable[[], int] = time.time_ns,
        touch: str = 'none',
        touch_every: int = 10,
        prefetch: bool = True,
        late_s: float = LATE_S,
        guard: Callable[[], Guard] | None = None,
    ) -> None:
        """A driver that is not connected yet.

        `touch`: `none`, `top10` or `full`, asked for in every `touch_every`-th cycle.
        """
        self.late: Callable[[], None] = lambda: None
        self._open_line = open_line
        self._clock_ns = clock_ns
        self._touch = touch
        self._touch_every = touch_every
        self._prefetch = prefetch
        self._late_s = late_s
        self._make_guard = guard
        self._guard: Guard | None = None
        self._pucks: Pucks | None = None
        self._initialised = False
        self._aborting = False
        self._asked = False
        self._cycle_count = 0
        self._sent: dict[int, int] = {}
        self._gauge_fitted: dict[int, bool] = dict.fromkeys(FINGERS, True)
        self._limits: dict[int, int | None] = dict.fromkeys(FINGERS)
        self._replies = ReplyReader()
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
        pucks = self._pucks = Pucks(self._open_line())
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
        states = {motor: pucks.get(motor, 'STAT') for motor in MOTORS_ALL}
        silent = [str(NODES[motor]) for motor, state in states.items() if state is None]
        if silent:
            raise HandError(f'node {", ".join(silent)} does not answer')
        asleep = [motor for motor, state in states.items() if state == properties.STATUS_RESET]
        for motor in asleep:
            pucks.set(motor, 'STAT', properties.STATUS_READY)
        if asleep:
            # Traffic while transceivers come up can drive the host off the bus.
            time.sleep(WAKE_SILENCE_S)
            pucks.drain()
        self._initialised = not asleep
        versions = [pucks.get(motor, 'VERS') for motor in MOTORS_ALL]
        roles = {motor: pucks.get(motor, 'ROLE') for motor in MOTORS_ALL}
        if None in versions or None in roles.values():
            raise HandError('a node woke up but does not say what it is')
        pucks.firmware = min(version for version in versions if version is not None)
        for motor, role in roles.items():
            if (role or 0) & properties.ROLE_PRODUCT != properties.ROLE_HAND:
                raise HandError(f'node {NODES[motor]} is not part of a hand (ROLE {role})')
        self._gauge_fitted = {
            finger: bool((roles[finger] or 0) & properties.ROLE_GAUGE) for finger in FINGERS
        }
        pucks.number('SG')
        self._limits = {finger: pucks.get(finger, 'HSG') or None for finger in FINGERS}
        serial_number = pucks.get(1, 'SN')
        if self._touch != 'none':
            self._begin_touch(pucks, roles)
        self._sent = {}
        return HandFacts(
            model='BH8-280',
            firmware=str(pucks.firmware),
            serial_number=str(serial_number or 0),
            encoder=ENCODER_280,
            highest_gauge_count=4095,
            ceiling_hz=1.0 / CYCLE_WIRE_S,
        )

    def _begin_touch(self, pucks: Pucks, roles: Mapping[int, int | None]) -> None:
        mode = properties.TOUCH_FULL if self._touch == 'full' else properties.TOUCH_TOP_10
        for motor in MOTORS_ALL:
            if (roles[motor] or 0) & properties.ROLE_TOUCH:
                pucks.set(motor, 'TACT', mode)

    def initialize(self) -> None:
        """Let fingers, then the spread, find their zero. Takes seconds.

        Raises:
            HandError: a motor does not finish in time, or `abort` was called.
        """
        pucks = self._connected()
        pucks.drain()
        self._asked = False
        self._sent = {}
        self._aborting = False
        for finger in FINGERS:
            pucks.set(finger, 'CMD', properties.COMMAND_INITIALISE)
        self._await_rest(pucks, FINGERS, FINGERS_TIMEOUT_S)
        pucks.set(SPREAD, 'CMD', properties.COMMAND_INITIALISE)
        self._await_rest(pucks, (SPREAD,), SPREAD_TIMEOUT_S)
        self._initialised = True

    def _await_rest(self, pucks: Pucks, motors: tuple[int, ...], timeout_s: float) -> None:
        """Wait until motors are idle, or hold their position after arriving."""
        deadline = time.monotonic() + timeout_s
        waiting = set(motors)
        time.sleep(STARTING_S)
        while waiting:
            if self._aborting:
                pucks.set_all('MODE', properties.MODE_IDLE)
                raise HandError('initialisation was stopped')
            if time.monotonic() > deadline:
                names = ', '.join(str(NODES[motor]) for motor in sorted(waiting))
                raise HandError(f'node {names} did not finish initialising in {timeout_s:g} s')
            for motor in tuple(waiting):
                mode = pucks.get(motor, 'MODE')
                if mode in (properties.MODE_IDLE, properties.MODE_PID):
                    waiting.discard(motor)
            time.sleep(0.02)

    def sample(self, velocities: Mapping[int, float] | None) -> HandSample:
        """One cycle: gauges and positions of all motors by two group requests.

        Raises:
            HandNotInitialisedError: the hand wants to be initialised first.
            HandError: the bus is gone or a puck no longer answers.
        """
        if not self._initialised:
            raise HandNotInitialisedError(
                'the hand is not initialised: call hand/initialize (its fingers will open)'
            )
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
            states = {motor: pucks.get(motor, 'STAT') for motor in MOTORS_ALL}
            self._initialised = all(s == properties.STATUS_READY for s in states.values())
            raise HandError(f'no reply from {missing}: is it asleep or unplugged?')
        if self._prefetch:
            self._request(velocities)
            self._asked = True
        return self._sample(cycle, stamp_ns)

    def _request(self, velocities: Mapping[int, float] | None) -> None:
        pucks = self._connected()
        self._cycle_count += 1
        if velocities is not None:
            self._command(pucks, velocities)
        pucks.ask_all('SG')
        pucks.ask_all('P')
        if self._cycle_count % TEMPERATURE_CYCLES == 1:
            pucks.ask_all('TEMP')
        if self._touch != 'none' and self._cycle_count % self._touch_every == 0:
            pucks.ask_all('TACT')

    def _command(self, pucks: Pucks, velocities: Mapping[int, float]) -> None:
        """Send velocities where they changed, and all of them now and then."""
        if self._cycle_count % REFRESH_CYCLES == 0:
            self._sent.clear()
        scale = ENCODER_280
        for motor in MOTORS_ALL:
            per_count = (
                scale.spread_rad_per_count if motor == SPREAD else scale.finger_rad_per_count
            )
            wanted = velocities.get(motor, 0.0) / per_count / 1000.0
            speed = round(wanted)
            if speed == 0 and wanted != 0.0:
                speed = 1 if wanted > 0 else -1
            if self._sent.get(motor) == speed:
                continue
            self._sent[motor] = speed
            if speed == 0:
                pucks.set(motor, 'MODE', properties.MODE_IDLE)
            else:
                pucks.set(motor, 'V', speed)
                pucks.set(motor, 'MODE', properties.MODE_VELOCITY)

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
        gauge = pucks.number('SG')
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
                self._replies.take(frame, cycle, gauge)
            except FrameError:
                self.strange_frames += 1
        return stamp_ns

    def _sample(self, cycle: Cycle, stamp_ns: int) -> HandSample:
        limits = self._limits
        gauges = [cycle.gauges[f] if self._gauge_fitted[f] else None for f in FINGERS]
        inner = [cycle.positions[finger][1] for finger in FINGERS]
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
        )

    def limit_force(self, counts: Mapping[int, int | None]) -> None:
        """Set HSG per finger: above it the finger gives way by itself (0: no limit).

        Raises:
            HandError: the bus takes no frames.
        """
        for finger, limit in counts.items():
            value = 0 if limit is None else min(max(limit, 1), HIGHEST_GAUGE_COUNT)
            self._connected().set(finger, 'HSG', value)
            self._limits[finger] = value or None

    def stop(self) -> None:
        """All motors idle; the worm gears hold the position.

        Raises:
            HandError: the bus takes no frames.
        """
        self._sent = {}
        self._connected().set_all('MODE', properties.MODE_IDLE)

    @staticmethod
    def stop_all(bus: can.BusABC) -> None:
        """All motors of the hand idle, over a bus that nobody else uses; then let go of it."""
        pucks = Pucks(bus)
        pucks.set_all('MODE', properties.MODE_IDLE)
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
        self._sent, self._asked, self._cycle_count = {}, False, 0
        self._replies = ReplyReader()
        if pucks is not None:
            pucks.shut()


def _gives_way(counts: int, limit: int | None) -> bool:
    """Whether a finger with this reading drives itself back: beyond HSG, or its gauge's ends."""
    low, high = properties.SELF_PRESERVATION_COUNTS
    return not low <= counts <= min(high, high if limit is None else limit)
