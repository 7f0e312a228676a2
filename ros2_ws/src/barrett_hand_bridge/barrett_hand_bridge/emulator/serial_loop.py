# SPDX-License-Identifier: Apache-2.0
"""RealTime mode of an emulated BH8-262: control blocks in, feedback blocks out.

BH8-series manual for firmware 4.3x, section 6 (worked example on page 41); temperature size after
the manuals of both firmwares: two signed bytes up to 4.3x, one unsigned byte from 4.4 on.
"""

from __future__ import annotations

from barrett_hand_bridge.emulator.mechanics import SPREAD
from barrett_hand_bridge.emulator.serial_state import SerialState

INVALID_HEADER = 2048


class LoopSession:
    """One stay in RealTime mode; the block structure is fixed by the flags at its start."""

    def __init__(self, hand: SerialState, motors: tuple[int, ...]) -> None:
        """Fix the layout for `motors` from the hand's present parameters."""
        self._hand = hand
        self._motors = motors
        self._parameters = {motor: dict(hand.parameters.motor[motor]) for motor in motors}
        self._temperature = bool(hand.parameters.hand['LFT'])
        self._discard = bool(hand.parameters.hand['LFDPD'])
        self._header: int | None = None
        self._data = bytearray()
        self._control_bytes = 0
        for own in self._parameters.values():
            self._control_bytes += own['LCV'] + own['LCPG'] + 2 * own['LCT']

    def take_byte(self, byte: int, output: bytearray) -> int:
        """Take one byte from the host; returns 0, or the status that ends the loop."""
        if self._header is None:
            if byte not in b'CcAa':
                return INVALID_HEADER
            self._header = byte
            if byte in b'CA':
                self._append_feedback(output)
            else:
                output += b'*'
            if byte in b'Aa' or self._control_bytes == 0:
                self._header = None
            return 0
        self._data.append(byte)
        if len(self._data) == self._control_bytes:
            self._obey(bytes(self._data))
            self._header = None
            self._data.clear()
        return 0

    def _obey(self, data: bytes) -> None:
        at = 0
        for motor in self._motors:
            own = self._parameters[motor]
            state = self._hand.mechanics.motors[motor]
            if own['LCV']:
                signed = data[at] - 256 if data[at] > 127 else data[at]
                # Eight bits with four behind the point, times the coefficient.
                speed = signed / 16.0 * own['LCVC']
                at += 1
                if speed == 0.0:
                    state.stop()
                else:
                    state.drive(self._hand.velocity(motor, speed))
            at += own['LCPG'] + 2 * own['LCT']

    def _append_feedback(self, output: bytearray) -> None:
        hand = self._hand
        output += b'*'
        for motor in self._motors:
            own = self._parameters[motor]
            position = hand.mechanics.encoder_counts(motor)
            if own['LFV']:
                state = hand.mechanics.motors[motor]
                speed = state.velocity * hand.sample_period_s / max(own['LFVC'], 1)
                output.append(_clip(int(speed)) & 0xFF)
            if own['LFS']:
                output.append(hand.strain(motor))
            before = hand.reported[motor]
            if own['LFAP']:
                output += hand.report_position(motor).to_bytes(2, 'big')
            if own['LFDP']:
                divisor = max(own['LFDPC'], 1)
                delta = _clip(int((position - before) / divisor))
                output.append(delta & 0xFF)
                if not (own['LFAP'] or self._discard):
                    position = before + delta * divisor
                hand.reported[motor] = position
            if own['LFBP']:
                broken_at = None if motor == SPREAD else hand.mechanics.breakaway_counts.get(motor)
                output += int(broken_at or 0).to_bytes(2, 'big')
            if own['LFAIN']:
                output.append(0)
        if self._temperature:
            if hand.firmware < (4, 4, 0):
                output += int(hand.temperature_c * 10).to_bytes(2, 'big', signed=True)
            else:
                output.append(int(hand.temperature_c))


def _clip(value: int) -> int:
    return min(max(value, -128), 127)
