# SPDX-License-Identifier: Apache-2.0
"""Text for terminals: nothing foreign steers one, nothing of ours is lost."""

from __future__ import annotations

import io
import os
import pty
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from tests.patience import Patience

from grasp_common.terminal import (
    complain,
    fixed,
    in_picture,
    print_table,
    printable,
    progress_bar,
    significant,
    tracked,
)


@given(st.text())
def test_what_is_printable_steers_no_terminal(text: str) -> None:
    assert printable(text).isprintable()


@given(st.text(max_size=100).filter(str.isprintable))
def test_harmless_text_stays_as_it_is(text: str) -> None:
    assert printable(text) == text


@pytest.mark.parametrize(
    ('text', 'shown'),
    [
        ('\x1b]0;pwned\x07', r'\x1b]0;pwned\x07'),
        ('a\nb\r', r'a\nb\r'),
        ('\u202eevil', r'\u202eevil'),
        ('\x9b31m', r'\x9b31m'),
        (os.fsdecode(b'\xff'), r'\udcff'),
        ('Öl µ 5 °C', 'Öl µ 5 °C'),
    ],
)
def test_controls_are_shown_as_escapes(text: str, shown: str) -> None:
    assert printable(text) == shown


@given(st.floats(allow_nan=False, allow_infinity=False, width=32), st.integers(0, 6))
def test_a_fixed_number_is_the_rounded_one_and_its_zero_has_no_sign(
    value: float, digits: int
) -> None:
    text = fixed(value, digits)
    assert float(text) == float(f'{value:.{digits}f}')
    assert not (text.startswith('-') and float(text) == 0.0)


def test_what_is_rounding_beside_the_largest_number_is_zero() -> None:
    assert significant(-6.4e-16, 5, 5.4) == '0'
    assert significant(-6.4e-16, 5, 1e-12) == '-6.4e-16'
    assert significant(0.0, 5, 0.0) == '0'


def test_headings_keep_their_units_and_names_their_brackets() -> None:
    stream = io.StringIO()
    print_table(
        ['name', 'depth [mm]'], [['[red]ball[/red]', '1.5'], ['\x1b[2J', '-']], stream=stream
    )
    assert 'depth [mm]' in stream.getvalue()
    assert '[red]ball[/red]' in stream.getvalue()
    assert r'\x1b[2J' in stream.getvalue() and '\x1b' not in stream.getvalue()


def test_a_complaint_is_one_harmless_line(capsys: pytest.CaptureFixture[str]) -> None:
    complain('record', ValueError('bad name \x1b[31m\n'))
    assert capsys.readouterr().err == 'record: bad name \\x1b[31m\\n\n'


def test_without_a_terminal_there_is_no_progress(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(tracked([1, 2, 3], 'counting')) == [1, 2, 3]
    assert capsys.readouterr() == ('', '')


@contextmanager
def terminal(monkeypatch: pytest.MonkeyPatch, quiet: float) -> Iterator[int]:
    """stderr is a terminal meanwhile; gives its other end."""
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, 'w') as stream, monkeypatch.context() as patch:
        patch.setattr(sys, 'stderr', stream)
        patch.setattr('grasp_common.terminal.QUIET_SECONDS', quiet)
        patch.setenv('TERM', 'xterm')
        yield ours
    os.close(ours)


def test_a_bar_comes_while_the_work_is_in_one_long_call(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, patience = '', Patience(20.0)
    with terminal(monkeypatch, 0.05) as end, progress_bar('solving [\x1b[2J]') as show:
        show(0.0, 'first [step]')
        while 'step' not in seen and not patience.over:
            seen += os.read(end, 4096).decode()
    assert r'solving [\x1b[2J]' in seen and 'first [step]' in seen


def test_quick_work_shows_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch, 60.0) as end:
        with progress_bar('quick', 1.0) as show:
            show(1.0)
        sys.stderr.write('end')
        sys.stderr.flush()
        assert os.read(end, 4096) == b'end'


@pytest.mark.parametrize('name', ['a\x1b]0;owned\x07b', '$\\frac$', '50 $', '\u202eball'])
def test_a_name_in_a_picture_is_drawn_without_a_complaint(
    name: str, recwarn: pytest.WarningsRecorder
) -> None:
    figure = Figure()
    figure.suptitle(in_picture(name))
    figure.savefig(io.BytesIO())
    assert not recwarn.list
