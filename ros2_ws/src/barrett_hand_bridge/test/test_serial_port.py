# SPDX-License-Identifier: Apache-2.0
"""Serial ports: what is said when one cannot be opened, an adapter that is plugged in again."""

import os

import pytest

from barrett_hand_bridge.gcl import port
from barrett_hand_bridge.gcl.port import PortName, open_port
from barrett_hand_bridge.hand import HandError


def test_a_port_that_is_not_there_names_those_that_are(tmp_path, monkeypatch):
    monkeypatch.setattr(port, 'BY_ID', tmp_path)
    (tmp_path / 'usb-FTDI_0001').symlink_to('/dev/null')
    with pytest.raises(HandError, match='does not exist; there are .*usb-FTDI_0001'):
        open_port('/dev/ttyUSB77')


def test_a_port_that_one_may_not_use_names_the_group(tmp_path, monkeypatch):
    device = tmp_path / 'ttyUSB0'
    device.touch()
    monkeypatch.setattr(os, 'access', lambda *_: False)
    with pytest.raises(HandError, match='usermod -aG'):
        open_port(str(device))


def test_an_adapter_that_comes_back_under_another_name_is_found_by_its_link(tmp_path):
    by_id = tmp_path / 'by-id'
    by_id.mkdir()
    first, second = tmp_path / 'ttyUSB0', tmp_path / 'ttyUSB1'
    first.touch()
    link = by_id / 'usb-FTDI_0001'
    link.symlink_to(first)
    name = PortName(str(first), by_id)
    assert name.now() == str(link)
    first.unlink()
    link.unlink()
    second.touch()
    link.symlink_to(second)
    assert os.path.realpath(name.now()) == str(second)


def test_a_port_without_a_link_keeps_its_name(tmp_path):
    assert PortName('/dev/ttyS0', tmp_path).now() == '/dev/ttyS0'


def test_an_adapter_is_told_to_pass_every_byte_on_at_once(monkeypatch):
    told = []

    class Adapter:
        def __init__(self, *arguments, **options):
            pass

        def set_low_latency_mode(self, on):
            told.append(on)

    monkeypatch.setattr(port.serial, 'Serial', Adapter)
    open_port('/dev/ttyUSB0')
    assert told == [True]
