# SPDX-License-Identifier: Apache-2.0
"""A motion to the newest of the positions that a controller streams."""

from __future__ import annotations

import math
from collections.abc import Mapping

from barrett_hand_bridge.motion import MotionResult, StallWatch, joint_position, met_limit
from barrett_hand_bridge.observer import Observation

NEAR_RAD = math.radians(25.0)
"""Streamed positions begin within this of where the hand stands."""

SETTLED_S = 0.5
"""A position that has not changed for so long is the last one."""


def far_from_hand(observation: Observation, wanted: Mapping[int, float]) -> str:
    """Why a hand that stands still does not set off to `wanted` (rad by motor); '' if it may."""
    for motor, position in wanted.items():
        way = abs(position - joint_position(observation, motor))
        if way > NEAR_RAD:
            return (
                f'motor {motor} stands {math.degrees(way):.1f} degrees from its first command, '
                f'{math.degrees(NEAR_RAD):g} are allowed: activate the controller anew, or send '
                'a trajectory'
            )
    return ''


class Tracking:
    """Goes where it is aimed at, again and again; ends where it stands there for a while."""

    def __init__(
        self,
        wanted: Mapping[int, float],
        *,
        fastest_rad_s: float,
        torque_limit_nm: float,
        gain_per_s: float = 10.0,
        tolerance_rad: float = math.radians(0.3),
    ) -> None:
        """Aim at `wanted`, positions in rad by motor."""
        self._fastest, self._torque_limit = fastest_rad_s, torque_limit_nm
        self._gain, self._tolerance = gain_per_s, tolerance_rad
        self._watch = StallWatch()
        self._since_s = math.inf
        self._seen: Mapping[int, float] = {}
        self.arrived: Mapping[int, float] = {}
        self.aim(wanted)

    def aim(self, wanted: Mapping[int, float]) -> None:
        """Go there from now on; may be called from another thread."""
        self._wanted = dict(wanted)

    def step(self, observation: Observation, time_s: float) -> Mapping[int, float] | MotionResult:
        """See `Motion`."""
        wanted = self._wanted
        if wanted is not self._seen:
            self._seen, self._since_s = wanted, time_s
        refusal = met_limit(observation, tuple(wanted), self._torque_limit)
        if refusal:
            return MotionResult(False, refusal)
        errors = {m: wanted[m] - joint_position(observation, m) for m in wanted}
        away = [motor for motor, error in errors.items() if abs(error) > self._tolerance]
        if not away and time_s - self._since_s > SETTLED_S:
            self.arrived = wanted
            return MotionResult(True, 'at the commanded position')
        if away and self._watch.stalled(observation, away, time_s):
            names = ', '.join(str(motor) for motor in away)
            return MotionResult(False, f'motor {names} does not come nearer to its command')
        return {
            motor: min(max(self._gain * error, -self._fastest), self._fastest)
            for motor, error in errors.items()
        }

    def limit_nm(self, observation: Observation) -> float:
        """See `Motion`."""
        return self._torque_limit

    def speeds(self) -> Mapping[str, float]:
        """See `Motion`: it may stand still on its way."""
        return {}
