# SPDX-License-Identifier: Apache-2.0
"""Tables of node parameters: declaration, range, check, usage text.

A node lists its parameters once; its `--help`, its README, the descriptors that `ros2 param
describe` shows and the check of every new value come from that list.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from grasp_common.terminal import printable

Value = bool | int | float | str | list[float] | list[int] | list[str]
Moment = Literal['running', 'configure', 'start']


class ParameterError(ValueError):
    """A parameter value that cannot be used; the message names it and what is allowed."""


@dataclass(frozen=True)
class Parameter:
    """One declared parameter.

    `lowest` and `highest` bound numbers, `choices` words (each one of a list), `length` lists.
    `settable`: while the node is running, only before it is configured, or only at its start.
    """

    name: str
    default: Value
    description: str
    lowest: float | None = None
    highest: float | None = None
    choices: tuple[str, ...] = ()
    length: int | None = None
    settable: Moment = 'running'

    @property
    def limits(self) -> str:
        """What is allowed, in words; empty when everything of its type is."""
        if self.choices:
            return f'one of {", ".join(self.choices)}'
        if self.lowest is not None and self.highest is not None:
            return f'{self.lowest:g} to {self.highest:g}'
        return ''


def check(parameter: Parameter, value: Any) -> None:
    """Raise ParameterError unless `value` has the length, the range and the words allowed."""
    is_list = isinstance(value, (list, tuple)) or hasattr(value, 'typecode')
    values = list(value) if is_list else [value]
    name, meaning = parameter.name, parameter.description
    if parameter.length is not None and len(values) != parameter.length:
        raise ParameterError(
            f'{name} has {len(values)} values; it needs {parameter.length}: {meaning}'
        )
    low, high = parameter.lowest, parameter.highest
    for one in values:
        if parameter.choices and one not in parameter.choices:
            raise ParameterError(
                f'{name} is {printable(repr(one))}; choose one of {", ".join(parameter.choices)}'
            )
        if isinstance(one, (bool, str)):
            continue
        if low is not None and high is not None and not low <= one <= high:
            raise ParameterError(
                f'{name} is {one}; it must lie between {low:g} and {high:g}: {meaning}'
            )
        if not math.isfinite(one):
            raise ParameterError(f'{name} is {one}; it must be finite: {meaning}')


def check_known(parameters: Iterable[Parameter], values: Mapping[str, Any]) -> None:
    """Check those of `values` that the table declares, by name; raises ParameterError."""
    by_name = {parameter.name: parameter for parameter in parameters}
    for name, value in values.items():
        if name in by_name:
            check(by_name[name], value)


def unknown(name: str, known: Sequence[str]) -> str:
    """A sentence on a name that is no parameter, with the nearest one that is."""
    near = difflib.get_close_matches(name, known, 1)
    hint = f'did you mean {near[0]}?' if near else 'see --help'
    return f'there is no parameter {printable(repr(name))}; {hint}'


def usage(program: str, purpose: str, parameters: Iterable[Parameter]) -> str:
    """What `PROGRAM --help` prints: every parameter with its unit, range and default."""
    lines = [
        f'usage: {program} [-h] [--version] [--ros-args -p NAME:=VALUE ...]',
        '',
        f'{purpose} SI units.',
        '',
        'parameters:',
    ]
    for parameter in parameters:
        limits = f' ({parameter.limits})' if parameter.limits else ''
        lines.append(f'  {parameter.name} (default {parameter.default!r})')
        lines.append(f'      {parameter.description}{limits}')
    return '\n'.join(lines)
