"""Touch cells of the BH8-280's fingers as contacts: where each cell is and what it presses.

24 cells per finger, 8 rows along the link and 3 columns across it. Positions along the link are
those of an open driver's table; it gives the pad height of the flat rows and of the last row only,
so the rounded rows lie on the arc that leaves the flat tangentially and ends there. The order of
cells (row by row, from the joint outward) and the layout of the palm's cells are not published:
the palm is not turned into contacts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.contacts import FLAG_CONTACT, Contact
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.kinematics import Array, FingerFrames

ROWS_M = (0.02225, 0.02825, 0.03425, 0.04023, 0.04619, 0.05108, 0.05381, 0.05542)
COLUMNS_M = (0.0052, 0.0, -0.0052)
LAST_FLAT_ROW = 4
LAST_HEIGHT_M = 0.00213
FLAT_LENGTH_M = 0.0055
CURVED_LENGTH_M = 0.0042
N_PER_CM2_TO_PA = 1e4
SENSOR_RELATIVE_SIGMA = 0.1
SENSOR_SIGMA_N_PER_CM2 = 0.1


@dataclass(frozen=True)
class TouchCell:
    """Centre (m) and outward normal in the frame of joint 3, (3,) each, and its area in m2."""

    centre: Array
    normal: Array
    area_m2: float


def finger_cells(pad_height_m: float) -> tuple[TouchCell, ...]:
    """The 24 cells of a finger, row by row from joint 3 outward."""
    bend = ROWS_M[LAST_FLAT_ROW]
    reach = ROWS_M[-1] - bend
    drop = pad_height_m - LAST_HEIGHT_M
    radius = (reach**2 + drop**2) / (2.0 * drop)
    cells = []
    for row, along in enumerate(ROWS_M):
        curved = row > LAST_FLAT_ROW
        angle = math.asin(min((along - bend) / radius, 1.0)) if curved else 0.0
        height = pad_height_m - radius * (1.0 - math.cos(angle))
        length = CURVED_LENGTH_M if curved else FLAT_LENGTH_M
        for across in COLUMNS_M:
            cells.append(
                TouchCell(
                    np.array([along, height, across]),
                    np.array([math.sin(angle), math.cos(angle), 0.0]),
                    length * abs(COLUMNS_M[0]),
                )
            )
    return tuple(cells)


def touch_contacts(
    pressures_n_per_cm2: Mapping[int, tuple[float, ...]],
    frames: Mapping[int, FingerFrames],
    cells: tuple[TouchCell, ...],
    threshold_n_per_cm2: float,
) -> list[Contact]:
    """One contact per pressed finger cell, in the hand frame."""
    contacts = []
    for finger in FINGERS:
        for cell, pressure in zip(cells, pressures_n_per_cm2.get(finger, ()), strict=False):
            if pressure < threshold_n_per_cm2:
                continue
            joint = frames[finger].joint_3
            normal = joint[:3, :3] @ cell.normal
            newton = N_PER_CM2_TO_PA * cell.area_m2
            sigma = math.hypot(SENSOR_RELATIVE_SIGMA * pressure, SENSOR_SIGMA_N_PER_CM2)
            contacts.append(
                Contact(
                    finger=finger,
                    flags=FLAG_CONTACT,
                    point=joint[:3, :3] @ cell.centre + joint[:3, 3],
                    normal=normal,
                    force=newton * pressure * normal,
                    sigma_normal_n=newton * sigma,
                    radius_m=math.sqrt(cell.area_m2 / math.pi),
                    travel_m=math.nan,
                    sigma_travel_m=math.inf,
                    sigma_point_m=0.5 * FLAT_LENGTH_M,
                    sigma_direction_rad=math.radians(5.0),
                )
            )
    return contacts
