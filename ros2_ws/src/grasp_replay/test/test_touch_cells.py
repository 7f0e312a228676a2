# SPDX-License-Identifier: Apache-2.0
"""Touch cells of a recording: where the push of a hold lies, and which cells do not count."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp_replay.experiment import read_experiment
from grasp_replay.holds import HeldContacts, holds_of
from grasp_replay.recording import Recording, read_recording
from grasp_replay.touch_cells import carried_bodies, felt_in, sentence
from shell_deform.live.tick.touch_check import TouchCells

BAG = Path(__file__).resolve().parents[4] / 'bags' / 'ball_fingertips'
BODIES = carried_bodies('barrett_fingertip')


@pytest.fixture(scope='module')
def recording() -> Recording:
    return read_recording(BAG)


def held(recording: Recording) -> tuple[HeldContacts, tuple[str, ...]]:
    """The contacts of the one hold of the recording, and what is noted of it."""
    (hold,) = (one for one in holds_of(recording, read_experiment(BAG)) if one.contacts)
    assert hold.contacts is not None
    return hold.contacts, hold.notes


def changed(recording: Recording, change: object) -> Recording:
    """The recording with the forces (c,) of the cells of finger 2 changed."""
    cells = []
    for sample in recording.cells:
        force = sample.force.copy()
        force[sample.finger == 2] = change(force[sample.finger == 2])  # type: ignore[operator]
        cells.append(replace(sample, force=force))
    return replace(recording, cells=tuple(cells))


def test_the_push_of_a_hold_lies_where_its_cells_felt_it(recording: Recording) -> None:
    contacts, notes = held(recording)
    assert sorted(contacts.shapes) == [1, 2]
    assert notes == ('the push of finger 1, 2 lies where its touch cells felt it',)
    for shape in contacts.shapes.values():
        assert shape.shares.sum() == pytest.approx(1.0)
        # The solid is felt by the few cells about the place of touch, noise by none.
        assert 2 <= np.count_nonzero(shape.shares) <= 6
    np.testing.assert_allclose(
        [contacts.cells[finger].sum() for finger in (1, 2)], contacts.push, rtol=0.05
    )
    np.testing.assert_allclose(contacts.along, [[0.0, 0.0, 1.0]] * 2, atol=1e-6)


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda force: np.zeros(24), 'finger 2 feels less than 0.3 N by them'),
        (lambda force: np.where(force == force.max(), 0.0, force), 'N by its gauge'),
        (lambda force: np.minimum(force, 0.5), 'N by its gauge'),
        (lambda force: force + 9.0 * (np.arange(24) == 20), 'N by its gauge'),
    ],
    ids=['all dead', 'the strongest dead', 'at their end', 'one stuck'],
)
def test_cells_that_do_not_fit_the_gauge_leave_an_even_push(
    recording: Recording, change: object, says: str
) -> None:
    contacts, notes = held(changed(recording, change))
    assert list(contacts.shapes) == [1]
    assert says in notes[0]
    assert 'its push lies evenly' in notes[0]


def test_noisy_cells_press_where_clean_ones_do(recording: Recording) -> None:
    random = np.random.default_rng(8)
    contacts, _ = held(changed(recording, lambda force: force + random.normal(0.0, 0.3, 24)))
    clean, noisy = (held(recording)[0].shapes[2], contacts.shapes[2])
    assert clean.differs(noisy) < 0.1


def test_cells_of_another_array_are_told_and_left_out(recording: Recording) -> None:
    few = [
        replace(one, finger=one.finger[:40], cell=one.cell[:40], force=one.force[:40])
        for one in recording.cells
    ]
    contacts, notes = held(replace(recording, cells=tuple(few)))
    assert not contacts.shapes
    assert 'has 16 cells of finger 2' in notes[0]


def test_cells_without_a_body_are_told(recording: Recording) -> None:
    bare = replace(read_experiment(BAG), finger_body='')
    (hold,) = (one for one in holds_of(recording, bare) if one.contacts)
    assert hold.notes == ('hand/tactile is not used: experiment.yaml names no finger_body',)


def test_a_hold_has_the_medians_of_its_cells() -> None:
    finger, cell = np.ones(24, np.int64), np.arange(24)
    samples = [
        TouchCells(k, finger, cell, np.full(24, value)) for k, value in enumerate((1, 2, 9))
    ]
    lost = TouchCells(4, finger, cell, np.full(24, np.nan))
    medians, notes = felt_in([*samples, lost], BODIES)
    assert medians[1].tolist() == [2.0] * 24
    assert notes[0].startswith('1 of 4 samples of the hold: cell 0 of finger 1 measures nan N')


def test_the_sentence_names_the_finger_that_contradicts() -> None:
    touch = {
        'contradiction': 3.2,
        'suspect': 'centre of the cells of finger 2',
        'fingers': [{'finger': 2, 'cells_n': [1.0, 2.0], 'expected_cells_n': [2.0, 2.5]}],
    }
    assert sentence(touch) == (
        'finger 2 feels 3.00 N by its cells, its body 4.50 N; the centre of the cells of finger 2 '
        'contradicts (3.20 sigma)'
    )
