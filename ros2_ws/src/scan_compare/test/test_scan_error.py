# SPDX-License-Identifier: Apache-2.0
"""The command as a user runs it."""

from __future__ import annotations

import csv
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scan_shells import scan_points, shell, two_dents
from tests.executables import executable

from scan_compare.commands.scan_error import main
from scan_compare.model_file import surface_of_object
from scan_compare.rigid import rotation_from_vector
from scan_compare.scan_file import read_scan

SHELL = surface_of_object('tennis_ball')
REST = SHELL.limit.limit_positions(SHELL.rest)
TURN = rotation_from_vector(np.array([0.03, -0.02, 0.0]))
POINTS = 8_000
GRASPED = shell(REST, SHELL.mesh.triangles, SHELL.thickness, two_dents(0.005, bulge=0.0003))


@pytest.fixture(scope='module')
def grasp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """scan.xyz (inch), rest.xyz (mm), surface.ply and rest.ply (m): a synthetic grasp."""
    folder = tmp_path_factory.mktemp('grasp')
    np.savetxt(folder / 'scan.xyz', scan_points(GRASPED, POINTS) @ TURN / 0.0254, fmt='%.6f')
    np.savetxt(folder / 'rest.xyz', 1e3 * scan_points(SHELL, POINTS) @ TURN, fmt='%.6f')
    for name, control in (('surface.ply', GRASPED.deformed), ('rest.ply', GRASPED.rest)):
        positions = GRASPED.limit.limit_positions(control)
        mesh = trimesh.Trimesh(positions, GRASPED.mesh.triangles, process=False)
        (folder / name).write_bytes(mesh.export(file_type='ply', vertex_normal=False))
    return folder


@pytest.fixture
def files(tmp_path: Path, grasp: Path) -> Path:
    """A folder of the test's own with the files of the grasp."""
    for file in grasp.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path


def test_json_is_one_document_on_stdout(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(
        [str(files / 'scan.xyz'), '--object', 'tennis_ball', '--json',
         '--surface', str(files / 'surface.ply'), '--undeformed', str(files / 'rest.xyz')]
    )  # fmt: skip
    result = json.loads(capsys.readouterr().out)
    assert code == 0
    assert result['mean_error_m'] == pytest.approx(0.1013e-3, rel=0.1)
    truth = GRASPED.max_displacement
    assert result['max_displacement_m'] == pytest.approx(truth, rel=1e-3)
    assert result['measured_max_displacement_m'] == pytest.approx(truth, abs=0.15e-3)
    assert any('unit inferred: inch' in note for note in result['notes'])


def test_a_report_opens_offline_and_its_error_map_is_a_scan(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = files / 'report'
    arguments = [str(files / 'scan.xyz'), '--object', 'tennis_ball', '--out', str(out)]
    arguments += ['--surface', str(files / 'surface.ply'), '--rest', str(files / 'rest.ply')]
    assert main(arguments) == 0
    assert 'mean error (unsigned, scan vertices)' in capsys.readouterr().out
    page = (out / 'report.html').read_text()
    assert page.count('data:image/png;base64,') == 2
    assert 'http' not in page
    assert read_scan(out / 'error.ply', 'm').points.shape == (POINTS, 3)
    points = list(csv.DictReader((out / 'error.csv').read_text().splitlines()))
    assert len(points) == POINTS
    assert set(points[0]) == {'x_m', 'y_m', 'z_m', 'distance_m', 'used', 'in_dent'}
    assert {row['in_dent'] for row in points} == {row['used'] for row in points} | {'0'}
    written = trimesh.load(out / 'error.ply', process=False)
    stored = written.metadata['_ply_raw']['vertex']['data']
    for name, column in (('x', 'x_m'), ('z', 'z_m'), ('distance', 'distance_m')):
        told = np.array([float(row[column]) for row in points])
        assert np.ravel(stored[name]) == pytest.approx(told, abs=1e-7)
    assert not list(out.glob('*.part'))
    rows = list(csv.DictReader((out / 'comparison.csv').read_text().splitlines()))
    table = {row['statistic']: row for row in rows}
    found = json.loads((out / 'comparison.json').read_text())
    for name, key in (('mean error, area-weighted', 'mean_m'), ('median error', 'median_m'),
                      ('rms error, area-weighted', 'rms_m'), ('95 % of errors below', 'p95_m'),
                      ('max error (single point)', 'max_m')):  # fmt: skip
        weighted = '_area_weighted' if 'area' in name else ''
        for column, region in (('in_dent', 'dent'), ('outside_dent', 'outside_dent')):
            value = found[region + weighted][key]
            assert float(table[name][column]) == pytest.approx(1e3 * value, abs=6e-4)
            assert f'<td class="n">{table[name][column]}</td>' in page
        assert table[name]['unit'] == 'mm'
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    main([*arguments, '--json'])
    assert {path.name: path.read_bytes() for path in out.iterdir()} == first


def test_two_surfaces_are_ranked_and_known_contacts_start_the_fit(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    contacts = np.array([[0.0, 0, 0.03], [0, 0, -0.03], [0.03, 0, 0], [0, 0.03, 0]])
    np.savetxt(files / 'contacts.txt', np.hstack((contacts @ TURN, contacts)))
    code = main(
        [str(files / 'scan.xyz'), '--object', 'tennis_ball', '--surface', str(files / 'rest.ply'),
         '--against', str(files / 'surface.ply'), '--contacts', str(files / 'contacts.txt')]
    )  # fmt: skip
    assert code == 0
    shown = capsys.readouterr().out
    assert f'{files / "surface.ply"} is better than' in shown
    assert 'unobservable, fixed by the contacts: rotation about' in shown


def test_a_cropped_copy_of_the_scan_names_the_undeformed_region(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = np.loadtxt(files / 'scan.xyz')
    np.savetxt(files / 'cropped.xyz', points[np.abs(points[:, 2]) < 0.7], fmt='%.6f')
    arguments = [str(files / 'scan.xyz'), '--object', 'tennis_ball', '--json']
    arguments += ['--surface', str(files / 'surface.ply'), '--undeformed-region']
    assert main([*arguments, str(files / 'cropped.xyz')]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['mean_error_m'] == pytest.approx(0.1013e-3, rel=0.1)
    assert found['registration']['trimmed_fraction'] > 0.3
    assert main([*arguments, str(files / 'rest.xyz')]) == 1
    assert 'none of its points is one of the scan' in capsys.readouterr().err


def test_views_are_merged_and_the_gap_between_them_is_printed(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Views need twenty points of another within reach.
    points = scan_points(GRASPED, 22_000) @ TURN / 0.0254
    views = {'left.xyz': points[points[:, 0] < 0.3], 'right.xyz': points[points[:, 0] > -0.3]}
    for name, view in views.items():
        np.savetxt(files / name, view, fmt='%.6f')
    paths = [str(files / name) for name in views]
    surface = ['--surface', str(files / 'surface.ply')]
    assert main([*paths, '--object', 'tennis_ball', *surface]) == 0
    assert '2 views merged, each refined against the others' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['scan.xyz', '--object', 'tennis_ball', '--unit', 'mm'], 'factor 25.4'),
        (['absent.stl', '--object', 'tennis_ball'], 'absent.stl: No such file'),
        (['scan.xyz', '--object', 'no_such_object'], 'no_such_object'),
        (['scan.xyz', '--object', 'half_soda_can', '--surface', 'surface.ply'], '--rest'),
        (['scan.xyz', '--object', 'tennis_ball', '--surface', 'scan.xyz'], 'triangles'),
        (['few.xyz', '--object', 'tennis_ball'], 'few.xyz: 4 scan points; at least 20'),
        (['nan.xyz', '--object', 'tennis_ball'], 'nan.xyz: all 2 points are NaN'),
        (['scan.xyz', '--object', 'tennis_ball', '--out', 'few.xyz'], 'few.xyz: File exists'),
    ],
)
def test_failures_are_one_sentence_and_exit_code_one(
    files: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    (files / 'few.xyz').write_text('30 0 0\n-30 0 0\n0 30 0\n0 0 30\n')
    (files / 'nan.xyz').write_text('0 nan 0\n1 nan inf\n')
    paths = [str(files / word) if '.' in word and word[0] != '-' else word for word in arguments]
    assert main(paths) == 1
    captured = capsys.readouterr()
    assert captured.out == ''
    assert words in captured.err
    assert len(captured.err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    'arguments',
    [[], ['a.stl'], ['a.stl', '--object', 'x', '--scanner-sigma', '-1'],
     ['a.stl', '--object', 'x', '--start', '1 2 3']],
)  # fmt: skip
def test_wrong_arguments_exit_with_code_two(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


def test_the_installed_command_prints_its_help() -> None:
    command = executable('scan_error')
    shown = subprocess.run([command, '--help'], capture_output=True, text=True, timeout=600)
    assert shown.returncode == 0
    assert '[m]' in shown.stdout
