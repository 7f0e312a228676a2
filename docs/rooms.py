# SPDX-License-Identifier: Apache-2.0
"""The picture of the rooms of `shell_deform` in architecture.md, from the imports: `make tables`.

Read from the syntax trees of all modules, lazy imports inside functions and those for types alone
included. A test asserts that the picture is in step and that no import runs against `ORDER`.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'architecture.md'
NAME = 'shell_deform'
PACKAGE = ROOT / 'ros2_ws' / 'src' / NAME / NAME
BEGIN, END = '<!-- rooms: made by docs/rooms.py -->', '<!-- end of rooms -->'

FRONT_DOOR = ''
"""The room of `__init__.py`, above all others."""

ORDER = (
    FRONT_DOOR,
    'commands',
    'squeeze',
    'node',
    'live.tick',
    'live.background',
    'grasp',
    'identify',
    'verification',
    'solve',
    'picture',
    'building',
    'readout',
    'model',
    'contact',
    'supports',
    'assemble',
    'objects',
    'surface',
    'theory',
    'factor',
    'compiled',
    'live',
)
"""Each room imports only rooms that stand after it; `live` alone is what its two rooms share."""


def room(module: str) -> str:
    """The room of a module, both as dotted names inside the package."""
    parts = module.split('.')
    inner = '.'.join(parts[:2])
    return inner if inner in ORDER else parts[0]


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name inside it; a folder by its own."""
    names = {}
    for path in sorted(PACKAGE.rglob('*.py')):
        parts = path.relative_to(PACKAGE).with_suffix('').parts
        names['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = path
    return names


def arrows() -> dict[tuple[str, str], list[str]]:
    """Which room imports which, and by which lines: (from, to) -> 'module -> module'."""
    known = modules()
    found = defaultdict(list)
    for module, path in known.items():
        for name in _imported(module, path, known):
            if room(name) != room(module):
                found[room(module), room(name)].append(f'{module} -> {name}')
    return dict(found)


def _imported(module: str, path: Path, known: dict[str, Path]) -> Iterator[str]:
    """The modules of the package that a module imports anywhere."""
    folder = module if path.name == '__init__.py' else module.rpartition('.')[0]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            inside = [a.name for a in node.names if a.name.startswith(f'{NAME}.')]
            yield from (name.removeprefix(f'{NAME}.') for name in inside)
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(node, folder)
            if base is None:
                continue
            for alias in node.names:
                name = f'{base}.{alias.name}'.lstrip('.')
                yield name if name in known else base


def _absolute(node: ast.ImportFrom, folder: str) -> str | None:
    """What an import statement reads from, inside the package; None for other packages."""
    if not node.level:
        name = node.module or ''
        return name[len(NAME) + 1 :] if f'{name}.'.startswith(f'{NAME}.') else None
    parts = folder.split('.')
    above = parts[: len(parts) - node.level + 1]
    return '.'.join([*above, *([node.module] if node.module else [])])


def floors(edges: set[tuple[str, str]]) -> dict[str, int]:
    """The floor of every room: one above the highest that it imports."""
    result: dict[str, int] = {}
    for name in reversed(ORDER):
        below = [result[to] for start, to in edges if start == name]
        if below or any(to == name for _, to in edges):
            result[name] = 1 + max(below, default=-1)
    return result


def picture(edges: set[tuple[str, str]]) -> str:
    """The rooms as a Mermaid chart, floor by floor; arrows that others imply are left out."""
    floor = floors(edges)
    lines = ['```mermaid', 'flowchart TD']
    for level in sorted(set(floor.values()), reverse=True):
        lines.append(f'    subgraph floor{level} [floor {level}]')
        lines += [f'        {_node(name)}' for name in ORDER if floor.get(name) == level]
        lines.append('    end')
    direct = sorted(edges - {(a, c) for a, b in edges for c in _reachable(edges, b)})
    lines += [f'    {_identifier(a)} --> {_identifier(b)}' for a, b in direct]
    return '\n'.join([*lines, '```'])


def _node(name: str) -> str:
    return f'{_identifier(name)}["{name.replace(".", "/") or "import shell_deform"}"]'


def _identifier(name: str) -> str:
    return f'room_{name.replace(".", "_")}'


def _reachable(edges: set[tuple[str, str]], start: str) -> set[str]:
    """The rooms below a room, by any number of arrows."""
    direct = {to for name, to in edges if name == start}
    return direct.union(*(_reachable(edges, to) for to in direct))


def renewed(text: str) -> str:
    """The text of the page with the picture between its marks replaced."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f'{before}{BEGIN}\n\n{picture(set(arrows()))}\n\n{END}{after}'


def main() -> None:
    """Renew the picture in the page."""
    PAGE.write_text(renewed(PAGE.read_text()))


if __name__ == '__main__':
    main()
