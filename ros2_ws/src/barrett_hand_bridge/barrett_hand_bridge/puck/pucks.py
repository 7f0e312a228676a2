"""The pucks behind an open CAN bus: properties set and asked for, frames in and out."""

from __future__ import annotations

import contextlib
import time

import can

from barrett_hand_bridge.hand import HandError
from barrett_hand_bridge.puck import properties
from barrett_hand_bridge.puck.frames import (
    GROUP_HAND,
    GROUP_PROPERTY,
    HOST,
    NODES,
    Frame,
    FrameError,
    decode_address,
    decode_property,
    get_frame,
    set_frame,
)

REPLY_S = 0.1
SEND_S = 0.1


class Pucks:
    """Four motor controllers on a bus; `firmware` decides the numbers of their properties."""

    def __init__(self, bus: can.BusABC) -> None:
        """Talk over `bus`, to pucks of unknown firmware."""
        self._bus = bus
        self.firmware = 0

    def number(self, name: str) -> int:
        """Number of a property in this firmware.

        Raises:
            PropertyError: the firmware does not have it.
        """
        return properties.number(name, self.firmware)

    def send(self, frame: Frame) -> None:
        """Put a frame on the bus.

        Raises:
            HandError: the bus does not take it.
        """
        message = can.Message(
            arbitration_id=frame.identifier, data=frame.data, is_extended_id=False
        )
        try:
            self._bus.send(message, timeout=SEND_S)
        except (can.CanError, OSError, ValueError) as error:
            raise HandError(f'the CAN bus takes no frames: {error}') from error

    def receive(self, timeout_s: float) -> Frame | None:
        """The next frame that does not come from a host (some buses echo what one sends).

        Raises:
            HandError: the bus is gone.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            left = deadline - time.monotonic()
            try:
                message = self._bus.recv(timeout=max(left, 0.0))
            except (can.CanError, OSError, ValueError) as error:
                raise HandError(f'the CAN bus is gone: {error}') from error
            if message is None:
                return None
            if message.is_error_frame or message.is_extended_id or message.is_remote_frame:
                continue
            if message.arbitration_id >> 5 & 0x1F != HOST:
                return Frame(message.arbitration_id, bytes(message.data))

    def drain(self, quiet_s: float = 0.0) -> None:
        """Throw away what has come, and what comes before the bus is quiet for a time."""
        while self.receive(quiet_s) is not None:
            continue

    def ask_all(self, name: str) -> None:
        """Ask all four for a property at once; their replies are left to be received."""
        self.send(get_frame(GROUP_HAND, self.number(name), group=True))

    def set_all(self, name: str, value: int) -> None:
        """Set a property of all four at once."""
        number = self.number(name)
        wide = properties.is_wide(number)
        self.send(set_frame(GROUP_HAND, number, value, wide=wide, group=True))

    def set(self, motor: int, name: str, value: int) -> None:
        """Set a property of one motor."""
        number = self.number(name)
        self.send(set_frame(NODES[motor], number, value, wide=properties.is_wide(number)))

    def get(self, motor: int, name: str) -> int | None:
        """One property of one motor; None when it does not answer."""
        number = self.number(name)
        self.send(get_frame(NODES[motor], number))
        deadline = time.monotonic() + REPLY_S
        while (left := deadline - time.monotonic()) > 0:
            frame = self.receive(left)
            if frame is None:
                break
            with contextlib.suppress(FrameError):
                address = decode_address(frame.identifier)
                if address.sender != NODES[motor] or not address.group:
                    continue
                if address.destination == GROUP_PROPERTY:
                    got, value = decode_property(frame.data)
                    if got == number:
                        return value
        return None

    def shut(self) -> None:
        """Let go of the bus."""
        with contextlib.suppress(Exception):
            self._bus.shutdown()
