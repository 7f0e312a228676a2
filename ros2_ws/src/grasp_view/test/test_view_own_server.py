# SPDX-License-Identifier: Apache-2.0
"""The page obeys only itself: other origins, other hosts and share requests are refused."""

from __future__ import annotations

import asyncio
import gzip
import os
import signal
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from pathlib import Path

import msgspec
import pytest
import viser
import websockets
from viser import _messages
from websockets.datastructures import Headers

from grasp_view import own_server, with_parent
from grasp_view.front_page import FrontPage
from grasp_view.loop_buffer import LoopEvent
from grasp_view.own_server import OwnServer, refusal

LOCAL = ('127.0.0.1', 8080)
EVERYWHERE = ('192.168.7.4', 8080)
PORT = 8971


def asked(host, origin=None, upgrade=True):
    headers = Headers()
    for one in [host] if isinstance(host, str) else host:
        headers['Host'] = one
    if origin is not None:
        headers['Origin'] = origin
    if upgrade:
        headers['Upgrade'] = 'websocket'
    return headers


@pytest.mark.parametrize('host', ['127.0.0.1:8080', 'localhost:8080', 'LOCALHOST:8080'])
def test_the_page_itself_is_obeyed(host):
    assert refusal(asked(host, f'http://{host}'), LOCAL) == ''
    assert refusal(asked(host, upgrade=False), LOCAL) == ''


@pytest.mark.parametrize(
    'origin',
    [
        'https://evil.example',
        'http://127.0.0.1',
        'http://127.0.0.1:9000',
        'https://127.0.0.1:8080',
        'http://127.0.0.1:8080.evil.example',
        'http://localhost:8080',
        'null',
        '',
        None,
    ],
)
def test_a_foreign_origin_is_refused(origin):
    assert 'only the page' in refusal(asked('127.0.0.1:8080', origin), LOCAL)


@pytest.mark.parametrize(
    'host',
    [
        'evil.example',
        'evil.example:8080',
        '127.0.0.1',
        '127.0.0.1:9000',
        '127.0.0.1.evil.example:8080',
        '192.168.7.4:8080',
        '',
        [],
        ['127.0.0.1:8080', 'evil.example:8080'],
    ],
)
def test_a_foreign_host_is_refused_also_for_reading_the_page(host):
    first = host if isinstance(host, str) else '127.0.0.1:8080'
    for upgrade in (True, False):
        text = refusal(asked(host, f'http://{first}', upgrade), LOCAL)
        assert 'own address' in text


def test_a_page_for_the_whole_network_is_reached_by_address_and_by_name(monkeypatch):
    monkeypatch.setattr(own_server.socket, 'gethostname', lambda: 'cell')
    for host in ('192.168.7.4:8080', 'cell:8080', 'cell.local:8080'):
        assert refusal(asked(host, f'http://{host}'), EVERYWHERE) == ''
    assert refusal(asked('evil.example:8080', 'http://evil.example:8080'), EVERYWHERE)


def test_an_address_of_another_machine_is_one_error_at_once():
    for host in ('10.99.99.99', '999.1.1.1', 'no such name', 'a' * 300):
        with pytest.raises(OSError):
            OwnServer(host, PORT, FrontPage(lambda tab, width, height: {}))


@pytest.fixture
def served():
    server = OwnServer(
        '127.0.0.1', PORT, FrontPage(lambda tab, width, height: {'header': f'ours{tab}'})
    )
    yield server
    server.stop()


def packed(message):
    return msgspec.msgpack.encode(message.as_serializable_dict([]))


CAMERA = _messages.ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(1.0, 0.0, 0.0),
    fov=1.0,
    near=0.01,
    far=10.0,
    look_at=(0.0, 0.0, 0.0),
    up_direction=(0.0, 0.0, 1.0),
    image_height=600,
    image_width=800,
)


async def connected(origin, port, *messages):
    protocol = f'viser-v{viser.__version__}'
    address = f'ws://127.0.0.1:{port}'
    async with websockets.connect(address, subprotocols=[protocol], origin=origin) as page:
        for message in (CAMERA, *messages):
            await page.send(packed(message))
        return await asyncio.wait_for(page.recv(), 10.0)


def test_a_socket_of_another_site_is_closed_before_it_is_opened(served):
    with pytest.raises(websockets.exceptions.InvalidStatus, match='403'):
        asyncio.run(connected('https://evil.example', served.get_port()))
    assert asyncio.run(connected(f'http://127.0.0.1:{served.get_port()}', served.get_port()))


def read(port, path, **headers):
    request = urllib.request.Request(f'http://127.0.0.1:{port}{path}', headers=headers)
    with urllib.request.urlopen(request, timeout=10) as answer:
        body = answer.read()
        packed = answer.headers['Content-Encoding'] == 'gzip'
        return (gzip.decompress(body) if packed else body).decode()


@pytest.mark.parametrize('encoding', ['gzip', 'identity'])
def test_the_page_has_our_title_icon_and_style_however_it_is_packed(served, encoding):
    page = read(served.get_port(), '/', **{'Accept-Encoding': encoding})
    assert '<title>grasp</title>' in page and 'Viser client' not in page
    assert page.count('rel="icon"') == 1 and 'grasp-overlay' in page


def test_overlays_are_for_the_page_alone(served):
    assert read(served.get_port(), '/overlay') == '{"header": "ours"}'
    assert read(served.get_port(), '/overlay?tab=5') == '{"header": "ours5"}'
    for headers in ({'Host': 'rebound.example:8971'}, {'Origin': 'https://evil.example'}):
        with pytest.raises(urllib.error.HTTPError, match='403'):
            read(served.get_port(), '/overlay', **headers)


def test_a_rebound_name_does_not_get_the_page(served):
    address = f'http://127.0.0.1:{served.get_port()}/'
    foreign = urllib.request.Request(address, headers={'Host': 'evil.example'})
    with pytest.raises(urllib.error.HTTPError, match='403'):
        urllib.request.urlopen(foreign, timeout=10.0)
    with urllib.request.urlopen(address, timeout=10.0) as page:
        assert page.status == 200


def test_nobody_can_publish_the_page_to_the_internet(served, monkeypatch):
    tunnels = []
    monkeypatch.setattr(viser._viser, 'ViserTunnel', lambda *given: tunnels.append(given))
    own = f'http://127.0.0.1:{served.get_port()}'
    asyncio.run(connected(own, served.get_port(), _messages.ShareUrlRequest()))
    # One more exchange: what came before it has been served.
    asyncio.run(connected(own, served.get_port()))
    assert served.request_share_url() is None
    assert tunnels == []


def test_a_command_ends_with_its_parent_however_that_dies(tmp_path, wait_until):
    folder = tempfile.mkdtemp(dir=tmp_path)
    script = (
        'import os, sys, time\n'
        'from grasp_view import with_parent\n'
        f'with_parent.start({folder!r}, [sys.executable, "-c", "import os, time\\n'
        f'print(os.getpid(), flush=True)\\ntime.sleep(600)"])\n'
        'time.sleep(600)\n'
    )
    parent = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    wait_until(lambda: not os.path.exists(f'/proc/{child}'), 10.0)
    wait_until(lambda: not Path(folder).exists(), 10.0)


def test_a_command_hears_what_is_said_to_it(tmp_path):
    heard = tmp_path / 'heard'
    script = f'import sys; open({str(heard)!r}, "w").write(sys.stdin.readline())'
    process = with_parent.start(tempfile.mkdtemp(dir=tmp_path), [sys.executable, '-c', script])
    process.stdin.write(b'begin\n')
    process.stdin.flush()
    assert process.wait(60) == 0
    with_parent.stop(process)
    assert heard.read_text() == 'begin\n'


def test_a_command_that_is_stopped_leaves_nothing(tmp_path):
    folder = tempfile.mkdtemp(dir=tmp_path)
    process = with_parent.start(folder, [sys.executable, '-c', 'import time; time.sleep(600)'])
    with_parent.stop(process)
    assert process.returncode is not None
    assert not Path(folder).exists()


def test_a_thread_that_fills_what_is_to_be_sent_wakes_nobody_and_the_loop_does(served):
    """Going through those that wait from another thread, viser ended the page now and then."""
    event = LoopEvent()
    assert type(served._websock_server.get_message_buffer().message_event) is LoopEvent

    async def woken() -> bool:
        waiting = asyncio.ensure_future(event.wait())
        await asyncio.sleep(0)
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, event.set)
        assert event.is_set() and not waiting.done()
        loop.call_soon_threadsafe(event.set)
        return await asyncio.wait_for(waiting, 10.0)

    assert asyncio.run(woken())
