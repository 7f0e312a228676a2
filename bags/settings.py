# SPDX-License-Identifier: Apache-2.0
"""Where fingers and objects stand in each recording, and the object files that go with them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bags.grasps import Touch, touch_at
from bags.relaxing import Fading
from bags.solid_cup import Cup, profile
from bags.stage import Setting, along_pins
from bags.surfaces import BallTruth, ShellTruth
from barrett_hand_bridge.emulator.geometry import MountedPin

BALL_RADIUS_M = 0.0325
SPREAD_AXIS_M = 0.025
# The axisymmetric solution has its pins on z, the object file of the ball on x.
Z_TO_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
PIN = MountedPin(length_m=0.040, forward_m=0.020)
CAN_CROWN_FROM_PALM_M = 0.040
THREE_FINGER_HEIGHT_M = 0.1945

FADING = Fading(share=0.03, onset_s=0.1)
HOLD_LAPSE = 17.0
"""Seconds of gauge and rubber in one of the recording that is held for long."""


def ball_between_two_pins() -> Setting:
    """Fingers 1 and 2 face each other; the ball hangs between their pins, x along them."""
    touches = {
        finger: touch_at(finger, math.pi / 2, BALL_RADIUS_M - SPREAD_AXIS_M, PIN)
        for finger in (1, 2)
    }
    first, second = (np.array(touches[finger].point) for finger in (1, 2))
    return Setting(
        truth=BallTruth(),
        touches=touches,
        spread_rad=math.pi / 2,
        rotation=along_pins(first, second),
        origin=0.5 * (first + second),
        pinched=True,
        width_m=2 * BALL_RADIUS_M,
        from_solution=Z_TO_X,
    )


def relaxing_ball_between_two_pins() -> Setting:
    """The same, and what the ball pushes back with falls with the logarithm of time."""
    return replace(ball_between_two_pins(), fading=FADING, warm_s=3 * 3600.0)


def relaxing_ball_object() -> dict:
    """The tennis ball with its relaxation, in the time of a recording that runs faster."""
    return {
        'name': 'relaxing_tennis_ball',
        'surface': {'sphere': {'outer_diameter_m': 0.065}},
        'thickness_m': 0.0025,
        'young_modulus_pa': 12.75e6,
        'poisson_ratio': 0.5,
        'gas': {'kind': 'sealed', 'gauge_pressure_pa': 0.0, 'ambient_pa': 101325.0},
        'relaxation': {
            'kind': 'log',
            'share_per_decade': FADING.share,
            'from_s': round(FADING.onset_s / HOLD_LAPSE, 6),
            'to_s': 100.0,
            'sigma_per_decade': 0.003,
        },
        'contacts': [
            {'at_m': [x, 0.0, 0.0], 'radius_m': 0.001, 'kind': 'pin'}
            for x in (BALL_RADIUS_M, -BALL_RADIUS_M)
        ],
        'control_vertices': 900,
        'source': 'As tennis_ball; a share a decade of unfilled rubber. Synthetic experiment; '
        f'its seconds are {HOLD_LAPSE:g} of the rubber.',
    }


def half_can_under_one_pin() -> Setting:
    """Finger 3 presses along -y on the crown; the can's axis is upright."""
    touch = touch_at(3, 0.0, CAN_CROWN_FROM_PALM_M, PIN)
    x, y, z = touch.point
    return Setting(
        truth=ShellTruth('half_soda_can'),
        touches={3: touch},
        spread_rad=0.0,
        rotation=np.eye(3),
        origin=np.array([x, y - 0.033, z]),
        pinched=False,
    )


def meeting_point(spread_rad: float) -> float:
    """y (m) of the point on the palm's mirror plane in which the planes of fingers 1, 2 meet."""
    return SPREAD_AXIS_M / math.tan(spread_rad)


def ball_between_three_pins() -> Setting:
    """Spread 60 degrees: the three finger planes meet in the ball's axis, 120 degrees apart."""
    spread = math.pi / 3
    behind = SPREAD_AXIS_M / math.sin(spread)
    outward = {1: BALL_RADIUS_M - behind, 2: BALL_RADIUS_M - behind}
    outward[3] = BALL_RADIUS_M + meeting_point(spread)
    guesses = {1: (0.94, 0.6), 2: (0.94, 0.6), 3: (0.63, 0.19)}
    touches = {
        finger: touch_at(
            finger,
            spread,
            outward[finger],
            PIN,
            height_m=THREE_FINGER_HEIGHT_M,
            guess=guesses[finger],
        )
        for finger in (1, 2, 3)
    }
    return Setting(
        truth=ShellTruth('ball_three_finger'),
        touches=touches,
        spread_rad=spread,
        rotation=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        origin=np.array([0.0, meeting_point(spread), THREE_FINGER_HEIGHT_M]),
        pinched=False,
    )


def cup_between_two_pins() -> Setting:
    """Spread 75 degrees: the planes of fingers 1 and 2 meet in the cup's axis."""
    cup = Cup()
    outline = profile(cup)
    spread = math.radians(cup.azimuth_deg)
    outward = float(outline(cup.contact_z)) * 1e-3 - SPREAD_AXIS_M / math.sin(spread)
    touches: dict[int, Touch] = {
        finger: touch_at(finger, spread, outward, PIN, rise=float(outline(cup.contact_z, 1)))
        for finger in (1, 2)
    }
    height = touches[1].point[2] - cup.contact_z * 1e-3
    return Setting(
        truth=ShellTruth('off_axis_cup'),
        touches=touches,
        spread_rad=spread,
        rotation=np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        origin=np.array([0.0, meeting_point(spread), height]),
        pinched=False,
    )


def three_finger_object() -> dict:
    """The tennis ball with three contacts; the modulus is that of the shell's own fit."""
    angles = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)
    return {
        'name': 'tennis_ball_three_contacts',
        'surface': {'sphere': {'outer_diameter_m': 0.065}},
        'thickness_m': 0.0025,
        'young_modulus_pa': 12.75e6,
        'poisson_ratio': 0.5,
        'gas': {'kind': 'sealed', 'gauge_pressure_pa': 0.0, 'ambient_pa': 101325.0},
        'contacts': [
            {
                'at_m': [
                    round(BALL_RADIUS_M * math.cos(angle), 9),
                    round(BALL_RADIUS_M * math.sin(angle), 9),
                    0.0,
                ],
                'radius_m': 0.001,
                'kind': 'pin',
            }
            for angle in angles
        ],
        'control_vertices': 900,
        'source': 'As tennis_ball, with contacts 120 degrees apart. Synthetic experiment.',
    }


def cup_object() -> dict:
    """The cup by its outer profile, foot clamped."""
    truth = ShellTruth('off_axis_cup').data
    contacts = []
    for mirror in (1.0, -1.0):
        x, y, z = truth['contacts'][0]['centre_m']
        contacts.append({'at_m': [x, mirror * y, z], 'radius_m': 0.001, 'kind': 'pin'})
    return {
        'name': 'free_form_cup',
        'surface': {'revolution': {'outer_profile_m': truth['outer_profile_rz_m']}},
        'thickness_m': truth['thickness_m'],
        'young_modulus_pa': truth['young_modulus_pa'],
        'poisson_ratio': truth['poisson_ratio'],
        'supports': [{'kind': 'clamped', 'where': 'lower'}],
        'contacts': contacts,
        'control_vertices': 1500,
        'source': 'Invented cup; modulus of a stiff polypropylene. Synthetic experiment.',
    }
