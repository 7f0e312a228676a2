# SPDX-License-Identifier: Apache-2.0
"""What surrounds the scene: title, icon, style and overlays of the served page.

The page library has no interface for them, so its one HTML file is completed on its way out, and
a small script asks `overlay` for what is to stand over the scene: header, legend, probe. The
script takes nothing but what this server says, and nothing comes from elsewhere.
"""

from __future__ import annotations

import gzip
import html
import json
from collections.abc import Callable, Mapping
from importlib.resources import files
from urllib.parse import parse_qs, quote

from websockets.datastructures import Headers
from websockets.http11 import Response

TITLE = 'grasp'
ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'>"
    "<circle cx='16' cy='16' r='11' fill='#d9c44c'/>"
    "<path d='M27 10a7 7 0 0 0 0 12z' fill='#17202b'/>"
    "<path d='M31 16H20' stroke='#a84300' stroke-width='4'/>"
    "<path d='M1 16h6' stroke='#005a9c' stroke-width='4'/></svg>"
)
OVERLAY_PATH = '/overlay'
Parts = Mapping[str, str]


def complete(page: str) -> str:
    """The library's page with our title, icon, style and script."""
    folder = files('grasp_view')
    style = folder.joinpath('page.css').read_text(encoding='utf-8')
    script = folder.joinpath('page.js').read_text(encoding='utf-8')
    start, end = page.index('<title>'), page.index('</title>')
    page = f'{page[:start]}<title>{html.escape(TITLE)}{page[end:]}'
    icon = page.index('rel="icon"')
    link, closed = page.rindex('<link', 0, icon), page.index('/>', icon) + 2
    ours = f'<link rel="icon" href="data:image/svg+xml,{quote(ICON)}" />'
    page = page[:link] + ours + page[closed:]
    page = page.replace('content="Viser client"', 'content="A grasp, live"', 1)
    # Before the library's own scripts, which ask for the theme.
    place = page.index('</title>') + len('</title>')
    return f'{page[:place]}<style>{style}</style><script>{script}</script>{page[place:]}'


class FrontPage:
    """Completes the library's answers; `parts` gives the overlays' HTML by name.

    It is told the name of the tab that asks, how wide its window and how high its picture is in
    pixels; '' and 0 where it did not say.
    """

    def __init__(self, parts: Callable[[str, int, int], Parts]) -> None:
        self._parts = parts
        self._completed: dict[bytes, bytes] = {}

    def answer(self, path: str) -> Response | None:
        """The answer to a path of our own; None for the library's."""
        place, _, query = path.partition('?')
        if place != OVERLAY_PATH:
            return None
        asked = {name: values[0] for name, values in parse_qs(query).items()}
        sizes = (asked.get(name, '')[:5] for name in ('width', 'height'))
        width, height = (int(size) if size.isdecimal() else 0 for size in sizes)
        parts = self._parts(asked.get('tab', ''), width, height)
        body = json.dumps(dict(parts)).encode()
        headers = {'Content-Type': 'application/json', 'Cache-Control': 'no-store'}
        return _response(200, 'OK', headers, body)

    def finish(self, response: Response | None) -> Response | None:
        """The library's answer, completed where it is the page."""
        if response is None or not response.headers.get('Content-Type', '').startswith(
            'text/html'
        ):
            return response
        packed = response.headers.get('Content-Encoding') == 'gzip'
        given = bytes(response.body)
        if given not in self._completed:
            page = gzip.decompress(given) if packed else given
            done = complete(page.decode('utf-8')).encode()
            self._completed[given] = gzip.compress(done) if packed else done
        body = self._completed[given]
        kept = {
            name: value
            for name, value in response.headers.raw_items()
            if name.lower() != 'content-length'
        }
        return _response(response.status_code, response.reason_phrase, kept, body)


def _response(status: int, reason: str, headers: Mapping[str, str], body: bytes) -> Response:
    return Response(status, reason, Headers({**headers, 'Content-Length': str(len(body))}), body)
