# SPDX-License-Identifier: Apache-2.0
"""Emulated mechanics: gauges, tendons, clutch, squeezed objects."""

import math

import numpy as np
import pytest

from barrett_hand_bridge.emulator.faults import FaultError, parse_fault
from barrett_hand_bridge.emulator.mechanics import SCALE_280, HandBody, HandMechanics
from barrett_hand_bridge.emulator.squeeze import (
    ForceTable,
    Pinched,
    SqueezeError,
    Supported,
    read_force_table,
    read_squeezed,
)
from barrett_hand_bridge.emulator.strain_gauge import (
    StrainGauge,
    character_8_bit,
    character_12_bit,
    invert_published_torque,
    published_torque,
)
from barrett_hand_bridge.grasp import opposed_grasp
from barrett_hand_bridge.hand import ENCODER_262
from barrett_hand_bridge.kinematics import HandGeometry, Pin

TABLE = ForceTable((0.0, 0.001, 0.010), (0.0, 4.0, 22.0))
BALL = Pinched((1, 2), 0.065, TABLE)


def at_ball(squeezed=BALL, **body):
    mechanics = HandMechanics(HandBody(**body), 4, squeezed)
    counts = opposed_grasp(HandGeometry(), Pin(), 0.070).counts(ENCODER_262)
    mechanics.place({motor: float(value) for motor, value in counts.items()})
    return mechanics


def quiet_gauge(draw=character_8_bit, seed=1):
    generator = np.random.default_rng(seed)
    return StrainGauge(draw(generator), generator, noisy=False)


def test_a_prescribed_force_is_met_on_both_fingers():
    mechanics = at_ball()
    mechanics.close_to_force(10.631, (1, 2))
    for finger in (1, 2):
        assert mechanics.truth(finger).force_n == pytest.approx(10.631, abs=1e-6)


def test_displacements_of_a_pinched_object_follow_its_table():
    mechanics = at_ball()
    mechanics.close_to_force(13.0, (1, 2))
    truth = mechanics.truth(1)
    assert truth.displacement_m == pytest.approx(0.0055, abs=1e-8)
    gap = np.linalg.norm(np.subtract(mechanics.truth(2).pin_tip, truth.pin_tip))
    assert gap == pytest.approx(0.065 - 2 * 0.0055, abs=1e-7)


def test_stretched_tendons_need_more_motor_travel_for_the_same_force():
    stiff = at_ball(tendon_compliance_rad_per_nm=dict.fromkeys((1, 2, 3), 0.0))
    soft = at_ball()
    for mechanics in (stiff, soft):
        mechanics.close_to_force(15.0, (1, 2))
    assert soft.motors[1].position > stiff.motors[1].position + 10


def test_the_largest_load_of_the_paper_meets_the_documented_end_of_the_gauge():
    ball = Pinched(
        (1, 2),
        0.065,
        ForceTable((0, 0.00256, 0.00605, 0.00912, 0.01027), (0, 10.631, 16.503, 20.373, 21.485)),
    )
    mechanics = at_ball(ball, outer_link_mass_kg=0.0)
    mechanics.close_to_force(21.485, (1, 2))
    assert mechanics.truth(1).torque_nm == pytest.approx(1.0, abs=0.05)


def test_a_supported_object_pushes_back_along_its_own_normal():
    mechanics = at_ball(None)
    start = mechanics.truth(1).pin_tip
    mechanics.squeezed = Supported({1: start}, {1: (1.0, 0.0, 0.0)}, TABLE)
    mechanics.close_to_force(5.0, (1,))
    truth = mechanics.truth(1)
    assert truth.inward == (1.0, 0.0, 0.0)
    assert truth.pin_tip[0] - start[0] == pytest.approx(truth.displacement_m, abs=1e-7)


def test_a_slipping_clutch_freezes_the_inner_joint():
    mechanics = at_ball(clutch_torque_nm=0.2)
    mechanics.motors[1].drive(400.0)
    mechanics.motors[2].drive(400.0)
    mechanics.advance(4.0)
    broken_at = mechanics.breakaway_counts[1]
    assert broken_at is not None
    inner, outer = mechanics.angles(1)
    assert inner == pytest.approx(broken_at * math.radians(140) / 17500)
    assert outer > inner / 3


def test_a_motor_stalls_instead_of_crushing():
    mechanics = at_ball(stall_torque_nm=0.5)
    for finger in (1, 2):
        mechanics.motors[finger].drive(500.0)
    mechanics.advance(10.0)
    assert mechanics.motors[1].stalled
    assert mechanics.truth(1).torque_nm < 0.55


def test_encoder_shows_whole_counts():
    mechanics = at_ball()
    mechanics.place({1: 123.4})
    assert mechanics.encoder_counts(1) == 123


def test_eight_bit_gauges_start_inside_the_documented_band():
    for seed in range(20):
        assert 100 <= quiet_gauge(seed=seed).character.zero_counts <= 140


def test_a_gauge_clips_at_its_highest_code():
    gauge = quiet_gauge()
    gauge.step(3.0, 0.01)
    assert gauge.counts == 255


def test_a_gauge_that_is_not_fitted_reads_like_saturation():
    gauge = quiet_gauge()
    gauge.fitted = False
    assert gauge.counts == 255


def test_play_makes_loading_and_unloading_differ():
    gauge = quiet_gauge()
    readings = []
    for torque in (0.0, 0.5, 1.0, 0.5, 0.0):
        gauge.step(torque, 0.01)
        readings.append(gauge._play)
    assert readings[3] - readings[1] == pytest.approx(2 * gauge.character.play_counts)


def test_the_12_bit_gauge_follows_the_published_cubic():
    assert published_torque(1809.3) == pytest.approx(0.0, abs=2e-4)
    assert published_torque(3460) == pytest.approx(1.133, abs=1e-3)
    gauge = quiet_gauge(character_12_bit)
    gauge.step(0.0, 0.01)
    assert 1800 <= gauge.counts <= 2050


@pytest.mark.parametrize(
    ('counts', 'torque'),
    [(667, -1.018), (1000, -0.519), (2000, 0.049), (2048, 0.060), (3000, 0.506), (3460, 1.133)],
)
def test_the_published_cubic_has_its_published_values(counts, torque):
    assert published_torque(counts) == pytest.approx(torque, abs=6e-4)
    assert invert_published_torque(published_torque(counts)) == pytest.approx(counts, abs=1e-6)


def test_drift_is_a_few_counts_in_half_an_hour():
    generator = np.random.default_rng(9)
    gauge = StrainGauge(character_8_bit(generator), generator)
    for _ in range(1800):
        gauge.step(0.0, 1.0)
    assert 0.5 < abs(gauge.drift_counts) < 6.0


@pytest.mark.parametrize(
    ('displacement', 'force'),
    [((0.0,), (0.0,)), ((0.0, 1.0), (0.0, 0.0)), ((0.1, 1.0), (0.0, 1.0)), ((0, 1, 2), (0, 2, 1))],
)
def test_tables_that_do_not_rise_from_zero_are_refused(displacement, force):
    with pytest.raises(SqueezeError):
        ForceTable(displacement, force)


def test_a_squeezed_object_is_read_from_yaml_with_its_table_beside_it(tmp_path):
    (tmp_path / 'ball.csv').write_text('displacement_m,force_n\n0,0\n0.01,20\n')
    (tmp_path / 'ball.yaml').write_text(
        'table: ball.csv\npinched: {fingers: [1, 2], width_m: 0.065}\n'
    )
    squeezed = read_squeezed(tmp_path / 'ball.yaml')
    assert isinstance(squeezed, Pinched)
    assert squeezed.table.force(0.005) == pytest.approx(10.0)


def test_a_solved_sweep_is_a_table_too(tmp_path):
    path = tmp_path / 'sweep.json'
    path.write_text(
        '{"points": [{"displacement_m": 0.0, "force_n": 0.0},'
        ' {"displacement_m": 0.005, "force_n": 12.0}]}'
    )
    assert read_force_table(path).displacement(6.0) == pytest.approx(0.0025)
    path.write_text('{"rows": []}')
    with pytest.raises(SqueezeError, match='expected "points"'):
        read_force_table(path)


def test_a_missing_object_file_is_named(tmp_path):
    with pytest.raises(SqueezeError, match='nothing.yaml'):
        read_squeezed(tmp_path / 'nothing.yaml')


def test_faults_are_written_with_time_and_value():
    fault = parse_fault('unplug@2.5:3')
    assert (fault.kind, fault.at_s, fault.value) == ('unplug', 2.5, 3.0)
    assert parse_fault('mute@signal').at_s == math.inf
    with pytest.raises(FaultError, match='expected KIND@SECONDS'):
        parse_fault('explode@1')


def test_the_280_counts_eleven_times_finer():
    mechanics = HandMechanics(HandBody(scale=SCALE_280), 1)
    mechanics.place({1: 199111.1})
    assert mechanics.angles(1)[0] == pytest.approx(math.radians(140))
