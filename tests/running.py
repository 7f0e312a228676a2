# SPDX-License-Identifier: Apache-2.0
"""Real processes of a test on a ROS domain of their own, which never outlive it."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest
from tests.executables import executable
from tests.patience import Patience


def _free_domain() -> tuple[IO[str], int]:
    """A ROS domain id that no other test on this machine holds, and the lock that keeps it so."""
    for number in range(1, 101):
        handle = (Path(tempfile.gettempdir()) / f'ros_domain_{number}.lock').open('w')
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            handle.close()
            continue
        return handle, number
    pytest.fail('all 100 ROS domain ids are held by other tests')


@contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain of one's own, also across test runs; what starts meanwhile is in it."""
    handle, number = _free_domain()
    with handle, pytest.MonkeyPatch.context() as environment:
        environment.setenv('ROS_DOMAIN_ID', str(number))
        yield number


class Running:
    """A started executable with its log file."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        self.process = process
        self.log = log
        self._asked = False

    @property
    def text(self) -> str:
        """Everything it has written to stdout and stderr so far."""
        return self.log.read_text(errors='replace')

    def wait_for(self, text: str, timeout: float = 30.0) -> None:
        """Wait until `text` stands in the log; fail with the log if it ends or the time is up."""
        wait_until(
            lambda: text in self.text or self.process.poll() is not None,
            timeout,
            lambda: f'{text!r} not in:\n{self.text}',
        )
        assert text in self.text, self.text

    def ask(self, sig: int = signal.SIGINT) -> None:
        """Send `sig` once: a second one would interrupt the clean-up that the first began."""
        if self.process.poll() is None and not self._asked:
            self._asked = True
            self.process.send_signal(sig)

    def ended(self, timeout: float = 60.0) -> int:
        """Wait until it ends by itself; returns its exit code."""
        wait_until(
            lambda: self.process.poll() is not None, timeout, lambda: f'runs on:\n{self.text}'
        )
        return int(self.process.returncode)

    def stop(self, sig: int = signal.SIGINT, timeout: float = 10.0) -> int:
        """End it by `sig`, then by SIGKILL; returns its exit code."""
        if self.process.poll() is None:
            self.ask(sig)
            patience = Patience(timeout)
            while self.process.poll() is None and not patience.over:
                time.sleep(0.01)
            if self.process.poll() is None:
                self.process.kill()
                self.process.wait()
        return self.process.returncode


def wait_until(
    condition: Callable[[], object],
    timeout: float = 30.0,
    message: Callable[[], str] = lambda: 'condition not met in time',
) -> None:
    """Poll `condition` every 10 ms until it is true or `timeout` seconds of patience are over."""
    patience = Patience(timeout)
    while not condition():
        if patience.over:
            pytest.fail(message())
        time.sleep(0.01)


@contextmanager
def processes(folder: Path) -> Iterator[Callable[..., Running]]:
    """Starts executables of the environment by name, their logs in `folder`; ends all of them."""
    started: list[Running] = []

    def run(name: str, *arguments: object, **environment: str) -> Running:
        log = folder / f'{name}_{len(started)}.log'
        with log.open('wb') as stream:
            process = subprocess.Popen(
                [executable(name), *map(str, arguments)],
                stdout=stream,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env={**os.environ, **environment, 'PYTHONUNBUFFERED': '1'},
            )
        started.append(Running(process, log))
        return started[-1]

    try:
        yield run
    finally:
        for running in started:
            running.ask()
        for running in started:
            running.stop()
