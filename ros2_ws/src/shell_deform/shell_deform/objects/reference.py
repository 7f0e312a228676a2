# SPDX-License-Identifier: Apache-2.0
"""The reference of the object file, from its JSON Schema: one source for editors and people."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

SCHEMA_FILE = Path(__file__).parent / 'object.schema.json'


def schema() -> dict[str, Any]:
    """The JSON Schema of an object file."""
    document: dict[str, Any] = json.loads(SCHEMA_FILE.read_text(encoding='utf-8'))
    return document


def reference_table() -> str:
    """Every key of an object file as the rows of a Markdown table."""
    rows = ['| key | value | what |', '|---|---|---|']
    _rows(schema(), '', rows)
    return '\n'.join(rows) + '\n'


def _rows(node: dict[str, Any], path: str, rows: list[str]) -> None:
    for key, inner in node.get('properties', {}).items():
        name = f'{path}{key}'
        needed = ' (required)' if key in node.get('required', ()) else ''
        rows.append(f'| `{name}`{needed} | {_value(inner)} | {inner.get("description", "")} |')
        _rows(inner, f'{name}.', rows)
        if inner.get('type') == 'array':
            _rows(inner['items'], f'{name}[].', rows)


def _value(node: dict[str, Any]) -> str:
    if 'enum' in node:
        return ', '.join(f'`{item}`' for item in node['enum'])
    if 'anyOf' in node:
        return ', or '.join(_value(item) for item in node['anyOf'])
    kind = node['type']
    if kind == 'object':
        return 'one key' if node.get('maxProperties') == 1 else 'keys'
    if kind == 'array':
        count = node.get('minItems', 0)
        fixed = count == node.get('maxItems')
        return f'list of {count}' if fixed else 'list'
    if kind == 'string':
        return 'text'
    words = 'whole number' if kind == 'integer' else 'number'
    bounds = [
        f'{sign} {node[key]:g}'
        for key, sign in (('exclusiveMinimum', '>'), ('minimum', '>='), ('maximum', '<='))
        if key in node
    ]
    return ' '.join([words, ', '.join(bounds)]).strip()
