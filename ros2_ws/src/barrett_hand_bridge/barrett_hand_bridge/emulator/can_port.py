# SPDX-License-Identifier: Apache-2.0
"""An emulated CAN hand on a bus: any python-can interface, or a USB-CAN stick (slcan) on a pty."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Sequence

import can

from barrett_hand_bridge.emulator.can_hand import CanHand, OutgoingFrame
from barrett_hand_bridge.emulator.faults import Fault, FaultPlan
from barrett_hand_bridge.emulator.pty_port import LONGEST_STEP_S, sharpen_timers

FRAME_OVERHEAD_BITS = 47
BIT_S = 1e-6
REPLY_LATENCY_S = 70e-6
IDLE_TICK_S = 0.005


def frame_s(size: int) -> float:
    """Time of a frame with `size` bytes on a bus of 1 Mbit/s, without stuffing."""
    return (FRAME_OVERHEAD_BITS + 8 * size) * BIT_S


class BusSchedule:
    """When the hand's frames are on the bus, and the faults that strike them."""

    def __init__(self, hand: CanHand, *, paced: bool, faults: Sequence[Fault] = ()) -> None:
        """Frames of `hand`; `paced`: they take their time."""
        self.hand = hand
        self._paced = paced
        self.faults = FaultPlan(faults)
        self._now = time.monotonic()
        self._free = 0.0
        self._queue: deque[tuple[float, OutgoingFrame]] = deque()
        self._drop = self._garble = 0
        self._delay_s = 0.0
        self._mute_until = 0.0

    def next_due(self, now: float) -> float:
        """Time until something is to be done, in s."""
        due = self._queue[0][0] if self._queue else now + IDLE_TICK_S
        return min(max(due - now, 0.0), IDLE_TICK_S)

    def receive(self, identifier: int, data: bytes, now: float) -> None:
        """A frame from the host came at `now`."""
        self._live_until(now)
        self.hand.receive(identifier, data)
        latency = self._delay_s + (REPLY_LATENCY_S if self._paced else 0.0)
        self._free = max(self._free, now + latency)
        for frame in self.hand.take():
            if self._paced:
                self._free += frame_s(len(frame.data))
            if now < self._mute_until:
                continue
            if self._drop > 0:
                self._drop -= 1
                continue
            if self._garble > 0:
                self._garble -= 1
                frame = OutgoingFrame(frame.identifier, bytes(b ^ 0x5A for b in frame.data))
            self._queue.append((self._free, frame))

    def due(self, now: float) -> list[OutgoingFrame]:
        """Frames that have passed the bus by now."""
        self._strike(now)
        self._live_until(now)
        frames = []
        while self._queue and self._queue[0][0] <= now:
            frames.append(self._queue.popleft()[1])
        return frames

    def _live_until(self, now: float) -> None:
        if now > self._now:
            self.hand.advance(min(now - self._now, LONGEST_STEP_S))
            self._now = now

    def _strike(self, now: float) -> None:
        for fault in self.faults.due(now):
            print(f'fault {fault.kind} {fault.value:g}', file=sys.stderr, flush=True)
            count = max(int(fault.value), 1)
            if fault.kind == 'drop':
                self._drop = count
            elif fault.kind == 'garble':
                self._garble = count
            elif fault.kind == 'delay':
                self._delay_s = fault.value
            elif fault.kind in ('mute', 'unplug'):
                self._mute_until = now + (fault.value or 1e9)
                self._queue.clear()
            elif fault.kind == 'brown-out':
                self.hand.power_cycle()
            elif fault.kind == 'sleep':
                self.hand.pucks[count].awake = False
            elif fault.kind == 'no-gauge':
                self.hand.mechanics.gauges[count].fitted = False
            elif fault.kind == 'press':
                self.hand.press()
            elif fault.kind == 'no-touch':
                self.hand.touch_broken.add(count)
            elif fault.kind == 'hot':
                self.hand.temperature_c = 70


class CanPort:
    """Serves a hand on an open python-can bus until `stop`."""

    def __init__(self, schedule: BusSchedule, open_bus: Callable[[], can.BusABC]) -> None:
        """Nothing is opened before `start`."""
        self._schedule = schedule
        self.faults = schedule.faults
        self._open_bus = open_bus
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Serve in a thread of this process."""
        bus = self._open_bus()
        self._thread = threading.Thread(target=self._run, args=(bus,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End and close the bus."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, bus: can.BusABC) -> None:
        sharpen_timers()
        try:
            while not self._stopping.is_set():
                message = bus.recv(timeout=self._schedule.next_due(time.monotonic()))
                now = time.monotonic()
                if message is not None and not message.is_extended_id:
                    self._schedule.receive(message.arbitration_id, bytes(message.data), now)
                for frame in self._schedule.due(time.monotonic()):
                    bus.send(
                        can.Message(
                            arbitration_id=frame.identifier,
                            data=frame.data,
                            is_extended_id=False,
                        )
                    )
        finally:
            bus.shutdown()


class SlcanPort:
    """A USB-CAN stick that speaks Lawicel ASCII on a pty, with the hand on its bus."""

    def __init__(self, schedule: BusSchedule) -> None:
        """Open the pty."""
        self._schedule = schedule
        self.faults = schedule.faults
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._line = bytearray()
        self._open = False
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Serve in a thread of this process."""
        self._thread.start()

    def stop(self) -> None:
        """End and close the pty."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        sharpen_timers()
        try:
            while not self._stopping.is_set():
                wait = self._schedule.next_due(time.monotonic())
                ready, _, _ = select.select([self._master], [], [], wait)
                now = time.monotonic()
                if ready:
                    with contextlib.suppress(BlockingIOError, OSError):
                        for byte in os.read(self._master, 4096):
                            self._byte(byte, now)
                for frame in self._schedule.due(time.monotonic()):
                    if self._open:
                        text = (
                            f't{frame.identifier:03X}{len(frame.data)}{frame.data.hex().upper()}'
                        )
                        self._write(text.encode() + b'\r')
        finally:
            os.close(self._master)
            os.close(self._slave)

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError, OSError):
            os.write(self._master, data)

    def _byte(self, byte: int, now: float) -> None:
        if byte != 0x0D:
            self._line.append(byte)
            return
        line = self._line.decode('ascii', errors='replace')
        self._line.clear()
        match = re.fullmatch(r't([0-7][0-9A-Fa-f]{2})([0-8])((?:[0-9A-Fa-f]{2})*)', line)
        if match is not None and self._open:
            data = bytes.fromhex(match.group(3))
            if len(data) == int(match.group(2)):
                self._schedule.receive(int(match.group(1), 16), data, now)
                self._write(b'z\r')
                return
        if line in ('O', 'C'):
            self._open = line == 'O'
        known = line in ('O', 'C') or re.fullmatch(r'S[0-8]', line) is not None
        self._write(b'\r' if known else b'\x07')
