# SPDX-License-Identifier: Apache-2.0
"""Contacts: from angles, torque and pin to force, point, normal and travel, with uncertainties."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.kinematics import Array, length

FLAG_CONTACT = 1
FLAG_SATURATED = 2
FLAG_STALE = 4
FLAG_NOT_TARED = 8
FLAG_FAULT = 16
FLAG_NO_GAUGE = 32

SMALLEST_ARM_M = 0.005


@dataclass(frozen=True)
class Contact:
    """One contact in the hand frame: SI units, vectors (3,).

    `force` is that of the finger on the object, along the normal alone: one torque per finger
    cannot tell a tangential part, whose sigma is infinite. `along`: of the finger to its tip.
    """

    finger: int
    flags: int
    point: Array
    normal: Array
    force: Array
    sigma_normal_n: float
    radius_m: float
    travel_m: float
    sigma_travel_m: float
    sigma_point_m: float
    sigma_direction_rad: float
    along: Array
    sigma_tangential_n: float = math.inf


@dataclass(frozen=True)
class NormalForce:
    """Size of the normal force in N and its standard deviation."""

    force_n: float
    sigma_n: float


def normal_force(
    torque_nm: float,
    sigma_torque_nm: float,
    arm_m: float,
    sigma_arm_m: float,
) -> NormalForce:
    """Force along a direction from the torque about joint 3 and the arm of that direction.

    An arm under 5 mm says nothing about the force: its sigma is then infinite.
    """
    if arm_m < SMALLEST_ARM_M:
        return NormalForce(0.0, math.inf)
    force = torque_nm / arm_m
    return NormalForce(force, math.hypot(sigma_torque_nm, force * sigma_arm_m) / arm_m)


def opposed_normals(first: Array, second: Array) -> tuple[Array, Array]:
    """Inward normals of two contacts that face each other: along the line between them."""
    line = second - first
    distance = length(line)
    if distance < 1e-6:
        return np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])
    return line / distance, -line / distance


@dataclass(frozen=True)
class TouchSettings:
    """When a contact begins and ends, in multiples of the force's sigma, and for how long."""

    begin_sigmas: float = 4.0
    end_sigmas: float = 2.0
    begin_samples: int = 3
    end_samples: int = 10
    memory: int = 150


class TouchTracker:
    """First touch of one finger and the way of its pin along the normal since then.

    The force passes its threshold late. So the last samples are remembered: touch is the corner
    where the force began to rise with the pin's way, and travel is counted from there.
    """

    def __init__(self, settings: TouchSettings) -> None:
        """No contact."""
        self.settings = settings
        self.touching = False
        self._above = 0
        self._below = 0
        self._history: deque[tuple[Array, float]] = deque(maxlen=settings.memory)
        self._origin: Array | None = None
        self._origin_sigma_m = 0.0
        self.withdrawn_m = 0.0

    def reset(self) -> None:
        """Forget contact and history."""
        self.touching = False
        self._above = self._below = 0
        self._history.clear()
        self._origin = None
        self.withdrawn_m = 0.0

    def update(
        self, point: Array, force_n: float, noise_n: float, resolution_n: float = 0.0
    ) -> bool:
        """Take the pin's end (m, hand frame), the force and its white noise; True while touching.

        Drift is no part of `noise_n`: it moves slowly and does not look like a touch.
        `resolution_n`: of the gauge, one count; a change of less may come late or not at all.
        """
        s = self.settings
        self._history.append((point, force_n))
        if not self.touching:
            self._above = self._above + 1 if force_n > s.begin_sigmas * noise_n else 0
            if self._above >= s.begin_samples:
                self.touching = True
                self._below = 0
                self._find_origin(noise_n, resolution_n)
        else:
            self._below = self._below + 1 if force_n < s.end_sigmas * noise_n else 0
            if self._below >= s.end_samples:
                self.reset()
        return self.touching

    def _find_origin(self, noise_n: float, resolution_n: float) -> None:
        """Fit "flat, then rising with the pin's way" to the last samples; touch is the corner."""
        points = np.array([point for point, _ in self._history])
        forces = np.array([force for _, force in self._history])
        ways = -np.sqrt(np.sum((points - points[-1]) ** 2, axis=1))
        corner, slope = _corner(ways, forces)
        self._origin = points[corner]
        rising = len(forces) - 1 - corner
        span = -float(ways[corner])
        if slope <= 0.0 or rising < 1:
            self._origin_sigma_m = span
            return
        step = span / rising
        self._origin_sigma_m = math.hypot(
            2.0 * noise_n / slope / math.sqrt(rising), step, resolution_n / slope
        )

    def travel(self, point: Array, normal: Array) -> tuple[float, float]:
        """Way along the normal since touch and the uncertainty of its start, in m."""
        if self._origin is None:
            return 0.0, 0.0
        travel = float((point - self._origin) @ normal)
        self.withdrawn_m = -travel
        return travel, self._origin_sigma_m


def _corner(ways: Array, forces: Array) -> tuple[int, float]:
    """Index at which a line that was flat begins to rise with the way, and that rise in N/m."""
    count = len(forces)
    flat = np.cumsum(forces) / np.arange(1, count + 1)
    best = (math.inf, count - 1, 0.0)
    for corner in range(count - 1):
        rise = ways[corner + 1 :] - ways[corner]
        above = forces[corner + 1 :] - flat[corner]
        square = float(rise @ rise)
        slope = float(rise @ above) / square if square > 0.0 else 0.0
        before = forces[: corner + 1] - flat[corner]
        left = above - slope * rise
        error = float(before @ before + left @ left)
        if slope > 0.0 and error < best[0]:
            best = (error, corner, slope)
    return best[1], best[2]
