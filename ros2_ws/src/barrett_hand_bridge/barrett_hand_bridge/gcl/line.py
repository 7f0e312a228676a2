# SPDX-License-Identifier: Apache-2.0
"""The serial line of a GCL hand: commands with echo and prompt, resynchronisation, line speed."""

from __future__ import annotations

import time

from barrett_hand_bridge.gcl.language import (
    CARRIAGE_RETURN,
    CONTROL_C,
    PROMPT,
    HandLinkError,
    HandRefusedError,
    Reply,
    parse_reply,
)
from barrett_hand_bridge.gcl.port import Port

BITS_PER_BYTE = 10
UNKNOWN_PARAMETER = 64
ANSWER_TIMEOUT_S = 2.0
SHORT_PATIENCE_S = 0.3
LONG_PATIENCE_S = 1.5
SILENCE = '(silence)'
LOST_MEMORY = (
    'A hand that stood without power for a day has lost its memory: it asks for its firmware, or '
    'obeys erratically, until that is loaded again'
)


class Line:
    """Conversation with the hand in Supervisory mode over an open port."""

    def __init__(self, port: Port) -> None:
        """Talk over `port`; its speed is that of the port now."""
        self.port = port

    @property
    def byte_s(self) -> float:
        """Time of one byte on the wire (8 data bits, start and stop bit)."""
        return BITS_PER_BYTE / self.port.baudrate

    def command(self, line: str, timeout_s: float = ANSWER_TIMEOUT_S) -> Reply:
        """Send one command and wait for the prompt.

        Raises:
            HandRefusedError: the hand answered with a status sum.
            HandLinkError: no prompt in time, or an answer that cannot be read.
        """
        self.port.write(line.encode('ascii') + CARRIAGE_RETURN)
        raw = self.until_prompt(timeout_s + 100 * self.byte_s + len(line) * self.byte_s)
        reply = parse_reply(line, raw)
        if reply.status:
            raise HandRefusedError(line, reply.status)
        return reply

    def per_finger(self, name: str, missing: int = 0) -> tuple[int, int, int]:
        """A parameter of fingers 1, 2 and 3; `missing` where the firmware does not know it.

        Raises:
            HandLinkError: no answer that can be read, or a refusal for another reason.
        """
        try:
            first, second, third = self.command(f'GFGET {name}').integers(3)
        except HandRefusedError as refused:
            if refused.status != UNKNOWN_PARAMETER:
                raise
            return missing, missing, missing
        return first, second, third

    def until_prompt(self, timeout_s: float = ANSWER_TIMEOUT_S, begun: bytes = b'') -> bytes:
        """What has `begun` and everything up to a prompt, or until the time is over."""
        deadline = time.monotonic() + timeout_s
        data = bytearray(begun)
        while not data.endswith(PROMPT):
            left = deadline - time.monotonic()
            if left <= 0:
                break
            self.port.timeout = min(left, 0.1)
            data += self.port.read(max(self.port.in_waiting, 1))
        return bytes(data)

    def read_for(self, seconds: float) -> bytes:
        """Everything that comes within a time."""
        deadline = time.monotonic() + seconds
        data = bytearray()
        while (left := deadline - time.monotonic()) > 0:
            self.port.timeout = left
            data += self.port.read(max(self.port.in_waiting, 1))
        return bytes(data)

    def drain(self) -> bytes:
        """Everything that still comes, until the line has been quiet for 40 byte times."""
        data = bytearray()
        self.port.timeout = max(40 * self.byte_s, 0.03)
        for _ in range(10_000):
            fresh = self.port.read(max(self.port.in_waiting, 1))
            if not fresh:
                break
            data += fresh
        return bytes(data)

    def resynchronise(self, patience_s: float = LONG_PATIENCE_S) -> None:
        """Leave RealTime mode or a motion if there is one, clear errors, end at a fresh prompt.

        `patience_s`: how long each of three attempts waits for the prompt.

        Raises:
            HandLinkError: no prompt comes at this line speed.
        """
        self.port.write(CONTROL_C)
        heard = self.drain()
        for _ in range(3):
            self.port.write(CARRIAGE_RETURN)
            answer = self.until_prompt(patience_s + 20 * self.byte_s)
            heard += answer
            if answer.endswith(PROMPT) and not self.drain():
                return
        raise HandLinkError(
            f'no prompt from the hand at {self.port.baudrate} baud'
            + (f' (heard {heard[-20:]!r})' if heard else f' {SILENCE}')
        )

    def find_speed(self, speeds: tuple[int, ...]) -> int:
        """Try line speeds until the hand answers with a prompt.

        Raises:
            HandLinkError: at none of them.
        """
        heard = ''
        for patience_s in (SHORT_PATIENCE_S, LONG_PATIENCE_S):
            for speed in speeds:
                self.port.baudrate = speed
                try:
                    self.resynchronise(patience_s)
                    return speed
                except HandLinkError as error:
                    heard = str(error).partition(' baud ')[2] or heard
        tried = ', '.join(str(speed) for speed in speeds)
        raise HandLinkError(
            f'no prompt from the hand at {tried} baud {heard}: is it powered, is the cable '
            'straight-through?' + ('' if heard == SILENCE else f' {LOST_MEMORY}')
        )

    def change_speed(self, speed: int) -> None:
        """Change the line speed of hand and port.

        Raises:
            HandLinkError: the hand does not answer at the new speed.
        """
        if self.port.baudrate == speed:
            return
        line = f'PSET BAUD {speed // 100}'
        self.port.write(line.encode('ascii') + CARRIAGE_RETURN)
        self.port.timeout = ANSWER_TIMEOUT_S + 2 * len(line) * self.byte_s
        echo = self.port.read(len(line))
        if echo != line.encode('ascii'):
            raise HandLinkError(f'{line}: echo is {echo!r}')
        self.port.baudrate = speed
        self.read_for(1.0)
        self.resynchronise()
