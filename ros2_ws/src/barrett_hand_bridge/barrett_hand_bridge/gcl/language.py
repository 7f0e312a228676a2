# SPDX-License-Identifier: Apache-2.0
"""Supervisory mode of a serial BarrettHand: command lines out, replies in (pure functions).

BH8-series manual for firmware 4.3x (pages 28 to 41), BH8-262 manual for firmware 4.4 (pages 40 to
58). Line ends in replies are LF CR, but any mix is accepted; every character is echoed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

PROMPT = b'=> '
CONTROL_C = b'\x03'
CARRIAGE_RETURN = b'\r'
LOOP_ACCEPTED = b'*'
BAUD_RATES = (9600, 19200, 38400)
RESET_MARK = b'BarrettHand Firmware'

STATUS_TEXTS = {
    1: 'no motor board',
    2: 'no motor',
    4: 'motor not initialised',
    16: 'position not reached',
    32: 'unknown command',
    64: 'unknown parameter',
    128: 'invalid value',
    256: 'read-only parameter written',
    1024: 'too many arguments',
    2048: 'invalid RealTime header',
    4096: 'prefix not allowed',
    8192: 'over-temperature',
    16384: 'interrupted by Ctrl-C',
}


class HandLinkError(Exception):
    """The conversation with the hand failed; the message says what was expected and what came."""


class HandRefusedError(HandLinkError):
    """The hand refused a command, or stopped it, with a status sum."""

    def __init__(self, command: str, status: int) -> None:
        """Keep command and status; the text lists the bits."""
        super().__init__(f'{command}: hand answers ERR {status} ({status_text(status)})')
        self.status = status


class HandRestartedError(HandLinkError):
    """The banner came in mid-conversation: the hand lost power or was reset."""


@dataclass(frozen=True)
class Reply:
    """A complete answer to one command: its values, or its status sum (0: done)."""

    values: tuple[str, ...]
    status: int = 0

    def integers(self, count: int) -> tuple[int, ...]:
        """The values as exactly `count` integers.

        Raises:
            HandLinkError: another number of values, or one that is no integer.
        """
        if len(self.values) != count or not all(
            re.fullmatch(r'-?\d{1,10}', value) for value in self.values
        ):
            text = ' '.join(self.values)
            raise HandLinkError(f'expected {count} integers from the hand, got {text!r}')
        return tuple(int(value) for value in self.values)


def status_text(status: int) -> str:
    """The meaning of a status sum in words."""
    bits = [1 << bit for bit in range(16) if status & (1 << bit)]
    return ', '.join(STATUS_TEXTS.get(bit, f'unknown bit {bit}') for bit in bits) or 'no error'


def parse_reply(command: str, raw: bytes) -> Reply:
    """Read the bytes from the echo up to and including the prompt.

    Args:
        command: the line that was sent, without its carriage return.
        raw: everything that came back.

    Raises:
        HandRestartedError: the banner stands in it.
        HandLinkError: no prompt at the end, a wrong echo, or an ERR without a number.
    """
    if RESET_MARK in raw and command != 'VERS':
        raise HandRestartedError(f'{command}: the hand restarted (its banner came back)')
    if not raw.endswith(PROMPT):
        raise HandLinkError(f'{command}: no prompt after {raw[-40:]!r}')
    echo = command.encode('ascii')
    if not raw.startswith(echo):
        raise HandLinkError(f'{command}: echo is {raw[: len(echo)]!r}')
    body = raw[len(echo) : -len(PROMPT)]
    if not body.startswith((b'\n', b'\r')):
        raise HandLinkError(f'{command}: no line end after the echo, {body[:20]!r}')
    if any(byte not in b'\n\r' and not 0x20 <= byte < 0x7F for byte in body):
        raise HandLinkError(f'{command}: unprintable bytes in the answer {body[:40]!r}')
    words = body.decode('ascii').split()
    if words and words[0] == 'ERR':
        if len(words) != 2 or not re.fullmatch(r'\d{1,5}', words[1]) or int(words[1]) == 0:
            raise HandLinkError(f'{command}: error without a number, {body!r}')
        return Reply((), int(words[1]))
    if 'ERR' in words:
        raise HandLinkError(f'{command}: values and an error in one answer, {body!r}')
    return Reply(tuple(words))


def parse_loop_end(raw: bytes) -> int:
    """Status sum in what follows when the hand leaves RealTime mode by itself.

    Raises:
        HandRestartedError: the banner stands in it.
        HandLinkError: no ERR with a number and a prompt.
    """
    if RESET_MARK in raw:
        raise HandRestartedError('the hand restarted in RealTime mode')
    match = re.search(rb'[\n\r]+ERR (\d{1,5})[\n\r]+=> \Z', raw)
    if match is None or int(match.group(1)) == 0:
        raise HandLinkError(f'RealTime mode: neither feedback nor an error in {raw[:40]!r}')
    return int(match.group(1))


def parse_firmware(values: tuple[str, ...]) -> tuple[int, int]:
    """Main and sub-version of the firmware from the words of VERS.

    Raises:
        HandLinkError: no version number in it.
    """
    for word in reversed(values):
        match = re.fullmatch(r'[Vv]?(\d{1,2})\.(\d{1,2}).*', word)
        if match is not None:
            return int(match.group(1)), int(match.group(2)[0])
    raise HandLinkError(f'VERS: no version number in {" ".join(values)!r}')
