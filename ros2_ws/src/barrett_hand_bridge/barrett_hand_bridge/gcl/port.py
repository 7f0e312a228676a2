# SPDX-License-Identifier: Apache-2.0
"""Serial ports: the part of pyserial that is used, opening one, and finding it again by name."""

from __future__ import annotations

import contextlib
import grp
import os
from pathlib import Path
from typing import Protocol

import serial

from barrett_hand_bridge.hand import HandError

BY_ID = Path('/dev/serial/by-id')


class Port(Protocol):
    """The part of a pyserial port that is used here."""

    baudrate: int
    timeout: float | None

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes, waiting at most `timeout` seconds."""

    def write(self, data: bytes, /) -> int | None:
        """Send bytes."""

    def fileno(self) -> int:
        """File descriptor of the open port."""

    def close(self) -> None:
        """Let go of the port."""


def open_port(name: str) -> Port:
    """Open a serial port as the hand expects it after power-up: 9600 baud, 8N1, no handshake.

    A USB adapter is told to pass every byte on at once: by itself it waits up to 16 ms.

    Raises:
        HandError: the port does not exist, is in use, or may not be opened.
    """
    try:
        port = serial.Serial(name, 9600, timeout=1.0, write_timeout=5.0, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        raise HandError(
            f'serial port {name!r} cannot be opened ({error}): {_way_out(name)}'
        ) from error
    with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
        # Not every port has a latency to set: a pty has none.
        port.set_low_latency_mode(True)
    return port


def _way_out(name: str) -> str:
    """What to do about a port that cannot be opened."""
    path = Path(name)
    if not path.exists():
        known = sorted(str(link) for link in BY_ID.glob('*')) if BY_ID.is_dir() else []
        seen = f'there are {", ".join(known)}' if known else 'no USB adapter is plugged in'
        return f'it does not exist; {seen} (names in {BY_ID} stay when one is plugged in again)'
    if not os.access(path, os.R_OK | os.W_OK):
        try:
            group = grp.getgrgid(path.stat().st_gid).gr_name
        except (KeyError, OSError):
            group = 'dialout'
        return (
            f'this user may not use it: "sudo usermod -aG {group} $USER", log in again; or a udev '
            'rule with MODE="0660", TAG+="uaccess"'
        )
    return 'another program may hold it; check parameter port and the cable'


class PortName:
    """The name of a port, found again when its adapter comes back under another one.

    An adapter that is pulled out and plugged in again may become ttyUSB1 instead of ttyUSB0; its
    link in /dev/serial/by-id stays the same.
    """

    def __init__(self, name: str, by_id: Path = BY_ID) -> None:
        """`name` as the user gave it."""
        self._name = name
        self._folder = by_id
        self._link: Path | None = None

    def now(self) -> str:
        """The name to open now: that of the adapter that was there first."""
        if self._link is None and Path(self._name).exists() and self._folder.is_dir():
            device = Path(self._name).resolve()
            links = (link for link in sorted(self._folder.iterdir()) if link.resolve() == device)
            self._link = next(links, None)
        return self._name if self._link is None else str(self._link)
