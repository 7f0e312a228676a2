# SPDX-License-Identifier: Apache-2.0
"""`object_prepare` with a user's own scan: unit, missing parts, primitives, contacts, gas."""

import gzip
import json

import numpy as np
import pytest
import trimesh

from shell_deform.objects import load_object
from shell_deform.objects.primitive_fit import capped_share, fitting_primitive
from shell_deform.objects.scan_clean import clean_scan

pytest.importorskip('fast_simplification')

MATERIAL = ['--young', '2e6', '--poisson', '0.45', '--thickness', '0.001']


def main(*arguments):
    from shell_deform.commands.object_prepare import main as command

    return command([str(argument) for argument in arguments])


def _noisy(mesh, noise=1e-4, seed=0):
    generator = np.random.default_rng(seed)
    mesh.vertices += noise * generator.standard_normal(mesh.vertices.shape)
    return mesh


def _moved(mesh):
    turn = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0], [0.01, 0.0, 0.0])
    return mesh.apply_transform(turn)


def _scan(mesh):
    return clean_scan(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64))


def _part(mesh, share):
    """The triangles of the lower `share` of a mesh, by area along z."""
    middle = mesh.triangles_center[:, 2]
    order = np.argsort(middle)
    kept = order[np.cumsum(mesh.area_faces[order]) <= share * mesh.area]
    return trimesh.Trimesh(mesh.vertices, mesh.faces[kept], process=True)


@pytest.mark.parametrize('share', [0.5, 0.8, 1.0])
def test_part_of_a_ball_is_known_as_one_and_how_much_is_missing(share):
    ball = trimesh.creation.icosphere(5, 0.0325)
    part = ball if share == 1.0 else _part(ball, share)
    found = fitting_primitive(_scan(_noisy(part)))
    assert found.surface == {'sphere': {'outer_diameter_m': pytest.approx(0.065, abs=2e-4)}}
    assert found.missing == pytest.approx(1.0 - share, abs=0.02)


@pytest.mark.parametrize('ends', ['open', 'closed'])
def test_a_can_is_known_with_and_without_its_ends(ends):
    can = trimesh.creation.cylinder(0.033, 0.115, sections=120)
    can = can.subdivide_to_size(0.004)
    if ends == 'open':
        side = np.abs(can.face_normals[:, 2]) < 0.5
        can = trimesh.Trimesh(can.vertices, can.faces[side], process=True)
    found = fitting_primitive(_scan(_noisy(_moved(can), 5e-5)))
    cylinder = found.surface['cylinder']
    assert cylinder['outer_diameter_m'] == pytest.approx(0.066, abs=3e-4)
    assert cylinder['length_m'] == pytest.approx(0.115, abs=2e-3)
    assert cylinder['ends'] == ends
    assert found.missing == pytest.approx(0.0, abs=0.05)


def test_half_a_can_says_that_half_of_it_is_missing():
    can = trimesh.creation.cylinder(0.033, 0.115, sections=120).subdivide_to_size(0.004)
    side = (np.abs(can.face_normals[:, 2]) < 0.5) & (can.triangles_center[:, 0] > 0.0)
    half = trimesh.Trimesh(can.vertices, can.faces[side], process=True)
    found = fitting_primitive(_scan(_noisy(_moved(half), 5e-5)))
    assert found.kind == 'cylinder'
    assert found.missing == pytest.approx(0.5, abs=0.05)


def test_a_cup_is_a_cone():
    angle = np.linspace(0, 2 * np.pi, 161)[:-1]
    rings = np.linspace(0, 0.1, 41)
    radius = 0.03 + 0.12 * rings
    points = np.array(
        [[r * np.cos(a), r * np.sin(a), z] for z, r in zip(rings, radius, strict=True)
         for a in angle]
    )  # fmt: skip
    faces = []
    for i in range(len(rings) - 1):
        for j in range(160):
            a, b = 160 * i + j, 160 * i + (j + 1) % 160
            faces += [(a, b, a + 160), (b, b + 160, a + 160)]
    found = fitting_primitive(_scan(_noisy(_moved(trimesh.Trimesh(points, faces)), 5e-5)))
    cone = found.surface['cone']
    assert cone['outer_diameters_m'] == pytest.approx([0.06, 0.084], abs=5e-4)
    assert cone['length_m'] == pytest.approx(0.1, abs=2e-3)


def test_a_shape_that_is_none_offers_none():
    box = trimesh.creation.box((0.06, 0.05, 0.09)).subdivide_to_size(0.004)
    assert fitting_primitive(_scan(_noisy(box))) is None
    assert capped_share(_scan(box)) == 0.0


def test_the_lid_of_half_a_ball_is_a_third_of_the_closed_shape():
    half = _part(trimesh.creation.icosphere(5, 0.0325), 0.5)
    assert capped_share(_scan(half)) == pytest.approx(1 / 3, abs=0.02)


@pytest.fixture(scope='module')
def half_ball(tmp_path_factory):
    """Half a noisy ball of 65 mm in inches."""
    half = _noisy(_part(trimesh.creation.icosphere(5, 0.0325), 0.55))
    path = tmp_path_factory.mktemp('scan') / 'half.ply'
    half.apply_scale(1 / 0.0254).export(path)
    return path


def test_half_a_ball_is_told_with_the_primitive_that_fits(half_ball, tmp_path, capsys):
    code = main(
        half_ball, '--unit', 'inch', *MATERIAL, '--vertices', 200, '--out', tmp_path, '--json',
        '--contact', '-0.026,0,-0.0195,0.002', '--contact', '0.026,0,-0.0195',
        '--gas', 'open',
    )  # fmt: skip
    report = json.loads(capsys.readouterr().out)
    assert code == 0
    assert report['primitive']['missing_share'] == pytest.approx(0.45, abs=0.03)
    assert report['missing_lid_share'] > 0.2
    assert any('% of it is missing in the scan' in text for text in report['warnings'])
    shell = load_object(tmp_path / 'half.yaml')
    assert [contact.radius_m for contact in shell.contacts] == [0.002, 0.001]
    assert shell.contacts[0].at_m[0] == -0.026
    assert shell.gas.kind == 'open'


@pytest.mark.parametrize('unit', ['m', 'mm'])
def test_a_unit_that_makes_the_object_no_hand_sized_one_is_refused(
    half_ball, unit, tmp_path, capsys
):
    out = tmp_path / 'out'
    assert main(half_ball, '--unit', unit, *MATERIAL, '--out', out) == 1
    error = capsys.readouterr().err
    assert 'or --unit inch makes it 64' in error and error.count('\n') == 1
    assert not out.exists()


def test_an_object_of_another_size_is_read_when_its_size_is_stated(tmp_path, capsys):
    path = tmp_path / 'drum.stl'
    trimesh.creation.icosphere(4, 0.6).export(path)
    assert main(path, '--unit', 'm', *MATERIAL, '--out', tmp_path) == 1
    assert 'in m the object is 1' in capsys.readouterr().err
    assert main(path, '--unit', 'm', '--size', 1.2, *MATERIAL, '--out', tmp_path) == 0
    assert main(path, '--unit', 'm', '--size', 0.05, *MATERIAL, '--out', tmp_path) == 1


@pytest.mark.parametrize('form', ['stl.gz', 'off', 'wrl', 'bom.obj'])
def test_the_formats_are_those_of_scan_error(form, tmp_path, capsys):
    ball = trimesh.creation.icosphere(3, 32.5)
    path = tmp_path / f'ball.{form}'
    if form == 'stl.gz':
        path.write_bytes(gzip.compress(ball.export(file_type='stl')))
    elif form == 'off':
        path.write_text(ball.export(file_type='off'))
    elif form == 'bom.obj':
        path.write_bytes(b'\xef\xbb\xbf' + ball.export(file_type='obj').encode())
    else:
        points = ' '.join(f'{v:.6f}' for v in ball.vertices.ravel())
        index = ' '.join(f'{a} {b} {c} -1' for a, b, c in ball.faces)
        path.write_text(
            '#VRML V2.0 utf8\nShape { geometry IndexedFaceSet { coord Coordinate { point [ '
            f'{points} ] }} coordIndex [ {index} ] }} }}\n'
        )
    assert main(path, '--unit', 'mm', *MATERIAL, '--vertices', 200, '--out', tmp_path) == 0
    assert 'a sphere fits the scan' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('a.stl', bytes(80) + b'\x05\0\0\0' + bytes(120), 'declares 5 faces but holds 2'),
        ('a.stl', b'<!DOCTYPE html><html>', 'web page'),
        ('a.stl', b'', 'the file is empty'),
        ('a.3mf', b'PK\x03\x04' + bytes(60), '3MF'),
        ('a.obj', b'\xef\xbb\xbfv 0 0 0\nf 1 2 3\n', 'names vertex'),
        ('a.xyz', b'1 2 3\n4 5 6\n', 'no triangles, only 2 points'),
        ('a.ply', b'version https://git-lfs.github.com/spec/v1\n', 'git lfs pull'),
    ],
)
def test_what_is_no_mesh_is_named_for_what_it_is(name, content, words, tmp_path, capsys):
    path = tmp_path / name
    path.write_bytes(content)
    assert main(path, '--unit', 'mm', *MATERIAL, '--out', tmp_path / 'out') == 1
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1
