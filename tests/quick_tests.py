# SPDX-License-Identifier: Apache-2.0
"""A pytest plugin for `tests/mutants.py`: the quick tests, those that know the place first.

A test is stopped, and counts as skipped, when it takes more processor time than it is given or
sleeps for long; so is the whole run when all together did. Nothing is run that starts a process
by a fixture of `conftest.py`. What happened is written as JSON.
"""

from __future__ import annotations

import inspect
import json
import os
import re
import signal
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

LIMITS = 'QUICK_TESTS'
"""The variable of the environment that holds `Limits`."""

SLEEPS = 4.0
"""So many times longer than of processor time a test may take."""

STOPPED = 'takes its time'
"""Why a test was skipped that was stopped."""


@dataclass(frozen=True)
class Limits:
    """Processor time of one test and of all [s], names that a test may know, where to tell."""

    one_s: float
    all_s: float
    names: tuple[str, ...]
    told: str

    @property
    def text(self) -> str:
        """As the environment holds it."""
        return json.dumps(asdict(self))


@dataclass(frozen=True)
class Told:
    """The first test that failed, all of them, those that were stopped, and whether one hung."""

    failed: str = ''
    all_failed: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()
    hangs: bool = False


def read_told(path: Path) -> Told:
    """What a run told; nothing where it did not come to that."""
    if not path.exists():
        return Told()
    found = json.loads(path.read_text(encoding='utf-8'))
    return Told(next(iter(found['failed']), ''), tuple(found['failed']), tuple(found['slow']))


class QuickTests:
    """Orders, stops and keeps the tests of one run."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._failed: list[str] = []
        self._slow: list[str] = []
        self._stopped = False

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the order of the files: they share what they build."""
        processes = {'start', 'open_tab', 'browser', 'domain_id'}
        items[:] = [one for one in items if not processes & set(getattr(one, 'fixturenames', ()))]
        files = {path: number for number, path in enumerate(dict.fromkeys(i.path for i in items))}
        items.sort(key=lambda item: (files[item.path], -self._knows(item)))

    def _knows(self, item: pytest.Item) -> int:
        words = set(re.findall(r'\w+', inspect.getsource(getattr(item, 'function', type(item)))))
        return len(words & set(self._limits.names))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[Any]:
        """Give a test its time."""
        self._stopped = False
        signal.setitimer(signal.ITIMER_PROF, self._limits.one_s)
        signal.setitimer(signal.ITIMER_REAL, SLEEPS * self._limits.one_s)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            if time.process_time() > self._limits.all_s:
                item.session.shouldstop = 'all together took their time'

    def stop(self, *_: object) -> None:
        """The time of a test is up."""
        self._stopped = True
        raise pytest.skip.Exception(STOPPED)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep what failed, unless it was only stopped, with all that a stopped fixture serves."""
        if report.skipped and STOPPED in str(report.longrepr):
            self._stopped = True
        if self._stopped:
            self._slow.append(report.nodeid)
        elif report.failed:
            self._failed.append(report.nodeid)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """A file that cannot be read fails as a whole."""
        if report.failed:
            self._failed.append(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        """Tell."""
        told = {'failed': self._failed, 'slow': self._slow}
        found = {word: list(dict.fromkeys(names)) for word, names in told.items()}
        Path(self._limits.told).write_text(json.dumps(found), encoding='utf-8')


def pytest_configure(config: pytest.Config) -> None:
    """Take the limits of the environment."""
    values = json.loads(os.environ[LIMITS])
    plugin = QuickTests(Limits(**{**values, 'names': tuple(values['names'])}))
    signal.signal(signal.SIGPROF, plugin.stop)
    signal.signal(signal.SIGALRM, plugin.stop)
    config.pluginmanager.register(plugin, 'quick tests')
