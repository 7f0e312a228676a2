# SPDX-License-Identifier: Apache-2.0
"""CAN frames of the Puck 2 motor controllers: identifiers, properties, positions, touch cells.

Facts after the maker's and four other open drivers (property sets, identifiers, packing); pure
functions. 11-bit identifiers: bit 10 says that the destination is a group, bits 9 to 5 are the
sender, bits 4 to 0 the destination.
"""

from __future__ import annotations

from dataclasses import dataclass

HOST = 0
NODES = (11, 12, 13, 14)
GROUP_HAND = 5
GROUP_PROPERTY = 6
GROUP_POSITION = 3
GROUP_TOP_10 = 8
GROUP_FULL = 9
GROUP_FLAG = 0x400

CELLS = 24
FULL_FRAMES = 5
CELLS_PER_FRAME = 5


class FrameError(ValueError):
    """A frame that cannot be right; the message says what it holds."""


@dataclass(frozen=True)
class Frame:
    """An identifier (11 bits) and up to 8 bytes."""

    identifier: int
    data: bytes


@dataclass(frozen=True)
class Address:
    """Who sends to whom; `group` when the destination is a group of nodes."""

    sender: int
    destination: int
    group: bool


@dataclass(frozen=True)
class HandAddresses:
    """Where the motors of one hand are on its bus: their nodes, and the group of all four."""

    nodes: tuple[int, int, int, int] = NODES
    group: int = GROUP_HAND

    def node(self, motor: int) -> int:
        """The node of motor 1 to 4."""
        return self.nodes[motor - 1]

    def motor(self, node: int) -> int | None:
        """The motor at a node; None for a node of somebody else."""
        return self.nodes.index(node) + 1 if node in self.nodes else None


def encode_address(address: Address) -> int:
    """Address to identifier.

    Raises:
        FrameError: sender or destination does not fit into five bits.
    """
    if not 0 <= address.sender < 32 or not 0 <= address.destination < 32:
        raise FrameError(f'node numbers are 0 to 31, got {address}')
    return (GROUP_FLAG if address.group else 0) | address.sender << 5 | address.destination


def decode_address(identifier: int) -> Address:
    """Identifier to address.

    Raises:
        FrameError: not an 11-bit identifier.
    """
    if not 0 <= identifier < 0x800:
        raise FrameError(f'identifier {identifier:#x} has more than 11 bits')
    return Address(identifier >> 5 & 0x1F, identifier & 0x1F, bool(identifier & GROUP_FLAG))


def get_frame(destination: int, number: int, *, group: bool = False) -> Frame:
    """Ask a node or a group for a property by number."""
    return Frame(encode_address(Address(HOST, destination, group)), bytes((number & 0x7F,)))


def set_frame(
    destination: int, number: int, value: int, *, wide: bool = False, group: bool = False
) -> Frame:
    """Set a property; `wide` properties have 32 bits, the others 16.

    Raises:
        FrameError: the value does not fit.
    """
    size = 4 if wide else 2
    try:
        payload = value.to_bytes(size, 'little', signed=True)
    except OverflowError:
        raise FrameError(f'property {number}: {value} does not fit into {size} bytes') from None
    identifier = encode_address(Address(HOST, destination, group))
    return Frame(identifier, bytes((number & 0x7F | 0x80, 0)) + payload)


def decode_property(data: bytes) -> tuple[int, int]:
    """Number and value of an ordinary property reply.

    Raises:
        FrameError: neither 4 nor 6 bytes, or not marked as a value.
    """
    if len(data) not in (4, 6) or not data[0] & 0x80 or data[1] != 0:
        raise FrameError(f'property reply {data.hex()}: expected xx 00 and 2 or 4 bytes')
    return data[0] & 0x7F, int.from_bytes(data[2:], 'little', signed=True)


def decode_position(data: bytes) -> tuple[int, int | None]:
    """Motor counts and, where the node has one, inner-link encoder counts.

    Each is a signed number of 22 bits, most significant first, in three bytes.

    Raises:
        FrameError: neither 3 nor 6 bytes, or without the mark in the first one.
    """
    if len(data) not in (3, 6) or not data[0] & 0x80:
        raise FrameError(f'position reply {data.hex()}: expected 3 or 6 bytes, first with bit 7')
    values = []
    for at in range(0, len(data), 3):
        raw = (data[at] & 0x3F) << 16 | data[at + 1] << 8 | data[at + 2]
        values.append(raw - (1 << 22) if raw & 1 << 21 else raw)
    return values[0], values[1] if len(values) == 2 else None


def decode_full_frame(data: bytes) -> tuple[int, tuple[float, ...]]:
    """Frame number 0 to 4 and its pressures in N/cm2 (five, four in the last frame).

    Raises:
        FrameError: not 8 bytes, or a frame number above 4.
    """
    if len(data) != 8 or data[0] >> 4 >= FULL_FRAMES:
        raise FrameError(f'touch frame {data.hex()}: expected 8 bytes and a number below 5')
    number = data[0] >> 4
    bits = int.from_bytes(data, 'big')
    count = CELLS_PER_FRAME if number < FULL_FRAMES - 1 else CELLS - CELLS_PER_FRAME * number
    values = [(bits >> (48 - 12 * i) & 0xFFF) / 256.0 for i in range(count)]
    return number, tuple(values)


def decode_top_10(data: bytes) -> tuple[float, ...]:
    """Pressures of all 24 cells in N/cm2 from the ten strongest; the others are 0.

    Raises:
        FrameError: not 8 bytes, or more than ten cells marked.
    """
    if len(data) != 8:
        raise FrameError(f'touch frame {data.hex()}: expected 8 bytes')
    bits = int.from_bytes(data, 'big')
    marked = [cell for cell in range(CELLS) if bits >> (63 - cell) & 1]
    if len(marked) > 10:
        raise FrameError(f'touch frame {data.hex()}: {len(marked)} cells marked, at most 10')
    pressures = [0.0] * CELLS
    for place, cell in enumerate(marked):
        pressures[cell] = float(bits >> (36 - 4 * place) & 0xF)
    return tuple(pressures)
