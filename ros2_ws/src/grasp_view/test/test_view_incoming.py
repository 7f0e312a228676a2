# SPDX-License-Identifier: Apache-2.0
"""What a browser says is taken only where a page of ours can have said it."""

from __future__ import annotations

import math

import msgspec
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp_view.incoming import Incoming

CAMERA = {
    'type': 'ViewerCameraMessage', 'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [1.0, 0.0, 0.0],
    'fov': 1, 'near': 0.01, 'far': 10.0, 'image_height': 600, 'image_width': 800,
    'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0],
}  # fmt: skip


@pytest.fixture(scope='module')
def server():
    server = viser.ViserServer('127.0.0.1', 8978, verbose=False)
    yield server
    server.stop()


@pytest.fixture(scope='module')
def incoming(server):
    made = Incoming()
    made.gui = server.gui
    return made


def packed(said):
    return msgspec.msgpack.encode(said)


def test_what_a_page_says_is_taken(incoming):
    assert incoming.may_be(packed(CAMERA))
    assert incoming.may_be(packed({'type': 'ShareUrlRequest'}))


@pytest.mark.parametrize(
    'changed',
    [
        {'fov': math.nan}, {'position': [math.inf, 0.0, 0.0]}, {'look_at': [0.0, 0.0]},
        {'look_at': 'there'}, {'image_height': 1e30}, {'up_direction': None}, {'type': 'Nonsense'},
        {'type': None}, {'type': []},
    ],
)  # fmt: skip
def test_a_camera_that_is_nowhere_is_dropped(incoming, changed):
    assert not incoming.may_be(packed({**CAMERA, **changed}))


@settings(max_examples=30)
@given(raw=st.binary(max_size=60) | st.text() | st.sampled_from([b'\x91' * 10**5, b'\x81' * 999]))
def test_bytes_that_are_no_message_are_dropped(raw):
    assert not Incoming().may_be(raw)


def test_an_input_takes_only_what_it_offers(server, incoming):
    colour = server.gui.add_dropdown('Colour', ('depth', 'stress'))
    force = server.gui.add_slider('Force', 0.0, 25.0, 0.1, 5.0)
    shown = server.gui.add_checkbox('Shown', True)
    steps = server.gui.add_button_group('Steps', ('one', 'two'))
    button = server.gui.add_button('Tare')

    def takes(handle, value, **more):
        updates = {'value': value, **more}
        said = {'type': 'GuiUpdateMessage', 'uuid': handle._impl.uuid, 'updates': updates}
        return incoming.may_be(packed(said))

    assert takes(colour, 'stress') and not takes(colour, 'x') and not takes(colour, [])
    assert takes(force, 7) and takes(force, 25.0000001)
    assert not any(takes(force, value) for value in (-1.0, 26.0, math.nan, '7', None, True))
    assert takes(shown, False) and not takes(shown, 'no')
    assert takes(steps, 'two') and not takes(steps, 'three')
    assert takes(button, True) and not takes(button, 5)
    # What belongs to the server, and an input that is none.
    assert not takes(colour, 'stress', removed=True)
    said = {'type': 'GuiUpdateMessage', 'uuid': 'none', 'updates': {'value': 1}}
    assert not incoming.may_be(packed(said))
