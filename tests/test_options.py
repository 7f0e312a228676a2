# SPDX-License-Identifier: Apache-2.0
"""One grammar: the same option means the same in every command, and the page that lists them."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from docs.option_tables import PAGE, PARSERS, Described, everything, page
from tests.executables import EXECUTABLES, executable

from grasp_common.command_line import parse
from grasp_common.options import SHARED, UNITS_OF_VALUES
from shell_deform.commands.object_prepare_options import RENAMED

ROOT = Path(__file__).resolve().parent.parent
OPTIONS = everything()
NODES = ('hand_bridge', 'deformation', 'scan_compare', 'grasp_view')
COMMANDS = [name for names in EXECUTABLES.values() for name in names]
# rosbag2's own short options: the delay of `bag play`, the duration of `bag record`.
OF_ROSBAG2 = {'-d'}
# Options whose value has no better name than theirs.
PLAIN = ('NAME', 'REGEX', 'SEED')
OBJECT = ['a.stl', '--unit', 'mm', '--thickness', '1e-3', '--young', '1e6', '--poisson', '0.4']


def words(option: Described) -> str:
    """What a usage text calls its value; '' for choices, which are shown themselves."""
    return '' if ', ' in option.value else option.value


def test_every_command_that_is_no_node_is_listed() -> None:
    assert sorted(PARSERS) == sorted(set(COMMANDS) - set(NODES))


def test_the_page_of_options_is_in_step() -> None:
    assert PAGE.read_text(encoding='utf-8') == page(), 'run: make tables'


@pytest.mark.parametrize('name', [name for name, ones in OPTIONS.items() if len(ones) > 1])
def test_an_option_of_several_commands_means_the_same_in_all(name: str) -> None:
    shared = SHARED[name]
    for one in OPTIONS[name]:
        assert one.help.startswith(shared.meaning), f'{one.command} {name}: {one.help}'
        value = shared.value or ''
        assert words(one) in (value, f'{value},{value},…') or words(one).startswith(f'{value} [')
        assert set(shared.names) <= set(one.names)
    # A switch in one command is no value in another.
    assert len({one.value == '' for one in OPTIONS[name]}) == 1


def test_no_spelling_stands_for_two_options() -> None:
    meant: dict[str, set[str]] = defaultdict(set)
    for name, ones in OPTIONS.items():
        for one in ones:
            for spelling in one.names:
                meant[spelling].add(name)
    twice = {spelling: names for spelling, names in meant.items() if len(names) > 1}
    assert set(twice) == OF_ROSBAG2, twice


ALL = [one for ones in OPTIONS.values() for one in ones]
IDS = [f'{one.command} {one.name}' for one in ALL]


def test_every_option_has_a_help_and_every_value_a_name_that_is_not_the_option() -> None:
    for one in ALL:
        assert len(one.help) > 5, f'{one.command} {one.name}'
        made_up = one.name.lstrip('-').replace('-', '_').upper()
        assert one.value != made_up or one.value in PLAIN, f'{one.command} {one.name}'


def test_a_value_with_a_unit_names_it_in_the_help_and_in_one_way() -> None:
    for one in ALL:
        unit = UNITS_OF_VALUES.get(one.value.strip('[]'))
        if unit is not None:
            assert unit in one.help, f'{one.command} {one.name}: {one.help}'
        # No unit in the name, and none in round brackets.
        assert re.search(r'\((m|s|N|Pa|mm|kg|Hz)\)', one.help) is None or one.name == '--grid'
        assert re.search(r'-(m|pa|n|s|mm|kg|hz)$', one.name) is None, one.name


@pytest.mark.parametrize(
    ('module', 'old', 'new'),
    [
        ('shell_identify', ['--thickness'], ['--fit-thickness']),
        ('shell_identify', ['--pressure'], ['--fit-pressure']),
        ('shell_objects', ['--mesh'], ['--mesh-fit']),
        ('object_prepare', ['--size-m=0.1'], ['--size=0.1']),
        ('hand_calibrate', ['--out', 'hand.yaml'], ['--calibration', 'hand.yaml']),
    ],
)
def test_a_name_of_before_is_taken_and_its_user_told(
    module: str, old: list[str], new: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    from importlib import import_module

    found = import_module(PARSERS[module])
    needed = {
        'shell_identify': ['a.csv', '--object', 'tennis_ball'],
        'shell_objects': [],
        'object_prepare': OBJECT,
        'hand_calibrate': ['weights.csv'],
    }[module]
    told = parse('grasp_common', found.build_parser(), needed + old, found.RENAMED)
    assert f'{old[0].partition("=")[0]} is called' in capsys.readouterr().err
    assert vars(told) == vars(parse('grasp_common', found.build_parser(), needed + new))


@pytest.mark.parametrize('name', COMMANDS)
def test_a_usage_text_loads_no_solver_and_no_robot_library(name: str) -> None:
    """What takes long to load waits for the work: a usage text is there at once."""
    asked = subprocess.run(
        [sys.executable, '-X', 'importtime', executable(name), '--help'],
        capture_output=True,
        check=True,
        text=True,
    )
    assert asked.stdout.startswith('usage: ')
    loaded = {line.rpartition('|')[2].strip() for line in asked.stderr.splitlines()}
    assert not loaded & {'scipy', 'numba', 'rclpy', 'can', 'matplotlib', 'trimesh', 'aiohttp'}


def test_whatever_names_an_option_names_one_of_today() -> None:
    """Sentences of errors and hints too; ROS's own and those of rosbags-convert are named.

    So is the one word that a page says to the node that stands by for it.
    """
    known = {spelling for ones in OPTIONS.values() for one in ones for spelling in one.names}
    known |= {'--help', '--version', '--ros-args', '--enclave', '--src', '--dst', *RENAMED}
    known |= {'--standby', '--params-file'}
    unknown = set()
    for source in (ROOT / 'ros2_ws' / 'src').glob('*/*/**/*.py'):
        if 'test' in source.parts:
            continue
        named = re.findall(r'(?<![\w-])--[a-z][a-z0-9]*(?:-[a-z0-9]+)*', source.read_text())
        unknown |= {(source.name, name) for name in named if name not in known}
        if source.name != 'object_prepare_options.py':
            assert set(RENAMED).isdisjoint(named), source
    assert unknown == set()
