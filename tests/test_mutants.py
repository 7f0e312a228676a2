# SPDX-License-Identifier: Apache-2.0
"""The mutation run: what it leaves, what it asks and what it takes for no change."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest
from tests import mutants
from tests.mutants import mutant_at, places
from tests.processes import living
from tests.running import wait_until

# A process that starts one in a group of its own, tells its number and waits.
PARENT = """
import subprocess, time
child = subprocess.Popen(['sleep', '1000'], start_new_session=True)
print(child.pid, flush=True)
time.sleep(1000)
"""


def test_tests_of_a_run_that_is_cut_end_with_all_that_they_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cut = threading.Event()
    cut.set()
    monkeypatch.setattr(mutants, 'CUT', cut)
    command = [sys.executable, '-c', PARENT]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        assert living(child)
        assert not mutants.ended(process, 1000.0)
    wait_until(lambda: not living(child))


@pytest.mark.parametrize(
    ('source', 'change'),
    [
        ('def f(x):\n    return x < 3\n', ['x >= 3', 'x < 6']),
        ('y = -x + 1e-09', ['-x - 1e-09', '+x + 1e-09', '-x + 1.000000001']),
        ('y = a and (not b)', ['a or not b']),
        ("told = f'{1000.0 * gap:.1f} mm of {name[:40]!r}'", ['1000.0 / gap', '2000.0 * gap']),
        ('cell = fixed(1000.0 * gap, 4)', ['1000.0 / gap', '2000.0 * gap']),
        ('x: Array[3] = points.reshape(-1, 4)', ['reshape(-1, 8)']),
        ('FACE_GOAL = 0.01', []),
    ],
)
def test_what_can_be_seen_is_changed_and_what_is_only_for_show_is_not(
    tmp_path: Path, source: str, change: list[str]
) -> None:
    path = tmp_path / 'one.py'
    path.write_text(source)
    texts = [mutant_at(path, index).text for index in places(path)]
    assert len(texts) == len(change)
    assert all(any(one in text for text in texts) for one in change)


def test_a_mutant_knows_the_functions_of_its_file_that_lead_to_it(tmp_path: Path) -> None:
    path = tmp_path / 'one.py'
    path.write_text(
        'MORE = 3\n\n'
        'def _deep(x):\n    return x - MORE\n\n'
        'def _middle(x):\n    return _deep(x)\n\n'
        'def shown(x):\n    return _middle(x)\n\n'
        'def other(x):\n    return x\n'
    )
    found = [mutant_at(path, index).within for index in places(path)]
    assert sorted(found, key=len) == [
        ('_deep', '_middle', 'shown'),
        ('MORE', '_deep', '_middle', 'shown'),
    ]
