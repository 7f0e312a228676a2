"""VRML 2 (`.wrl`): the IndexedFaceSets and PointSets of a scene with their transforms.

Neither trimesh nor meshio reads VRML, hence this reader. It parses the node syntax of
ISO/IEC 14772-1 generically (unknown nodes are parsed and left out), walks grouping nodes, and
applies every Transform. Prototypes, scripts, routes and external files (Inline) are not followed;
an Inline is named in the notes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from scan_compare.formats.raw import (
    RawMesh,
    ScanFileError,
    checked_triangles,
    parse_numbers,
    triangles_from_polygons,
)

DEEPEST_NESTING = 100
MOST_NODES = 50_000

_SPACE = re.compile(rb'(?:[\s,]+|#[^\n\r]*)+')
_NUMBER = re.compile(
    rb'[+-]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf)(?![\w.])'
)
_STRING = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)
_WORD = re.compile(rb'[^\s,\[\]{}"#+\-.\d][^\s,\[\]{}"#]*')
_NO_STRUCTURE = re.compile(rb'[^\[\]{}"#]*')
_COMMENT = re.compile(rb'#[^\n\r]*')
LARGEST_LENGTH = 1e30
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
    if not first_line.startswith(b'#VRML V2.0'):
        raise ScanFileError(
            f'{first_line[:30].decode("latin-1")!r} is not "#VRML V2.0"; '
            'export VRML 2 (VRML97), or PLY'
        )
    scene = _Parser(data).scene()
    collected = _Collected(byte_budget=4 * len(data) + 2**25)
    for node in scene:
        _walk(node, np.eye(4), collected, 0)
    if not collected.points:
        raise ScanFileError('VRML scene without any IndexedFaceSet or PointSet')
    points = np.concatenate(collected.points)
    triangles = None
    if collected.triangles:
        triangles = checked_triangles(np.concatenate(collected.triangles), len(points))
    return RawMesh(points, triangles, tuple(collected.notes))


class _Parser:
    """A cursor over the text; every method leaves it behind what it has read."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0
        self._nodes = 0
        self._named: dict[str, Node] = {}

    def scene(self) -> list[Node]:
        nodes = []
        while self._skip_space():
            word = self._word()
            if word in ('ROUTE',):
                for expected in ('', 'TO', ''):
                    self._skip_space()
                    if self._dotted_word() != expected and expected:
                        raise ScanFileError('VRML ROUTE without TO')
            elif word in ('PROTO', 'EXTERNPROTO'):
                raise ScanFileError(f'VRML {word} is not supported; export plain geometry')
            else:
                node = self._node(word, 0)
                if node is not None:
                    nodes.append(node)
        return nodes

    def _skip_space(self) -> bool:
        """Move to the next token; False at the end of the text."""
        match = _SPACE.match(self._data, self._position)
        if match:
            self._position = match.end()
        return self._position < len(self._data)

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
        match = re.compile(rb'[^\s,]+').match(self._data, self._position)
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

    def _field(self, node: Node, depth: int) -> None:
        key = self._word()
        if key == 'Script' or node.type == 'Script':
            raise ScanFileError('VRML Script is not supported; export plain geometry')
        if not self._skip_space():
            raise ScanFileError(f'VRML: the text ends after "{key}"')
        node.fields[key] = self._value(depth)

    def _value(self, depth: int) -> object:
        start = self._peek()
        if start == b'[':
            return self._list(depth)
        if start == b'"':
            return self._string()
        if _NUMBER.match(self._data, self._position):
            return self._inline_numbers()
        word = self._word()
        if word in ('TRUE', 'FALSE'):
            return word
        return self._node(word, depth + 1)

    def _string(self) -> str:
        match = _STRING.match(self._data, self._position)
        if not match:
            raise ScanFileError('VRML: a string without its closing quote')
        self._position = match.end()
        return ''

    def _inline_numbers(self) -> np.ndarray:
        values = []
        while match := _NUMBER.match(self._data, self._position):
            text = match[0]
            values.append(float(int(text, 16)) if b'x' in text.lower() else float(text))
            self._position = match.end()
            if not self._skip_space():
                break
        return np.array(values)

    def _list(self, depth: int) -> object:
        plain = self._plain_array()
        if plain is not None:
            return plain
        self._position += 1
        numbers: list[np.ndarray] = []
        nodes: list[Node] = []
        while self._skip_space() and self._peek() != b']':
            value = self._value(depth)
            if isinstance(value, np.ndarray):
                numbers.append(value)
            elif isinstance(value, Node):
                nodes.append(value)
        self._expect(b']')
        return np.concatenate(numbers) if numbers else nodes

    def _plain_array(self) -> np.ndarray | None:
        """Read a list of nothing but numbers at once; None, and nothing read, if it is another."""
        pieces = []
        place = self._position + 1
        while True:
            plain = _NO_STRUCTURE.match(self._data, place)
            assert plain is not None
            pieces.append(plain[0])
            comment = _COMMENT.match(self._data, plain.end())
            if comment is None:
                break
            place = comment.end()
        text = b' '.join(pieces).replace(b',', b' ')
        starts_well = text.isspace() or not text or _NUMBER.match(text.lstrip()[:80])
        if self._data[plain.end() : plain.end() + 1] != b']' or not starts_well:
            return None
        self._position = plain.end() + 1
        return parse_numbers(text, 'VRML array')


@dataclass
class _Collected:
    byte_budget: int
    points: list[np.ndarray] = field(default_factory=list)
    triangles: list[np.ndarray] = field(default_factory=list)
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
    with np.errstate(all='ignore'):
        points = point.reshape(-1, 3) @ to_scene[:3, :3].T + to_scene[:3, 3]
    start = collected.n_points
    collected.points.append(points)
    collected.n_points += len(points)
    collected.spend(points.nbytes)
    index = geometry.fields.get('coordIndex')
    if geometry.type == 'PointSet' or not isinstance(index, np.ndarray):
        return
    triangles = _indexed_triangles(index, len(points))
    if not geometry.flag('ccw', True):
        triangles = triangles[:, ::-1]
    collected.spend(triangles.nbytes)
    collected.triangles.append(triangles + start)


def _indexed_triangles(index: np.ndarray, n_points: int) -> np.ndarray:
    """Cut polygons, each ended by -1 (the last end may be missing), into triangles (m, 3)."""
    if np.any(index != np.floor(index)) or np.any(np.abs(index) > 2**31):
        raise ScanFileError('VRML coordIndex that is not made of 32-bit integers')
    whole = index.astype(np.int64)
    if whole.size and whole[-1] != -1:
        whole = np.append(whole, -1)
    ends = np.flatnonzero(whole == -1)
    sizes = np.diff(ends, prepend=-1) - 1
    corners = whole[whole != -1]
    return checked_triangles(triangles_from_polygons(sizes, corners), n_points)
