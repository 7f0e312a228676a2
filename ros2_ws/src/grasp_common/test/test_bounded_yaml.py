# SPDX-License-Identifier: Apache-2.0
"""YAML from strangers is read like any other, unless it expands or nests beyond reason."""

import os
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from grasp_common import bounded_yaml

LAUGHS = 'a: &a [lol, lol, lol, lol, lol, lol, lol, lol, lol]\n' + ''.join(
    f'{chr(97 + i)}: &{chr(97 + i)} [{",".join(["*" + chr(96 + i)] * 9)}]\n' for i in range(1, 9)
)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text('abc ', max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text('xyz'), inner, max_size=4),
)


@given(PLAIN)
def test_plain_documents_are_read_as_ever(value):
    assert bounded_yaml.load(yaml.safe_dump(value)) == value


def test_aliases_are_read_as_what_they_stand_for():
    assert bounded_yaml.load('a: &x [1, 2]\nb: *x\n') == {'a': [1, 2], 'b': [1, 2]}


@pytest.mark.parametrize('read', [bounded_yaml.load, bounded_yaml.compose])
@pytest.mark.parametrize(
    ('text', 'told'),
    [
        (LAUGHS, 'aliases counted'),
        ('[' * 20_000 + ']' * 20_000, 'levels deep'),
        ('{a: ' * 20_000, 'levels deep'),
        ('- ' * 20_000 + 'x', 'levels deep'),
        ('x' * (bounded_yaml.LARGEST_TEXT + 1), 'characters'),
    ],
)
def test_a_bomb_is_one_error_at_once(read, text, told):
    began = time.process_time()
    with pytest.raises(yaml.YAMLError, match=told):
        read(text)
    assert time.process_time() - began < 20.0


def test_a_value_that_holds_itself_is_no_endless_one():
    with pytest.raises(yaml.YAMLError):
        bounded_yaml.load('&a [*a, *a]' + '\n- [')
    found = bounded_yaml.load('&a [1, *a]')
    assert found[1] is found


def test_tags_that_would_run_something_are_refused():
    with pytest.raises(yaml.YAMLError):
        bounded_yaml.load('!!python/object/apply:os.system ["true"]')


def test_a_pipe_or_a_device_is_refused_unopened(tmp_path: Path) -> None:
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    for path in (pipe, Path('/dev/zero')):
        with pytest.raises(OSError, match='no regular file'):
            bounded_yaml.text_of(path)


def test_a_file_longer_than_any_is_not_read_to_its_end(tmp_path: Path) -> None:
    file = tmp_path / 'long'
    with file.open('wb') as stream:
        stream.truncate(2**40)
    with pytest.raises(OSError, match='more than 8388608 bytes'):
        bounded_yaml.text_of(file)
