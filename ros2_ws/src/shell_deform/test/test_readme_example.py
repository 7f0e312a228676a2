# SPDX-License-Identifier: Apache-2.0
"""The examples of the README and of the package's docstring run as they are printed."""

import doctest
import re
from pathlib import Path

import pytest

import shell_deform

README = Path(__file__).parents[1] / 'README.md'


def statements_of(heading):
    """The code under a heading, and its lines without imports and empty ones."""
    section = README.read_text().split(f'## {heading}', 1)[1]
    code = re.search(r'```python\n(.*?)```', section, re.DOTALL).group(1)
    return code, [line for line in code.splitlines() if line and 'import' not in line]


def test_five_lines_solve_and_show_a_squeezed_ball(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, statements = statements_of('Five lines')
    assert len(statements) <= 5
    exec(compile(code, str(README), 'exec'), {})
    said = re.fullmatch(r'tennis_ball: ([0-9.]+) N per contact, 10 mm\n', capsys.readouterr().out)
    assert 18.0 < float(said.group(1)) < 24.0
    assert (tmp_path / 'ball.png').read_bytes().startswith(b'\x89PNG')


def test_ten_lines_solve_a_squeezed_ball(capsys):
    code, statements = statements_of('Ten lines')
    assert len(statements) <= 10
    exec(compile(code, str(README), 'exec'), {})
    lines = capsys.readouterr().out.strip().splitlines()
    assert len(lines) == 6
    forces = [float(line.split()[2]) for line in lines]
    assert forces[0] == 0.0 and all(a < b for a, b in zip(forces, forces[1:], strict=False))
    assert 18.0 < forces[-1] < 24.0


def test_the_example_in_the_docstring_of_the_package_is_true():
    failed, tried = doctest.testmod(shell_deform)
    assert (failed, tried) == (0, 4)


def test_the_example_of_the_page_on_the_factorisation_gives_the_solution():
    page = Path(__file__).parents[4] / 'docs' / 'factor.md'
    code = re.search(r'```python\n(.*?)```', page.read_text(), re.DOTALL).group(1)
    names = {}
    exec(compile(code, str(page), 'exec'), names)
    assert names['x'] == pytest.approx([1 / 4, 1 / 5, 1 / 6])
    assert names['unstable'] is False
