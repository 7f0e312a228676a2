# SPDX-License-Identifier: Apache-2.0
"""Calibration files: fit, write, read back, refuse."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.calibration import (
    CalibrationError,
    GaugeCalibration,
    HandCalibration,
    read_calibration,
    write_calibration,
)
from barrett_hand_bridge.commands import hand_calibrate
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.weighing import weighing_table
from barrett_hand_bridge.fit import Weighing, fit_gauge, parse_weighings

GAUGE = GaugeCalibration(
    'cubic',
    coefficients_nm=(-1.2, 0.01, 1e-6, 1e-9),
    reference_counts=120.0,
    no_load_counts=(100.0, 140.0),
    noise_counts=0.5,
    residual_nm=0.003,
    relative_sigma=0.002,
    valid_torque_nm=1.1,
)
TABLE = GaugeCalibration(
    'table',
    counts=(100.0, 120.0, 230.0),
    torque_nm=(-0.2, 0.0, 1.1),
    zero='shift',
    reference_counts=120.0,
    no_load_counts=(100.0, 140.0),
    valid_torque_nm=1.1,
)


def weighings(law, noise=0.5):
    torques = np.linspace(0.0, 1.1, 12)
    return [Weighing(float(t), float(law(t)), noise) for t in torques]


@pytest.mark.parametrize('gauge', [GAUGE, TABLE])
def test_a_calibration_file_comes_back_unchanged(gauge, tmp_path):
    path = tmp_path / 'hand.yaml'
    written = HandCalibration(
        'BH8-262', '77', {1: gauge, 2: GAUGE, 3: GaugeCalibration('none')}, str(path)
    )
    write_calibration(written, path)
    assert read_calibration(path) == written


def test_torque_is_zero_at_the_tared_zero():
    for gauge in (GAUGE, TABLE):
        for zero in (110.0, 120.0, 131.5):
            assert gauge.torque(zero, zero) == 0.0


def test_difference_and_shift_differ_on_a_curved_law():
    difference = GaugeCalibration('cubic', coefficients_nm=(0.0, 1e-3, 1e-4))
    shift = GaugeCalibration('cubic', coefficients_nm=(0.0, 1e-3, 1e-4), zero='shift')
    assert difference.torque(20.0, 10.0) == pytest.approx(1e-2 + 1e-4 * 300)
    assert shift.torque(20.0, 10.0) == pytest.approx(1e-2 + 1e-4 * 100)


@given(gain=st.floats(80, 120), zero=st.floats(90, 150), cubic=st.floats(-3, 3))
def test_a_cubic_law_is_recovered_within_a_thousandth(gain, zero, cubic):
    fit = fit_gauge(weighings(lambda t: zero + gain * t + cubic * t**3))
    for torque in (0.1, 0.5, 1.0):
        counts = zero + gain * torque + cubic * torque**3
        assert fit.gauge.torque(counts, zero) == pytest.approx(torque, abs=1e-3)


def test_a_table_passes_through_its_own_weights():
    fit = fit_gauge(weighings(lambda t: 120 + 100 * t), kind='table')
    assert max(abs(r) for r in fit.residuals_nm) < 1e-12


def test_scatter_of_an_emulated_session_is_a_third_of_a_count():
    lines = weighing_table(HandMechanics(HandBody(), 11), 11)
    fit = fit_gauge(parse_weighings(lines, 'session')[1])
    assert 0.0 < fit.gauge.residual_nm < 0.005


def test_the_weights_of_a_session_go_up_in_steps_and_down_again():
    lines = weighing_table(HandMechanics(HandBody(), 11), 11, readings=1)
    rows = [list(map(float, line.split(','))) for line in lines[1:]]
    for finger in (1, 2, 3):
        masses = np.array([row[1] for row in rows if row[0] == finger])
        assert masses.max() == 2.4 and masses[0] == 0.0
        steps = np.diff(masses[: len(masses) // 2 + 1])
        assert steps == pytest.approx(np.append(np.full(9, 0.25), 0.15))
        assert (masses == masses[::-1]).all()
    assert {row[2] for row in rows} == {0.05}


def test_clipped_weighings_are_left_out_of_the_fit():
    clipped = weighings(lambda t: min(140 + 120 * t, 255.0))
    fit = fit_gauge(clipped)
    assert fit.gauge.valid_torque_nm == pytest.approx(0.9)
    assert fit.gauge.torque(200.0, 140.0) == pytest.approx(0.5, abs=1e-3)


def session(generator, count, noise=0.5):
    """Weighings of a gauge drawn at random, each mean with an error as large as the noise."""
    gain, zero = generator.uniform(90, 110), generator.uniform(100, 140)
    cubic = generator.uniform(-2, 2)

    def law(torque):
        return zero + gain * torque + cubic * torque**3

    torques = np.linspace(0.0, 1.08, count)
    return law, [
        Weighing(float(t), float(law(t) + noise * generator.standard_normal()), noise)
        for t in torques
    ]


@pytest.mark.parametrize('kind', ['cubic', 'table'])
@pytest.mark.parametrize('count', [5, 6, 9])
def test_the_sigma_of_few_weights_holds_its_90_percent_level(kind, count):
    generator = np.random.default_rng([881, count])
    within = []
    for _ in range(400):
        law, weighed = session(generator, count)
        try:
            gauge = fit_gauge(weighed, kind=kind).gauge
        except CalibrationError:
            continue
        torque = float(generator.uniform(0.05, 1.05))
        error = gauge.torque(law(torque), law(0.0)) - torque
        sigma = np.hypot(gauge.residual_nm, gauge.relative_sigma * torque)
        within.append(abs(error) <= 1.6449 * sigma)
    assert len(within) > 380
    # 400 draws scatter by 1.5 %.
    assert 0.85 <= np.mean(within) <= 0.95


def test_one_degree_of_freedom_is_widened_to_its_90_percent_interval():
    off = np.array([0.0, 1.0, -1.0, 1.0, -1.0])
    laws = [
        Weighing(t, 120 + 100 * t + 5 * d, 0.0) for t, d in zip(np.arange(5) / 5, off, strict=True)
    ]
    fit = fit_gauge(laws)
    plain = np.sqrt(np.sum(np.square(fit.residuals_nm)) / 1)
    assert fit.gauge.residual_nm == pytest.approx(6.314 / 1.645 * plain, rel=1e-3)


def test_weights_that_lie_on_the_law_by_chance_are_no_better_than_their_noise():
    fit = fit_gauge(weighings(lambda t: 120 + 100 * t, noise=0.6))
    assert fit.gauge.residual_nm == pytest.approx(0.5 * 0.6 / 100)


def test_a_table_tells_from_its_left_out_weights_how_well_it_tells():
    bent = fit_gauge(weighings(lambda t: 120 + 100 * t + 20 * t**2, noise=0.0), kind='table')
    straight = fit_gauge(weighings(lambda t: 120 + 100 * t, noise=0.0), kind='table')
    # Half the second difference of the counts, 20 (0.1 N m)^2 of them, over the slope.
    assert bent.gauge.residual_nm == pytest.approx(20 * 0.1**2 / 120, rel=0.3)
    assert straight.gauge.residual_nm < 1e-12


def lagging(kind, counts, both_ways=True):
    """Fit a gauge that reads `counts` more on the way down than on the way up, and half less."""
    up = np.linspace(0.0, 1.0, 5)
    order = [*up, *up[-2::-1]] if both_ways else up
    half = [-0.5 * counts] * 5 + [0.5 * counts] * 4
    return fit_gauge(
        [Weighing(t, 120 + 100 * t + d, 0.0) for t, d in zip(order, half, strict=False)], kind=kind
    )


@pytest.mark.parametrize('kind', ['cubic', 'table'])
def test_a_gauge_that_lags_holds_its_90_percent_level_when_weighed_up_and_down(kind):
    fit = lagging(kind, 2.0)
    # Tared after a release and loaded again, it reads all of the lag too little.
    assert 0.7 < 0.02 / (np.sqrt(2.0) * fit.gauge.residual_nm) < 1.645
    assert not fit.one_way


def test_what_a_table_keeps_of_a_lag_is_student_s_interval_of_its_levels():
    # Eight weighings are one count off the mean of their level; nine less five means leave four.
    off = 0.01 * np.sqrt(8 / 4) * 2.1318 / 1.6449
    assert lagging('table', 2.0).gauge.residual_nm == pytest.approx(off, rel=0.02)


@pytest.mark.parametrize('kind', ['cubic', 'table'])
def test_weights_that_only_rise_show_no_lag_and_say_so(kind):
    fit = lagging(kind, 2.0, both_ways=False)
    assert fit.gauge.residual_nm < 1e-9
    assert fit.one_way


def test_falling_counts_are_refused():
    with pytest.raises(CalibrationError, match='falls'):
        fit_gauge(weighings(lambda t: 120 - 100 * t))


def test_a_session_without_the_unloaded_gauge_is_refused():
    with pytest.raises(CalibrationError, match='mass 0'):
        fit_gauge(weighings(lambda t: 120 + 100 * t)[1:])


def test_too_few_weights_are_refused():
    with pytest.raises(CalibrationError, match='needs 5 weights'):
        fit_gauge(weighings(lambda t: 120 + 100 * t)[:4])


@pytest.mark.parametrize(
    ('change', 'complaint'),
    [
        ({'format': 'other/1'}, 'format must be'),
        ({'colour': 'red'}, "unknown key 'colour'"),
        ({'fingers': {1: {'kind': 'none'}}}, 'as 1, 2 and 3'),
        ({'fingers': dict.fromkeys((1, 2, 3), {'kind': 'spline'})}, 'cubic, table or none'),
    ],
)
def test_a_wrong_file_is_refused_by_name(change, complaint, tmp_path):
    path = tmp_path / 'hand.yaml'
    write_calibration(HandCalibration('BH8-262', '', dict.fromkeys((1, 2, 3), GAUGE)), path)
    document = yaml.safe_load(path.read_text()) | change
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(CalibrationError, match=complaint) as caught:
        read_calibration(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ('key', 'value', 'complaint'),
    [
        ('noise_counts', -1.0, 'must not be negative'),
        ('residual_nm', float('nan'), 'finite number'),
        ('zero', 'guess', 'difference or shift'),
        ('no_load_counts', [140.0, 100.0], 'two rising counts'),
        ('coefficients_nm', [0.0, -0.01], 'falls with rising counts'),
        ('coefficients_nm', 'many', 'list of numbers'),
    ],
)
def test_an_impossible_value_is_refused_with_finger_and_key(key, value, complaint, tmp_path):
    path = tmp_path / 'hand.yaml'
    write_calibration(HandCalibration('BH8-262', '', dict.fromkeys((1, 2, 3), GAUGE)), path)
    document = yaml.safe_load(path.read_text())
    document['fingers'][2][key] = value
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(CalibrationError, match=f'finger 2.*{complaint}'):
        read_calibration(path)


def test_hand_calibrate_writes_file_plot_and_one_json_document(tmp_path, capsys):
    table = tmp_path / 'weights.csv'
    table.write_text('\n'.join(weighing_table(HandMechanics(HandBody(), 5), 5)))
    out, plot = tmp_path / 'hand.yaml', tmp_path / 'fit.png'
    arguments = [str(table), '--calibration', str(out), '--plot', str(plot), '--json']
    assert hand_calibrate.main(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document['fingers']['1']['residual_nm']) == 21
    assert plot.read_bytes().startswith(b'\x89PNG')
    assert read_calibration(out).fingers[3].kind == 'cubic'


def test_a_picture_of_an_unknown_kind_is_refused_with_one_sentence(tmp_path, capsys):
    table = tmp_path / 'weights.csv'
    table.write_text('\n'.join(weighing_table(HandMechanics(HandBody(), 5), 5)))
    out = tmp_path / 'hand.yaml'
    arguments = [str(table), '--calibration', str(out), '--plot', str(tmp_path / 'fit.xyz')]
    assert hand_calibrate.main(arguments) == 1
    assert 'fit.xyz' in capsys.readouterr().err


def test_an_unloaded_gauge_may_read_what_a_tenth_of_a_newton_metre_gives(tmp_path):
    for scale in (0.5, 1.0):
        # Half the weights, the same gauge: the band does not depend on the heaviest one.
        weighings = [Weighing(t, 120.0 + 100.0 * t, 0.5) for t in scale * np.linspace(0, 1, 11)]
        low, high = fit_gauge(weighings).gauge.no_load_counts
        assert (low, high) == pytest.approx((110.0, 130.0), abs=0.1)


def test_hand_calibrate_prints_every_residual(tmp_path, capsys):
    table = tmp_path / 'weights.csv'
    table.write_text('\n'.join(weighing_table(HandMechanics(HandBody(), 5), 5)))
    assert hand_calibrate.main([str(table), '--calibration', str(tmp_path / 'hand.yaml')]) == 0
    told = capsys.readouterr().out
    assert told.count('1.1768') == 3
    assert 'hysteresis' not in told


def test_hand_calibrate_says_whose_weights_show_no_hysteresis(tmp_path, capsys):
    table = tmp_path / 'weights.csv'
    rising = [
        f'{finger},{0.25 * k},0.05,{120 + 12 * k},0.5' for finger in (1, 3) for k in range(6)
    ]
    up_and_down = [f'2,{mass},0.05,{120 + 48 * mass},0.5' for mass in (0, 0.5, 1, 1.5, 2, 1, 0)]
    table.write_text(
        '\n'.join(['finger,mass_kg,arm_m,counts,noise_counts', *rising, *up_and_down])
    )
    assert hand_calibrate.main([str(table), '--calibration', str(tmp_path / 'hand.yaml')]) == 0
    assert 'finger 1, 3: the weights were hung in one direction only' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('mass,count\n', 'first line must be'),
        ('finger,mass_kg,arm_m,counts,noise_counts\n1,0.5,x,120,0.5\n', 'line 2'),
        ('finger,mass_kg,arm_m,counts,noise_counts\n7,0.5,0.05,120,0.5\n', 'finger 7'),
        ('finger,mass_kg,arm_m,counts,noise_counts\n1,nan,0.05,120,0.5\n', 'impossible'),
        ('finger,mass_kg,arm_m,counts,noise_counts\n', 'no weighings'),
    ],
)
def test_hand_calibrate_fails_with_one_sentence(text, complaint, tmp_path, capsys):
    table = tmp_path / 'weights.csv'
    table.write_text(text)
    assert hand_calibrate.main([str(table), '--calibration', str(tmp_path / 'out.yaml')]) == 1
    error = capsys.readouterr().err
    assert complaint in error
    assert not (tmp_path / 'out.yaml').exists()
