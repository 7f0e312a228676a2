# SPDX-License-Identifier: Apache-2.0
"""`deformation --standby`: everything is loaded before somebody says with what to begin."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.executables import executable
from tests.processes import descendants, living

from shell_deform.commands import deformation
from shell_deform.commands.deformation import StandBy
from shell_deform.live.background import worker_link
from shell_deform.live.background.worker_link import Build, WorkerLink


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


class Ahead:
    """A background process that is none, and remembers what it was told."""

    def __init__(self) -> None:
        self.build: Build | None = None
        self.alive, self.ended = True, False
        self.process = SimpleNamespace(pid=os.getpid())

    def start(self, build: Build) -> None:
        self.build = build
        self.alive = build.object_name != 'teapot'

    def stop(self, patience_s: float) -> None:
        self.ended = True


BALL = b'{"object": "ball.yaml", "theory": "koiter"}\n'


@pytest.mark.parametrize(
    ('said', 'built'),
    [
        (b'', None),
        (BALL, Build('ball.yaml', 'koiter')),
        (BALL.replace(b'ball', b'cup') + BALL, Build('ball.yaml', 'koiter')),
    ],
)
def test_it_builds_what_it_is_told_while_it_stands_by(
    monkeypatch: pytest.MonkeyPatch, said: bytes, built: Build | None
) -> None:
    monkeypatch.setattr(deformation, 'WorkerProcess', Ahead)
    ours, theirs = os.pipe()
    # All at once, as where it loads slowly.
    os.write(theirs, said + b'["--ros-args"]\n')
    os.close(theirs)
    standing_by = StandBy(ours)
    assert standing_by.wait() == ['--ros-args']
    assert standing_by.ahead.build == built
    os.close(ours)


def test_a_shell_that_cannot_be_built_leaves_it_standing_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(deformation, 'WorkerProcess', Ahead)
    monkeypatch.setattr(deformation, 'LOOKED_AFTER_S', 0.001)
    ours, theirs = os.pipe()
    os.write(theirs, BALL.replace(b'ball.yaml', b'teapot'))
    standing_by = StandBy(ours)
    first = standing_by.ahead
    renew = standing_by._renew
    monkeypatch.setattr(standing_by, '_renew', lambda: (renew(), os.write(theirs, b'[]\n')))
    assert standing_by.wait() == []
    assert first.ended and standing_by.ahead.build is None
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize('same', [True, False])
def test_what_was_built_meanwhile_serves_where_it_is_what_is_wanted(
    monkeypatch: pytest.MonkeyPatch, same: bool
) -> None:
    monkeypatch.setattr(worker_link, 'WorkerProcess', Ahead)
    wanted, ahead = Build('ball.yaml', 'koiter'), Ahead()
    ahead.start(wanted if same else Build('ball.yaml', 'thick'))
    link = WorkerLink(wanted, ahead)
    assert (link.worker is ahead) == same and ahead.ended != same
    assert link.worker.build == wanted
