# SPDX-License-Identifier: Apache-2.0
"""What force and displacement say about a shell, and what they cannot."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from shell_deform.building import with_material
from shell_deform.commands import shell_identify
from shell_deform.identify.force_curve import ForceCurve, IdentificationError
from shell_deform.identify.modulus import (
    SqueezeData,
    cross_validate,
    identify,
    squeeze_data,
    thickness_sensitivity,
)
from shell_deform.identify.squeeze_bag import _good, read_squeeze
from shell_deform.objects import load_object

PUBLISHED = np.array([[10.631, 2.56e-3], [16.503, 6.05e-3], [20.373, 9.12e-3], [21.485, 10.27e-3]])
BAGS = Path(__file__).parents[4] / 'bags'
SOLID = BAGS / 'solid' / 'ball_two_finger.json'
COUNT_N = 0.2
"""One count of the 8-bit gauge at 50 mm."""


@pytest.fixture(scope='module')
def ball():
    return load_object('tennis_ball')


@pytest.fixture(scope='module')
def curve(ball):
    return ForceCurve(ball, control_vertices=350)


class SplineCurve:
    """The curve of a ball, solved at two moduli: many noisy squeezes need many depths.

    Between them its forces are linear in the modulus, but for how its gas bends the shell.
    """

    def __init__(self, curve, deepest, points=28):
        self.shell_object = curve.shell_object
        self.excess_stiffness, self.force_sigma = curve.excess_stiffness, curve.force_sigma
        self._own = curve.shell_object.young_modulus_pa
        self._step = 0.2 if curve.shell_object.gas.kind == 'sealed' else 1.0
        depth = np.concatenate([[0.0], np.geomspace(1e-4, 1.05 * deepest, points)])
        forces = [np.zeros_like(depth), np.zeros_like(depth)]
        forces[1][1:] = curve.force(depth[1:], self._own)
        if self._step < 1.0:
            forces[0][1:] = curve.force(depth[1:], (1.0 - self._step) * self._own)
        self._less, self._here = (CubicSpline(depth, force) for force in forces)

    def force(self, displacement, young, gauge=0.0):
        less, here = self._less(displacement), self._here(displacement)
        return here + (young / self._own - 1.0) / self._step * (here - less)


def noisy(curve, young, generator, rows=30, deepest=8e-3):
    """A squeeze seen by 8-bit gauges: their zero, its drift, gain, noise and whole counts."""
    depth = np.linspace(5e-4, deepest, rows)
    zero, gain = 0.1 * generator.normal(), 1.0 + 0.01 * generator.normal()
    drift = 0.01 * np.cumsum(generator.normal(size=rows))
    force = gain * curve.force(depth, young) + zero + drift + 0.1 * generator.normal(size=rows)
    counted = COUNT_N * np.round(force / COUNT_N)
    sigma = np.hypot(0.1, COUNT_N / np.sqrt(12.0))
    return SqueezeData(
        counted,
        depth + 2e-5 * generator.normal(size=rows),
        np.full(rows, sigma),
        np.full(rows, 2e-5),
        sigma_zero=0.12,
        sigma_gain=0.01,
    )


def test_the_first_published_row_gives_the_modulus_of_the_shipped_ball(curve):
    data = squeeze_data(PUBLISHED[:1], 0.1, 0.127e-3)
    found = identify(curve, data)
    assert found.values[0] == pytest.approx(12.75e6, rel=0.01)
    # the scanner's 0.127 mm alone moves the modulus by about 3 %
    assert found.sigma[0] / found.values[0] == pytest.approx(0.03, abs=0.015)


def test_modulus_from_row_one_predicts_the_other_forces_within_six_percent(curve):
    _, predicted = cross_validate(curve, squeeze_data(PUBLISHED, 0.1, 0.127e-3), 1)
    np.testing.assert_allclose(predicted, PUBLISHED[1:, 0], rtol=0.06)


def test_force_grows_with_modulus_times_thickness_to_two_and_a_half(ball):
    assert thickness_sensitivity(
        ForceCurve(ball), squeeze_data(PUBLISHED, 0.1, 1e-4)
    ) == pytest.approx(2.5, abs=0.1)


@pytest.fixture(scope='module')
def airless():
    printed = load_object('tennis_ball_as_printed')
    return SplineCurve(ForceCurve(printed, control_vertices=350), 8e-3)


def test_eight_bit_gauges_that_drift_give_the_modulus_and_an_honest_interval(airless):
    truth, inside, errors = 11e6, 0, []
    for seed in range(200):
        found = identify(airless, noisy(airless, truth, np.random.default_rng(seed)))
        low, high = found.interval('young_modulus_pa')
        inside += low <= truth <= high
        errors.append(found.values[0] / truth - 1.0)
        assert found.stiffness_product == pytest.approx(found.values[0] * 0.0025**2.5)
    assert np.abs(errors).max() < 0.05
    assert 170 <= inside <= 190


def test_a_shared_gain_does_not_average_out(airless):
    depth = np.linspace(1e-3, 8e-3, 40)
    force = airless.force(depth, 12e6)
    alone = SqueezeData(force, depth, np.full(40, 0.1), np.full(40, 1e-6))
    shared = SqueezeData(force, depth, np.full(40, 0.1), np.full(40, 1e-6), 0.0, 0.01)
    assert identify(airless, alone).sigma[0] < 0.003 * 12e6
    assert identify(airless, shared).sigma[0] == pytest.approx(0.01 * 12e6, rel=0.1)


def test_on_a_solid_the_bias_is_a_term_of_the_model(curve):
    # Finite-element solid of 14.196 MPa: the thin shell needs less, and says by how much.
    solid = json.loads(SOLID.read_text())
    levels = [level for level in solid['levels'] if 1e-3 < level['middle_displacement_m'] < 9e-3][
        ::3
    ]
    table = np.array([[level['force_n'], level['middle_displacement_m']] for level in levels])
    found = identify(curve, squeeze_data(table, 0.05, 1e-5))
    truth = solid['young_modulus_pa']
    assert 0.90 < found.values[0] / truth < 0.99
    low, high = found.interval('solid_modulus_pa')
    assert low < truth < high
    assert found.solid_modulus == pytest.approx(truth, rel=0.05)
    assert 'E low by up to 10 %' in ' '.join(found.statement)


@pytest.fixture(scope='module')
def rubber():
    """The finite-element ball with sealed air: force [N] over travel of the pin, modulus [Pa]."""
    solid = json.loads(SOLID.read_text())
    travel = [0.0, *(level['outer_displacement_m'] for level in solid['levels'])]
    force = [0.0, *(level['force_n'] for level in solid['levels'])]
    return CubicSpline(travel, force), solid['young_modulus_pa'], solid['poisson_ratio']


@pytest.fixture(scope='module')
def thick(ball, rubber):
    described = with_material(ball, rubber[1], rubber[2])
    return SplineCurve(ForceCurve(described, None, 'thick'), 9.7e-3, points=14)


def test_a_thick_wall_finds_the_modulus_of_a_solid_without_a_correction(thick, rubber):
    force, truth, _ = rubber
    depth = np.linspace(0.5e-3, 8e-3, 12)
    table = np.column_stack([depth, force(depth)])[:, ::-1]
    found = identify(thick, squeeze_data(table, 0.05, 1e-5))
    assert found.values[0] == pytest.approx(truth, rel=0.02)
    assert found.solid_modulus == found.values[0]
    assert 'thin-shell' not in ' '.join(found.statement)


def test_the_interval_of_a_thick_wall_covers_the_solid(thick, rubber):
    force, truth, _ = rubber

    class Solid:
        def force(self, displacement, young):
            return force(displacement)

    inside, errors = 0, []
    for seed in range(200):
        found = identify(thick, noisy(Solid(), truth, np.random.default_rng(seed), deepest=9.7e-3))
        low, high = found.interval('young_modulus_pa')
        inside += low <= truth <= high
        errors.append(found.values[0] / truth - 1.0)
    assert abs(np.mean(errors)) < 0.022
    assert 170 <= inside <= 190


@pytest.mark.parametrize('gauge', [0.2e5, 0.8e5])
def test_pressure_of_a_blown_ball_is_recovered_by_eight_bit_gauges(ball, gauge):
    # Truth and fit share their mesh, so a coarse one will do.
    curve = ForceCurve(ball, control_vertices=150)
    depth = np.array([0.7e-3, 2e-3, 4e-3, 6e-3, 9e-3])
    generator = np.random.default_rng(3)
    force = curve.force(depth, 9e6, gauge) + 0.1 * generator.normal(size=5)
    force = COUNT_N * np.round(force / COUNT_N)
    data = SqueezeData(force, depth, np.full(5, 0.11), np.full(5, 2e-5))
    found = identify(curve, data, pressure=True, start=(10e6, 5e4))
    assert found.values[1] == pytest.approx(gauge, rel=0.1)
    assert found.values[0] == pytest.approx(9e6, rel=0.1)


def test_two_unknowns_from_one_row_are_refused(curve):
    with pytest.raises(IdentificationError, match='two rows'):
        identify(curve, squeeze_data(PUBLISHED[:1], 0.1, 1e-4), pressure=True)


@pytest.mark.parametrize(
    ('table', 'message'),
    [
        ([[1.0, 1e-3], [np.nan, 2e-3]], 'force of row 2'),
        ([[1.0, 1e-3, 0.0]], 'sigma_force of row 1 is 0'),
        ([[1.0, -1e-3]], 'only squeezed states'),
        ([[1.0]], 'the table has 1 columns'),
    ],
)
def test_a_row_that_cannot_be_used_is_named(table, message):
    with pytest.raises(IdentificationError, match=message):
        squeeze_data(np.array(table), 0.1, 1e-4)


def test_force_and_displacement_of_a_curve_are_inverse(curve):
    depth = np.array([5e-3, 2e-3])
    force = curve.force(depth, 10e6, 5e3)
    np.testing.assert_allclose(curve.displacement(force, 10e6, 5e3), depth, rtol=1e-5)
    assert curve.modulus(float(force[0]), 5e-3, 5e3) == pytest.approx(10e6, rel=1e-4)


def test_a_recorded_grasp_gives_the_forces_of_its_truth():
    data = read_squeeze(BAGS / 'tennis_ball_two_finger')
    solid = json.loads(SOLID.read_text())['levels']
    truth = np.interp(
        data.displacement,
        [level['middle_displacement_m'] for level in solid],
        [level['force_n'] for level in solid],
    )
    assert len(data.force) >= 8
    np.testing.assert_allclose(data.force, truth, rtol=0.06)
    # The gauge's gain is the same in all rows, and no row claims more than that by itself.
    assert 0.01 < data.sigma_gain < 0.05
    assert (data.sigma_force < data.sigma_gain * data.force.max()).all()


@pytest.mark.parametrize('name', ['solid', 'published', 'nowhere.mcap'])
def test_what_is_no_bag_is_one_sentence(capsys, name):
    assert shell_identify.main([str(BAGS / name), '--object', 'tennis_ball']) == 1
    error = capsys.readouterr().err
    assert name in error and error.count('\n') == 1


def test_command_prints_what_it_found(tmp_path, capsys):
    table, plot = tmp_path / 'squeeze.csv', tmp_path / 'squeeze.png'
    table.write_text('force_n,displacement_m\n10.631,0.00256\n16.503,0.00605\n')
    command = [str(table), '--object', 'tennis_ball', '--plot', str(plot), '--json']
    command += ['--theory', 'koiter']
    assert shell_identify.main(command) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['parameters']['young_modulus_pa']['value'] == pytest.approx(13e6, rel=0.05)
    assert result['solid_modulus_pa']['value'] > result['parameters']['young_modulus_pa']['value']
    assert result['thickness_exponent'] == pytest.approx(2.5, abs=0.1)
    assert plot.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        ('', 'holds no numbers'),
        ('force_n,displacement_m\n', 'holds no numbers'),
        ('force_n,displacement_m\n1,2,3\n4,5\n', 'columns'),
        ('1.0,abc\n', 'row 1'),
    ],
)
def test_a_table_that_cannot_be_read_is_one_sentence(tmp_path, capsys, content, message):
    path = tmp_path / 'squeeze.csv'
    path.write_text(content)
    assert shell_identify.main([str(path), '--object', 'tennis_ball']) == 1
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_wrong_numbers_are_wrong_arguments(capsys):
    for option in ('--pin-radius=0', '--sigma-force=-1', '--sigma-zero=-1', '--sigma-gain=nan'):
        with pytest.raises(SystemExit) as caught:
            shell_identify.main(['squeeze.csv', '--object', 'tennis_ball', option])
        assert caught.value.code == 2
        assert option.split('=')[0] in capsys.readouterr().err


def test_a_plot_without_a_folder_fails_before_the_work(tmp_path, capsys):
    plot = str(tmp_path / 'nowhere' / 'fit.png')
    assert shell_identify.main(['x.csv', '--object', 'tennis_ball', '--plot', plot]) == 1
    assert 'no such folder' in capsys.readouterr().err


def test_a_missing_file_is_one_sentence(capsys):
    assert shell_identify.main(['nothing.csv', '--object', 'tennis_ball']) == 1
    assert 'nothing.csv does not exist' in capsys.readouterr().err


def cloud_of(**columns):
    """A point cloud message of float32 columns; `finger` and `flags` are bytes."""
    kinds = {name: 2 if name in ('finger', 'flags') else 7 for name in columns}
    layout = np.dtype([(name, 'u1' if kind == 2 else '<f4') for name, kind in kinds.items()])
    points = np.zeros(len(columns['flags']), layout)
    for name, column in columns.items():
        points[name] = column
    fields = [
        SimpleNamespace(name=name, datatype=kind, offset=layout.fields[name][1])
        for name, kind in kinds.items()
    ]
    return SimpleNamespace(fields=fields, point_step=layout.itemsize, data=points.tobytes())


def test_only_a_tared_fresh_fitted_gauge_that_touches_tells_a_squeeze():
    flags = [1, 0, 1 | 2, 1 | 4, 1 | 8, 1 | 16, 1 | 32]
    fingers, rows = _good(
        cloud_of(
            finger=range(7),
            nx=0.6,
            ny=0.8,
            nz=0.0,
            fx=3.0,
            fy=4.0,
            fz=9.0,
            sigma_n=0.2,
            travel=2e-3,
            sigma_travel=1e-4,
            flags=flags,
        )  # fmt: skip
    )
    assert fingers == [0]
    assert rows == pytest.approx(np.array([[2e-3, 5.0, 0.2, 1e-4]]), rel=1e-6)
