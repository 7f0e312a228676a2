# SPDX-License-Identifier: Apache-2.0
"""Touch cells of the BH8-280 as contacts: where each cell is and what it presses.

24 cells per finger, 8 rows along the outer link by 3 columns, and 24 in the palm, in rows of 5, 7,
7 and 5. Places, sizes and order are those of the one open driver that has them
(RCPRG-ros-pkg/barrett_hand, `tactile_geometry.h`, BSD). That table puts the palm 2.7 mm below the
inner joints of the hand model beside it, whose z axis is ours and whose x and y point the other
way; nobody else has confirmed it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.contacts import FLAG_CONTACT, Contact
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.kinematics import Array, HandGeometry

PALM = 4
# Rows of a finger in the frame of joint 3, mm: centre along the link and below the flat of the
# pad, half a cell along the link and downward.
FINGER_ROWS_MM = (
    (22.25, 0.0, 2.75, 0.0),
    (28.25, 0.0, 2.75, 0.0),
    (34.2484, 0.08629, 2.74837, 0.085096),
    (40.2349, 0.44305, 2.73902, 0.241919),
    (46.1912, 1.14113, 2.72073, 0.397956),
    (51.0813, 2.3116, 1.35885, 0.614231),
    (53.8108, 4.35778, 0.970635, 1.13209),
    (55.4163, 7.36766, 0.399575, 1.4367),
)
FINGER_COLUMNS_MM = (5.2, 0.0, -5.2)
FINGER_HALF_WIDTH_MM = 2.35
# Rows of the palm in the hand frame, mm: y, and how many cells; fingers 1 and 2 are at negative y.
PALM_ROWS_MM = ((-15.9, 5), (-5.3, 7), (5.3, 7), (15.9, 5))
PALM_PITCH_MM = 11.0
PALM_HALF_CELL_MM = (5.0, 4.85)
PALM_BELOW_JOINTS_MM = 2.6966
MM = 1e-3
N_PER_CM2_TO_PA = 1e4
SENSOR_RELATIVE_SIGMA = 0.1
SENSOR_SIGMA_N_PER_CM2 = 0.1


@dataclass(frozen=True)
class TouchCell:
    """Centre (m) and outward normal, (3,) each, and its area in m2.

    A finger's cells are in the frame of its joint 3, the palm's in the hand frame.
    """

    centre: Array
    normal: Array
    area_m2: float


def finger_cells(pad_height_m: float) -> tuple[TouchCell, ...]:
    """The 24 cells of a finger, row by row from joint 3 outward."""
    cells = []
    for along, below, half, fall in FINGER_ROWS_MM:
        half_length = math.hypot(half, fall)
        for across in FINGER_COLUMNS_MM:
            cells.append(
                TouchCell(
                    np.array([along * MM, pad_height_m - below * MM, across * MM]),
                    np.array([fall, half, 0.0]) / half_length,
                    4.0 * half_length * FINGER_HALF_WIDTH_MM * MM**2,
                )
            )
    return tuple(cells)


def palm_cells(palm_height_m: float) -> tuple[TouchCell, ...]:
    """The 24 cells of the palm, row by row from the side of fingers 1 and 2, finger 1 first."""
    length, width = PALM_HALF_CELL_MM
    height = palm_height_m - PALM_BELOW_JOINTS_MM * MM
    return tuple(
        TouchCell(
            np.array([(k - 0.5 * (count - 1)) * PALM_PITCH_MM * MM, across * MM, height]),
            np.array([0.0, 0.0, 1.0]),
            4.0 * length * width * MM**2,
        )
        for across, count in PALM_ROWS_MM
        for k in range(count)
    )


def touch_cells(geometry: HandGeometry) -> dict[int, tuple[TouchCell, ...]]:
    """All cells of a hand: fingers 1 to 3, and `PALM`."""
    finger = finger_cells(geometry.pad_height_m)
    return {**dict.fromkeys(FINGERS, finger), PALM: palm_cells(geometry.palm_height_m)}


def touch_contacts(
    pressures_n_per_cm2: Mapping[int, tuple[float, ...]],
    poses: Mapping[int, Array],
    cells: Mapping[int, tuple[TouchCell, ...]],
    threshold_n_per_cm2: float,
) -> list[Contact]:
    """One contact per pressed cell, in the hand frame; the palm counts as finger 4.

    poses: (4, 4) of joint 3 in the hand frame, per finger.
    """
    contacts = []
    for where, pad in cells.items():
        pose = poses.get(where, np.eye(4))
        for cell, pressure in zip(pad, pressures_n_per_cm2.get(where, ()), strict=False):
            if pressure < threshold_n_per_cm2:
                continue
            normal = pose[:3, :3] @ cell.normal
            newton = N_PER_CM2_TO_PA * cell.area_m2
            sigma = math.hypot(SENSOR_RELATIVE_SIGMA * pressure, SENSOR_SIGMA_N_PER_CM2)
            contacts.append(
                Contact(
                    finger=where,
                    flags=FLAG_CONTACT,
                    point=pose[:3, :3] @ cell.centre + pose[:3, 3],
                    normal=normal,
                    force=newton * pressure * normal,
                    sigma_normal_n=newton * sigma,
                    radius_m=math.sqrt(cell.area_m2 / math.pi),
                    travel_m=math.nan,
                    sigma_travel_m=math.inf,
                    sigma_point_m=0.5 * math.sqrt(cell.area_m2),
                    sigma_direction_rad=math.radians(5.0),
                    along=pose[:3, 0],
                )
            )
    return contacts
