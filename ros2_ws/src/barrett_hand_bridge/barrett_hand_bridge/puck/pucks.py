# SPDX-License-Identifier: Apache-2.0
"""The pucks behind an open CAN bus: properties set and asked for, frames in and out."""

from __future__ import annotations

import contextlib
import errno
import time

import can

from barrett_hand_bridge.hand import FINGERS, SPREAD, HandError
from barrett_hand_bridge.puck import properties
from barrett_hand_bridge.puck.frames import (
    GROUP_PROPERTY,
    HOST,
    Frame,
    FrameError,
    HandAddresses,
    decode_address,
    decode_property,
    get_frame,
    set_frame,
)

SILENCE = (
    'is the hand powered and awake, is one terminator on at each end of the bus (writes can work '
    'where reads do not), is the bus at 1 Mbit/s? A host that went off the bus comes back with '
    '"ip link set can0 type can bitrate 1000000 restart-ms 100"'
)
MOTORS_ALL = (*FINGERS, SPREAD)
REPLY_S = 0.1
SEND_S = 0.1
# How long a full transmit queue gets to empty before the next try: two frames at 1 Mbit/s.
FULL_QUEUE_S = 0.0003
# Others may talk on a bus without end, or disturb it: what is not for us is thrown away so long.
CHATTER_S = 0.05


class Pucks:
    """Four motor controllers on a bus; `firmware` decides the numbers of their properties."""

    def __init__(self, bus: can.BusABC, addresses: HandAddresses | None = None) -> None:
        """Talk over `bus`, to pucks of unknown firmware."""
        self._bus = bus
        self.addresses = addresses or HandAddresses()
        self.firmware = 0
        self.error_frames = 0

    def number(self, name: str) -> int:
        """Number of a property in this firmware.

        Raises:
            PropertyError: the firmware does not have it.
        """
        return properties.number(name, self.firmware)

    def has(self, name: str) -> bool:
        """Whether this firmware has a property."""
        try:
            self.number(name)
        except properties.PropertyError:
            return False
        return True

    def send(self, frame: Frame) -> None:
        """Put a frame on the bus; a full transmit queue gets `SEND_S` to empty.

        Raises:
            HandError: the bus does not take it.
        """
        message = can.Message(
            arbitration_id=frame.identifier, data=frame.data, is_extended_id=False
        )
        deadline = time.monotonic() + SEND_S
        while True:
            try:
                self._bus.send(message, timeout=SEND_S)
                return
            except (can.CanError, OSError, ValueError) as error:
                # python-can says at once that the queue is full, whatever its time-out.
                if not _queue_is_full(error) or time.monotonic() > deadline:
                    raise HandError(
                        f'the CAN bus takes no frames: {error} ({self.bus_state()})'
                    ) from error
            time.sleep(FULL_QUEUE_S)

    def receive(self, timeout_s: float) -> Frame | None:
        """The next frame that does not come from a host (some buses echo what one sends).

        Raises:
            HandError: the bus is gone.
        """
        deadline = time.monotonic() + timeout_s
        while (left := deadline - time.monotonic()) > -CHATTER_S:
            try:
                message = self._bus.recv(timeout=max(left, 0.0))
            except (can.CanError, OSError, ValueError) as error:
                raise HandError(f'the CAN bus is gone: {error}') from error
            if message is None:
                return None
            if message.is_error_frame:
                self.error_frames += 1
                continue
            if message.is_extended_id or message.is_remote_frame:
                continue
            if message.arbitration_id >> 5 & 0x1F != HOST:
                return Frame(message.arbitration_id, bytes(message.data))
        return None

    def bus_state(self) -> str:
        """What the bus says of itself."""
        try:
            state = self._bus.state.name
        except (NotImplementedError, can.CanError, OSError, AttributeError):
            state = 'not told by this interface'
        return f'bus state {state}, {self.error_frames} error frames'

    def drain(self, quiet_s: float = 0.0) -> None:
        """Throw away what has come, and what comes before the bus is quiet for a time.

        A bus on which others talk without end is never quiet: it is left after `CHATTER_S`.
        """
        end = time.monotonic() + CHATTER_S
        while self.receive(quiet_s) is not None and time.monotonic() < end:
            continue

    def ask_all(self, name: str) -> None:
        """Ask all four for a property at once; their replies are left to be received."""
        self.send(get_frame(self.addresses.group, self.number(name), group=True))

    def idle(self) -> None:
        """All four motors idle, one by one: this needs no group that a restart has forgotten."""
        for motor in MOTORS_ALL:
            self.set(motor, 'MODE', properties.MODE_IDLE)

    def set(self, motor: int, name: str, value: int) -> None:
        """Set a property of one motor."""
        number = self.number(name)
        node = self.addresses.node(motor)
        self.send(set_frame(node, number, value, wide=properties.is_wide(number)))

    def get(self, motor: int, name: str) -> int | None:
        """One property of one motor; None when it does not answer."""
        number = self.number(name)
        node = self.addresses.node(motor)
        self.send(get_frame(node, number))
        deadline = time.monotonic() + REPLY_S
        while (left := deadline - time.monotonic()) > 0:
            frame = self.receive(left)
            if frame is None:
                break
            with contextlib.suppress(FrameError):
                address = decode_address(frame.identifier)
                if address.sender != node or not address.group:
                    continue
                if address.destination == GROUP_PROPERTY:
                    got, value = decode_property(frame.data)
                    if got == number:
                        return value
        return None

    def name(self, motor: int) -> str:
        """A motor in words, with its node."""
        part = 'spread' if motor == SPREAD else f'finger {motor}'
        return f'{part} (node {self.addresses.node(motor)})'

    def shut(self) -> None:
        """Let go of the bus."""
        with contextlib.suppress(Exception):
            self._bus.shutdown()


def _queue_is_full(error: Exception) -> bool:
    code = getattr(error, 'error_code', None) or getattr(error, 'errno', None)
    return code in (errno.ENOBUFS, errno.EAGAIN) or 'buffer space' in str(error).lower()
