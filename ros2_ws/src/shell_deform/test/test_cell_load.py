# SPDX-License-Identifier: Apache-2.0
"""Measured touch cells as the shape of a load: where it lies, when it is laid anew, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from shell_deform.contact.bodies import frame_of
from shell_deform.contact.cell_load import CellShape, cell_shares, shaped_by_cells
from shell_deform.contact.finger_bodies import read_finger_bodies
from shell_deform.contact.loads import contact_patch
from shell_deform.live.background.contact_tracking import ContactTracker, Touch
from shell_deform.live.background.worker import build
from shell_deform.live.background.worker_link import empty_request
from shell_deform.live.tick.touch_check import TouchCells, write_shapes
from shell_deform.objects import ObjectError, load_object
from shell_deform.squeeze import load

RADIUS, WALL = 0.0325, 1e-3
MIDDLE = RADIUS - 0.5 * WALL
BODIES = read_finger_bodies('barrett_fingertip').loaded()
CELLS = BODIES[0].cells
DOWN, ALONG = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
TOP = np.array([0.0, 0.0, RADIUS])


@pytest.fixture(scope='module')
def ball(sphere):
    return sphere(MIDDLE, WALL, subdivisions=3, young=1e9)


def felt(**forces):
    """Forces of all cells, of which few feel anything: `felt(c4=1.0)`."""
    values = np.zeros(len(CELLS))
    for name, force in forces.items():
        values[int(name[1:])] = force
    return values


def shape(**forces):
    return CellShape(CELLS, cell_shares(felt(**forces)))


def laid(ball, chosen):
    patch = contact_patch(ball.surface, TOP, 7e-3)
    frame = TOP, frame_of(DOWN, ALONG)
    return shaped_by_cells(patch, ball.surface, ball.rest, frame, chosen)


def feet():
    """Where the normals through the cells meet the middle of the ball's wall (c, 3) [m]."""
    places = CELLS @ frame_of(DOWN, ALONG).T + TOP
    return places / np.linalg.norm(places, axis=1, keepdims=True) * MIDDLE


def test_the_push_stands_in_the_centre_of_what_the_cells_felt(ball):
    chosen = shape(c4=1.0, c5=2.0, c7=1.0)
    patch = laid(ball, chosen)
    assert patch.spread.sum() == pytest.approx(1.0)
    centre = patch.spread @ ball.surface.mesh.vertices
    # A point of the surface is the mean of control points that its basis values give.
    np.testing.assert_allclose(centre, chosen.shares @ feet(), atol=2e-4)


def test_the_moment_of_the_push_is_that_of_the_cells(ball):
    one, other = laid(ball, shape(c4=1.0)), laid(ball, shape(c4=1.0, c13=1.0))
    apart = np.linalg.norm((feet()[13] - feet()[4])[:2])
    assert other.inertia == pytest.approx(one.inertia + 0.25 * apart**2, rel=0.05)


def test_a_spin_row_of_cells_feels_a_turn_and_no_shift(ball):
    patch = laid(ball, shape(c3=1.0, c4=3.0, c10=2.0))
    row = patch.spin_row()
    shift = np.broadcast_to([1.0, 2.0, 3.0], ball.rest.shape)
    turn = np.cross(patch.axis, ball.rest)
    assert np.sum(row * shift) == pytest.approx(0.0, abs=1e-9)
    assert np.sum(row * turn) / patch.radius == pytest.approx(1.0, rel=0.02)


def test_cells_that_pull_or_are_faint_are_no_load():
    shares = cell_shares(felt(c0=-5.0, c1=4.0, c2=1.0, c3=0.01))
    np.testing.assert_allclose(shares[:4], [0.0, 0.8, 0.2, 0.0])
    assert not cell_shares(np.zeros(24)).any()
    assert not cell_shares(np.full(24, -1.0)).any()


def test_the_noise_of_cells_that_feel_nothing_is_no_load():
    noise = np.random.default_rng(3).normal(0.0, 0.1, 24)
    clean = felt(c4=2.0, c5=3.0, c7=2.0)
    shares, wanted = cell_shares(clean + noise), cell_shares(clean)
    assert shares[wanted == 0.0].sum() < 0.05
    assert 0.5 * np.abs(shares - wanted).sum() < 0.1


def touch(forces=None, **changes):
    found = Touch(
        1, TOP, DOWN, 7e-3, 1.0, 0.0, np.nan, ALONG, None if forces is None else shape(**forces)
    )
    return replace(found, **changes)


def test_a_patch_is_laid_anew_where_the_push_goes_to_other_cells(ball):
    tracker = ContactTracker(ball, ball.rest)
    assert tracker.update((touch({'c4': 1.0, 'c5': 1.0}),), ball.rest)
    first = tracker.patches[0]
    assert not tracker.update((touch({'c4': 1.0, 'c5': 1.1}),), ball.rest)
    assert tracker.update((touch({'c4': 1.0, 'c5': 3.0}),), ball.rest)
    assert not np.array_equal(tracker.patches[0].spread, first.spread)
    # It is the same contact still: what travel and displacement are off by has stayed.
    assert not tracker.laid
    assert tracker.update((touch(),), ball.rest)
    assert tracker.contacts[0].shape is None


def request_of(stamp=1000, along=ALONG):
    request = empty_request()[0]
    request['contacts'], request['stamp'] = 1, stamp
    row = request['touch'][0]
    row['finger'], row['normal'], row['along'] = 2, DOWN, along
    return request


def measured(stamp=1000, **forces):
    return TouchCells(stamp, np.full(24, 2), np.arange(24)[::-1], felt(**forces)[::-1])


def test_a_load_case_carries_the_cells_of_its_fingers_in_their_order():
    request = request_of()
    assert write_shapes(request, measured(c4=1.0, c6=3.0), BODIES) == {2: ''}
    row = request['touch'][0]
    assert row['cells'] == 24
    np.testing.assert_allclose(row['share'][:24], cell_shares(felt(c4=1.0, c6=3.0)))
    np.testing.assert_allclose(row['cell'][:24], CELLS)


@pytest.mark.parametrize(
    ('cells', 'along', 'push', 'why'),
    [
        (None, ALONG, 1.0, 'last half second'),
        (measured(10**10, c4=1.0), ALONG, 1.0, 'last half second'),
        (measured(c4=0.1), ALONG, 0.1, 'less than 0.3 N'),
        (measured(c4=1.0), np.full(3, np.nan), 1.0, 'how it lies'),
        (measured(c4=1.0), DOWN, 1.0, 'how it lies'),
        (measured(c4=1.0), ALONG, 6.0, '1.00 N by them and 6.00 N by its gauge'),
        (measured(c4=9.0, c20=4.0), ALONG, 6.0, '13.00 N by them and 6.00 N'),
    ],
    ids=['none', 'old', 'faint', 'lies unknown', 'lies along its normal', 'dead', 'stuck'],
)
def test_cells_that_say_nothing_leave_an_even_push_and_say_why(cells, along, push, why):
    request = request_of(along=along)
    request['touch'][0]['cells'], request['touch'][0]['force'] = 24, push
    assert why in write_shapes(request, cells, BODIES)[2]
    assert request['touch'][0]['cells'] == 0


TEXT = (
    'name: ball\nsurface: {sphere: {outer_diameter_m: 0.065}}\nthickness_m: 0.001\n'
    'young_modulus_pa: 1.0e+8\npoisson_ratio: 0.3\ncontrol_vertices: 300\ncontacts:\n'
)


def written(folder, more, kind='fingertip'):
    file = folder / 'ball.yaml'
    body = 'body: barrett_fingertip, along: [1, 0, 0], ' if kind == 'fingertip' else ''
    rows = ''.join(
        f'  - {{at_m: [0, 0, {z}], kind: {kind}, {body}{more}}}\n' for z in (0.0325, -0.0325)
    )
    file.write_text(TEXT + rows)
    return file


def test_an_object_file_with_cells_dents_where_they_felt_it(tmp_path):
    deepest = {}
    for cell in (4, 13):
        ball = load(written(tmp_path, f'cells_n: {felt(**{f"c{cell}": 1.0}).tolist()}'))
        squeezed = ball.squeeze(force=1.0)
        np.testing.assert_allclose(squeezed.contact_force, 1.0)
        upper = ball.points[:, 2] > 0.0
        moved = np.where(upper, -squeezed.displacement[:, 2], 0.0)
        deepest[cell] = ball.points[np.argmax(moved), 0]
        assert not squeezed.fingers
    # The heel lies behind where the finger touches, the fifth row before it.
    assert deepest[4] < -2e-3
    assert deepest[13] > 3e-3


@pytest.mark.parametrize(
    ('more', 'kind', 'says'),
    [
        ('cells_n: [1, 2, 3]', 'fingertip', 'cells_n has 3 numbers, barrett_fingertip has 24'),
        (f'cells_n: {[0.0] * 24}', 'fingertip', 'no cell in cells_n pushes'),
        (f'cells_n: {[-1.0] * 24}', 'fingertip', 'no cell in cells_n pushes'),
        (f'cells_n: {[1.0] * 23 + [float("nan")]}'.replace('nan', '.nan'), 'fingertip', 'nan'),
        (f'cells_n: {[1.0] * 23 + [2e4]}', 'fingertip', '20000'),
        (f'cells_n: {[1.0] * 24}, friction: 0.4', 'fingertip', 'friction is that of a rigid body'),
        (f'cells_n: {[1.0] * 24}', 'pin', 'cells_n needs kind: fingertip, not pin'),
        ('cells_n: 3', 'fingertip', 'cells_n'),
    ],
)
def test_cells_that_cannot_be_are_refused_in_one_sentence(more, kind, says, tmp_path):
    with pytest.raises(ObjectError, match=says) as told:
        load(written(tmp_path, more, kind))
    assert '\n' not in str(told.value)


def test_live_auto_is_thin_where_cells_shape_the_load_and_thick_is_refused(tmp_path):
    file = tmp_path / 'bare.yaml'
    file.write_text(TEXT.replace('contacts:\n', '').replace('0.001', '0.004'))
    options = {
        'object': str(file), 'bodies': 'barrett_fingertip', 'by_cells': True,
        'control_vertices': 100,
    }  # fmt: skip
    assert build({**options, 'theory': 'auto'}).model.theory == 'koiter'
    with pytest.raises(ObjectError, match='take theory koiter'):
        build({**options, 'theory': 'thick'})


def test_a_thick_wall_takes_no_cells(tmp_path):
    file = written(tmp_path, f'cells_n: {[1.0] * 24}')
    assert load_object(file).contacts[0].finger is not None
    with pytest.raises(ObjectError, match='take theory koiter'):
        load(file, theory='thick')
