# SPDX-License-Identifier: Apache-2.0
"""The command `object_prepare`."""

import json

import numpy as np
import pytest
import scan_shapes as scans
import trimesh

from shell_deform.objects import load_object, object_mesh

pytest.importorskip('fast_simplification')

MATERIAL = ['--young', '2e6', '--poisson', '0.45']


def main(*arguments):
    from shell_deform.commands.object_prepare import main as command

    return command([str(argument) for argument in arguments])


@pytest.fixture(scope='module')
def scan(tmp_path_factory):
    path = tmp_path_factory.mktemp('scan') / 'potato.stl'
    points, faces = scans.damaged(*scans.potato(5, 5e-5))
    trimesh.Trimesh(1e3 * points, faces, process=False).export(path)
    return path


def test_a_scan_becomes_an_object_that_can_be_loaded(scan, tmp_path, capsys):
    top = scans.potato_radius(np.array([[0, 0, 1.0]]))[0]
    code = main(
        scan, '--unit', 'mm', '--thickness', 0.0005, *MATERIAL, '--vertices', 400,
        '--contact', f'0,0,{top},0.002', '--out', tmp_path, '--json',
    )  # fmt: skip
    report = json.loads(capsys.readouterr().out)
    assert code == 0
    assert report['fit']['rms_m'] == pytest.approx(5e-5, rel=0.1)
    assert report['scan']['pieces'] == 2
    assert report['scan']['holes_closed'] == 1
    potato = load_object(tmp_path / 'potato.yaml')
    assert (potato.young_modulus_pa, potato.poisson_ratio) == (2e6, 0.45)
    assert potato.contacts[0].radius_m == 0.002
    mesh = object_mesh(potato)
    assert mesh.vertex_count == report['vertices'] == potato.control_vertices
    assert mesh.is_closed
    assert (tmp_path / 'potato_fit.png').stat().st_size > 10_000
    errors = np.load(tmp_path / 'potato_error.npz')
    assert errors['distance_m'].shape == (len(errors['points_m']),)


def test_without_json_the_results_are_told_in_words(scan, tmp_path, capsys):
    assert main(
        scan, '--unit', 'mm', '--thickness', 0.003, *MATERIAL, '--vertices', 300,
        '--name', 'spud', '--out', tmp_path,
    ) == 0  # fmt: skip
    text = capsys.readouterr().out
    assert text.startswith('spud: ')
    assert 'warning: the wall is' in text
    assert 'spud.yaml' in text


def test_a_thickness_per_place_is_kept_per_vertex(scan, tmp_path, capsys):
    points, _ = scans.potato(2, 0.0)
    table = np.column_stack([points, np.full(len(points), 0.001)])
    np.savetxt(tmp_path / 'wall.csv', table, delimiter=',')
    assert main(
        scan, '--unit', 'mm', '--thickness-file', tmp_path / 'wall.csv', *MATERIAL,
        '--vertices', 300, '--out', tmp_path, '--json',
    ) == 0  # fmt: skip
    potato = load_object(tmp_path / 'potato.yaml')
    np.testing.assert_allclose(potato.vertex_thickness_m, 0.001)
    assert len(potato.vertex_thickness_m) == json.loads(capsys.readouterr().out)['vertices']


@pytest.mark.parametrize(
    ('extra', 'message'),
    [
        (['--thickness', '0'], '0 is not above zero'),
        (['--thickness', '0.001', '--vertices', '5'], '5 is not between 40 and 100000'),
        (['--thickness', '0.001', '--contact', '1,2'], 'is not X,Y,Z,RADIUS'),
        (['--thickness', '0.001', '--vertices', '50', '--error', '1e-4'], 'not both'),
        ([], 'one of the arguments --thickness/--thickness-m --thickness-file is required'),
    ],
)
def test_wrong_arguments_exit_two(scan, extra, message, capsys):
    with pytest.raises(SystemExit) as caught:
        main(scan, '--unit', 'mm', *MATERIAL, *extra)
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_an_unreadable_scan_is_one_sentence_and_exit_one(tmp_path, capsys):
    path = tmp_path / 'broken.stl'
    path.write_bytes(b'solid nothing')
    assert main(path, '--unit', 'mm', '--thickness', 0.001, *MATERIAL, '--out', tmp_path) == 1
    output = capsys.readouterr()
    assert output.out == ''
    assert output.err.startswith('object_prepare: ')
    assert 'broken.stl' in output.err


@pytest.mark.parametrize(
    ('extra', 'message'),
    [
        (['--thickness', '0.06'], 'thicker than the object is round'),
        (['--thickness', '0.001', '--contact', '1,1,1,0.001'], 'm from the scan'),
        (['--thickness-file', 'nothing.csv'], 'nothing.csv'),
    ],
)
def test_what_cannot_be_an_object_leaves_no_file(scan, tmp_path, capsys, extra, message):
    out = tmp_path / 'out'
    assert main(scan, '--unit', 'mm', *extra, *MATERIAL, '--vertices', 300, '--out', out) == 1
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
    assert not out.exists()


@pytest.mark.parametrize('name', ['nothing.stl', 'nan.obj'])
def test_a_missing_or_broken_scan_is_named(tmp_path, capsys, name):
    path = tmp_path / name
    if name == 'nan.obj':
        path.write_text('v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n')
    assert main(path, '--unit', 'mm', '--thickness', 0.001, *MATERIAL, '--out', tmp_path) == 1
    error = capsys.readouterr().err
    assert name in error and error.count('\n') == 1
    assert ('no such file' in error) == (name == 'nothing.stl')


def test_an_open_scan_becomes_an_object_with_a_ring_beyond_its_edge(tmp_path, capsys):
    points, faces = scans.bowl(4, 5e-5)
    path = tmp_path / 'bowl.ply'
    trimesh.Trimesh(1e3 * points, faces, process=False).export(path)
    assert main(
        path, '--unit', 'mm', '--thickness', 0.001, *MATERIAL, '--vertices', 300,
        '--out', tmp_path, '--json',
    ) == 0  # fmt: skip
    report = json.loads(capsys.readouterr().out)
    assert report['open_rims'] == 1
    bowl = load_object(tmp_path / 'bowl.yaml')
    mesh = object_mesh(bowl)
    assert not mesh.is_closed
    assert mesh.vertex_count > report['vertices']
    assert mesh.active.sum() < mesh.triangle_count
