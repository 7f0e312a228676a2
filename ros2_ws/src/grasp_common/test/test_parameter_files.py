# SPDX-License-Identifier: Apache-2.0
"""A file of parameters that is none is refused by name; one for other nodes is told."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_common.parameter_files import FORM, given_files, nodes_in, speaks_to
from grasp_common.parameter_table import ParameterError


def written(folder: Path, text: str | bytes) -> str:
    file = folder / 'parameters.yaml'
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(file)


@pytest.mark.parametrize(
    ('text', 'nodes'),
    [
        ('/**:\n  ros__parameters:\n    speed: 1.0\n', ['/**']),
        ('small:\n  ros__parameters: {}\n', ['/small']),
        ('/left/small:\n  ros__parameters: {speed: 1.0}\n', ['/left/small']),
        ('left:\n  small:\n    ros__parameters: {a: {b: 1}}\n', ['/left/small']),
        ('"*":\n  ros__parameters: {}\nb:\n  ros__parameters: {}\n', ['/*', '/b']),
        (b'\xef\xbb\xbfsmall: {ros__parameters: {a: 1}}', ['/small']),
    ],
)
def test_the_nodes_that_a_file_speaks_to(tmp_path: Path, text: str | bytes, nodes: list[str]):
    assert nodes_in(written(tmp_path, text)) == nodes


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('', 'it holds no map of names'),
        ('# all taken out\n', 'it holds no map of names'),
        ('root:x:0:0:somebody:/bin/sh\n', 'it holds no map of names'),
        ('- a\n- b\n', 'it holds no map of names'),
        ('speed: 1.0\n', 'line 1: speed stands outside ros__parameters'),
        ('small:\n  ros_parameters:\n    speed: 1.0\n', 'line 3: speed stands outside'),
        ('small:\n  ros__parameters: [1]\n', 'line 2: ros__parameters is no map'),
        ('ros__parameters:\n  speed: 1.0\n', 'line 1: ros__parameters stands without a node'),
        ('small: {}\n', 'it holds no ros__parameters'),
        ('small: [\n', 'line 2: '),
        ('small:\n\tros__parameters: {}\n', "line 2: found character '\\t'"),
        ('a: {}\n---\nb: {}\n', 'line 2: but found another document'),
        ('\x1b]0;owned\x07: 1\n', 'special characters are not allowed'),
        (b'h\xff\xfe: 3\n', 'it is no UTF-8 text'),
        ('[' * 20_000, 'nested more than'),
    ],
)
def test_what_is_none_is_refused_with_the_reason(tmp_path: Path, text: str | bytes, reason: str):
    file = written(tmp_path, text)
    with pytest.raises(ParameterError) as refused:
        nodes_in(file)
    said = str(refused.value)
    assert said.startswith(f'--params-file {file} is no file of parameters: ')
    assert reason in said and said.endswith(FORM) and said.isprintable()


@pytest.mark.parametrize('file', ['/nowhere/p.yaml', '/dev/zero', '/tmp', 'a\0b'])
def test_what_is_no_file_is_refused_unread(file: str):
    with pytest.raises(ParameterError, match='there is no regular file'):
        nodes_in(file)


def test_files_stand_behind_ros_args_only():
    own, ros = ['--params-file', 'a'], ['--ros-args', '-p', 'x:=1', '--params-file', 'b', '--']
    line = [*own, *ros, '--params-file', 'c']
    assert given_files([*line, '--ros-args', '--params-file', 'd', '--params-file']) == ['b', 'd']


@pytest.mark.parametrize(
    ('name', 'node', 'speaks'),
    [
        ('/**', '/left/small', True),
        ('/*', '/small', True),
        ('/*', '/left/small', False),
        ('/**/small', '/small', True),
        ('/left/*', '/left/small', True),
        ('/small', '/left/small', False),
        ('/s.all', '/small', False),
    ],
)
def test_wildcards_are_those_of_ros(name: str, node: str, speaks: bool):
    assert speaks_to(name, node) is speaks


@given(st.binary(max_size=200))
def test_whatever_stands_in_a_file_there_is_an_answer(tmp_path_factory, octets: bytes):
    file = written(tmp_path_factory.getbasetemp(), octets)
    try:
        assert all(name.startswith('/') for name in nodes_in(file))
    except ParameterError as error:
        assert file in str(error)
