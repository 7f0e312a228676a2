# SPDX-License-Identifier: Apache-2.0
"""Numbers that people read: each is that of its cause, in the unit that stands beside it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grasp_replay.commands.grasp_report import print_results
from grasp_replay.lockstep import _Open
from grasp_replay.report.write import _beside, _milli, _modulus
from grasp_replay.results import TABLE, THEORIES, models_of, table_lines, verdict
from grasp_replay.topic_selection import listed

POUND_FORCE_N = 0.45359237 * 9.80665
"""The international pound in kg times standard gravity."""


def row(**others: Any) -> dict[str, Any]:
    numbers = dict.fromkeys(TABLE, 0.0015)
    return {
        'force_n': 10.0,
        'measured_max_displacement_m': 0.0025,
        'measured_max_displacement_sigma_m': 1.25e-4,
        'measured_by_pins_m': None,
        'noise_floor_m': 1e-4,
        'theories': {name: {**numbers, 'max_displacement_m': 0.002} for name in THEORIES},
        **others,
    }


def test_the_table_is_in_newtons_pounds_and_millimetres() -> None:
    heading, *lines = table_lines({'rows': [row()]})
    assert [line[heading.index('theory')] for line in lines] == list(THEORIES)
    cells = dict(zip(heading, lines[0], strict=True))
    assert float(cells['force lbf']) == pytest.approx(10.0 / POUND_FORCE_N, abs=0.005)
    assert (cells['force N'], cells['measured mm'], cells['+-']) == ('10.000', '2.500', '0.125')
    assert (cells['mean'], cells['max disp.'], cells['noise floor']) == ('1.500', '2.000', '0.100')
    assert cells['pins mm'] == '-'


def test_each_model_is_named_with_its_modulus_and_its_own_displacement() -> None:
    predicted = {
        'young_modulus_pa': 12.75e6,
        'solid_young_modulus_pa': 13.79e6,
        'predicted_max_displacement_m': {'linear': 0.004, 'koiter': 0.006, 'thick': None},
    }
    # With its own, smaller modulus a linear wall gives way by that much more.
    assert models_of(predicted, 8.5e6) == {
        'linear, E 12.75 MPa': 0.004,
        'koiter, E 12.75 MPa': 0.006,
        'linear with its own E 8.50 MPa, from row 1': pytest.approx(0.004 * 1.5),
    }


@pytest.mark.parametrize(
    ('value', 'measured', 'text'),
    [
        (0.0055, 0.005, '5.50 (+10 %)'),
        (0.002, 0.005, '2.00 (-60 %)'),
        (0.005, 0.005, '5.00 (+0 %)'),
    ],
)
def test_a_prediction_stands_in_millimetres_with_how_far_it_is_off(
    value: float, measured: float, text: str
) -> None:
    assert _beside(value, measured) == text
    assert _milli(None) == '–'


def test_the_modulus_of_the_thick_wall_stands_beside_that_of_the_thin_one() -> None:
    known = {'rows': [row()], 'young_modulus_pa': 12.75e6, 'solid_young_modulus_pa': 13.79e6}
    assert _modulus(known) == 'E 12.75 MPa (thick: 13.79 MPa)'
    assert _modulus({**known, 'solid_young_modulus_pa': 12.75e6}) == 'E 12.75 MPa'
    assert _modulus({'rows': []}) == ''


def test_a_force_that_is_hardly_known_gives_no_verdict_and_says_how_well() -> None:
    def told(sigma: float) -> str:
        contacts = SimpleNamespace(sigma=np.full(2, sigma))
        compared = dict.fromkeys(('koiter', 'linear'), object())
        return verdict(SimpleNamespace(compared=compared, contacts=contacts, force=10.0))  # type: ignore[arg-type]

    assert 'the force is known to 50 % only' in told(5.0)
    nothing = SimpleNamespace(compared={'koiter': None, 'linear': object()})
    assert 'does not carry the load' in verdict(nothing)  # type: ignore[arg-type]


def test_who_owes_an_answer_is_named_with_the_time_of_the_question() -> None:
    owed = _Open('/hand/contacts', 1_250_000_000, {'/b', '/a'})
    assert owed.clause() == 'nothing on /a, /b for /hand/contacts of 1.250 s'
    assert _Open('/scan', None, {'/a'}).clause() == 'nothing on /a for /scan'


def test_many_topics_are_listed_up_to_the_twelfth_with_how_many_are_left() -> None:
    names = [f'/t{k:02d}' for k in range(15)]
    assert listed(names) == ', '.join(names[:12]) + ' and 3 more'
    assert listed(names[:12]) == ', '.join(names[:12])


def test_the_terminal_names_object_and_moduli_in_megapascals(
    capsys: pytest.CaptureFixture[str],
) -> None:
    results = {
        'experiment': 'squeeze', 'label': 'SYNTHETIC', 'object': 'ball', 'rows': [],
        'young_modulus_pa': 12.75e6, 'young_modulus_from': 'fitted to row 1',
        'solid_young_modulus_pa': 13.79e6, 'published': [],
    }  # fmt: skip
    print_results(results, Path('out'))
    told = capsys.readouterr().out
    assert 'squeeze (SYNTHETIC)' in told
    assert 'ball, E = 12.75 MPa (fitted to row 1), of the solid 13.79 MPa; lengths in mm' in told
