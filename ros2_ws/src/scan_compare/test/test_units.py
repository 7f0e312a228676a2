# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scan_compare.scan_file import ScanFileError, parse_scan
from scan_compare.units import METRES_PER_UNIT, UnitError, choose_unit, robust_extent

BALL = 0.065


def test_lengths_are_those_of_the_international_system() -> None:
    centimetres = {unit: 100.0 * metres for unit, metres in METRES_PER_UNIT.items()}
    expected = {'m': 100.0, 'cm': 1.0, 'mm': 0.1, 'um': 1e-4, 'inch': 2.54, 'in': 2.54}
    assert centimetres == pytest.approx(expected | {'ft': 30.48})


@pytest.mark.parametrize(('unit', 'extent'), [('mm', 65.0), ('inch', 2.559), ('m', 0.065)])
def test_the_unit_follows_from_the_size_of_the_object(unit: str, extent: float) -> None:
    chosen = choose_unit(extent, None, BALL)
    assert (chosen.name, chosen.inferred) == (unit, True)
    assert f'unit inferred: {unit}' in chosen.explanation


@given(st.floats(0.15, 1.5), st.sampled_from(['mm', 'inch', 'm']))
def test_a_partial_scan_has_at_most_one_unit(part: float, unit: str) -> None:
    extent = part * BALL / METRES_PER_UNIT[unit]
    assert choose_unit(extent, None, BALL).name == unit


def test_inches_declared_as_millimetres_are_detected_by_the_factor() -> None:
    with pytest.raises(UnitError, match=r'factor 25\.4, the file is in inch'):
        choose_unit(2.559, 'mm', BALL)


def test_a_wrong_unit_is_told_with_both_sizes() -> None:
    told = 'unit m makes the scan 2000 mm large but the object is 65 mm'
    with pytest.raises(UnitError, match=told):
        choose_unit(2.0, 'm', 0.065)


def test_millimetres_declared_as_inches_are_detected_by_the_factor() -> None:
    with pytest.raises(UnitError, match=r'factor 25\.4, the file is in mm'):
        choose_unit(65.0, 'inch', BALL)


def test_a_size_that_fits_no_unit_is_refused() -> None:
    told = r'fit the object of 65 mm \(.*700 mm as mm.*1\.778e\+04 mm as inch'
    with pytest.raises(UnitError, match=told):
        choose_unit(700.0, None, BALL)


def test_an_inferred_unit_is_told_with_both_sizes_in_millimetres() -> None:
    told = choose_unit(2.5, None, BALL).explanation
    assert told == 'unit inferred: inch (extent 2.5 inch = 63.5 mm, object 65 mm)'


def test_without_unit_and_object_the_unit_is_asked_for() -> None:
    with pytest.raises(UnitError, match='state the unit'):
        choose_unit(65.0, None, None)


def test_an_unknown_unit_lists_the_known_ones() -> None:
    with pytest.raises(UnitError, match='furlong.*mm'):
        choose_unit(65.0, 'furlong', BALL)


def test_stray_points_do_not_change_the_extent() -> None:
    points = np.random.default_rng(0).random((10_000, 3))
    points[:20] = 1e6
    assert robust_extent(points) < 1.01


def test_the_error_names_the_file() -> None:
    text = b'0 0 0\n2.5 0 0\n0 2.5 0\n0 0 2.5\n'
    with pytest.raises(ScanFileError, match=r'ball\.xyz: unit mm.*25\.4'):
        parse_scan(text, '.xyz', 'ball.xyz', 'mm', BALL)


def test_in_is_an_inch_as_in_an_object_file() -> None:
    assert choose_unit(65.0 / 25.4, 'in', 0.065).metres == METRES_PER_UNIT['inch']
