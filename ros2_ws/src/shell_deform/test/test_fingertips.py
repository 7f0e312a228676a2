# SPDX-License-Identifier: Apache-2.0
"""Fingertips of object files: the BarrettHand's own, parameter files, meshes; what is refused."""

import json

import numpy as np
import pytest
import trimesh

from shell_deform.commands.shell_solve import main
from shell_deform.contact.bodies import BodyError
from shell_deform.contact.body_file import MOST_CELLS, load_body
from shell_deform.contact.fingertip import Fingertip
from shell_deform.live.exchange import MAX_CELLS
from shell_deform.objects import ObjectError
from shell_deform.objects.finger_files import body_names, find_body
from shell_deform.squeeze import load

TEXT = (
    'name: ball\nsurface: {sphere: {outer_diameter_m: 0.0654}}\nthickness_m: 0.0027\n'
    'young_modulus_pa: 1.275e+7\npoisson_ratio: 0.49\ncontrol_vertices: 200\ncontacts:\n'
)
# Published rows of touch cells, mm: along the finger, below the flat, half a cell of both.
ROWS = (
    (22.25, 0.0, 2.75, 0.0), (28.25, 0.0, 2.75, 0.0), (34.2484, 0.08629, 2.74837, 0.085096),
    (40.2349, 0.44305, 2.73902, 0.241919), (46.1912, 1.14113, 2.72073, 0.397956),
    (51.0813, 2.3116, 1.35885, 0.614231), (53.8108, 4.35778, 0.970635, 1.13209),
    (55.4163, 7.36766, 0.399575, 1.4367),
)  # fmt: skip


@pytest.fixture
def tip():
    return load_body(find_body('barrett_fingertip', None))


def written(tmp_path, *rows, text=TEXT):
    file = tmp_path / 'ball.yaml'
    file.write_text(text + ''.join(f'  - {{{row}}}\n' for row in rows))
    return file


def test_a_barrett_fingertip_comes_with_the_package():
    assert 'barrett_fingertip' in body_names()


def test_its_pad_goes_within_a_tenth_of_a_millimetre_through_the_published_touch_cells(tip):
    places = np.array([
        [along + share * half, 0.0, -below - share * fall]
        for along, below, half, fall in ROWS for share in (-0.7, 0.0, 0.7)
    ])  # fmt: skip
    foot, turn = tip.shape.foot(tip.shape.touch)
    away = 1e-3 * places - [foot[0], 0.0, foot[1]]
    sine, cosine = np.sin(turn), np.cos(turn)
    frame = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    assert np.abs(tip.shape.distance(away @ frame.T).value).max() < 1e-4


def test_its_24_cells_lie_on_its_pad(tip):
    assert tip.cells.shape == (24, 3)
    np.testing.assert_allclose(tip.shape.distance(tip.cells).value, 0.0, atol=1e-12)


def test_a_mesh_in_another_unit_than_it_is_said_to_be_is_refused(tmp_path):
    file = tmp_path / 'tip.stl'
    trimesh.creation.box((12.0, 8.0, 4.0)).export(file)
    assert load_body(file, 'mm').size == pytest.approx(0.004)
    assert load_body(file, 'inch').size == pytest.approx(4 * 0.0254)
    for unit in ('m', 'um'):
        with pytest.raises(ObjectError, match=f'in {unit} the finger measures'):
            load_body(file, unit)


def test_a_pad_is_flat_or_a_cap_of_a_sphere(tmp_path):
    flat = load_body(body_file(tmp_path, 'pad: {radius_m: 0.008}')).shape
    beside = np.array([[0.006, 0.0, 0.001]])
    assert flat.distance(beside).value == pytest.approx(0.001)
    text = 'pad: {radius_m: 0.008, curvature_radius_m: 0.01}'
    cap = load_body(body_file(tmp_path, text)).shape
    assert cap.distance(beside).value == pytest.approx(np.hypot(0.006, 0.011) - 0.01)
    with pytest.raises(ObjectError, match='smallest allowed value is 0.008'):
        load_body(body_file(tmp_path, text.replace('0.01}', '0.005}')))


def test_the_palm_has_its_24_cells_in_rows_of_5_7_7_and_5():
    palm = load_body(find_body('barrett_palm', None))
    np.testing.assert_allclose(palm.shape.distance(palm.cells).value, 0.0, atol=1e-9)
    assert np.unique(palm.cells[:, 1], return_counts=True)[1].tolist() == [5, 7, 7, 5]
    assert np.ptp(palm.cells[:, 0]) == pytest.approx(0.066)


def body_file(tmp_path, text):
    file = tmp_path / 'body.yaml'
    file.write_text(f'name: mine\n{text}\n')
    return file


@pytest.mark.parametrize(
    'shape', ['ball: {radius_m: 0.01}', 'rod: {radius_m: 0.01, length_m: 0.02}']
)
def test_cells_that_are_listed_as_seen_along_z_lie_on_the_face(tmp_path, shape):
    cells = load_body(body_file(tmp_path, f'{shape}\ncells_m: [[0, 0], [0.004, 0.006]]')).cells
    assert cells[:, :2].tolist() == [[0.0, 0.0], [0.004, 0.006]]
    assert cells[0, 2] == pytest.approx(0.0, abs=1e-8)
    height = np.sqrt(0.01**2 - 0.006**2 - (0.004**2 if 'ball' in shape else 0.0)) - 0.01
    assert cells[1, 2] == pytest.approx(height, abs=1e-8)


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        (
            'ball: {radius_m: 0.01}\ncells_m: [[0, 0], [0.02, 0]]',
            'cell 1, .0.02, 0.0., lies beside',
        ),
        ('ball: {radius_m: 0.01}\ncells_m: [[0, 0, 0]]', 'has 3 values; 2 are needed'),
        ('ball: {radius_m: 0.01}\ncells_m: [[0, .nan]]', 'a plain number is needed'),
        (f'ball: {{radius_m: 0.01}}\ncells_m: {[[0, 0]] * 65}', 'has 65 touch cells; at most 64'),
    ],
)
def test_cells_that_cannot_be_are_refused(tmp_path, text, says):
    with pytest.raises(ObjectError, match=says):
        load_body(body_file(tmp_path, text))


def test_as_many_cells_are_read_as_the_background_process_is_told_of():
    assert MOST_CELLS == MAX_CELLS


def test_it_touches_with_its_origin_and_faces_along_z(tip):
    there = tip.shape.distance(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1e-3]]))
    np.testing.assert_allclose(there.value, [0.0, 1e-3], atol=1e-15)
    np.testing.assert_allclose(there.normal, [[0, 0, 1], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'rounding': 0.01}, 'do not fit'),
        ({'arcs': ((0.001, 1.0),)}, 'at a radius of at least'),
        ({'arcs': ((0.01, 2.5),)}, '135 is the most'),
        ({'touch': 0.1}, 'lies on none of its pad'),
        ({'arcs': ((0.05, 1.5),)}, 'behind its back'),
    ],
)
def test_a_fingertip_that_cannot_be_is_refused(changes, says):
    good = {
        'heel': 0.0, 'flat_to': 0.012, 'touch': 0.01, 'arcs': ((0.008, 1.5),), 'width': 0.016,
        'height': 0.02, 'rounding': 0.002,
    }  # fmt: skip
    Fingertip(**good)
    with pytest.raises(BodyError, match=says):
        Fingertip(**{**good, **changes})


def test_fingertips_of_an_object_file_press_by_their_pads(tmp_path):
    rows = (
        f'at_m: [0, 0, {z}], kind: fingertip, body: barrett_fingertip, along: [1, 0, 0]'
        for z in (0.0327, -0.0327)
    )
    ball = load(written(tmp_path, *rows))
    squeezed = ball.squeeze(displacement=2e-4)
    assert np.all(squeezed.contact_force > 0.0)
    assert ball.contacts[0].body.turn[0, 0] == pytest.approx(1.0)


def test_its_cells_feel_together_what_the_finger_pushes_with(tmp_path):
    rows = (
        f'at_m: [0, 0, {z}], kind: fingertip, body: barrett_fingertip, friction: 0.4'
        for z in (0.0327, -0.0327)
    )
    ball = load(written(tmp_path, *rows), control_vertices=300)
    squeezed = ball.squeeze(displacement=1e-3)
    for finger, force in zip(squeezed.fingers, squeezed.contact_force, strict=True):
        assert finger.cells.shape == (24, 3)
        np.testing.assert_allclose(-finger.cells[:, 2].sum(), force, rtol=1e-9)
        assert 0.0 <= finger.sticking <= finger.area < 1e-4
        assert finger.friction <= 0.4 * finger.push * (1.0 + 1e-9)


def test_shell_solve_prints_regions_and_cells_of_fingertips(tmp_path, capsys):
    row = 'at_m: [0, 0, {z}], kind: fingertip, body: barrett_fingertip, friction: 0.4'
    file = written(tmp_path, *(row.format(z=z) for z in (0.0327, -0.0327)))
    assert main(['--object', str(file), '--displacement-sweep', '0:2e-4:1', '--json']) == 0
    fingers = json.loads(capsys.readouterr().out)['points'][-1]['fingers']
    assert len(fingers) == 2
    assert len(fingers[0]['cells_n']) == 24
    assert fingers[0]['push_n'] > 0.0


def box(tmp_path, change=lambda mesh: mesh):
    mesh = change(trimesh.creation.box((20.0, 10.0, 8.0)).subdivide())
    mesh.export(tmp_path / 'tip.stl')
    return tmp_path / 'tip.stl'


def test_a_convex_mesh_is_a_finger_that_touches_with_the_middle_of_its_flat(tmp_path):
    body = load_body(box(tmp_path), 'mm')
    assert body.size == pytest.approx(0.005)
    there = body.shape.distance(np.array([[0.0, 0, 0], [0, 0, 0.001], [0.011, 0, -0.001]]))
    np.testing.assert_allclose(there.value, [0.0, 1e-3, 1e-3], atol=1e-9)


def holed(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)


def bent(mesh):
    vertices = mesh.vertices.copy()
    vertices[:, 2] += 0.05 * vertices[:, 0] ** 2
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ('change', 'says'), [(holed, '3 of its edges'), (bent, 'is not convex: it lies up to')]
)
def test_a_mesh_with_holes_or_hollows_is_refused(tmp_path, change, says):
    with pytest.raises(ObjectError, match=says):
        load_body(box(tmp_path, change), 'mm')


def test_a_mesh_without_unit_is_refused(tmp_path):
    with pytest.raises(ObjectError, match='needs the unit'):
        load_body(box(tmp_path))


PARAMETERS = {
    'ball: {radius_m: 0.004}': 0.004,
    'rod: {radius_m: 0.003, length_m: 0.02}': 0.003,
    'plate: {width_m: 0.02, length_m: 0.03, edge_radius_m: 0.001}': 0.01,
    'mesh: {file: tip.stl, unit: mm}': 0.005,
}


@pytest.mark.parametrize('text', PARAMETERS)
def test_a_parameter_file_describes_the_tip_of_another_hand(tmp_path, text):
    box(tmp_path)
    (tmp_path / 'tip.yaml').write_text(f'name: other\n{text}\nsource: a drawing\n')
    body = load_body(tmp_path / 'tip.yaml')
    assert body.size == pytest.approx(PARAMETERS[text])
    np.testing.assert_allclose(body.shape.distance(np.zeros((1, 3))).value, 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('name: x\n', 'needs exactly one of'),
        ('name: x\nball: {radius: 0.1}\n', 'say the unit, as in radius_m'),
        ('name: x\nball: {radius_m: -1}\n', 'line 2: radius_m is -1'),
        ('name: x\nmesh: {file: none.stl, unit: mm}\n', 'there is no file'),
        ('name: x\nplate: {width_m: 0.01, length_m: 0.01, edge_radius_m: 0.01}\n', 'rounded by'),
    ],
)
def test_a_parameter_file_that_says_nothing_usable_is_refused(tmp_path, text, says):
    (tmp_path / 'tip.yaml').write_text(text)
    with pytest.raises(ObjectError, match=says):
        load_body(tmp_path / 'tip.yaml')


TIP = 'kind: fingertip, body: barrett_fingertip'


@pytest.mark.parametrize(
    ('row', 'says'),
    [
        ('at_m: [0, 0, 0.0327], kind: fingertip', 'needs a body: barrett_fingertip'),
        ('at_m: [0, 0, 0.0327], kind: fingertip, body: thumb', "no body 'thumb'"),
        ('at_m: [0, 0, 0.0327], body: barrett_fingertip', 'body needs kind: fingertip'),
        (f'at_m: [0, 0, 0.0327], {TIP}, radius_m: 0.01', 'radius_m needs kind: pin or pad'),
        (f'at_m: [0, 0, 0.0327], {TIP}, unit: mm', 'a parameter file has its own'),
        (f'at_m: [0, 0, 0.0327], {TIP}, friction: -0.1', 'friction is -0.1'),
        (f'at_m: [0, 0, 0.0327], {TIP}, friction: .nan', 'nan'),
        (f'at_m: [0, 0, 0.0327], {TIP}, along: [0, 0, 0]', 'along is a direction'),
        (f'at_m: [0, 0, 0.0327], {TIP}, along: [0, 0, 1]', 'along the normal turns'),
        (f'at_m: [0, 0, 0.06], {TIP}', 'away from the object'),
        (f'at_m: [0, 0, 0.028], {TIP}', r'starts 0.0047 m inside'),
        (f'at_m: [0, 0, 0.0327], {TIP}, towards: [1, 0, 0]', 'inside the object'),
    ],
)
def test_a_finger_that_cannot_touch_so_is_refused(tmp_path, row, says):
    with pytest.raises(ObjectError, match=says):
        load(written(tmp_path, row))


def test_a_pad_that_starts_inside_is_refused_too(tmp_path):
    row = 'at_m: [0, 0, 0.028], kind: pad, radius_m: 0.01'
    with pytest.raises(ObjectError, match='starts 0.0047 m inside'):
        load(written(tmp_path, row))
