# SPDX-License-Identifier: Apache-2.0
"""Every reference value is told with its status, its source, and why it is scored or not."""

import ast
import json
from pathlib import Path

import pytest

from shell_deform import verification
from shell_deform.commands import shell_verify
from shell_deform.verification.problem import Verified
from shell_deform.verification.reference_table import reference_table

ROWS = reference_table()


def test_every_value_says_who_and_why():
    assert len(ROWS) > 300
    for row in ROWS:
        assert row.status in ('published', 'own')
        assert row.source
        assert row.scored.startswith(('yes', 'no: '))
        assert (row.goal is not None) <= row.scored.startswith('yes')


def test_the_scored_value_of_the_pinched_cylinder_is_the_published_one():
    values = {row.value: row for row in ROWS if row.problem == 'pinched_cylinder'}
    assert values[1.8248e-5].status == 'published' and values[1.8248e-5].goal == 5e-3
    assert values[1.828e-5].status == 'own' and values[1.828e-5].goal is None


def test_loads_that_are_not_scored_are_listed_with_a_reason():
    left_out = [row for row in ROWS if row.problem == 'sze_pullout_cylinder' and row.goal is None]
    assert {row.quantity.split()[0] for row in left_out} == {'W_A', '-U_B', '-U_C'}
    assert sum('snap' in row.scored for row in left_out) == 12
    assert sum('shear-flexible' in row.scored for row in left_out) == 9


def solved_problems():
    """What stands first in each `Verified(...)` of the package, up to its first variable part."""
    for path in sorted(Path(verification.__file__).parent.glob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'Verified':
                name = node.args[0]
                part = name.values[0] if isinstance(name, ast.JoinedStr) else name
                if isinstance(part, ast.Constant):
                    yield part.value


@pytest.mark.parametrize('problem', sorted(set(solved_problems())))
def test_every_problem_that_is_solved_has_its_reference_in_the_table(problem):
    assert any(row.problem.startswith(problem) for row in ROWS)


def test_a_goal_wider_than_a_percent_of_a_small_value_says_what_it_is_relative_to():
    wide = [r for r in ROWS if r.problem.startswith('sze') and r.goal and r.goal > 0.0101]
    assert wide
    assert all('largest value of its column' in row.scored for row in wide)


def test_the_printed_table_tells_a_source_once_and_ends_with_its_counts(capsys):
    assert shell_verify.main(['--references']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len([line for line in lines if line.lstrip().startswith('sze_slit_annulus')]) <= 10
    scored = sum(row.scored.startswith('yes') for row in ROWS)
    assert f'{len(ROWS)} references' in lines[-1] and f'{scored} scored' in lines[-1]


def test_the_printed_error_is_in_percent_of_the_reference_and_a_miss_is_marked(capsys):
    shell_verify._print_table([Verified('sphere', 'w', 2.0, 'book', 2.05, 500, 1.0, 0.01)])
    printed = capsys.readouterr()
    assert '+2.500 % !' in printed.out + printed.err
    assert '1.00 %' in printed.out + printed.err


def test_the_command_prints_the_table_without_solving(capsys):
    assert shell_verify.main(['--references', '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document['references']) == len(ROWS)
