# SPDX-License-Identifier: Apache-2.0
"""The shape of a scanned dent fixes the wall thickness, which its force does not.

Truth comes from solvers that share nothing with the model: an axisymmetric shell and a
finite-element solid.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from shell_deform.commands import shell_identify
from shell_deform.identify.dent_profile import (
    RINGS,
    DentScan,
    ThicknessFit,
    _Dent,
    _Rings,
    fit_thickness,
)
from shell_deform.identify.force_curve import ForceCurve, IdentificationError
from shell_deform.identify.modulus import identify, squeeze_data, with_thickness
from shell_deform.objects import load_object
from shell_deform.theory.gas import Gas
from shell_deform.verification.axisymmetric import PinnedSphere, forces_at, outer_meridians

SOLID = Path(__file__).parents[4] / 'bags' / 'solid' / 'ball_two_finger.json'
OUTER_RADIUS, NOISE, REGISTRATION = 0.0325, 0.127e-3, 5e-5


@pytest.fixture(scope='module')
def ball():
    return load_object('tennis_ball')


@pytest.fixture(scope='module')
def curve(ball):
    return ForceCurve(ball, control_vertices=250)


def scanned(meridian, generator, count=30_000):
    """Noisy points of the outer face whose quadrant is (radius, height), slightly misplaced."""
    direction = generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    angle = np.arctan2(*meridian.T)
    order = np.argsort(angle)
    away = np.arccos(np.abs(direction[:, 0]))
    distance = np.interp(away, angle[order], np.hypot(*meridian.T)[order])
    distance += NOISE * generator.normal(size=count)
    return direction * distance[:, None] + REGISTRATION * generator.normal(size=3)


def sealed_ball(thickness, young):
    return PinnedSphere(
        OUTER_RADIUS - 0.5 * thickness, thickness, young, 0.5, 1e-3, gas=Gas('sealed')
    )


def fitted(curve, scans, young=12.75e6):
    return fit_thickness(curve, scans, young, NOISE, REGISTRATION)


@pytest.mark.parametrize(
    ('thickness', 'depth'), [(0.0020, [3e-3]), (0.0025, [2.2e-3, 4.5e-3]), (0.0031, [3.5e-3])]
)
def test_scans_of_an_independent_shell_give_its_thickness_within_the_interval(
    curve, thickness, depth
):
    generator = np.random.default_rng(4)
    truth = sealed_ball(thickness, 12e6 * (0.0025 / thickness) ** 2.5)
    scans = [
        DentScan(f'{1e3 * w:.1f} mm', scanned(face, generator), float(w))
        for w, face in zip(depth, outer_meridians(truth, np.array(depth)), strict=True)
    ]
    found = fitted(curve, scans)
    assert abs(found.thickness - thickness) < 1.645 * found.sigma
    assert found.sigma < 0.04 * thickness
    np.testing.assert_allclose(found.depth, np.repeat(depth, 2), atol=0.15e-3)


@pytest.mark.parametrize('depth', [2.6e-3, 6.5e-3])
def test_the_wall_of_a_solid_lies_in_the_interval_that_is_stated_for_it(curve, depth):
    # The shell needs a thinner wall, since that of a solid shears, and says by how much.
    solid = json.loads(SOLID.read_text())
    level = min(solid['levels'], key=lambda one: abs(one['middle_displacement_m'] - depth))
    face = np.array(level['outer_profile_m'])
    scan = DentScan(
        'solid', scanned(face, np.random.default_rng(5)), level['middle_displacement_m']
    )
    found = fitted(curve, [scan])
    truth = solid['thickness_m']
    assert 0.88 < found.thickness / truth < 0.99
    low, high = found.solid_interval
    assert low < truth < high
    assert high - low < 0.2 * truth
    # material squeezed and sheared by the pin deepens the pin's own place, not the dent
    assert (found.depth < 0.95 * level['middle_displacement_m']).all()


def test_a_finger_in_the_scan_changes_nothing(curve):
    face = outer_meridians(sealed_ball(0.0025, 12e6), np.array([3e-3]))[0]
    points = scanned(face, np.random.default_rng(6))
    generator = np.random.default_rng(7)
    finger = generator.uniform([0.031, 0.004, -0.003], [0.060, 0.012, 0.003], (1500, 3))
    alone = fitted(curve, [DentScan('ball', points, 3e-3)])
    both = fitted(curve, [DentScan('ball', np.concatenate([points, finger]), 3e-3)])
    assert both.thickness == pytest.approx(alone.thickness, abs=alone.sigma)


def test_a_scan_of_the_unloaded_ball_is_no_dent(curve):
    angle = np.linspace(0.0, 0.5 * np.pi, 50)
    rest = OUTER_RADIUS * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    with pytest.raises(IdentificationError, match='rest: no dent 3 mm deep'):
        fitted(curve, [DentScan('rest', scanned(rest, np.random.default_rng(8)), 3e-3)])


def test_a_scan_of_too_few_points_is_refused(curve):
    face = OUTER_RADIUS * np.array([[0.0, 1.0], [1.0, 0.0]])
    with pytest.raises(IdentificationError, match='sparse: .* from a contact'):
        fitted(curve, [DentScan('sparse', scanned(face, np.random.default_rng(9), 300), 3e-3)])


def test_an_uneven_thickness_is_not_fitted(ball, curve):
    uneven = ForceCurve(ball, control_vertices=80)
    uneven.shell_object = replace(ball, vertex_thickness_m=np.full(80, 0.002))
    with pytest.raises(IdentificationError, match='from place to place'):
        fitted(uneven, [DentScan('any', np.zeros((1, 3)), 1e-3)])


@pytest.mark.parametrize(('share', 'verdict'), [(0.4, 'are NOT'), (0.02, 'are')])
def test_a_thickness_widens_the_modulus_and_is_told_apart_only_when_known(share, verdict):
    curve = ForceCurve(load_object('tennis_ball_as_printed'), control_vertices=80)
    found = identify(curve, squeeze_data(np.array([[1.0, 2.5e-3]]), 0.01, 1e-6))
    fit = ThicknessFit(2.5e-3, share * 2.5e-3, 2.6e-3, 0.1e-3, np.array([2.4e-3]), 1e-5, 1.0)
    told = with_thickness(found, fit, 2.5)
    assert told.sigma[0] / told.values[0] == pytest.approx(2.5 * share, rel=0.1)
    assert told.correlation[0, 1] < -0.9
    assert f'Modulus and thickness {verdict} separable by these scans' in told.statement[0]
    assert told.interval('thickness_m')[0] > 0.0


@pytest.fixture(scope='module')
def squeeze(tmp_path_factory):
    """A table of three rows, of which the last names a point cloud in millimetres."""
    folder = tmp_path_factory.mktemp('squeeze')
    truth = sealed_ball(0.0022, 15e6)
    depth = np.array([1e-3, 2.5e-3, 4e-3])
    force = forces_at(truth, depth)
    face = outer_meridians(truth, depth[-1:])[0]
    points = 1e3 * scanned(face, np.random.default_rng(10))
    trimesh.PointCloud(points).export(folder / 'deep.ply')
    names = [''] * (len(depth) - 1) + ['deep.ply']
    rows = [f'{f:.4f},{w:.6f},{n}' for f, w, n in zip(force, depth, names, strict=True)]
    table = folder / 'squeeze.csv'
    table.write_text('force_n,displacement_m,scan\n' + '\n'.join(rows) + '\n')
    return table


@pytest.fixture
def coarse(tmp_path):
    """The ball on a coarse mesh, as an object file."""
    shipped = Path(shell_identify.__file__).parents[1] / 'objects' / 'tennis_ball.yaml'
    path = tmp_path / 'ball.yaml'
    path.write_text(shipped.read_text().replace('control_vertices: 640', 'control_vertices: 250'))
    return str(path)


def test_the_command_tells_modulus_and_thickness_apart(squeeze, coarse, capsys):
    command = [str(squeeze), '--object', coarse, '--fit-thickness', '--scan-unit', 'mm', '--json']
    command += ['--theory', 'koiter']
    assert shell_identify.main(command) == 0
    result = json.loads(capsys.readouterr().out)
    for name, truth in (('young_modulus_pa', 15e6), ('thickness_m', 0.0022)):
        low, high = result['parameters'][name]['interval_90']
        assert low < truth < high
    assert result['correlation'][0][1] < -0.9
    assert 'are separable by these scans' in result['statement'][0]
    assert result['e_h_2_5_pa_m_2_5'] == pytest.approx(15e6 * 0.0022**2.5, rel=0.03)


@pytest.mark.parametrize(
    ('name', 'content', 'message'),
    [
        ('nowhere.ply', None, 'there is no such file'),
        ('scan.ply', 'ply\nnonsense', 'PLY header without'),
        ('scan.xyz', '0 0 0\n1 nan 0\n', 'vertex 1 is not finite'),
        ('scan.xyz', '0 0 0\n0 0.1 0\n', 'register it to the frame'),
    ],
)
def test_a_bad_scan_is_one_sentence(tmp_path, coarse, capsys, name, content, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    table = tmp_path / 'squeeze.csv'
    table.write_text(f'force_n,displacement_m,scan\n10.6,0.00256,{name}\n')
    plot = tmp_path / 'fit.png'
    command = [str(table), '--object', coarse, '--fit-thickness', '--plot', str(plot)]
    assert shell_identify.main(command) == 1
    error = capsys.readouterr().err
    assert name in error and message in error and error.count('\n') == 1
    assert not plot.exists()


@pytest.mark.parametrize(
    ('table', 'message'),
    [
        ('1.0,0.001\n', 'add a column `scan`'),
        ('force_n,displacement_m,scan\n1.0,0.001,\n', 'add a column `scan`'),
    ],
)
def test_a_thickness_without_scans_is_one_sentence(tmp_path, capsys, table, message):
    path = tmp_path / 'squeeze.csv'
    path.write_text(table)
    assert shell_identify.main([str(path), '--object', 'tennis_ball', '--fit-thickness']) == 1
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_pressure_and_thickness_together_are_wrong_arguments(capsys):
    with pytest.raises(SystemExit) as caught:
        shell_identify.main(
            ['x.csv', '--object', 'tennis_ball', '--fit-pressure', '--fit-thickness']
        )
    assert caught.value.code == 2
    assert 'not allowed with' in capsys.readouterr().err


def test_what_lies_far_from_its_ring_is_left_out_of_it():
    generator = np.random.default_rng(71)
    nodes, count = np.linspace(0.0, 4e-3, 5), 60
    off = 0.8e-3 + 0.02e-3 * generator.standard_normal((RINGS, count))
    off[:, 0] += 0.3e-3
    distance = np.tile(off.reshape(-1), (len(nodes), 1))
    ring = np.repeat(np.arange(RINGS), count)
    dent = _Dent('dent', np.zeros((RINGS * count, 3)), ring, ring * 0, 1e-3, 3e-3)
    rings = _Rings(dent, nodes, distance, 0.02e-3)
    # The finger in each ring is gone: the means are those of all others.
    assert rings.means(nodes, distance)(2e-3) == pytest.approx(off[:, 1:].mean(axis=1), abs=1e-6)
