# SPDX-License-Identifier: Apache-2.0
"""Every option of every command in one table, `docs/options.md`, from the commands: `make tables`.

A test asserts that it is in step, and that the same name means the same in all of them.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

PAGE = Path(__file__).resolve().parent / 'options.md'
PARSERS = {
    'shell_solve': 'shell_deform.commands.shell_solve_options',
    'shell_verify': 'shell_deform.commands.shell_verify',
    'shell_objects': 'shell_deform.commands.shell_objects_options',
    'shell_identify': 'shell_deform.commands.shell_identify_options',
    'object_prepare': 'shell_deform.commands.object_prepare_options',
    'grasp_map': 'shell_deform.commands.grasp_map_options',
    'scan_error': 'scan_compare.commands.scan_error_options',
    'grasp_report': 'grasp_replay.commands.grasp_report',
    'replay': 'grasp_replay.replay_options',
    'record': 'grasp_replay.record_options',
    'bag_check': 'grasp_replay.commands.bag_check',
    'hand_calibrate': 'barrett_hand_bridge.commands.hand_calibrate',
    'hand_emulator': 'barrett_hand_bridge.commands.hand_emulator',
}
"""The commands that are no nodes, and the module whose `build_parser` says what they take."""

HEAD = """# The options of all commands

Made by `make tables`. The same name means the same in every command and takes the same kind of
value in the same unit; values are SI, their unit stands in the help. `replay` and `record` have
rosbag2's names besides (`-d` is the delay of the one, the duration of the other). Keys of
object files (`--young-modulus-pa`) are taken where the option overrides that key. The nodes
(`hand_bridge`, `deformation`, `scan_compare`, `grasp_view`) take ROS parameters only: tables in
the READMEs of their packages. Every command has `--help` and `--version`.

| option | value | commands | what it is |
|---|---|---|---|
"""


@dataclass(frozen=True)
class Described:
    """An option of one command: its names, its value as usage texts show it, its help."""

    command: str
    names: tuple[str, ...]
    value: str
    help: str

    @property
    def name(self) -> str:
        """The one that it is called by: the first long one."""
        return next((name for name in self.names if name.startswith('--')), self.names[0])


def options(command: str) -> list[Described]:
    """All options of a command."""
    parser: argparse.ArgumentParser = import_module(PARSERS[command]).build_parser()
    found = []
    for action in parser._actions:
        if not action.option_strings or action.dest == 'help':
            continue
        shown = parser._get_formatter()._format_args(action, str(action.metavar or '').strip())
        if action.choices is not None and action.metavar is None:
            shown = ', '.join(map(str, action.choices))
        text = (action.help or '') % {'default': action.default, 'prog': parser.prog}
        value = '' if action.nargs == 0 else shown
        found.append(Described(command, tuple(action.option_strings), value, text))
    return found


def everything() -> dict[str, list[Described]]:
    """All options of all commands by name."""
    found: dict[str, list[Described]] = {}
    for command in PARSERS:
        for one in options(command):
            found.setdefault(one.name, []).append(one)
    return dict(sorted(found.items()))


def page() -> str:
    """The text of `docs/options.md`."""
    lines = []
    for described in everything().values():
        rows: dict[tuple[str, str], list[Described]] = {}
        for one in described:
            rows.setdefault((one.value, one.help), []).append(one)
        for (value, text), ones in rows.items():
            names = ' '.join(f'`{name}`' for name in ones[0].names)
            commands = ', '.join(one.command for one in ones)
            cells = (names, value and f'`{value}`', commands, text)
            lines.append('| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |')
    return HEAD + '\n'.join(lines) + '\n'


def main() -> int:
    """Write the page."""
    PAGE.write_text(page(), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
