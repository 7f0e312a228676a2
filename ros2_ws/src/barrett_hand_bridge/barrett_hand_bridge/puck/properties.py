# SPDX-License-Identifier: Apache-2.0
"""Property numbers of the Puck 2: they depend on the firmware, so VERS is read first."""

from __future__ import annotations

VERS = 0

# Firmware 175 and later.
NUMBERS: dict[str, int] = {
    'VERS': 0, 'ROLE': 1, 'SN': 2, 'ID': 3, 'ERROR': 4, 'STAT': 5, 'ADDR': 6, 'VALUE': 7,
    'MODE': 8, 'TEMP': 9, 'PTEMP': 10, 'OTEMP': 11, 'BAUD': 12, 'LOCK': 13, 'THERM': 20,
    'VBUS': 21, 'IMOTOR': 22, 'VLOGIC': 23, 'ILOGIC': 24, 'SG': 25, 'GRPA': 26, 'GRPB': 27,
    'GRPC': 28, 'CMD': 29, 'SAVE': 30, 'LOAD': 31, 'DEF': 32, 'FIND': 33, 'T': 42, 'MT': 43,
    'V': 44, 'MV': 45, 'MCV': 46, 'MOV': 47, 'P': 48, 'DP': 50, 'E': 52, 'OT': 54, 'CT': 56,
    'M': 58, 'DS': 60, 'MOFST': 61, 'IOFST': 62, 'UPSECS': 63, 'OD': 64, 'MDS': 65, 'MECH': 66,
    'CTS': 68, 'PIDX': 70, 'HSG': 71, 'LSG': 72, 'IVEL': 73, 'IOFF': 74, 'MPE': 76, 'HOLD': 77,
    'TSTOP': 78, 'KP': 79, 'KD': 80, 'KI': 81, 'ACCEL': 82, 'TENST': 83, 'TENSO': 84, 'JIDX': 85,
    'IPNM': 86, 'HALLS': 87, 'HALLH': 88, 'POLES': 90, 'IKP': 91, 'IKI': 92, 'IKCOR': 93,
    'EN': 94, 'JP': 96, 'JOFST': 98, 'TIE': 100, 'ECMAX': 101, 'ECMIN': 102, 'LFLAGS': 103,
    'LCTC': 104, 'LCVC': 105, 'TACT': 106, 'TACTID': 107, 'IHIT': 108,
}  # fmt: skip
WIDE = {48, 50, 52, 54, 56, 58, 66, 68, 74, 88, 96, 98}

OLDEST_GAUGE = 61
OLDEST_INNER_ENCODER = 125
OLDEST_TOUCH = 142
OLDEST_TOUCH_IDENTITY = 145
# The strain limit is there earlier, but open drivers set it only from here on.
OLDEST_STRAIN_LIMIT = 182

MODE_IDLE = 0
MODE_PID = 3
MODE_VELOCITY = 4
COMMAND_INITIALISE = 13
COMMAND_OPEN = 20
STATUS_RESET = 0
STATUS_READY = 2
ROLE_PRODUCT = 0x1F
ROLE_HAND = 5
ROLE_GAUGE = 0x0800
ROLE_TOUCH = 0x1000
TOUCH_FAILED = -2
TOUCH_NONE, TOUCH_TOP_10, TOUCH_FULL, TOUCH_TARE = 0, 1, 2, 3

# Beyond these readings the finger relieves itself, whatever is commanded (about 1.14 N m).
SELF_PRESERVATION_COUNTS = (667, 3460)


class PropertyError(ValueError):
    """A property that this firmware does not have; the message names both."""


def number(name: str, firmware: int) -> int:
    """Number of a property in a firmware.

    Raises:
        PropertyError: unknown name, or a firmware without it.
    """
    if name not in NUMBERS:
        raise PropertyError(f'property {name} is not known')
    oldest = {
        'SG': OLDEST_GAUGE,
        'JP': OLDEST_INNER_ENCODER,
        'JOFST': OLDEST_INNER_ENCODER,
        'TACT': OLDEST_TOUCH,
        'TACTID': OLDEST_TOUCH_IDENTITY,
        'HSG': OLDEST_STRAIN_LIMIT,
    }.get(name, 0)
    if firmware < oldest:
        raise PropertyError(
            f'property {name} needs firmware {oldest} or later, this puck has {firmware}'
        )
    if 65 <= firmware <= 131:
        swapped = {'HOLD': 94, 'EN': 77}
        if name in swapped:
            return swapped[name]
    return NUMBERS[name]


def is_wide(property_number: int) -> bool:
    """Whether a property has 32 bits."""
    return property_number in WIDE
