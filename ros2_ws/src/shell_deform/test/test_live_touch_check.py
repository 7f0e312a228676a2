# SPDX-License-Identifier: Apache-2.0
"""Measured touch cells against expected ones: which finger contradicts, and what is refused."""

import numpy as np
import pytest

from shell_deform.contact.finger_bodies import read_finger_bodies
from shell_deform.live.exchange import TAXEL_FIELDS
from shell_deform.live.tick.sample import SampleError
from shell_deform.live.tick.touch_check import TouchCells, check_cells, judged

BODIES = read_finger_bodies('barrett_fingertip').loaded()
CENTRES = BODIES[0].cells


def pressed(middle, push=8.0, width=5e-3):
    """Forces of 24 cells: a bell about a place of the pad [m]."""
    away = np.linalg.norm(CENTRES - middle, axis=1)
    bell = np.exp(-0.5 * (away / width) ** 2)
    return push * bell / bell.sum()


def expected(*forces):
    rows = np.zeros((24 * len(forces), len(TAXEL_FIELDS)))
    for k, force in enumerate(forces):
        mine = slice(24 * k, 24 * k + 24)
        rows[mine, 5] = 1.0
        rows[mine, 8] = force
        rows[mine, 13], rows[mine, 14] = k + 1, np.arange(24)
    return rows


def measured(*forces):
    finger = np.repeat(np.arange(len(forces)) + 1, 24)
    cell = np.tile(np.arange(24), len(forces))
    return TouchCells(1, finger, cell, np.concatenate(forces))


def test_cells_that_measure_what_is_expected_contradict_nothing():
    force = pressed(CENTRES[10])
    noise = np.random.default_rng(5).normal(0.0, 0.05, 24)
    found = judged(measured(force + noise, force), expected(force, force), BODIES)
    assert found.value < 1.0
    assert found.suspect == ''


@pytest.mark.parametrize(
    ('force', 'says'),
    [
        (pressed(CENTRES[1]), 'centre of the cells of finger 2'),
        (pressed(CENTRES[10], 16.0), 'push of the cells of finger 2'),
        (pressed(CENTRES[10], width=30e-3), 'extent of the cells of finger 2'),
    ],
)
def test_the_finger_whose_cells_contradict_is_named(force, says):
    good = pressed(CENTRES[10])
    found = judged(measured(good, force), expected(good, good), BODIES)
    assert found.value > 1.0
    assert found.suspect == says


def test_a_finger_that_hardly_presses_contradicts_nothing():
    faint = pressed(CENTRES[1], 0.1)
    assert judged(measured(faint), expected(pressed(CENTRES[20], 0.1)), BODIES).value == 0.0


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda c: TouchCells(1, c.finger[:20], c.cell[:20], c.force[:20]), 'has 20 cells'),
        (lambda c: TouchCells(1, c.finger, c.cell + 1, c.force), 'numbers 1 to 24'),
        (lambda c: TouchCells(1, c.finger, c.cell, c.force * np.nan), 'measures nan N'),
    ],
)
def test_cells_that_the_body_does_not_have_are_refused(change, says):
    cells = measured(pressed(CENTRES[10]))
    check_cells(cells, BODIES)
    with pytest.raises(SampleError, match=says):
        check_cells(change(cells), BODIES)


def test_cells_of_a_finger_without_a_body_are_refused():
    cells = measured(pressed(CENTRES[10]))
    with pytest.raises(SampleError, match='its body has 0'):
        check_cells(cells, {7: BODIES[0]})
