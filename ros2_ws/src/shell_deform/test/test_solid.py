# SPDX-License-Identifier: Apache-2.0
"""Thin shells beside solids, and the rule for thick walls."""

import json

import numpy as np
import pytest

from shell_deform.commands import shell_verify
from shell_deform.theory.thin_wall import excess_stiffness, thick_wall_warning
from shell_deform.verification import solid


@pytest.mark.parametrize('ratio', solid.ratios())
def test_the_rule_says_how_much_stiffer_than_a_solid_a_thin_sphere_is(ratio):
    sphere = solid.compare(ratio, vertices=350)
    assert excess_stiffness(1 / ratio) == pytest.approx(sphere.excess[0], rel=solid.RULE_GOAL)
    # The share at small loads is about the largest one; deep dents need more vertices than this.
    assert np.nanmax(sphere.excess[sphere.depth < 2.5]) < 1.08 * sphere.excess[0]


def test_a_thick_wall_is_warned_about_with_the_expected_error():
    assert thick_wall_warning(1 / 100) is None
    warning = thick_wall_warning(1 / 12.5)
    assert warning is not None and 'about 11 % too stiff' in warning


def test_series_reaches_from_six_to_a_hundred():
    assert min(solid.ratios()) == 6 and max(solid.ratios()) == 100


def test_command_prints_the_comparison_and_the_rule(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(solid, 'ratios', lambda: [25.0, 40.0])
    plot = tmp_path / 'solid.png'
    assert shell_verify.main(['--solid', '--plot', str(plot), '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert {row['name'] for row in document['problems']} == {
        'solid_sphere_rh_25',
        'solid_sphere_rh_40',
    }
    assert '5 % at R/h 29' in document['rule']
    assert plot.read_bytes().startswith(b'\x89PNG')
