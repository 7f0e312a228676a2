# SPDX-License-Identifier: Apache-2.0
"""The little of CDR that needs no type: the stamp at the front of a message with a header."""

from __future__ import annotations

import struct

from grasp_replay.errors import BagError
from grasp_replay.ros_types import definition_of


def has_header(type_name: str) -> bool:
    """Does a message of this type begin with a `std_msgs/Header`?"""
    for line in definition_of(type_name)[0].splitlines():
        if line.strip() and not line.lstrip().startswith('#'):
            return line.startswith(('std_msgs/Header ', 'std_msgs/msg/Header '))
    return False


def header_stamp(data: bytes) -> int:
    """The stamp (ns) of a stored message whose first field is a `std_msgs/Header`.

    Raises BagError when the message is too short to have one.
    """
    if len(data) < 12:
        raise BagError(f'a message of {len(data)} bytes has no header stamp')
    order = '<' if data[1] & 1 else '>'
    seconds, nanoseconds = struct.unpack_from(f'{order}iI', data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
