# SPDX-License-Identifier: Apache-2.0
"""Files of parameters (`--params-file`): whether one is any, and which nodes it speaks to.

rcl takes a file without a map in it (a text, an empty file) for one without parameters, and says
nothing; of others it says where its own sources gave up. So they are looked at before it does.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from grasp_common.bounded_yaml import compose, text_of
from grasp_common.parameter_table import ParameterError
from grasp_common.terminal import printable

PARAMETERS_KEY = 'ros__parameters'
FORM = 'NODE: {ros__parameters: {NAME: VALUE}}, where NODE may be /**'


def given_files(arguments: Sequence[str]) -> list[str]:
    """The files of parameters that a command line names behind `--ros-args`."""
    files, inside = [], False
    for word, value in zip(arguments, arguments[1:], strict=False):
        inside = word == '--ros-args' or (inside and word != '--')
        if inside and word == '--params-file':
            files.append(value)
    return files


def nodes_in(file: str) -> list[str]:
    """Absolute names of the nodes that a file has parameters for, wildcards as they stand.

    Raises ParameterError with the file, the line and what a file of parameters looks like.
    """
    try:
        if not Path(file).is_file():
            raise ParameterError('there is no regular file of this name')
        root = compose(text_of(Path(file), 'utf-8-sig'))
        if not isinstance(root, yaml.MappingNode):
            raise ParameterError('it holds no map of names')
        names = [f'/{name}' for name in _nodes(root, ())]
        if not names:
            raise ParameterError(f'it holds no {PARAMETERS_KEY}')
        return names
    except OSError as error:
        reason = str(error.strerror)
    except UnicodeDecodeError:
        reason = 'it is no UTF-8 text'
    except yaml.YAMLError as error:
        reason = _said(error)
    except ParameterError as error:
        reason = str(error)
    raise ParameterError(
        f'--params-file {printable(file)} is no file of parameters: {reason}; it must read {FORM}'
    )


def speaks_to(name: str, node: str) -> bool:
    """Whether a name in a file, with its wildcards, is that of a node (both absolute)."""
    # design.ros2.org, ros_command_line_arguments: * is one token, ** any number of them.
    parts = [
        '(/[^/]+)*' if part == '**' else '/[^/]+' if part == '*' else '/' + re.escape(part)
        for part in name.strip('/').split('/')
    ]
    return re.fullmatch(''.join(parts), node) is not None


def _nodes(holder: yaml.MappingNode, above: tuple[str, ...]) -> Iterator[str]:
    for key, value in holder.value:
        name, line = str(key.value), key.start_mark.line + 1
        if not isinstance(value, yaml.MappingNode):
            where = 'is no map' if name == PARAMETERS_KEY else f'stands outside {PARAMETERS_KEY}'
            raise ParameterError(f'line {line}: {printable(name)} {where}')
        if name != PARAMETERS_KEY:
            yield from _nodes(value, (*above, name.strip('/')))
        elif above:
            yield '/'.join(above)
        else:
            raise ParameterError(f'line {line}: {PARAMETERS_KEY} stands without a node')


def _said(error: yaml.YAMLError) -> str:
    """A complaint of the reader in one line."""
    mark = getattr(error, 'problem_mark', None)
    problem = getattr(error, 'problem', None) or str(error).replace('\n', ' ')
    return f'line {mark.line + 1}: {problem}' if mark is not None else str(problem)
