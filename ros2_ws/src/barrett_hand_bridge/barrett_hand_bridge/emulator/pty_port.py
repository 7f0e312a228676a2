# SPDX-License-Identifier: Apache-2.0
"""An emulated serial hand behind a pseudo-terminal, at the pace of the line.

Both ends are raw before the banner is written: in cooked mode the line discipline would rewrite
it. The emulator holds the far end open itself, so that a client may come and go.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import sys
import termios
import threading
import time
import tty
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from barrett_hand_bridge.emulator.faults import Fault, FaultPlan
from barrett_hand_bridge.emulator.serial_hand import SerialHand

PR_SET_TIMERSLACK = 29
BITS_PER_BYTE = 10
IDLE_TICK_S = 0.005
# How much too late the kernel wakes a sleeper.
WAKE_UP_S = 100e-6
LONGEST_STEP_S = 0.05
SPEEDS = {
    getattr(termios, f'B{speed}'): speed for speed in (600, 1200, 2400, 4800, 9600, 19200, 38400)
}


def sharpen_timers() -> None:
    """Ask the kernel to wake this thread within 1 microsecond instead of its usual 50."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


class PtyPort:
    """A pty with a hand behind it. `run` serves until `stop`; `start` does so in a thread.

    `paced`: bytes take as long as on the wire. `real_time`: the hand lives in wall time; without
    it only `advance` lets time pass for the hand (lockstep on simulated time). `link`: a name that
    keeps pointing to the present pty, also after an unplug.
    """

    def __init__(
        self,
        hand: SerialHand,
        *,
        paced: bool = True,
        real_time: bool = True,
        link: Path | None = None,
        faults: Sequence[Fault] = (),
    ) -> None:
        """Open the pty; nothing is written before `run`."""
        self.hand = hand
        self.lock = threading.Lock()
        self.link = link
        self._paced = paced
        self._real_time = real_time
        self.faults = FaultPlan(faults)
        self._now = time.monotonic()
        self._incoming: deque[tuple[float, int]] = deque()
        self._outgoing: deque[tuple[float, int]] = deque()
        self._in_free = self._out_free = 0.0
        self._delay_s = 0.0
        self._mute_until = 0.0
        self._replug_at: float | None = None
        self._drop = self._garble = 0
        self._wake_read, self._wake_write = os.pipe()
        self._stopping = False
        self._thread: threading.Thread | None = None
        self._master: int | None = None
        self._slave: int | None = None
        self.path = ''
        self._open()

    def _open(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        settings = termios.tcgetattr(self._slave)
        settings[4] = settings[5] = termios.B9600
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        if self.link is not None:
            fresh = self.link.with_name(self.link.name + '.new')
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.path)
            fresh.replace(self.link)

    def _close(self) -> None:
        for descriptor in (self._master, self._slave):
            if descriptor is not None:
                os.close(descriptor)
        self._master = self._slave = None

    def start(self) -> None:
        """Serve in a thread of this process."""
        self._thread = threading.Thread(target=self.run, name='pty_port', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End `run` and close the pty."""
        self._stopping = True
        os.write(self._wake_write, b'.')
        if self._thread is not None:
            self._thread.join()
        if self.link is not None:
            self.link.unlink(missing_ok=True)

    def advance(self, seconds: float) -> None:
        """Let simulated time pass for the hand (with `real_time` off)."""
        with self.lock:
            self.hand.advance(seconds)
            self._collect(time.monotonic())
        os.write(self._wake_write, b'.')

    def run(self) -> None:
        """Serve until `stop`."""
        sharpen_timers()
        try:
            while not self._stopping:
                self._wait()
                with self.lock:
                    self._turn(time.monotonic())
        finally:
            self._close()

    def _wait(self) -> None:
        now = time.monotonic()
        due = now + IDLE_TICK_S
        for queue in (self._incoming, self._outgoing):
            if queue:
                due = min(due, queue[0][0])
        # The last byte of an answer is awaited awake: its lateness would count as the line's.
        awake_s = WAKE_UP_S if len(self._outgoing) == 1 else 0.0
        inputs = [self._wake_read] + ([] if self._master is None else [self._master])
        ready, _, _ = select.select(inputs, [], [], max(due - awake_s - now, 0.0))
        while not ready and 0.0 < due - time.monotonic() <= awake_s:
            continue
        if self._wake_read in ready:
            os.read(self._wake_read, 4096)
        if self._master in ready and self._master is not None:
            with contextlib.suppress(BlockingIOError, OSError):
                self._receive(os.read(self._master, 4096), time.monotonic())

    def _client_speed(self) -> int:
        if self._slave is None:
            return 0
        return SPEEDS.get(termios.tcgetattr(self._slave)[5], 0)

    def _receive(self, data: bytes, now: float) -> None:
        baud = self.hand.baud
        wrong_speed = self._client_speed() != baud
        byte_s = BITS_PER_BYTE / baud if self._paced else 0.0
        for byte in data:
            self._in_free = max(self._in_free, now) + byte_s
            self._incoming.append((self._in_free, (byte ^ 0xA5) if wrong_speed else byte))

    def _turn(self, now: float) -> None:
        self._strike(now)
        while self._incoming and self._incoming[0][0] <= now:
            at, byte = self._incoming.popleft()
            self._live_until(at)
            self.hand.feed(bytes((byte,)))
            self._collect(at)
        self._live_until(now)
        self._collect(now)
        due = bytearray()
        while self._outgoing and self._outgoing[0][0] <= now:
            due.append(self._outgoing.popleft()[1])
        if due and self._master is not None:
            with contextlib.suppress(BlockingIOError, OSError):
                os.write(self._master, due)

    def _live_until(self, at: float) -> None:
        if self._real_time and at > self._now:
            # A starved process skips time: catching up would only starve it further.
            self.hand.advance(min(at - self._now, LONGEST_STEP_S))
            self._now = at

    def _collect(self, at: float) -> None:
        """Put what the hand has said onto the line, starting at time `at`."""
        data = self.hand.take()
        if not data:
            return
        baud = self.hand.baud
        byte_s = BITS_PER_BYTE / baud if self._paced else 0.0
        wrong_speed = self._client_speed() != baud
        for byte in data:
            self._out_free = max(self._out_free, at + self._delay_s) + byte_s
            if self._drop > 0:
                self._drop -= 1
                continue
            if self._garble > 0:
                self._garble -= 1
                byte ^= 0x5A
            if at < self._mute_until or self._master is None:
                continue
            self._outgoing.append((self._out_free, (byte ^ 0xA5) if wrong_speed else byte))

    def _strike(self, now: float) -> None:
        for fault in self.faults.due(now):
            print(f'fault {fault.kind} {fault.value:g}', file=sys.stderr, flush=True)
            self._fault(fault, now)
        if self._replug_at is not None and now >= self._replug_at:
            self._replug_at = None
            self._open()

    def _fault(self, fault: Fault, now: float) -> None:
        count = max(int(fault.value), 1)
        if fault.kind == 'drop':
            self._drop = count
        elif fault.kind == 'garble':
            self._garble = count
        elif fault.kind == 'delay':
            self._delay_s = fault.value
        elif fault.kind == 'mute':
            self._mute_until = now + fault.value
        elif fault.kind == 'brown-out':
            self._outgoing.clear()
            self.hand.power_cycle()
        elif fault.kind == 'unplug':
            self._close()
            self._incoming.clear()
            self._outgoing.clear()
            if fault.value > 0:
                self._replug_at = now + fault.value
        elif fault.kind == 'loop-error':
            self.hand.loop_error = int(fault.value)
        elif fault.kind == 'no-gauge':
            self.hand.mechanics.gauges[count].fitted = False
        elif fault.kind == 'hot':
            self.hand.temperature_c = 70.0
