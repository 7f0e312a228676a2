# SPDX-License-Identifier: Apache-2.0
"""The launch files of the packages: what each describes is started as it says.

`ros2 launch` itself comes with a sourced ROS and is no wheel; these tests read the same files, put
the arguments in, and start the executable with the parameters that they name.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from docs.parameter_tables import PACKAGES

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ROOT / 'ros2_ws' / 'src'
# That of ros2_control starts nodes of apt beside ours: test_ros2_control.py reads it.
FILES = {
    path.parts[-3]: path
    for path in SOURCES.glob('*/launch/*.launch.xml')
    if path.name != 'ros2_control.launch.xml'
}
BAG = ROOT / 'bags' / 'tennis_ball_two_finger'
NODES = {
    'barrett_hand_bridge': ({'backend': 'emulator', 'namespace': '/left'}, 'connected to a'),
    'shell_deform': ({'object': 'half_soda_can'}, 'half_soda_can:'),
    'scan_compare': ({}, 'waiting for scans'),
    'grasp_view': ({}, 'page ready on http://127.0.0.1:'),
    'grasp_replay': ({'bag': str(BAG)}, 'nobody listens to'),
}


def command(path: Path, given: dict[str, str]) -> tuple[str, list[str]]:
    """Executable and arguments that a launch file describes, as ROS's own launch makes them."""
    root = ElementTree.parse(path).getroot()
    values = {one.attrib['name']: one.get('default') for one in root.iter('arg')} | given

    def filled(text: str) -> str:
        return re.sub(r'\$\(var (\w+)\)', lambda name: str(values[name.group(1)]), text)

    (node,) = root.iter('node')
    words = filled(node.get('args', '')).split() + ['--ros-args']
    namespace = filled(node.get('namespace', ''))
    words += ['-r', f'__ns:={namespace}'] if namespace else []
    for one in node.iter('param'):
        value = filled(one.attrib['value'])
        quoted = f'"{value}"' if one.get('type') == 'str' else value
        words += ['-p', f'{one.attrib["name"]}:={quoted}']
    return node.attrib['exec'], words


@pytest.mark.parametrize('package', sorted(set(PACKAGES) | {'grasp_replay'}))
def test_every_package_with_a_node_has_a_launch_file(package: str) -> None:
    node = next(ElementTree.parse(FILES[package]).getroot().iter('node'))
    assert node.attrib['pkg'] == package
    assert f"'{node.attrib['exec']} = " in (SOURCES / package / 'setup.py').read_text()


@pytest.mark.parametrize('package', sorted(PACKAGES))
def test_what_a_launch_file_sets_is_declared_with_that_default(package: str) -> None:
    root = ElementTree.parse(FILES[package]).getroot()
    declared = {p.name: p.default for p in import_module(PACKAGES[package]).PARAMETERS}
    offered = {one.attrib['name']: one.attrib['default'] for one in root.iter('arg')}
    for one in root.iter('param'):
        name = one.attrib['name']
        assert str(declared[name]).lower() == offered[name].lower()


@pytest.mark.parametrize('package', sorted(NODES))
def test_a_launch_file_starts_its_node(package: str, start: Callable[..., Any]) -> None:
    given, ready = NODES[package]
    if package == 'grasp_view':
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            given = given | {'port': str(free.getsockname()[1])}
    executable, words = command(FILES[package], given)
    running = start(executable, *words)
    running.wait_for(ready, 60)
    assert 'there is no parameter' not in running.text
    assert running.stop() == 0, running.text
