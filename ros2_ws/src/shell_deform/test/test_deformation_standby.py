# SPDX-License-Identifier: Apache-2.0
"""`deformation --standby`: everything is loaded before somebody says with what to begin."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from tests.executables import executable
from tests.processes import descendants, living


def _standing_by() -> tuple[subprocess.Popen[bytes], list[int]]:
    """The process and what it has started below."""
    process = subprocess.Popen(
        [executable('deformation'), '--standby'],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    while not (below := descendants(process.pid)) or not _is_worker(below[0]):
        assert process.poll() is None
        time.sleep(0.01)
    return process, below


def _is_worker(pid: int) -> bool:
    # Before that it is a copy of its parent, which waits for it to become what it shall be.
    return b'background.worker' in Path(f'/proc/{pid}/cmdline').read_bytes()


@pytest.mark.parametrize(
    ('said', 'code', 'text'),
    [
        (b'', 0, ''),
        (b'["--nonsense"]\n', 2, "deformation: unknown argument '--nonsense'; see --help\n"),
    ],
)
def test_it_begins_with_what_it_is_told_and_ends_where_nobody_tells_it(
    said: bytes, code: int, text: str
) -> None:
    process, below = _standing_by()
    assert process.communicate(said)[0].decode() == text
    assert process.returncode == code
    assert not any(map(living, below))


def test_without_its_background_process_it_stands_by_no_longer() -> None:
    process, below = _standing_by()
    os.kill(below[0], signal.SIGSTOP)
    assert process.wait() == 0
    process.communicate()
    assert not any(map(living, below))
