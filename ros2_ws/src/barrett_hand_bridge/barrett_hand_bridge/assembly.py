# SPDX-License-Identifier: Apache-2.0
"""From checked parameter values to driver, observer settings and motion settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from barrett_hand_bridge.calibration import (
    CalibrationError,
    HandCalibration,
    read_calibration,
)
from barrett_hand_bridge.gcl.driver import LATE_PERIODS, SerialHand
from barrett_hand_bridge.gcl.port import open_port
from barrett_hand_bridge.hand import FINGERS, Hand, HandFacts
from barrett_hand_bridge.kinematics import HandGeometry, Pin
from barrett_hand_bridge.motion import CloseSettings
from barrett_hand_bridge.observer import HandObserver, ObserverSettings
from barrett_hand_bridge.puck.bus import open_bus
from barrett_hand_bridge.puck.driver import LATE_S, CanHand, PuckOptions
from barrett_hand_bridge.puck.frames import HandAddresses
from barrett_hand_bridge.stop_guard import guard_can, guard_serial
from barrett_hand_bridge.zero import DRIFT_8_BIT, DRIFT_12_BIT

Values = Mapping[str, Any]
NEVER_S = 60.0


def geometry(values: Values) -> HandGeometry:
    """Link constants from the parameters."""
    return HandGeometry(
        palm_offset_m=values['palm_offset'],
        palm_height_m=values['palm_height'],
        link_1_m=values['link_1'],
        link_2_m=values['link_2'],
        link_3_m=values['link_3'],
        pad_height_m=values['pad_height'],
        joint_2_offset_rad=values['joint_2_offset'],
        joint_3_offset_rad=values['joint_3_offset'],
        outer_link_mass_kg=values['outer_link_mass'],
        outer_link_centre_m=values['outer_link_centre'],
    )


def pins(values: Values) -> dict[int, Pin]:
    """The pin of each finger from the parameters."""
    return {
        finger: Pin(
            length_m=values['pin_length'][index],
            radius_m=values['pin_radius'][index],
            forward_m=values['pin_forward'][index],
            sideways_m=values['pin_sideways'][index],
            lean_rad=values['pin_lean'][index],
            position_sigma_m=values['pin_position_sigma'],
            direction_sigma_rad=values['pin_direction_sigma'],
        )
        for index, finger in enumerate(FINGERS)
    }


def make_hand(
    values: Values,
    port: Callable[[], str],
    clock_ns: Callable[[], int],
    *,
    simulated_time: bool = False,
) -> Hand:
    """The driver for the chosen backend, not connected yet; `port` is asked at each connection.

    On simulated time no answer is late: a recording must not depend on how busy a machine is.
    """
    period_s = values['poll_period']
    late_s = NEVER_S if simulated_time else LATE_PERIODS * period_s if period_s > 0.0 else None
    if values['backend'] == 'can':
        first, second, third, spread = values['can_nodes']
        return CanHand(
            lambda: open_bus(values['interface'], values['channel'], values['can_port']),
            clock_ns=clock_ns,
            options=PuckOptions(
                touch=values['touch'],
                addresses=HandAddresses((first, second, third, spread), values['can_group']),
                inner_encoders=values['inner_encoders'],
                motor_torque=values['motor_torque'],
            ),
            prefetch=period_s == 0.0,
            late_s=LATE_S if late_s is None else max(late_s, LATE_S),
            guard=lambda: guard_can(
                values['interface'], values['channel'], values['can_port'], values['can_nodes']
            ),
        )
    return SerialHand(
        lambda: open_port(port()),
        clock_ns=clock_ns,
        baud=values['baud'],
        servo_sample_s=values['servo_sample_time'],
        feedback=values['feedback'],
        prefetch=period_s == 0.0,
        late_s=late_s,
        guard=lambda line: guard_serial(line.fileno()),
    )


def load_calibration(path: str) -> HandCalibration:
    """The calibration file of the parameter.

    Raises:
        CalibrationError: no file given, or one that cannot be used.
    """
    if not path:
        raise CalibrationError(
            'parameter calibration is empty: every gauge differs, so give the file of this hand '
            '(make one with hand_calibrate)'
        )
    return read_calibration(Path(path))


def check_calibration(calibration: HandCalibration, facts: HandFacts) -> None:
    """Refuse the calibration of another hand.

    Raises:
        CalibrationError: another model, or another serial number (0 and empty fit every hand).
    """
    if calibration.hand and calibration.hand != facts.model:
        raise CalibrationError(
            f'calibration {calibration.source} is for a {calibration.hand}, this is a '
            f'{facts.model}'
        )
    known = {'', '0'}
    given, found = calibration.serial_number, facts.serial_number
    if given not in known and found not in known and given != found:
        raise CalibrationError(
            f'calibration {calibration.source} is for hand number {given}, this hand says {found}'
        )


def make_observer(values: Values, calibration: HandCalibration, facts: HandFacts) -> HandObserver:
    """The observer for a hand that has said what it is."""
    opposed = list(values['opposed_fingers'])
    gravity = values['gravity']
    return HandObserver(
        ObserverSettings(
            calibrations=calibration.fingers,
            geometry=geometry(values),
            pins=pins(values),
            encoder=facts.encoder,
            highest_gauge_count=facts.highest_gauge_count,
            drift=DRIFT_8_BIT if facts.highest_gauge_count == 255 else DRIFT_12_BIT,
            follow_drift=values['follow_drift'],
            tendon_compliance_rad_per_nm=values['tendon_compliance'],
            tendon_sigma_rad_per_nm=values['tendon_sigma'],
            tendon_play_rad=values['tendon_play'],
            opposed_fingers=None if opposed == [0] else (opposed[0], opposed[1]),
            gravity=(gravity[0], gravity[1], gravity[2]),
            touch_threshold_n_per_cm2=values['touch_threshold'],
        )
    )


def close_settings(values: Values, force_n: float | None = None) -> CloseSettings:
    """How `hand/close` closes, or something else with a force of its own."""
    return CloseSettings(
        force_n=values['close_force'] if force_n is None else force_n,
        torque_limit_nm=values['torque_limit'],
        approach_rad_s=values['approach_speed'],
        squeeze_rad_s=values['squeeze_speed'],
    )
