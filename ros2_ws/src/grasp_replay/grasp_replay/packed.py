# SPDX-License-Identifier: Apache-2.0
"""Messages that were compressed one by one, as rosbag2's compression mode `message` does.

The mode stands in metadata.yaml, which may be lost. The bytes tell it as well: CDR begins with a
zero byte, a compressed frame with a number of its format.
"""

from __future__ import annotations

import lz4.frame

from grasp_replay.mcap_blocks import COMPRESSION_ERRORS, Damage, unpack_frames, zstd

ZSTD, LZ4 = b'\x28\xb5\x2f\xfd', b'\x04\x22\x4d\x18'
LARGEST_MESSAGE = 2**30
"""A message of more bytes than that is not unpacked: memory is not given on its word."""


def is_packed(data: bytes | memoryview) -> bool:
    """Does a message begin as a compressed frame?"""
    return bytes(data[:4]) in (ZSTD, LZ4)


def unpacked(data: bytes) -> bytes:
    """A message without its compression; raises Damage."""
    kind = lz4.frame.LZ4FrameDecompressor if data[:4] == LZ4 else zstd.ZstdDecompressor
    try:
        found = unpack_frames(kind, data, LARGEST_MESSAGE)
    except COMPRESSION_ERRORS as error:
        raise Damage(f'a message does not decompress ({error})') from error
    if len(found) > LARGEST_MESSAGE:
        raise Damage(f'a message of {len(data)} bytes unpacks to more than {LARGEST_MESSAGE}')
    return found
