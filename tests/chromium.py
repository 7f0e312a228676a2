# SPDX-License-Identifier: Apache-2.0
"""The headless Chromium of tests and pictures: Debian's, with software rendering, no network."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--use-gl=angle',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
)
TIMEOUT_MS = 60_000
# Five pictures a second: drawn in software, sixty would take a whole core from what is shown.
FEWER_PICTURES = """
requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 200);
cancelAnimationFrame = clearTimeout;
"""
# The page library's own, when a body is dragged; the drag works.
HARMLESS = 'Unable to preventDefault inside passive event listener invocation.'


def installed() -> bool:
    """Whether there is a Chromium on this machine."""
    return shutil.which('chromium') is not None


@contextmanager
def chromium() -> Iterator[Any]:
    """A started browser (playwright's Browser), closed at the end."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which('chromium'), args=list(FLAGS))
        yield browser
        browser.close()


def new_tab(browser: Any, width: int, height: int, **options: Any) -> Any:
    """A page of width x height pixels, which keeps its `complaints` and what it `asked` for."""
    tab = browser.new_page(viewport={'width': width, 'height': height}, **options)
    tab.set_default_timeout(TIMEOUT_MS)
    tab.complaints, tab.asked = [], []
    tab.add_init_script(FEWER_PICTURES)

    def said(message: Any) -> None:
        if message.type == 'error' and message.text != HARMLESS:
            tab.complaints.append(message.text)

    tab.on('console', said)
    tab.on('request', lambda request: tab.asked.append(request.url))
    tab.on('pageerror', lambda error: tab.complaints.append(str(error)))
    return tab
