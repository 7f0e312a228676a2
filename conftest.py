# SPDX-License-Identifier: Apache-2.0
"""Fixtures for every test: an own ROS domain, and real processes that never outlive their test."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from tests.chromium import chromium, installed, new_tab
from tests.executables import executable
from tests.patience import Patience

# A busy machine must not fail an example for its time.
settings.register_profile('untimed', deadline=None)
settings.load_profile('untimed')
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Where nothing may be missing (CI), a skipped test fails the run."""
    reporter = session.config.pluginmanager.get_plugin('terminalreporter')
    skipped = reporter.stats.get('skipped', []) if reporter else []
    if os.environ.get('GRASP_NO_SKIP') and skipped:
        print(f'\n{len(skipped)} skipped: nothing may be missing here', file=sys.stderr)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that start processes come first: one of these at the end would idle a core."""
    long = {item.path for item in items if {'start', 'open_tab'} & set(item.fixturenames)}
    items.sort(key=lambda item: item.path not in long)


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain id that no other test on this machine holds, also across test runs."""
    for number in range(1, 101):
        path = Path(tempfile.gettempdir()) / f'ros_domain_{number}.lock'
        handle = path.open('w')
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            handle.close()
            continue
        monkeypatch.setenv('ROS_DOMAIN_ID', str(number))
        yield number
        handle.close()
        return
    pytest.fail('all 100 ROS domain ids are held by other tests')


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


@pytest.fixture(name='wait_until')
def _wait_until() -> Callable[..., None]:
    return wait_until


@pytest.fixture
def start(domain_id: int, tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Start an executable of the environment by name, on the test's own ROS domain."""
    started: list[Running] = []

    def run(name: str, *arguments: object, **environment: str) -> Running:
        log = tmp_path / f'{name}_{len(started)}.log'
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

    yield run
    for running in started:
        running.ask()
    for running in started:
        running.stop()


@pytest.fixture
def open_tab(tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Open a tab of a real browser by width and height; a complaint in its console fails."""
    if not installed():
        (pytest.fail if os.environ.get('GRASP_NO_SKIP') else pytest.skip)(
            'no chromium on this machine'
        )
    tabs: list[Any] = []
    with chromium() as browser:

        def opened(width: int, height: int, **options: Any) -> Any:
            tabs.append(new_tab(browser, width, height, **options))
            return tabs[-1]

        yield opened
        for k, tab in enumerate(tabs):
            tab.screenshot(path=tmp_path / f'tab_{k}.png')
        assert [tab.complaints for tab in tabs] == [[]] * len(tabs)
