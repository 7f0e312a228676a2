# SPDX-License-Identifier: Apache-2.0
"""A pyserial-like port straight into an emulated hand: no pty, no threads, no wall time.

Reading lets the hand's own time pass in small steps until the bytes are there or the time-out is
over, so a driver above it behaves the same on every machine.
"""

from __future__ import annotations

from barrett_hand_bridge.emulator.serial_hand import SerialHand

STEP_S = 0.0025


class DirectPort:
    """The part of a pyserial port that a driver uses, on simulated time."""

    def __init__(self, hand: SerialHand) -> None:
        """A line at 9600 bit/s to `hand`."""
        self.hand = hand
        self.baudrate = 9600
        self.timeout: float | None = 1.0
        self._received = bytearray()

    def _move(self) -> None:
        data = self.hand.take()
        if self.baudrate != self.hand.baud:
            data = bytes(byte ^ 0xA5 for byte in data)
        self._received += data

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        self._move()
        return len(self._received)

    def write(self, data: bytes, /) -> int:
        """Send bytes to the hand."""
        for byte in data:
            self._move()
            wrong_speed = self.baudrate != self.hand.baud
            self.hand.feed(bytes(((byte ^ 0xA5) if wrong_speed else byte,)))
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes, waiting at most `timeout` seconds of the hand's time."""
        self._move()
        left = self.timeout or 0.0
        while len(self._received) < size and left > 0.0:
            self.hand.advance(STEP_S)
            left -= STEP_S
            self._move()
        data = bytes(self._received[:size])
        del self._received[:size]
        return data

    def fileno(self) -> int:
        """There is none: nothing but this object leads to the hand."""
        raise OSError('a direct port has no file descriptor')

    def close(self) -> None:
        """Nothing to let go of."""
