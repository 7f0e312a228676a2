# SPDX-License-Identifier: Apache-2.0
"""The header of a PLY file: byte order, elements and their properties."""

from __future__ import annotations

import re
from dataclasses import dataclass

from grasp_common.formats.raw import ScanFileError

LARGEST_HEADER = 2**16

_TYPES = {
    **dict.fromkeys(('char', 'int8'), 'i1'),
    **dict.fromkeys(('uchar', 'uint8'), 'u1'),
    **dict.fromkeys(('short', 'int16'), 'i2'),
    **dict.fromkeys(('ushort', 'uint16'), 'u2'),
    **dict.fromkeys(('int', 'int32'), 'i4'),
    **dict.fromkeys(('uint', 'uint32'), 'u4'),
    **dict.fromkeys(('float', 'float32'), 'f4'),
    **dict.fromkeys(('double', 'float64'), 'f8'),
}
_CORNERS = ('vertex_indices', 'vertex_index')
_END = re.compile(rb'^end_header[ \t]*(\r\n|\n|\r|\Z)', re.MULTILINE)
_END_AFTER_RETURN = re.compile(rb'\rend_header[ \t]*(\r|\Z)')
_ORDERS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}


@dataclass(frozen=True)
class Property:
    """A number of each element, or a list of them: then `count_type` is that of its length."""

    name: str
    type: str
    count_type: str | None


@dataclass
class Element:
    """A table of the file: its name, rows and columns."""

    name: str
    count: int
    properties: list[Property]

    @property
    def lists(self) -> list[Property]:
        """The columns that hold lists."""
        return [item for item in self.properties if item.count_type is not None]

    @property
    def corners(self) -> int | None:
        """Which of the lists names vertices; None if none does."""
        names = [item.name for item in self.lists]
        for name in _CORNERS:
            if name in names:
                return names.index(name)
        return 0 if len(names) == 1 else None


def read_header(data: bytes) -> tuple[str, list[Element], int]:
    """Return byte order ('' for ASCII), elements and the offset of the body."""
    head = data[:LARGEST_HEADER]
    mark = _END.search(head) or _END_AFTER_RETURN.search(head)
    if not data.startswith(b'ply') or not mark:
        raise ScanFileError('PLY header without "ply" at its start or "end_header" at its end')
    end, body = mark.start(), mark.end()
    order = None
    elements: list[Element] = []
    for line in data[3:end].decode('latin-1').replace('\r', '\n').split('\n'):
        words = line.split()
        if not words or words[0] in ('comment', 'obj_info'):
            continue
        try:
            if words[0] == 'format':
                order = _ORDERS[words[1]]
            elif words[0] == 'element':
                elements.append(Element(words[1], _count(words[2]), []))
            elif words[0] == 'property':
                elements[-1].properties.append(_property(words))
            elif elements:
                raise ScanFileError(f'PLY header line not understood: {line[:60]!r}')
            # before the first element: a comment that was broken into two lines
        except (KeyError, IndexError):
            raise ScanFileError(f'PLY header line not understood: {line[:60]!r}') from None
    if order is None:
        raise ScanFileError('PLY header without a format line')
    return order, elements, body


def _count(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 19):
        raise ScanFileError(f'PLY element count {word[:40]!r} is not a number of elements')
    return int(word)


def _property(words: list[str]) -> Property:
    if words[1] == 'list':
        count_type = _TYPES[words[2]]
        if count_type.startswith('f'):
            raise ScanFileError('PLY list with a count that is not an integer type')
        return Property(words[4], _TYPES[words[3]], count_type)
    return Property(words[2], _TYPES[words[1]], None)


def missing(element: Element, present: int) -> ScanFileError:
    """The error for a file that ends before its elements do."""
    return ScanFileError(
        f'PLY declares {element.count} elements "{element.name}" but holds about {present}; '
        'the file is cut or its header is wrong'
    )
