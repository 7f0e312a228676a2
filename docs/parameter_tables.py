# SPDX-License-Identifier: Apache-2.0
"""The parameter tables of the package READMEs, from the declarations: `make tables`.

Each README carries its table between the two marks below; a test asserts that they are in step.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from grasp_common.parameter_table import Parameter

SOURCES = Path(__file__).resolve().parents[1] / 'ros2_ws' / 'src'
PACKAGES = {
    'barrett_hand_bridge': 'barrett_hand_bridge.parameters',
    'shell_deform': 'shell_deform.node.parameters',
    'scan_compare': 'scan_compare.parameters',
    'grasp_view': 'grasp_view.parameters',
}
"""Each package that declares parameters, and the module that does."""
BEGIN, END = '<!-- parameters: made by docs/parameter_tables.py -->', '<!-- end of parameters -->'


def readme(package: str) -> Path:
    """The README of a package."""
    return SOURCES / package / 'README.md'


def table(package: str) -> str:
    """The parameters that the node of a package declares, as Markdown."""
    lines = ['| parameter | default | allowed | meaning |', '|---|---|---|---|']
    parameters = import_module(PACKAGES[package]).PARAMETERS
    mixed = len({one.settable for one in parameters}) > 1
    for one in parameters:
        live = '; may change while running' if mixed and one.settable == 'running' else ''
        lines.append(
            f'| `{one.name}` | {_value(one.default)} | {_allowed(one)} | {one.description}{live} |'
        )
    return '\n'.join(lines)


def renewed(text: str, made: str) -> str:
    """A README's text with the table between its marks replaced; ValueError without them."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f'{before}{BEGIN}\n\n{made}\n\n{END}{after}'


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ' '.join(_value(one) for one in value)
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:g}' if isinstance(value, float) else str(value) or 'empty'


def _allowed(parameter: Parameter) -> str:
    if parameter.choices:
        return ', '.join(parameter.choices)
    lowest, highest = parameter.lowest, parameter.highest
    if lowest is None or highest is None:
        return '' if lowest is None else f'from {_value(lowest)}'
    return f'{_value(lowest)} to {_value(highest)}'


def main() -> int:
    """Renew the tables of all packages."""
    for package in PACKAGES:
        path = readme(package)
        path.write_text(renewed(path.read_text(), table(package)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
