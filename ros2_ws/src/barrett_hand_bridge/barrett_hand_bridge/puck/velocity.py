# SPDX-License-Identifier: Apache-2.0
"""Velocities of a BH8-280: whole counts per millisecond in mode 4, with what the mode needs.

The maker's page on control modes: velocity is MODE 4 with TSTOP 0, limited to MV. With a stall
time a slow squeeze against something soft counts as a stall, and the motor goes idle. MT, the
highest motor torque, holds in every mode; HSG is documented for movement commands only. Opening is
such a command: it ends by itself, at the open target or by a stall, also when nobody watches it.
"""

from __future__ import annotations

from collections.abc import Mapping

from barrett_hand_bridge.hand import ENCODER_280, SPREAD
from barrett_hand_bridge.puck import properties
from barrett_hand_bridge.puck.homing import STALL_MS
from barrett_hand_bridge.puck.pucks import MOTORS_ALL, Pucks

# Repeated now and then, should a frame be lost.
REFRESH_CYCLES = 25
# Nothing in the parameters asks for more than one and a half times 2.5 rad/s.
FASTEST_RAD_S = 3.75
MILLISECOND_S = 1e-3


def rad_per_count(motor: int) -> float:
    """Joint travel per encoder count."""
    return (
        ENCODER_280.spread_rad_per_count if motor == SPREAD else ENCODER_280.finger_rad_per_count
    )


def speed_step_rad_s(motor: int) -> float:
    """The slowest speed of joint 2, or of the spread, and the step of all speeds."""
    return rad_per_count(motor) / MILLISECOND_S


class VelocityCommands:
    """Sends velocities where they changed, and all of them now and then."""

    def __init__(self, motor_torque: int) -> None:
        """`motor_torque`: MT of every motor that moves, in the puck's own units."""
        self._motor_torque = motor_torque
        self._sent: dict[int, int] = {}
        self._slowed: set[int] = set()

    def prepare(self, pucks: Pucks) -> None:
        """Set the limits that hold in every mode."""
        for motor in MOTORS_ALL:
            pucks.set(motor, 'MT', self._motor_torque)
            self._let_run(pucks, motor)

    def _let_run(self, pucks: Pucks, motor: int) -> None:
        pucks.set(motor, 'MV', round(FASTEST_RAD_S / speed_step_rad_s(motor)))
        self._slowed.discard(motor)

    def open(self, pucks: Pucks, speeds: Mapping[int, float]) -> None:
        """Let motors open by themselves, at speeds in rad/s."""
        for motor, speed in speeds.items():
            pucks.set(motor, 'MV', max(round(speed / speed_step_rad_s(motor)), 1))
            pucks.set(motor, 'TSTOP', STALL_MS[motor])
            pucks.set(motor, 'CMD', properties.COMMAND_OPEN)
            self._slowed.add(motor)
            self._sent.pop(motor, None)

    def forget(self) -> None:
        """What was sent no longer counts: somebody else has stopped the motors."""
        self._sent.clear()

    def send(self, pucks: Pucks, velocities: Mapping[int, float], *, refresh: bool) -> None:
        """Command velocities in rad/s by motor; those not named stand."""
        for motor in MOTORS_ALL:
            wanted = velocities.get(motor, 0.0) / speed_step_rad_s(motor)
            speed = round(wanted)
            if speed == 0 and wanted != 0.0:
                speed = 1 if wanted > 0 else -1
            before = self._sent.get(motor)
            if before == speed and not refresh:
                continue
            self._sent[motor] = speed
            if speed == 0:
                pucks.set(motor, 'MODE', properties.MODE_IDLE)
                pucks.set(motor, 'TSTOP', STALL_MS[motor])
                continue
            if motor in self._slowed:
                self._let_run(pucks, motor)
            if not before or refresh:
                pucks.set(motor, 'TSTOP', 0)
            pucks.set(motor, 'V', speed)
            if not before or refresh:
                pucks.set(motor, 'MODE', properties.MODE_VELOCITY)
