"""What FGET shows of one motor of an emulated BH8-262: readings, and parameters as set."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barrett_hand_bridge.emulator.serial_hand import SerialHand


def motor_value(hand: SerialHand, motor: int, name: str) -> int:
    """The value of a motor parameter now."""
    mechanics = hand.mechanics
    broken_at = mechanics.breakaway_counts.get(motor)
    if name == 'P':
        return mechanics.encoder_counts(motor)
    if name == 'SG':
        return hand.strain(motor)
    if name == 'S':
        return hand.status[motor]
    if name == 'BD':
        return int(broken_at is not None)
    if name == 'BP':
        return 0 if broken_at is None else int(broken_at)
    if name == 'OD':
        return int(mechanics.motors[motor].position / 1000)
    return hand.parameters.motor[motor][name]
