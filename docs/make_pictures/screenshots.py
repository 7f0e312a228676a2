# SPDX-License-Identifier: Apache-2.0
"""Screenshots of the report and of the live page, in a headless Chromium."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bags.processes import end_process
from docs.make_pictures import BAG, BALL, PICTURES
from tests.chromium import chromium, new_tab

PHONE = {'has_touch': True, 'is_mobile': True, 'device_scale_factor': 2}
SIZES: tuple[tuple[str, tuple[int, int], dict[str, Any]], ...] = (
    ('view', (1440, 900), {}),
    ('view_dark', (1440, 900), {'color_scheme': 'dark'}),
    ('view_tablet', (1024, 768), {'has_touch': True}),
    ('view_phone', (390, 844), PHONE),
)
"""The live page's pictures: name, window, and what else the browser is."""


@contextlib.contextmanager
def _browser(width: int, height: int) -> Iterator[Any]:
    with chromium() as browser:
        yield new_tab(browser, width, height)


def _undisturbed(tab: Any) -> None:
    """Close the notice that this browser renders in software."""
    tab.locator('.mantine-Notification-closeButton').first.click()


def draw_report() -> list[Path]:
    """The report of the recorded ball, as a browser shows it."""
    path = PICTURES / 'report.png'
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [str(Path(sys.executable).parent / 'grasp_report'), str(BAG), '--out', folder],
            check=True,
        )
        with _browser(1200, 1900) as tab:
            tab.goto((Path(folder) / 'report.html').as_uri())
            tab.wait_for_selector('body.webgl')
            tab.screenshot(path=path)
    return [path]


class _Processes(contextlib.ExitStack):
    """Started nodes on a ROS domain of their own, ended by SIGINT; their output in a folder."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(self.enter_context(tempfile.TemporaryDirectory()))

    def start(self, *command: str) -> Path:
        """Start an executable of the environment; returns its log file."""
        log = self.folder / f'{command[0]}.log'
        with log.open('wb') as stream:
            process = subprocess.Popen(
                [str(Path(sys.executable).parent / command[0]), *command[1:]],
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={
                    **os.environ,
                    'ROS_DOMAIN_ID': '93',
                    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                },
            )
        self.callback(end_process, process, 10.0)
        return log


def _wait(log: Path, text: str, seconds: float = 120.0) -> None:
    deadline = time.monotonic() + seconds
    while text not in log.read_text(errors='replace'):
        if time.monotonic() > deadline:
            raise RuntimeError(f'{text!r} did not come within {seconds:g} s: {log.read_text()}')
        time.sleep(0.1)


def _free_port() -> str:
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return str(free.getsockname()[1])


def _deep(tab: Any, least_mm: float) -> bool:
    found = re.match(r'[\d.]+', tab.locator('.grasp-largest').inner_text())
    return found is not None and float(found.group()) >= least_mm


def draw_view() -> list[Path]:
    """The live page while the recorded ball is replayed through the real nodes, in all sizes."""
    port = _free_port()
    ball = ('--ros-args', '-p', f'object:={BALL}')
    with _Processes() as nodes, chromium() as browser:
        page = nodes.start('grasp_view', '--ros-args', '-p', f'port:={port}')
        _wait(nodes.start('deformation', *ball), 'serving')
        nodes.start('scan_compare', *ball)
        _wait(page, 'page ready')
        # Slower than recorded, so that a slow browser does not miss the deep dent.
        nodes.start('replay', str(BAG), '--rate', '0.5', '--loop')
        return [_shown(new_tab(browser, *size, **more), port, name) for name, size, more in SIZES]


def _shown(tab: Any, port: str, name: str) -> Path:
    """A picture of the page with a deep dent in that tab, which is closed."""
    path = PICTURES / f'{name}.png'
    tab.goto(f'http://127.0.0.1:{port}')
    tab.wait_for_selector('.grasp-legend')
    _undisturbed(tab)
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline:
        tab.wait_for_timeout(100)
        if _deep(tab, 8.0):
            tab.wait_for_timeout(2000)
            tab.screenshot(path=path, scale='css')
            # A slow browser may have drawn the release meanwhile.
            if _deep(tab, 8.0):
                break
    tab.close()
    return path


def draw_what_if() -> list[Path]:
    """Fingers placed in the page, solved live."""
    path, port = PICTURES / 'what_if.png', _free_port()
    with _Processes() as nodes, _browser(1280, 860) as tab:
        page = nodes.start(
            'grasp_view', '--ros-args', '-p', f'port:={port}', '-p', 'what_if:=true'
        )
        _wait(page, 'serving')
        tab.goto(f'http://127.0.0.1:{port}')
        tab.wait_for_selector('.grasp-legend')
        _undisturbed(tab)
        beside = '//*[normalize-space(text())="Finger 1 (N)"]'
        force = tab.locator(f'xpath={beside}/following::*[@type="text"]').first
        force.fill('15')
        force.press('Enter')
        deadline = time.monotonic() + 60
        while not _deep(tab, 4.0) and time.monotonic() < deadline:
            tab.wait_for_timeout(100)
        tab.wait_for_timeout(3000)
        tab.screenshot(path=path)
    return [path]
