# SPDX-License-Identifier: Apache-2.0
"""YAML from strangers: what expands, or nests, beyond reason is refused before it is built.

A kilobyte of aliases to aliases stands for 10^9 values, and twenty thousand brackets for a deeper
recursion than Python has. Plain data only, as by yaml.SafeLoader; aliases count as what they stand
for.
"""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import yaml

MOST_NODES = 50_000
DEEPEST = 50
LARGEST_TEXT = 8 * 2**20


class BoundedLoader(yaml.SafeLoader):
    """SafeLoader that counts nodes, with aliases expanded, and levels."""

    def __init__(self, stream: str) -> None:
        """Read `stream`; raises yaml.YAMLError when it is longer than `LARGEST_TEXT`."""
        if len(stream) > LARGEST_TEXT:
            raise yaml.YAMLError(
                f'the text has {len(stream)} characters; {LARGEST_TEXT} are read at most'
            )
        super().__init__(stream)
        self._count = 0
        self._depth = 0
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node and all below it; raises yaml.YAMLError beyond the bounds."""
        alias = self.check_event(yaml.AliasEvent)
        before = self._count
        self._depth += 1
        if self._depth > DEEPEST:
            raise yaml.YAMLError(f'values are nested more than {DEEPEST} levels deep')
        node = super().compose_node(parent, index)
        self._depth -= 1
        self._count += self._sizes.get(id(node), 1) if alias else 1
        if self._count > MOST_NODES:
            raise yaml.YAMLError(
                f'more than {MOST_NODES} values, aliases counted as what they stand for'
            )
        if not alias:
            self._sizes[id(node)] = self._count - before
        return node


def regular(path: Path) -> Path:
    """`path`; raises OSError for a pipe or a device.

    Whoever opens a pipe waits for its writer, for ever and for no signal; some devices never end.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, 'it is no regular file', str(path))
    return path


def text_of(path: Path, encoding: str = 'utf-8') -> str:
    """The text of a regular file; raises OSError or UnicodeDecodeError."""
    with regular(path).open('rb') as stream:
        octets = stream.read(LARGEST_TEXT + 1)
    if len(octets) > LARGEST_TEXT:
        raise OSError(errno.EFBIG, f'it has more than {LARGEST_TEXT} bytes', str(path))
    return octets.decode(encoding).replace('\r\n', '\n')


def load(text: str) -> Any:
    """The document in a text; raises yaml.YAMLError."""
    return yaml.load(text, Loader=BoundedLoader)  # noqa: S506  plain data only


def read(path: Path) -> Any:
    """The document in a regular file; raises OSError, UnicodeDecodeError or yaml.YAMLError."""
    return load(text_of(path))


def compose(text: str) -> yaml.Node | None:
    """The nodes of a text, which know their lines; None when empty; raises yaml.YAMLError."""
    return yaml.compose(text, Loader=BoundedLoader)
