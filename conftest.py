# SPDX-License-Identifier: Apache-2.0
"""Fixtures for every test: an own ROS domain, and real processes that never outlive their test."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from tests.chromium import chromium, installed, new_tab
from tests.running import Running, own_domain, processes, wait_until

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
def domain_id() -> Iterator[int]:
    """The test's own ROS domain."""
    with own_domain() as number:
        yield number


@pytest.fixture(name='wait_until')
def _wait_until() -> Callable[..., None]:
    return wait_until


@pytest.fixture
def start(domain_id: int, tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Start an executable of the environment by name, on the test's own ROS domain."""
    with processes(tmp_path) as run:
        yield run


@pytest.fixture(scope='module')
def browser() -> Iterator[Any]:
    """A real browser. Its library's event loop runs until it closes: not longer than a module."""
    if not installed():
        (pytest.fail if os.environ.get('GRASP_NO_SKIP') else pytest.skip)(
            'no chromium on this machine'
        )
    with chromium() as started:
        yield started


@pytest.fixture
def open_tab(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Open a tab by width and height; a complaint in its console fails."""
    tabs: list[Any] = []

    def opened(width: int, height: int, **options: Any) -> Any:
        tabs.append(new_tab(browser, width, height, **options))
        return tabs[-1]

    yield opened
    complaints = [tab.complaints for tab in tabs]
    for k, tab in enumerate(tabs):
        tab.screenshot(path=tmp_path / f'tab_{k}.png')
        tab.close()
    assert complaints == [[]] * len(tabs)
