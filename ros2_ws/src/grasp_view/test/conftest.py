# SPDX-License-Identifier: Apache-2.0
"""A page with its free port, its browser tab, and who publishes to it or listens beside it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from tests.chromium import new_tab
from tests.running import Running, own_domain, processes

# Lets the tests import what they share.
sys.path.insert(0, str(Path(__file__).parent))
from view_browser import as_at_first  # noqa: E402
from view_grasp import Grasp  # noqa: E402
from view_process import free_port, served  # noqa: E402


@pytest.fixture
def heard(domain_id: int) -> Iterator[Callable[[type, str], Any]]:
    """The newest message of a topic, by type and name; None while none came."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    newest: dict[str, Any] = {}

    def take(kind: type, topic: str) -> Any:
        if topic not in newest:
            newest[topic] = None
            node.create_subscription(kind, topic, lambda m: newest.update({topic: m}), 10)
        executor.spin_once(timeout_sec=0.1)
        return newest[topic]

    yield take
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def port() -> int:
    """A TCP port nobody uses."""
    return free_port()


@pytest.fixture
def tab(open_tab: Callable[..., Any]) -> Any:
    """A browser's tab in which both panels and the object have room."""
    return open_tab(1000, 640)


@pytest.fixture
def view(start: Callable[..., Running], port: int) -> Callable[..., Running]:
    """Start a page of the test's own, by further ROS parameters as name:=value."""
    return lambda *parameters: served(start, port, *parameters)


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Grasp]]:
    """The address of a page beside a squeezed ball, for all tests of a module."""
    port = free_port()
    with own_domain(), processes(tmp_path_factory.mktemp('page')) as start:
        running = served(start, port)
        with closing(Grasp()) as grasp:
            yield f'http://127.0.0.1:{port}', grasp
        assert running.process.poll() is None and 'Traceback' not in running.text


@pytest.fixture
def address(shared: tuple[str, Grasp]) -> str:
    """Where the module's page is."""
    return shared[0]


@pytest.fixture
def squeezed(shared: tuple[str, Grasp]) -> Grasp:
    """The ball beside the module's page, as it is before anybody squeezes it."""
    shared[1].rest_again()
    return shared[1]


@pytest.fixture(scope='module')
def only_tab(browser: Any, shared: tuple[str, Grasp]) -> Iterator[Any]:
    """The module's page in a tab that stays open: to load it takes longer than most tests."""
    opened = new_tab(browser, 1000, 640)
    opened.goto(shared[0])
    opened.wait_for_selector('.grasp-legend')
    yield opened
    opened.close()


@pytest.fixture
def page(squeezed: Grasp, only_tab: Any, tmp_path: Path) -> Iterator[Any]:
    """The module's page, with its controls as they are at first."""
    yield only_tab
    only_tab.screenshot(path=tmp_path / 'page.png')
    as_at_first(only_tab)
    assert only_tab.complaints == []
