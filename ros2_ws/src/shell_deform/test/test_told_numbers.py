# SPDX-License-Identifier: Apache-2.0
"""Sentences with numbers: each says the number of its cause, in its unit."""

from types import SimpleNamespace

import numpy as np
import pytest

from shell_deform.commands.arguments import direction
from shell_deform.commands.shell_verify import _print_table
from shell_deform.commands.solid_check import print_excess, rule
from shell_deform.identify.force_curve import IdentificationError
from shell_deform.identify.squeeze_table import read_table
from shell_deform.live.tick.finger_motion import FingerMotion
from shell_deform.live.tick.sample import SampleError, check_served
from shell_deform.readout import _stress_warnings, _warnings
from shell_deform.surface.control_mesh import MeshError, control_mesh
from shell_deform.theory.gas import Gas, GasError
from shell_deform.theory.thin_wall import excess_stiffness, thick_wall_warning
from shell_deform.verification.problem import Verified


def table(text):
    return [line.split() for line in text.splitlines() if line.strip()]


def test_an_error_stands_in_percent_with_a_mark_where_it_misses_its_goal(capsys):
    _print_table(
        [
            Verified('met', 'force', 2.0, 'paper', 2.01, 500, 1.25, 0.01),
            Verified('missed', 'force', 2.0, 'paper', 2.1, 500, 1.25, 0.01),
        ]
    )
    rows = {row[0]: row for row in table(capsys.readouterr().out)}
    assert rows['met'][1:] == (
        ['force', '2.01', '2', '+0.500', '%', '1.00', '%', '500', '1.2', 'paper']
    )
    assert rows['missed'][4:9] == ['+5.000', '%', '!', '1.00', '%']


def test_the_stiffness_beyond_a_solid_stands_in_percent_at_each_depth(capsys):
    depth, excess = np.array([0.05, 0.5, 2.4]), np.array([0.10, 0.06, 0.02])
    print_excess([SimpleNamespace(radius_over_thickness=29.0, depth=depth, excess=excess)])
    row = next(row for row in table(capsys.readouterr().out) if row[0] == '29')
    told = excess_stiffness(1.0 / 29.0)
    assert row[1:5] == ['+10.0', '%', f'{100 * told:+.1f}', '%']
    assert row[5:] == ['+9.6', '%', '+6.0', '%', '+4.9', '%', '+2.0', '%', '-']
    assert f'{100 * told:.3g} % at R/h 29' in rule()


def test_a_thick_wall_is_told_with_its_ratio_its_excess_and_where_that_is_small():
    assert thick_wall_warning(0.01) is None
    told = thick_wall_warning(0.1)
    assert 'the wall is 0.1 of the radius' in told
    assert f'about {100 * excess_stiffness(0.1):.0f} % too stiff' in told
    radius = float(told.partition('5 % at R/h ')[2].partition(')')[0])
    assert excess_stiffness(1.0 / radius) == pytest.approx(0.05, rel=0.05)


def test_a_stress_above_the_yield_stress_is_told_in_megapascals():
    at_rest, pulled = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [250e6, 0.0, 0.0]])
    (told,) = _stress_warnings(at_rest, pulled, 200e6)
    assert 'reaches 250 MPa, above the yield stress of 200 MPa' in told
    assert _stress_warnings(at_rest, pulled, 251e6) == ()
    assert _stress_warnings(at_rest, pulled, None) == ()


def test_a_large_strain_is_told_in_percent():
    small, large = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]])
    (told,) = _warnings(small, large, small, small, None)
    assert 'strain reaches 30 %: beyond' in told
    assert _warnings(small, small, small, small, None) == ()


def test_an_answer_larger_than_its_object_is_refused_in_millimetres():
    check_served(np.zeros((3, 3), np.float32), 0.065, 0.066)
    with pytest.raises(SampleError, match='by 70 mm, more than the 66 mm'):
        check_served(np.zeros((3, 3), np.float32), 0.070, 0.066)
    with pytest.raises(SampleError, match='not finite'):
        check_served(np.array([[np.nan]], np.float32))


def leaning(degrees):
    """One finger whose body has turned about z."""
    angle = np.radians(degrees)
    normal = np.array([[np.cos(angle), np.sin(angle), 0.0]])
    sample = SimpleNamespace(
        touching=np.array([True]), finger=np.array([2]), normal=normal,
        along=np.array([[0.0, 0.0, 1.0]]),
    )  # fmt: skip
    sample.rows = lambda _: sample
    return sample


def test_a_finger_that_turns_by_more_than_its_width_is_told_with_both():
    motion = FingerMotion(width=0.01, reach=0.05)
    motion.check(leaning(0.0))
    # 0.01 m at 0.05 m are 11.5 degrees.
    motion.check(leaning(11.0))
    with pytest.raises(SampleError, match='finger 2 turned by 12 degrees .* width of 10 mm'):
        motion.check(leaning(23.0))


def test_a_direction_of_a_command_is_a_unit_vector_however_long_it_is_written():
    for text in ('1,-2,2', '1e-200 -2e-200 2e-200', '1e300,-2e300,2e300'):
        assert direction(text) == pytest.approx((1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0))


def test_a_negative_absolute_pressure_is_told():
    with pytest.raises(GasError, match='absolute gas pressure -50.0 Pa is negative'):
        Gas('sealed', -150.0, 100.0)
    assert Gas('sealed', -100.0, 100.0).is_sealed


@pytest.mark.parametrize(
    ('faces', 'sentence'),
    [
        ([[0, 1, 2], [1, 0, 3], [0, 1, 4]], r'edge \(0, 1\) belongs to 3 triangles \[0, 1, 2\]'),
        ([[0, 1, 2], [0, 1, 3]], 'triangles 0 and 1 both run from vertex 0 to 1'),
        ([[0, 1, 2], [3, 4, 5]], r'has 2 separate pieces \(vertex 3 is not connected'),
    ],
)
def test_what_is_wrong_with_a_mesh_is_told_with_its_numbers(faces, sentence):
    places = np.random.default_rng(5).normal(size=(6, 3))[: np.max(faces) + 1]
    with pytest.raises(MeshError, match=sentence):
        control_mesh(places, np.array(faces))


def test_rows_of_different_lengths_are_told_with_their_numbers(tmp_path):
    path = tmp_path / 'rows.csv'
    path.write_text('1,0.001\n2,0.002\n3,0.003,7\n')
    with pytest.raises(IdentificationError, match='row 1 has 2, row 3 has 3'):
        read_table(path)
