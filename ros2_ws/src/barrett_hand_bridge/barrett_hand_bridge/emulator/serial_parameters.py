# SPDX-License-Identifier: Apache-2.0
"""Parameters of an emulated BH8-262: names, limits, defaults (manuals for firmware 4.3x, 4.4).

Where the known pages of the manuals give no range or default, the value here is this emulator's
own choice: LSG, ACCEL, CT, OT, DP, DS, HOLD, TSTOP, MPE, IVEL, IOFF, EN, SGFLIP, LCT, LFBP, LFAIN.
"""

from __future__ import annotations

from dataclasses import dataclass

MOTORS = (1, 2, 3, 4)


@dataclass(frozen=True)
class Limits:
    """Range and start value of one parameter, and the first firmware that has it.

    A parameter that only reads has no start value.
    """

    lowest: int
    highest: int
    start: int = 0
    start_spread: int | None = None
    read_only: bool = False
    since: tuple[int, int] = (0, 0)


FIRMWARE_4_4 = (4, 4)


def _flag(start: int, since: tuple[int, int] = (0, 0)) -> Limits:
    return Limits(0, 1, start, since=since)


MOTOR_PARAMETERS: dict[str, Limits] = {
    'P': Limits(0, 17800, read_only=True),
    'SG': Limits(0, 255, read_only=True),
    'S': Limits(0, 65535, read_only=True),
    'BD': Limits(0, 1, read_only=True),
    'BP': Limits(0, 20000, read_only=True),
    'OD': Limits(0, 4_000_000_000, read_only=True),
    'HSG': Limits(0, 256, 256),
    'LSG': Limits(0, 256, 0),
    'MCV': Limits(16, 4080, 100, 60),
    'MOV': Limits(16, 4080, 100, 60),
    'IVEL': Limits(16, 4080, 100, 60),
    'ACCEL': Limits(1, 10, 4, 2),
    'CT': Limits(0, 20000, 17500, 3150),
    'OT': Limits(0, 20000, 0),
    'DP': Limits(0, 20000, 4500, 1575),
    'DS': Limits(0, 20000, 1000, 300),
    'HOLD': Limits(0, 1, 0, 1),
    'TSTOP': Limits(0, 10000, 50, 150),
    'MPE': Limits(0, 20000, 50, 25),
    'IOFF': Limits(0, 20000, 0),
    'EN': _flag(1),
    'SGFLIP': _flag(0),
    'LCV': _flag(1),
    'LCVC': Limits(0, 255, 1),
    'LCPG': _flag(1),
    'LCT': _flag(0, FIRMWARE_4_4),
    'LFV': _flag(1),
    'LFVC': Limits(0, 255, 1),
    'LFS': _flag(1),
    'LFAP': _flag(1),
    'LFDP': _flag(1),
    'LFDPC': Limits(0, 255, 1),
    'LFBP': _flag(0, FIRMWARE_4_4),
    'LFAIN': _flag(0, FIRMWARE_4_4),
}
ALIASES = {'MSG': 'HSG'}

GLOBAL_PARAMETERS: dict[str, Limits] = {
    'BAUD': Limits(6, 384, 96),
    'TEMP': Limits(0, 1250, read_only=True),
    'PTEMP': Limits(0, 1250, read_only=True),
    'OTEMP': Limits(0, 1250, 560),
    'UPSECS': Limits(0, 4_000_000_000, read_only=True),
    'SN': Limits(0, 4_000_000_000, read_only=True),
    'LFT': _flag(0),
    'LFDPD': _flag(0),
}
BAUD_CODES = (6, 12, 24, 48, 96, 192, 384)


class ParameterStore:
    """The writable parameters of all motors and of the hand."""

    def __init__(self) -> None:
        """Start values everywhere."""
        self.motor: dict[int, dict[str, int]] = {motor: {} for motor in MOTORS}
        self.hand: dict[str, int] = {}
        for motor in MOTORS:
            self.restore_motor(motor)
        self.restore_hand()

    def restore_motor(self, motor: int) -> None:
        """Back to the start values of one motor."""
        for name, limits in MOTOR_PARAMETERS.items():
            if not limits.read_only:
                spread = motor == 4 and limits.start_spread is not None
                self.motor[motor][name] = (limits.start_spread or 0) if spread else limits.start

    def restore_hand(self) -> None:
        """Back to the start values of the hand as a whole, the line speed excepted."""
        for name, limits in GLOBAL_PARAMETERS.items():
            if not limits.read_only:
                self.hand[name] = self.hand.get(name, 96) if name == 'BAUD' else limits.start
