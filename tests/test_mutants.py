# SPDX-License-Identifier: Apache-2.0
"""The mutation run: what it leaves, what it asks and what it takes for no change."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest
from tests import mutants
from tests.processes import living

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
    assert not living(child)
