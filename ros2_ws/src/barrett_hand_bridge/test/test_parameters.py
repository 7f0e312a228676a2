# SPDX-License-Identifier: Apache-2.0
"""Parameters: every default passes its own check, every wrong value is named."""

import pytest

from barrett_hand_bridge.assembly import make_observer
from barrett_hand_bridge.calibration import HandCalibration
from barrett_hand_bridge.hand import ENCODER_262, HandFacts
from barrett_hand_bridge.parameters import BY_NAME, PARAMETERS, check_all
from barrett_hand_bridge.zero import DRIFT_8_BIT, DRIFT_12_BIT
from grasp_common.parameter_table import ParameterError, check

DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}


def test_all_defaults_are_allowed():
    check_all(DEFAULTS)


def test_names_are_unique_and_described():
    assert len(DEFAULTS) == len(PARAMETERS)
    assert all(len(parameter.description) > 10 for parameter in PARAMETERS)


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [
        ('backend', 'usb', 'choose one of serial, can, emulator'),
        ('close_force', 100.0, 'must lie between 0.1 and 25'),
        ('close_force', float('nan'), 'must lie between 0.1 and 25'),
        ('feedback', ['strain', 'smell'], "is 'smell'; choose one of strain"),
        ('pin_length', [0.1], '1 values; it needs 3'),
        ('pin_length', [0.1, 0.1, 9.0], 'pin_length is 9'),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(name, value, complaint):
    with pytest.raises(ParameterError, match=complaint):
        check(BY_NAME[name], value)


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [
        ('gravity', [0.0, 0.0, -0.5], 'length 0.5'),
        ('opposed_fingers', [1, 1], 'two different fingers'),
        ('hand_mount', [0.0] * 7, 'hand_mount: quaternion'),
        ('opposed_fingers', [0, 1], 'two different fingers'),
        ('hand_frame', 'finger_1_tip', "'finger_1_tip' is the name of two things"),
        ('world_frame', 'hand_base', "'hand_base' is the name of two things"),
        ('tip_frames', ['a', 'b', 'a'], "'a' is the name of two things"),
        ('tip_frames', ['a', 'b', 'finger_2_knuckle'], 'is the name of two things'),
        ('joint_names', ['a'] * 7, r"'a' is the name of two things \(parameters joint_names\)"),
        ('hand_frame', ' ', "' ' is no name"),
        ('hand_frame', '/hand_base', 'without a leading slash'),
        ('link_prefix', 'a\n', 'is no name'),
    ],
)
def test_values_are_checked_together(name, value, complaint):
    with pytest.raises(ParameterError, match=complaint):
        check_all({**DEFAULTS, name: value})


def test_unknown_gravity_is_allowed():
    check_all({**DEFAULTS, 'gravity': [0.0, 0.0, 0.0]})


@pytest.mark.parametrize(('highest', 'drift'), [(255, DRIFT_8_BIT), (4095, DRIFT_12_BIT)])
def test_a_zero_drifts_as_the_gauge_of_its_hand_does(highest, drift):
    values = {one.name: one.default for one in PARAMETERS}
    facts = HandFacts('BH8', '', '', ENCODER_262, highest, 100.0)
    settings = make_observer(values, HandCalibration('', '', {}), facts).settings
    assert (settings.drift, settings.highest_gauge_count) == (drift, highest)
