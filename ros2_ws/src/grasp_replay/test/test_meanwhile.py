# SPDX-License-Identifier: Apache-2.0
"""Work beside other work: its result, its error, and that nothing of it is left."""

from __future__ import annotations

import os
import signal
import time

import pytest

from grasp_replay import meanwhile as module
from grasp_replay.errors import BagError
from grasp_replay.meanwhile import meanwhile


def refused(text: str) -> None:
    raise BagError(text)


@pytest.fixture(params=[False, True], ids=['two cores', 'one core'])
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    monkeypatch.setattr(module, 'one_core', lambda: request.param)
    return request.param


def test_a_job_is_done_beside_the_block_where_there_is_a_core_for_it(cores: bool) -> None:
    with meanwhile(os.getpid) as later:
        assert (later() == os.getpid()) is cores


def test_what_a_job_raises_is_raised_where_its_result_is_asked_for(cores: bool) -> None:
    with meanwhile(refused, 'no such table') as later, pytest.raises(BagError, match='no such'):
        later()


def test_a_block_that_fails_does_not_wait_for_the_job(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, 'one_core', lambda: False)
    child = []
    with pytest.raises(BagError, match='on the way'), meanwhile(time.sleep, 600.0):
        child = [int(pid) for pid in children()]
        raise BagError('failed on the way')
    assert child and not set(child) & set(map(int, children()))


def pid_of_a_job() -> tuple[int, int]:
    with meanwhile(os.getpid) as later:
        return os.getpid(), later()


def test_a_process_that_may_have_no_children_does_the_job_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, 'one_core', lambda: False)
    # The child that it starts is such a process.
    with meanwhile(pid_of_a_job) as later:
        own, of_job = later()
    assert own == of_job != os.getpid()


def children() -> list[str]:
    """Process ids of the children of this thread."""
    with open(f'/proc/self/task/{os.getpid()}/children') as found:
        return found.read().split()


def die_in_a_child(parent: int) -> str:
    if os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    return 'done'


def test_what_a_killed_child_leaves_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, 'one_core', lambda: False)
    with meanwhile(die_in_a_child, os.getpid()) as later:
        assert later() == 'done'


def test_a_block_that_fails_at_once_ends_a_child_that_has_hardly_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, 'one_core', lambda: False)
    before = set(children())
    for _ in range(50):
        with pytest.raises(BagError), meanwhile(time.sleep, 600.0):
            raise BagError('at once')
    assert set(children()) <= before
