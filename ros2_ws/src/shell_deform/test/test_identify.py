"""What force and displacement say about a shell, and what they cannot."""

import json

import numpy as np
import pytest

from shell_deform.commands import shell_identify
from shell_deform.identify import (
    ForceCurve,
    IdentificationError,
    SqueezeData,
    cross_validate,
    identify,
    squeeze_data,
    thickness_sensitivity,
)
from shell_deform.objects import load_object

PUBLISHED = np.array([[10.631, 2.56e-3], [16.503, 6.05e-3], [20.373, 9.12e-3], [21.485, 10.27e-3]])


@pytest.fixture(scope='module')
def ball():
    return load_object('tennis_ball')


@pytest.fixture(scope='module')
def curve(ball):
    return ForceCurve(ball, control_vertices=350)


def test_the_first_published_row_gives_the_modulus_of_the_shipped_ball(curve):
    data = squeeze_data(PUBLISHED[:1], 0.1, 0.127e-3)
    found = identify(curve, data)
    assert found.values[0] == pytest.approx(12.75e6, rel=0.01)
    # the scanner's 0.127 mm alone moves the modulus by about 4 %
    assert found.sigma[0] / found.values[0] == pytest.approx(0.03, abs=0.015)


def test_modulus_from_row_one_predicts_the_other_forces_within_six_percent(curve):
    _, predicted = cross_validate(curve, squeeze_data(PUBLISHED, 0.1, 0.127e-3), 1)
    np.testing.assert_allclose(predicted, PUBLISHED[1:, 0], rtol=0.06)


def test_force_grows_with_modulus_times_thickness_to_two_and_a_half(ball):
    assert thickness_sensitivity(ball, squeeze_data(PUBLISHED, 0.1, 1e-4)) == pytest.approx(
        2.5, abs=0.1
    )


def test_true_modulus_lies_in_the_stated_interval_about_nine_times_in_ten():
    curve = ForceCurve(load_object('tennis_ball_as_printed'), control_vertices=350)
    generator = np.random.default_rng(5)
    depth = np.linspace(1e-3, 8e-3, 8)
    truth = curve.force(depth, 11e6)
    inside = 0
    for _ in range(100):
        noisy = truth + 0.15 * generator.normal(size=len(depth))
        data = SqueezeData(noisy, depth, np.full(8, 0.15), np.full(8, 1e-6))
        low, high = identify(curve, data).interval('young_modulus_pa')
        inside += low <= 11e6 <= high
    assert 85 <= inside <= 95


def test_pressure_of_a_blown_ball_is_recovered(curve):
    depth = np.array([1e-3, 3e-3, 6e-3, 9e-3])
    truth = curve.force(depth, 9e6, 20e3)
    data = SqueezeData(truth, depth, np.full(4, 0.05), np.full(4, 1e-6))
    found = identify(curve, data, pressure=True)
    assert found.values[1] == pytest.approx(20e3, rel=0.02)
    assert found.values[0] == pytest.approx(9e6, rel=0.01)


def test_two_unknowns_from_one_row_are_refused(curve):
    with pytest.raises(IdentificationError, match='two rows'):
        identify(curve, squeeze_data(PUBLISHED[:1], 0.1, 1e-4), pressure=True)


def test_a_row_that_is_not_a_number_is_named():
    with pytest.raises(IdentificationError, match='row 2'):
        squeeze_data(np.array([[1.0, 1e-3], [np.nan, 2e-3]]), 0.1, 1e-4)


def test_command_prints_what_it_found(tmp_path, capsys):
    table, plot = tmp_path / 'squeeze.csv', tmp_path / 'squeeze.png'
    table.write_text('force_n,displacement_m\n10.631,0.00256\n16.503,0.00605\n')
    command = [str(table), '--object', 'tennis_ball', '--plot', str(plot), '--json']
    assert shell_identify.main(command) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['parameters']['young_modulus_pa']['value'] == pytest.approx(13e6, rel=0.05)
    assert result['thickness_exponent'] == pytest.approx(2.5, abs=0.1)
    assert plot.read_bytes().startswith(b'\x89PNG')


def test_a_missing_file_is_one_sentence(capsys):
    assert shell_identify.main(['nothing.csv', '--object', 'tennis_ball']) == 1
    assert 'nothing.csv does not exist' in capsys.readouterr().err
