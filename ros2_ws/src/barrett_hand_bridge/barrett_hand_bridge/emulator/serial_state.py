# SPDX-License-Identifier: Apache-2.0
"""What an emulated BH8-262 is and shows, whatever is being said on its line."""

from __future__ import annotations

from barrett_hand_bridge.emulator.mechanics import SPREAD, HandMechanics
from barrett_hand_bridge.emulator.serial_parameters import (
    GLOBAL_PARAMETERS,
    MOTOR_PARAMETERS,
    MOTORS,
    Limits,
    ParameterStore,
)

NO_GAUGE = 255


class SerialState:
    """Mechanics, parameters and status of a BH8-262, and the readings they give."""

    def __init__(
        self,
        mechanics: HandMechanics,
        firmware: tuple[int, int, int],
        serial_number: int,
        sample_period_s: float,
    ) -> None:
        """A hand just switched on, its motors not initialised.

        `sample_period_s` is the servo sample to which velocities in counts per sample refer; the
        maker's value is not known here.
        """
        self.mechanics = mechanics
        self.firmware = firmware
        self.serial_number = serial_number
        self.sample_period_s = sample_period_s
        self.parameters = ParameterStore()
        self.status = dict.fromkeys(MOTORS, 0)
        self.initialised = dict.fromkeys(MOTORS, False)
        self.temperature_c = 31.5
        # The positions that the host has been told: deltas count from there.
        self.reported = dict.fromkeys(MOTORS, 0)
        self.switched_on_s = mechanics.time_s

    def motor_limits(self, name: str) -> Limits | None:
        """Limits of a motor parameter; None where this firmware does not know it."""
        limits = MOTOR_PARAMETERS.get(name)
        return None if limits is None or self.firmware[:2] < limits.since else limits

    def strain(self, motor: int) -> int:
        """What SG shows: the reading, flipped when SGFLIP is set; the spread has no gauge."""
        if motor == SPREAD:
            return NO_GAUGE
        counts = self.mechanics.gauges[motor].counts
        return 255 - counts if self.parameters.motor[motor]['SGFLIP'] else counts

    def velocity(self, motor: int, counts_per_sample: float) -> float:
        """Counts per second from counts per servo sample."""
        return counts_per_sample / self.sample_period_s

    def report_position(self, motor: int) -> int:
        """The position in counts, of which the host then knows."""
        self.reported[motor] = self.mechanics.encoder_counts(motor)
        return self.reported[motor]

    def motor_value(self, motor: int, name: str) -> int:
        """What FGET shows of a motor: a reading, or a parameter as set."""
        broken_at = self.mechanics.breakaway_counts.get(motor)
        if name == 'P':
            return self.report_position(motor)
        if name == 'SG':
            return self.strain(motor)
        if name == 'S':
            return self.status[motor]
        if name == 'BD':
            return int(broken_at is not None)
        if name == 'BP':
            return 0 if broken_at is None else int(broken_at)
        if name == 'OD':
            return int(self.mechanics.motors[motor].position / 1000)
        return self.parameters.motor[motor][name]

    def global_value(self, name: str) -> int:
        """What PGET shows: a reading, or a parameter as set."""
        readings = {
            'TEMP': int(self.temperature_c * 10),
            'PTEMP': int(self.temperature_c * 10),
            'UPSECS': int(self.mechanics.time_s - self.switched_on_s),
            'SN': self.serial_number,
        }
        return readings.get(name, self.parameters.hand.get(name, 0))

    def motor_listing(self, motors: tuple[int, ...], *, values: bool) -> list[int | str]:
        """Names of all motor parameters, each followed by its value per motor if wanted."""
        listing: list[int | str] = []
        for name in filter(self.motor_limits, MOTOR_PARAMETERS):
            listing.append(name)
            if values:
                listing += [self.motor_value(motor, name) for motor in motors]
        return listing

    def global_listing(self, *, values: bool) -> list[int | str]:
        """Names of all parameters of the hand as a whole, each with its value if wanted."""
        listing: list[int | str] = []
        for name in GLOBAL_PARAMETERS:
            listing.append(name)
            if values:
                listing.append(self.global_value(name))
        return listing
