# SPDX-License-Identifier: Apache-2.0
"""RealTime mode of a serial BarrettHand: size and content of its blocks (pure functions).

BH8-series manual for firmware 4.3x, section 6; BH8-262 manual for firmware 4.4, section 6.
The wire has no checksum: ranges are all that tells a wrong block from a right one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

HEADER_CONTROL_FEEDBACK = b'C'
HEADER_CONTROL = b'c'
HEADER_FEEDBACK = b'A'
HEADER_NOTHING = b'a'
ACKNOWLEDGE = 0x2A

HIGHEST_FINGER_COUNTS = 17800
HIGHEST_SPREAD_COUNTS = 3200
LOWEST_COUNTS = -50
SPREAD = 4
FIRMWARE_4_4 = (4, 4)
# What a block may bring: gauge reading, position or its change, where the clutch let go, heat.
FEEDBACK = ('strain', 'position', 'delta', 'breakaway', 'temperature')


class BlockError(ValueError):
    """A feedback block that cannot be right."""


@dataclass(frozen=True)
class MotorBlock:
    """What one motor's part of the blocks holds (the LC… and LF… flags of the hand)."""

    velocity_command: bool = False
    gain_command: bool = False
    torque_command: bool = False
    velocity: bool = False
    strain: bool = False
    position: bool = False
    delta: bool = False
    breakaway: bool = False
    analogue: bool = False

    @property
    def control_bytes(self) -> int:
        """Bytes of this motor in a control block."""
        return self.velocity_command + self.gain_command + 2 * self.torque_command

    @property
    def feedback_bytes(self) -> int:
        """Bytes of this motor in a feedback block."""
        return (
            self.velocity
            + self.strain
            + 2 * self.position
            + self.delta
            + 2 * self.breakaway
            + self.analogue
        )

    def parameters(self, firmware: tuple[int, int]) -> dict[str, int]:
        """The flags as the hand's own parameters, as far as its firmware knows them.

        Raises:
            ValueError: a flag is wanted that the firmware does not have.
        """
        flags = {
            'LCV': self.velocity_command,
            'LCPG': self.gain_command,
            'LFV': self.velocity,
            'LFS': self.strain,
            'LFAP': self.position,
            'LFDP': self.delta,
        }
        newer = {'LCT': self.torque_command, 'LFBP': self.breakaway, 'LFAIN': self.analogue}
        if firmware >= FIRMWARE_4_4:
            flags |= newer
        elif any(newer.values()):
            raise ValueError(
                'torque commands, breakaway and analogue feedback need firmware 4.4, this hand '
                f'has {firmware[0]}.{firmware[1]}'
            )
        return {name: int(flag) for name, flag in flags.items()}


@dataclass(frozen=True)
class MotorFeedback:
    """One motor's part of a feedback block; None where the layout leaves it out."""

    velocity: int | None = None
    strain: int | None = None
    position: int | None = None
    delta: int | None = None
    breakaway: int | None = None
    analogue: int | None = None


@dataclass(frozen=True)
class Feedback:
    """A feedback block: motors by number, temperature in degrees Celsius if sent."""

    motors: Mapping[int, MotorFeedback]
    temperature_c: float | None = None


@dataclass(frozen=True)
class Layout:
    """The structure of control and feedback blocks, fixed when RealTime mode is entered.

    `temperature_bytes` is 2 (signed, 0.1 degree) for firmware 4.3x, 1 (unsigned, degrees) from
    4.4 on: the two manuals differ.
    """

    motors: Mapping[int, MotorBlock] = field(default_factory=dict)
    temperature_bytes: int = 0
    velocity_coefficient: int = 1

    @property
    def highest_velocity(self) -> float:
        """Fastest command in counts per servo sample that fits into its byte."""
        return 127 / 16.0 * self.velocity_coefficient

    @property
    def control_bytes(self) -> int:
        """Size of a control block with its header."""
        return 1 + sum(block.control_bytes for block in self.motors.values())

    @property
    def feedback_bytes(self) -> int:
        """Size of a feedback block with its acknowledge byte."""
        return (
            1
            + sum(block.feedback_bytes for block in self.motors.values())
            + self.temperature_bytes
        )


def layout_for(
    feedback: Sequence[str] = ('strain', 'position'), *, velocity_coefficient: int = 8
) -> Layout:
    """Velocity commands for all motors, and of `FEEDBACK` what is wanted.

    The temperature is left to the firmware's `temperature_bytes`.

    Raises:
        ValueError: an unknown word, or neither `position` nor `delta`.
    """
    unknown = [name for name in feedback if name not in FEEDBACK]
    if unknown:
        raise ValueError(f'feedback {unknown[0]!r}: the hand sends {", ".join(FEEDBACK)}')
    if ('position' in feedback) == ('delta' in feedback):
        raise ValueError(f'feedback {list(feedback)}: needs either position or delta')
    where = {'position': 'position' in feedback, 'delta': 'delta' in feedback}
    finger = MotorBlock(
        velocity_command=True,
        strain='strain' in feedback,
        breakaway='breakaway' in feedback,
        **where,
    )
    spread = MotorBlock(velocity_command=True, **where)
    return Layout(
        {1: finger, 2: finger, 3: finger, SPREAD: spread},
        velocity_coefficient=velocity_coefficient,
    )


def temperature_bytes(firmware: tuple[int, int]) -> int:
    """Size of the temperature in a block: the manuals of 4.3x and 4.4 differ."""
    return 1 if firmware >= FIRMWARE_4_4 else 2


def encode_control(layout: Layout, velocities: Mapping[int, float]) -> bytes:
    """Header and velocity commands in counts per servo sample; motors left out stand still.

    Each is sent as a signed byte with four bits behind the point, to be multiplied by the
    coefficient LCVC.

    Raises:
        ValueError: a velocity that does not fit, or a layout with gain or torque commands.
    """
    data = bytearray(HEADER_CONTROL_FEEDBACK)
    for motor in sorted(layout.motors):
        block = layout.motors[motor]
        if block.gain_command or block.torque_command:
            raise ValueError('this driver commands velocities only (LCPG and LCT must be off)')
        if block.velocity_command:
            raw = round(velocities.get(motor, 0.0) * 16.0 / layout.velocity_coefficient)
            if not -127 <= raw <= 127:
                raise ValueError(
                    f'motor {motor}: velocity {velocities[motor]:g} counts per sample beyond '
                    f'+-{layout.highest_velocity:g}'
                )
            # 3 is Ctrl-C, which ends RealTime mode even in the middle of a block.
            data.append((2 if raw == 3 else raw) & 0xFF)
    return bytes(data)


def check_position(motor: int, name: str, counts: int) -> None:
    """Refuse a position that no motor can stand at.

    Raises:
        BlockError: it lies beyond the mechanical stops.
    """
    highest = HIGHEST_SPREAD_COUNTS if motor == SPREAD else HIGHEST_FINGER_COUNTS
    if not LOWEST_COUNTS <= counts <= highest:
        raise BlockError(f'motor {motor}: {name} {counts} beyond {highest}')


def decode_feedback(layout: Layout, data: bytes) -> Feedback:
    """Read one feedback block, acknowledge byte included.

    Raises:
        BlockError: wrong size, no acknowledge byte, or a position beyond the mechanical stops.
    """
    if len(data) != layout.feedback_bytes:
        raise BlockError(f'feedback block of {len(data)} bytes, expected {layout.feedback_bytes}')
    if data[0] != ACKNOWLEDGE:
        raise BlockError(f'feedback block starts with {data[0]:#04x}, expected 0x2a')
    at = 1
    motors: dict[int, MotorFeedback] = {}
    for motor in sorted(layout.motors):
        block = layout.motors[motor]
        values: dict[str, int] = {}
        for name, present, size, signed in (
            ('velocity', block.velocity, 1, True),
            ('strain', block.strain, 1, False),
            ('position', block.position, 2, False),
            ('delta', block.delta, 1, True),
            ('breakaway', block.breakaway, 2, False),
            ('analogue', block.analogue, 1, False),
        ):
            if present:
                values[name] = int.from_bytes(data[at : at + size], 'big', signed=signed)
                at += size
        for name in ('position', 'breakaway'):
            check_position(motor, name, values.get(name, 0))
        motors[motor] = MotorFeedback(**values)
    temperature: float | None = None
    if layout.temperature_bytes == 1:
        temperature = float(data[at])
    elif layout.temperature_bytes == 2:
        temperature = int.from_bytes(data[at : at + 2], 'big', signed=True) / 10.0
    return Feedback(motors, temperature)
