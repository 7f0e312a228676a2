# SPDX-License-Identifier: Apache-2.0
"""What a recording's programme can do: move, hold, scan; keeps the rows and their truth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from bags import scanner as scanning
from bags.recording import START_NS, World
from bags.scanner import Scan, Scanner, View
from bags.stage import Stage, quaternion


@dataclass
class Session:
    """One recording under way."""

    stage: Stage
    world: World
    scanner: Scanner
    views: tuple[View, ...]
    rows: list[dict] = field(default_factory=list)
    truths: list[dict] = field(default_factory=list)
    scans: list[Scan] = field(default_factory=list)
    windows: list[dict] = field(default_factory=list)
    _window: dict | None = None

    @property
    def time_s(self) -> float:
        """Seconds since the recording began."""
        return round((self.world.now_ns - START_NS) * 1e-9, 9)

    def hold(self, seconds: float) -> None:
        """Let time pass with the fingers where they are."""
        self.world.hold(seconds)

    def move_to(self, force_n: float, seconds: float) -> None:
        """Close or open to a prescribed force of the first finger (0: open)."""
        self.world.move_to(force_n, seconds)

    def slide(self, axis: tuple[float, float, float], degrees: float, seconds: float) -> None:
        """Turn the object under the pins about an axis of its grip: the contacts slide on it."""
        steps = max(round(seconds / self.world.period_s), 1)
        before = self.stage.slip
        for step in range(1, steps + 1):
            part = 0.5 - 0.5 * float(np.cos(np.pi * step / steps))
            turn = Rotation.from_rotvec(np.radians(degrees * part) * np.array(axis))
            self.stage.slip = turn.as_matrix() @ before
            self.world.tick(self.stage.counts)

    @contextmanager
    def held(self, force_n: float, **facts: object) -> Iterator[None]:
        """A span in which a prescribed force is held; scans inside belong to it."""
        window = {'from_s': self.time_s, 'to_s': None, 'prescribed_force_n': force_n, **facts}
        self.windows.append(window)
        self._window = window
        try:
            yield
        finally:
            window['to_s'] = self.time_s
            self._window = None

    def scan(self, kind: str) -> None:
        """Scan the object as it now is and publish the cloud."""
        number = len(self.scans)
        truth = self.stage.setting.truth
        force = self.stage.force()
        rotation, origin = self.stage.pose()
        grip, _ = self.stage.grip()
        turn = grip @ self.stage.setting.from_solution
        dented_by = self.stage.elastic_force()
        surface = truth.surface(dented_by).moved(turn, origin)
        scan = scanning.scan(
            surface,
            list(self.views),
            self.stage.obstacles() if force > 0.0 else [],
            origin,
            self.scanner,
            self.stage.seed * 1000 + number,
        )
        self.scans.append(scan)
        stamp = self.world.show(scan)
        measured_rotation, measured_origin = self.world.measured_pose()
        row: dict = {
            'row': number,
            'kind': kind,
            'scan_stamp_ns': stamp,
            'scan_time_s': self.time_s,
            'points': len(scan.points),
            'object_pose': _pose(measured_rotation, measured_origin),
        }
        if self._window is not None:
            row['hold'] = self._window
        self.rows.append(row)
        self.truths.append(
            {
                'row': number,
                'force_n': round(force, 9),
                'displacement_middle_m': round(truth.middle_displacement(dented_by), 9),
                'displacement_outer_m': round(truth.outer_displacement(dented_by), 9),
                'object_pose': _pose(rotation, origin),
                'scan_placement': _pose(scan.placement_rotation, scan.placement_shift),
                'scan_seed': self.stage.seed * 1000 + number,
            }
        )


def _pose(rotation: np.ndarray, origin: np.ndarray) -> list[float]:
    """x y z qx qy qz qw, rounded to a nanometre and 1e-12."""
    # Adding zero turns -0.0 into 0.0.
    place = [round(float(value), 9) + 0.0 for value in origin]
    return place + [round(value, 12) + 0.0 for value in quaternion(rotation)]
