# SPDX-License-Identifier: Apache-2.0
"""Parameters: every default passes its own check, every wrong value is named."""

import math

import pytest

from barrett_hand_bridge.assembly import geometry, make_observer, pins
from barrett_hand_bridge.calibration import HandCalibration
from barrett_hand_bridge.emulator.geometry import FingerDimensions, MountedPin
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.misfit import MISFITS, misfit_body, misfit_gauges
from barrett_hand_bridge.hand import ENCODER_262, HandFacts
from barrett_hand_bridge.kinematics import HandGeometry, Pin
from barrett_hand_bridge.observer import ObserverSettings
from barrett_hand_bridge.parameters import BY_NAME, PARAMETERS, check_all
from barrett_hand_bridge.zero import DRIFT_8_BIT, DRIFT_12_BIT
from grasp_common.parameter_table import ParameterError, check

DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}


def test_all_defaults_are_allowed():
    check_all(DEFAULTS)


def test_what_the_node_is_told_by_default_is_what_the_observer_takes_without_it():
    assert geometry(DEFAULTS) == HandGeometry()
    assert pins(DEFAULTS) == dict.fromkeys((1, 2, 3), Pin())
    facts = HandFacts('BH8-262', '4.4', '', ENCODER_262, 255, 100.0)
    found = make_observer(DEFAULTS, HandCalibration({}, 'BH8-262'), facts)
    assert found.settings == ObserverSettings({}, pins=pins(DEFAULTS))


def test_the_emulated_hand_is_made_as_the_manual_of_the_real_one_says():
    """BH8-262 manual: Aw 25, A1 50, Dw 84, A2 70, A3 50, D3 9.5 mm; Phi2 2.46, Phi3 50 degrees."""
    known = (0.025, 0.050, 0.084, 0.070, 0.050, 0.0095)
    body, told = FingerDimensions(), HandGeometry()
    assert known == (
        body.spread_axis_from_centre_m, body.knuckle_from_spread_axis_m, body.knuckle_height_m,
        body.inner_link_m, body.outer_link_m, body.pad_height_m,
    )  # fmt: skip
    assert known == (
        told.palm_offset_m, told.link_1_m, told.palm_height_m, told.link_2_m, told.link_3_m,
        told.pad_height_m,
    )  # fmt: skip
    for angles in (
        (body.inner_link_angle_rad, body.outer_link_angle_rad),
        (told.joint_2_offset_rad, told.joint_3_offset_rad),
    ):
        assert [math.degrees(angle) for angle in angles] == pytest.approx([2.46, 50.0])


def test_the_emulated_pin_is_mounted_as_the_driver_takes_it_to_be():
    mounted, taken = MountedPin(), Pin()
    assert (mounted.length_m, mounted.forward_m, mounted.sideways_m, mounted.lean_rad) == (
        taken.length_m, taken.forward_m, taken.sideways_m, taken.lean_rad,
    )  # fmt: skip
    assert set(HandBody().pins.values()) == {mounted}
    body, told = HandBody(), HandGeometry()
    assert (body.outer_link_mass_kg, body.outer_link_centre_m) == (
        told.outer_link_mass_kg, told.outer_link_centre_m,
    )  # fmt: skip


@pytest.mark.parametrize(
    ('name', 'changed'),
    [
        ('none', {}),
        ('warm-up', {'warm_up_counts': 2.0}),
        ('walk', {'walk_counts_per_sqrt_minute': 3.0}),
        ('play', {'play_counts': 4.0}),
        ('tendon', {}),
    ],
)
def test_a_misfit_changes_what_it_says_and_nothing_else(name, changed):
    misfit, plain = MISFITS[name], HandMechanics(HandBody(), 3)
    other = HandMechanics(misfit_body(HandBody(), misfit), 3)
    misfit_gauges(other, misfit)
    for finger, gauge in other.gauges.items():
        drawn = vars(plain.gauges[finger].character)
        minutes = 4.0 if name == 'warm-up' else drawn['warm_up_minutes']
        expected = {**drawn, 'warm_up_minutes': minutes}
        expected |= {trait: factor * drawn[trait] for trait, factor in changed.items()}
        assert vars(gauge.character) == pytest.approx(expected)
    play = 0.004 if name == 'tendon' else 0.0
    assert set(other.body.tendon_play_rad.values()) == {play}


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
