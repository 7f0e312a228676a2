# SPDX-License-Identifier: Apache-2.0
"""Strict reading of a YAML document: every complaint names the file and the line."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from pathlib import Path

import yaml

from grasp_common import bounded_yaml

from .shell_object import ObjectError


class Entry:
    """One value of a YAML document, with its place in the file."""

    def __init__(self, node: yaml.Node, file: str, key: str) -> None:
        self._node = node
        self._file = file
        self.key = key

    def error(self, complaint: str) -> ObjectError:
        """An error that names file, line and key."""
        return ObjectError(f'{self._file}, line {self._node.start_mark.line + 1}: {complaint}')

    def mapping(self, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, Entry]:
        """The entries of a mapping with exactly these keys."""
        required, optional = tuple(required), tuple(optional)
        entries = self._entries()
        allowed = (*required, *optional)
        for name, entry in entries.items():
            if name not in allowed:
                raise entry.error(_unknown(name, self.key, allowed))
        missing = [name for name in required if name not in entries]
        if missing:
            raise self.error(f'{self.key} lacks {", ".join(missing)}')
        return entries

    def one_of(self, kinds: Iterable[str]) -> tuple[str, Entry]:
        """The only entry of a mapping that has exactly one key out of `kinds`."""
        allowed = tuple(kinds)
        entries = self._entries()
        for name, entry in entries.items():
            if name not in allowed:
                raise entry.error(_unknown(name, self.key, allowed))
        if len(entries) != 1:
            raise self.error(f'{self.key} needs exactly one of {", ".join(allowed)}')
        return next(iter(entries.items()))

    def items(self, count: int | None = None) -> list[Entry]:
        """The entries of a list, `count` of them if given."""
        if not isinstance(self._node, yaml.SequenceNode):
            raise self.error(f'{self.key} must be a list')
        nodes = self._node.value
        if count is not None and len(nodes) != count:
            raise self.error(f'{self.key} has {len(nodes)} values; {count} are needed')
        return [Entry(node, self._file, f'{self.key}[{i}]') for i, node in enumerate(nodes)]

    @property
    def is_list(self) -> bool:
        """True for a list."""
        return isinstance(self._node, yaml.SequenceNode)

    def text(self, choices: Iterable[str] | None = None) -> str:
        """A text, one of `choices` if given."""
        if not isinstance(self._node, yaml.ScalarNode):
            raise self.error(f'{self.key} must be a text')
        value = str(self._node.value)
        if choices is not None and value not in (allowed := tuple(choices)):
            raise self.error(f'{self.key} is {value!r}; allowed are {", ".join(allowed)}')
        return value

    def number(
        self,
        *,
        above: float = -math.inf,
        minimum: float = -math.inf,
        maximum: float = math.inf,
    ) -> float:
        """A finite number within the given limits."""
        text = self.text()
        try:
            value = float(text)
        except ValueError:
            raise self.error(f'{self.key} is {text!r}; a plain number is needed') from None
        if not math.isfinite(value):
            raise self.error(f'{self.key} is {text}; a finite number is needed')
        if value <= above:
            raise self.error(f'{self.key} is {text}; it must be above {above:g}')
        if value < minimum:
            raise self.error(f'{self.key} is {text}; the smallest allowed value is {minimum:g}')
        if value > maximum:
            raise self.error(f'{self.key} is {text}; the largest allowed value is {maximum:g}')
        return value

    def whole(self, minimum: int, maximum: int) -> int:
        """A whole number within the given limits."""
        value = self.number(minimum=minimum, maximum=maximum)
        if value != int(value):
            raise self.error(f'{self.key} is {value:g}; a whole number is needed')
        return int(value)

    def _entries(self) -> dict[str, Entry]:
        if not isinstance(self._node, yaml.MappingNode):
            raise self.error(f'{self.key} must be a mapping')
        entries: dict[str, Entry] = {}
        for key_node, value_node in self._node.value:
            name = str(key_node.value)
            entry = Entry(value_node, self._file, name)
            if name in entries:
                raise Entry(key_node, self._file, name).error(f'{name} is given twice')
            entries[name] = entry
        return entries


def read_document(path: Path) -> Entry:
    """The root of a YAML file.

    Raises:
        ObjectError: the file cannot be read, is empty, or is no YAML.
    """
    try:
        text = bounded_yaml.text_of(path)
        node = bounded_yaml.compose(text)
    except OSError as error:
        raise ObjectError(f'{path}: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise ObjectError(f'{path}: not a text file (byte {error.start})') from error
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f', line {mark.line + 1}' if mark else ''
        problem = getattr(error, 'problem', None) or str(error)
        if isinstance(error, yaml.reader.ReaderError):
            problem = 'a character that YAML does not allow'
        raise ObjectError(f'{path}{where}: not YAML: {problem}') from error
    if node is None:
        raise ObjectError(f'{path}: the file is empty')
    return Entry(node, str(path), 'the object')


def _unknown(name: str, owner: str, allowed: tuple[str, ...]) -> str:
    longer = [other for other in allowed if other.startswith(name + '_')]
    if longer:
        return f'{owner} has no key {name!r}: say the unit, as in {longer[0]}'
    near = difflib.get_close_matches(name, allowed, 1)
    hint = f'; did you mean {near[0]}?' if near else f'; allowed are {", ".join(allowed)}'
    return f'{owner} has no key {name!r}{hint}'
