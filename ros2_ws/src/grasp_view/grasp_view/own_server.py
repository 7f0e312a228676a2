# SPDX-License-Identifier: Apache-2.0
"""The page's server: only for pages that it served itself, and never published elsewhere.

Any web site that is open in the operator's browser can open a WebSocket to this machine, also to
127.0.0.1, and a name that its owner points here makes the page its own (DNS rebinding). Browsers
say where a request comes from: `Host` must be the address of this server, `Origin` the page's.
viser checks neither, nor what a page says, and has no hook for it, so the function that it serves
with is replaced while it starts.
"""

from __future__ import annotations

import contextlib
import http
import ipaddress
import socket
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server as websocket_server
from websockets.datastructures import Headers
from websockets.http11 import Response

from .front_page import FrontPage
from .incoming import Incoming
from .loop_buffer import use_loop_buffers

# A browser may leave between two lines of ours; what was for it then is nobody's loss.
warnings.filterwarnings('ignore', message='Queued a .* on a closed connection')

LOOPBACK_NAMES = ('localhost',)
_replacing = threading.Lock()


class OwnServer(viser.ViserServer):
    """A viser server behind the gate, without viser's public tunnel."""

    def __init__(self, host: str, port: int, front: FrontPage) -> None:
        """Serve on http://host:port, completed by `front`.

        Raises OSError where this machine does not have that address.
        """
        _check_address(host, port)
        use_loop_buffers()
        incoming = Incoming()
        with _gated(front, incoming):
            super().__init__(host=host, port=port, verbose=False)
        incoming.gui = self.gui

    def cookies(self, client: viser.ClientHandle) -> str:
        """The cookies that a browser sent with its request for the socket; empty if unknown."""
        # viser keeps the connection for its own tests, without an interface.
        connection = self._websock_server._live_connections.get(client.client_id)
        request = None if connection is None else connection.request
        return '' if request is None else ';'.join(request.headers.get_all('Cookie'))

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Never: any client may ask viser to publish the page on the internet."""
        return None


def refusal(headers: Headers, local: tuple[Any, ...]) -> str:
    """Why a request is refused that came to the local address `local`; empty when it is not."""
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    if len(hosts) != 1 or not _is_own(hosts[0], str(local[0]), int(local[1])):
        return 'this page is served under its own address only'
    upgrade = headers.get('Upgrade', '').lower() == 'websocket'
    if (upgrade or origins) and origins != [f'http://{hosts[0]}']:
        return 'only the page that this server gave may talk to it'
    return ''


def _is_own(host: str, address: str, port: int) -> bool:
    """Whether a Host header names this server: its address, or a name of this machine."""
    name, colon, given_port = host.rpartition(':')
    if not colon or given_port != str(port):
        return False
    own = ipaddress.ip_address(address.partition('%')[0])
    if isinstance(own, ipaddress.IPv6Address) and own.ipv4_mapped is not None:
        own = own.ipv4_mapped
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(name.strip('[]')) == own
    if own.is_loopback:
        return name.lower() in LOOPBACK_NAMES
    machine = socket.gethostname().lower()
    return name.lower() in {machine, f'{machine}.local', socket.getfqdn().lower()}


def _check_address(host: str, port: int) -> None:
    """Raise OSError where nothing can listen; viser would look for another port for ever."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except UnicodeError as error:
        raise OSError(f'{host!r} is no address') from error
    for family, kind, protocol, _, address in found:
        with socket.socket(family, kind, protocol) as probe:
            # Port 0: whether this port is free is another question.
            probe.bind((address[0], 0, *address[2:]))


@contextlib.contextmanager
def _gated(front: FrontPage, incoming: Incoming) -> Iterator[None]:
    """Whatever begins to serve meanwhile asks `refusal` first, and hears what is `incoming`."""
    serve = websocket_server.serve

    def serve_gated(handler: Any, *arguments: Any, **options: Any) -> Any:
        inner, heard = options.pop('process_request', None), incoming.checked(handler)
        return serve(heard, *arguments, process_request=_gate(inner, front), **options)

    with _replacing:
        websocket_server.serve = serve_gated  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            websocket_server.serve = serve  # type: ignore[misc]


def _gate(
    inner: Callable[[Any, Any], Response | None] | None, front: FrontPage
) -> Callable[[Any, Any], Any]:
    def process(connection: Any, request: Any) -> Response | None:
        why = refusal(request.headers, connection.local_address)
        if why:
            body = why.encode()
            headers = Headers({'Content-Type': 'text/plain', 'Content-Length': str(len(body))})
            return Response(http.HTTPStatus.FORBIDDEN, 'Forbidden', headers, body)
        ours = front.answer(request.path)
        if ours is not None or inner is None:
            return ours
        return front.finish(inner(connection, request))

    return process
