# SPDX-License-Identifier: Apache-2.0
"""Opening a CAN bus by any interface that python-can knows."""

from __future__ import annotations

import can

from barrett_hand_bridge.hand import HandError


def open_bus(interface: str, channel: str, port: int = 43113) -> can.BusABC:
    """Open a bus by any interface that python-can knows, at 1 Mbit/s where it has a speed.

    Raises:
        HandError: it cannot be opened.
    """
    options: dict[str, object] = {'interface': interface, 'channel': channel}
    if interface == 'udp_multicast':
        # One group and port per hand; no hop: nothing leaves this machine.
        options |= {'port': port, 'hop_limit': 0}
    elif interface == 'slcan':
        options |= {'bitrate': 1_000_000, 'sleep_after_open': 0.1}
    elif interface not in ('socketcan', 'virtual'):
        options['bitrate'] = 1_000_000
    try:
        return can.Bus(**options)  # type: ignore[arg-type]
    except Exception as error:
        # Every interface of python-can fails in its own way.
        raise HandError(
            f'CAN channel {channel!r} of interface {interface!r} cannot be opened ({error})'
        ) from error
