# SPDX-License-Identifier: Apache-2.0
"""What the visitor of the page chose to see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .scene_model import Quantity, Shape

ScanChoice = Literal['with scan error', 'always', 'never']
SCAN_CHOICES: tuple[ScanChoice, ...] = ('with scan error', 'always', 'never')


@dataclass(frozen=True)
class ViewOptions:
    """What the visitor chose to see."""

    quantity: Quantity
    shape: Shape = 'served'
    exaggeration: float = 1.0
    rest: bool = True
    depth_lines: bool = True
    mesh_lines: bool = False
    contacts: bool = True
    scan: ScanChoice = 'with scan error'
    hand: bool = True
    cones: bool = False
    friction: float = 0.5
