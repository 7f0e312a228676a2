# SPDX-License-Identifier: Apache-2.0
"""VRML 2 (`.wrl`): the IndexedFaceSets and PointSets of a scene with their transforms.

Neither trimesh nor meshio reads VRML, hence this reader. It parses the node syntax of
ISO/IEC 14772-1 generically (unknown nodes are parsed and left out), walks grouping nodes, and
applies every Transform. Prototypes, scripts, routes and external files (Inline) are not followed;
an Inline is named in the notes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from grasp_common.formats.raw import (
    RawMesh,
    Rows,
    ScanFileError,
    checked_triangles,
    chunks_of_lines,
    chunks_of_words,
    parse_numbers,
    refuse_decimal_commas,
    triangles_from_polygons,
)

DEEPEST_NESTING = 100
MOST_NODES = 50_000

_SPACE = re.compile(rb'[\s,]*')
_NUMBER = re.compile(
    rb'[+-]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf)(?![\w.])'
)
_WORD = re.compile(rb'[^\s,\[\]{}"#+\-.\d][^\s,\[\]{}"#]*')
_DOTTED_WORD = re.compile(rb'[^\s,\[\]{}"#]+')
_PLAIN = re.compile(rb'[^\[\]{}"#]*')
_COMMENT = re.compile(rb'#[^\n\r]*')
LARGEST_LENGTH = 1e30
_PIECE = 2**18
"""Points or indices that are treated at once."""

_LONG_FIELDS: dict[str, type[np.float64] | type[np.int32]] = {
    'point': np.float64,
    'coordIndex': np.int32,
}
_SHORT_FIELDS = {
    *('geometry', 'coord', 'ccw', 'children', 'level', 'choice', 'whichChoice'),
    *('translation', 'rotation', 'scale', 'scaleOrientation', 'center'),
}
"""The fields that say where points and faces are; all others are passed over."""

_MOST_INLINE = 16
"""Numbers kept of a field without brackets: the longest one of use here, a rotation, has four."""
_GROUPS = {
    'Transform': 'children',
    'Group': 'children',
    'Anchor': 'children',
    'Billboard': 'children',
    'Collision': 'children',
    'LOD': 'level',
    'Switch': 'choice',
}


@dataclass
class Node:
    """A node of the scene: its type and its fields (arrays, nodes, lists of nodes, words)."""

    type: str
    fields: dict[str, object] = field(default_factory=dict)

    def numbers(self, name: str, count: int, default: tuple[float, ...]) -> np.ndarray:
        """Return field `name` as `count` numbers; raises ScanFileError if it holds others."""
        value = self.fields.get(name, np.array(default))
        if (
            not isinstance(value, np.ndarray)
            or value.size != count
            or not np.all(np.abs(value) < LARGEST_LENGTH)
        ):
            raise ScanFileError(f'VRML {self.type[:40]} needs {count} numbers for "{name}"')
        return value

    def flag(self, name: str, default: bool) -> bool:
        """Return the truth value of field `name`."""
        return self.fields.get(name, 'TRUE' if default else 'FALSE') == 'TRUE'


def read_vrml(data: bytes) -> RawMesh:
    """Read all shapes of a VRML 2 scene into one mesh; raises ScanFileError."""
    first_line = data[:80].split(b'\n')[0]
    if first_line.startswith(b'#X3D'):
        raise ScanFileError('this is X3D in the classic encoding; export VRML 2 (VRML97), or PLY')
    if not first_line.startswith(b'#VRML V2.0'):
        raise ScanFileError(
            f'{first_line[:30].decode("latin-1")!r} is not "#VRML V2.0"; '
            'export VRML 2 (VRML97), or PLY'
        )
    parser = _Parser(data)
    scene = parser.scene()
    collected = _Collected(2 * len(data) + 2**25, parser.uses)
    for node in scene:
        _walk(node, np.eye(4), collected, 0)
    del parser, scene
    if not collected.points:
        others = ', '.join(dict.fromkeys(collected.notes))[:200]
        raise ScanFileError(
            'VRML scene without any IndexedFaceSet or PointSet'
            + (f' ({others})' if others else '')
            + '; export a mesh'
        )
    triangles = None
    if len(collected.triangles):
        triangles = checked_triangles(collected.triangles.table(), collected.n_points)
    return RawMesh(_joined(collected.points), triangles, tuple(collected.notes))


def _joined(pieces: list[np.ndarray]) -> np.ndarray:
    """Join points (k, 3), each piece given back once it is copied."""
    if len(pieces) == 1:
        return pieces[0]
    points = Rows(np.float64, 3)
    for k in range(len(pieces)):
        for start in range(0, len(pieces[k]), _PIECE):
            points.add(pieces[k][start : start + _PIECE])
        pieces[k] = np.empty((0, 3))
    return points.table()


class _Parser:
    """A cursor over the text; every method leaves it behind what it has read."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0
        self._nodes = 0
        self.uses = 0
        self._named: dict[str, Node] = {}

    def scene(self) -> list[Node]:
        nodes = []
        while self._skip_space():
            word = self._word()
            if word == 'ROUTE':
                self._route()
            elif word in ('PROTO', 'EXTERNPROTO'):
                raise ScanFileError(f'VRML {word} is not supported; export plain geometry')
            else:
                node = self._node(word, 0)
                if node is not None:
                    nodes.append(node)
        return nodes

    def _skip_space(self) -> bool:
        """Move to the next token; False at the end of the text."""
        while True:
            self._pass(_SPACE)
            if self._peek() != b'#':
                return self._position < len(self._data)
            self._pass(_COMMENT)

    def _pass(self, pattern: re.Pattern[bytes]) -> None:
        match = pattern.match(self._data, self._position)
        if match:
            self._position = match.end()

    def _peek(self) -> bytes:
        return self._data[self._position : self._position + 1]

    def _expect(self, character: bytes) -> None:
        if not self._skip_space() or self._peek() != character:
            found = self._data[self._position : self._position + 20].decode('latin-1')
            raise ScanFileError(f'VRML: {character.decode()!r} expected, {found!r} found')
        self._position += 1

    def _word(self) -> str:
        match = _WORD.match(self._data, self._position)
        if not match:
            found = self._data[self._position : self._position + 20].decode('latin-1')
            raise ScanFileError(f'VRML: a name expected, {found!r} found')
        self._position = match.end()
        return match[0][:200].decode('latin-1')

    def _dotted_word(self) -> str:
        match = _DOTTED_WORD.match(self._data, self._position)
        if not match:
            raise ScanFileError('VRML: the text ends inside a ROUTE')
        self._position = match.end()
        return match[0][:200].decode('latin-1')

    def _node(self, word: str, depth: int) -> Node | None:
        """Read a node whose first word has been read; None for NULL."""
        if depth > DEEPEST_NESTING:
            raise ScanFileError(f'VRML nodes nested deeper than {DEEPEST_NESTING}')
        if word == 'NULL':
            return None
        if word == 'USE':
            self.uses += 1
            self._skip_space()
            used = self._word()
            if used not in self._named:
                raise ScanFileError(f'VRML USE of {used!r} before its DEF')
            return self._named[used]
        name: str | None = None
        if word == 'DEF':
            self._skip_space()
            name = self._word()
            self._skip_space()
            word = self._word()
        self._nodes += 1
        if self._nodes > MOST_NODES:
            raise ScanFileError(f'VRML scene of more than {MOST_NODES} nodes; export PLY')
        node = Node(word)
        self._expect(b'{')
        while self._skip_space() and self._peek() != b'}':
            self._field(node, depth)
        self._expect(b'}')
        if name is not None:
            self._named[name] = node
        return node

    def _route(self) -> None:
        """Pass a route, `ROUTE a.b TO c.d`, whose first word has been read."""
        for expected in ('', 'TO', ''):
            self._skip_space()
            if self._dotted_word() != expected and expected:
                raise ScanFileError('VRML ROUTE without TO')

    def _field(self, node: Node, depth: int) -> None:
        key = self._word()
        if key == 'ROUTE':
            return self._route()
        if key == 'Script' or node.type == 'Script':
            raise ScanFileError('VRML Script is not supported; export plain geometry')
        if not self._skip_space():
            raise ScanFileError(f'VRML: the text ends after "{key}"')
        value = self._value(key, depth)
        if key in _SHORT_FIELDS or key in _LONG_FIELDS:
            node.fields[key] = value

    def _value(self, key: str, depth: int) -> object:
        start = self._peek()
        if start == b'[':
            return self._list(key, depth)
        if start == b'"':
            return self._string()
        if _NUMBER.match(self._data, self._position):
            return self._inline_numbers()
        word = self._word()
        if word in ('TRUE', 'FALSE'):
            return word
        return self._node(word, depth + 1)

    def _string(self) -> str:
        """Pass a string; what it says is of no use here."""
        end = self._position
        while (end := self._data.find(b'"', end + 1)) > 0:
            before = end
            while self._data[before - 1 : before] == b'\\':
                before -= 1
            if (end - before) % 2 == 0:
                self._position = end + 1
                return ''
        raise ScanFileError('VRML: a string without its closing quote')

    def _inline_numbers(self) -> np.ndarray:
        values: list[float] = []
        while match := _NUMBER.match(self._data, self._position):
            if len(values) < _MOST_INLINE:
                text = match[0]
                values.append(float(int(text, 16)) if b'x' in text.lower() else float(text))
            self._position = match.end()
            if not self._skip_space():
                break
        return np.array(values)

    def _list(self, key: str, depth: int) -> object:
        plain = self._plain_array(key)
        if plain is not None:
            return plain
        self._position += 1
        nodes: list[Node] = []
        while self._skip_space() and self._peek() != b']':
            value = self._value(key, depth)
            if isinstance(value, Node):
                nodes.append(value)
        self._expect(b']')
        return nodes

    def _plain_array(self, key: str) -> np.ndarray | None:
        """Read a list of nothing but numbers; None, and nothing read, if it is another.

        Numbers of fields that are of no use here are passed over.
        """
        place = self._position + 1
        while True:
            plain = _PLAIN.match(self._data, place)
            assert plain is not None
            comment = _COMMENT.match(self._data, plain.end())
            if comment is None:
                break
            place = comment.end()
        start, end = self._position + 1, plain.end()
        if self._data[end : end + 1] != b']' or not self._starts_with_number(start, end):
            return None
        if key == 'point':
            refuse_decimal_commas(self._data[start:end], 'VRML points')
        numbers = Rows(_LONG_FIELDS.get(key, np.float64), 1)
        if key in _SHORT_FIELDS or key in _LONG_FIELDS:
            for text in self._plain_text(start, end):
                values = parse_numbers(text, 'VRML array')
                numbers.add(_indices(values) if key == 'coordIndex' else values)
        self._position = end + 1
        return numbers.table().reshape(-1)

    def _starts_with_number(self, start: int, end: int) -> bool:
        """Whether the list from `start` to `end` is empty or begins with a number."""
        position, self._position = self._position, start
        self._skip_space()
        first, self._position = self._position, position
        return first >= end or _NUMBER.match(self._data, first) is not None

    def _plain_text(self, start: int, end: int) -> Iterator[bytes]:
        """Yield the text of a list from `start` to `end` in pieces, without comments or commas."""
        text = self._data[start:end]
        if b'#' in text:
            for chunk in chunks_of_lines(text):
                yield _COMMENT.sub(b'', chunk).replace(b',', b' ')
        else:
            for chunk in chunks_of_words(text):
                yield chunk.replace(b',', b' ')


def _indices(values: np.ndarray) -> np.ndarray:
    if not np.all((values == np.floor(values)) & (np.abs(values) < 2**31)):
        raise ScanFileError('VRML coordIndex that is not made of 32-bit integers')
    return values.astype(np.int32)


@dataclass
class _Collected:
    byte_budget: int
    shared: int
    """How often the scene uses a node again: without any, points are moved where they are."""
    points: list[np.ndarray] = field(default_factory=list)
    triangles: Rows = field(default_factory=lambda: Rows(np.int32, 3))
    notes: list[str] = field(default_factory=list)
    n_points: int = 0
    visits: int = 0

    def spend(self, n_bytes: int) -> None:
        """Count memory against the budget: chains of USE multiply a small file without end."""
        self.byte_budget -= n_bytes
        if self.byte_budget < 0:
            raise ScanFileError('VRML scene that repeats its shapes too often; export PLY')


def _walk(node: Node, to_scene: np.ndarray, collected: _Collected, depth: int) -> None:
    collected.visits += 1
    if collected.visits > MOST_NODES or depth > DEEPEST_NESTING:
        raise ScanFileError(f'VRML scene of more than {MOST_NODES} instances; export PLY')
    if node.type == 'Shape':
        geometry = node.fields.get('geometry')
        if isinstance(geometry, Node):
            _add_geometry(geometry, to_scene, collected)
    elif node.type in _GROUPS:
        if node.type == 'Transform':
            to_scene = to_scene @ _transform(node)
        for child in _children(node):
            _walk(child, to_scene, collected, depth + 1)
    elif node.type == 'Inline':
        collected.notes.append('VRML Inline not followed: export one file')


def _children(node: Node) -> list[Node]:
    value = node.fields.get(_GROUPS[node.type], [])
    children = [value] if isinstance(value, Node) else value
    if not isinstance(children, list):
        raise ScanFileError(f'VRML {node.type} whose {_GROUPS[node.type]} are not nodes')
    if node.type == 'LOD':
        return children[:1]
    if node.type == 'Switch':
        chosen = node.numbers('whichChoice', 1, (-1.0,))[0]
        return [child for k, child in enumerate(children) if k == chosen]
    return children


def _transform(node: Node) -> np.ndarray:
    """Return the 4 x 4 matrix T C R SR S -SR -C of a Transform (ISO/IEC 14772-1, 6.52)."""
    center = node.numbers('center', 3, (0.0, 0.0, 0.0))
    orientation = _rotation(node.numbers('scaleOrientation', 4, (0.0, 0.0, 1.0, 0.0)))
    rotation = _rotation(node.numbers('rotation', 4, (0.0, 0.0, 1.0, 0.0)))
    scale = node.numbers('scale', 3, (1.0, 1.0, 1.0))
    linear = rotation @ orientation @ np.diag(scale) @ orientation.T
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    matrix[:3, 3] = node.numbers('translation', 3, (0.0, 0.0, 0.0)) + center - linear @ center
    return matrix


def _rotation(axis_angle: np.ndarray) -> np.ndarray:
    axis, angle = axis_angle[:3], axis_angle[3]
    length = np.linalg.norm(axis)
    if length == 0.0 or angle == 0.0:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _add_geometry(geometry: Node, to_scene: np.ndarray, collected: _Collected) -> None:
    if geometry.type not in ('IndexedFaceSet', 'PointSet'):
        collected.notes.append(f'VRML {geometry.type[:40]} left out')
        return
    coordinates = geometry.fields.get('coord')
    point = coordinates.fields.get('point') if isinstance(coordinates, Node) else None
    if not isinstance(point, np.ndarray) or point.size % 3 or point.size == 0:
        raise ScanFileError(f'VRML {geometry.type} without points of three coordinates')
    if collected.shared:
        collected.spend(point.nbytes)
        point = point.copy()
    elif isinstance(coordinates, Node):
        del coordinates.fields['point']
    points = point.reshape(-1, 3)
    for start in range(0, len(points), _PIECE):
        piece = slice(start, start + _PIECE)
        with np.errstate(all='ignore'):
            points[piece] = points[piece] @ to_scene[:3, :3].T + to_scene[:3, 3]
    first = collected.n_points
    collected.points.append(points)
    collected.n_points += len(points)
    index = geometry.fields.get('coordIndex')
    if geometry.type == 'PointSet' or not isinstance(index, np.ndarray):
        return
    turned = not geometry.flag('ccw', True)
    for triangles in _indexed_triangles(index, len(points)):
        if collected.shared:
            collected.spend(triangles.nbytes)
        collected.triangles.add((triangles[:, ::-1] if turned else triangles) + first)


def _indexed_triangles(index: np.ndarray, n_points: int) -> Iterator[np.ndarray]:
    """Cut polygons, each ended by -1 (the last end may be missing), into triangles (m, 3)."""
    start = 0
    while start < len(index):
        piece = index[start : start + _PIECE]
        ends = np.flatnonzero(piece == -1)
        if start + len(piece) == len(index):
            if piece[-1] != -1:
                ends = np.append(ends, len(piece))
        elif not len(ends):
            raise ScanFileError(f'VRML face of more than {_PIECE} corners; export triangles')
        piece = piece[: ends[-1]]
        sizes = np.diff(ends, prepend=-1) - 1
        yield checked_triangles(triangles_from_polygons(sizes, piece[piece != -1]), n_points)
        start += int(ends[-1]) + 1
