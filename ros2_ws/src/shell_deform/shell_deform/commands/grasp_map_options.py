# SPDX-License-Identifier: Apache-2.0
"""The command line of grasp_map; nothing here loads a solver."""

from __future__ import annotations

import argparse
from pathlib import Path

from grasp_common.command_line import usage_of
from shell_deform.commands.arguments import above_zero, not_negative


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='grasp_map',
        description='Sample grasps of an object, squeeze each, and rank them by what they hold: '
        'map.json, map.csv and map.html.',
        epilog='Friction is an input and tangential forces are values of the model. A map that '
        'was interrupted goes on where it was; the number of workers changes no byte.',
    )
    add = parser.add_argument
    add('object', metavar='OBJECT', help='name of a shipped object, or an object file')
    add('--out', type=Path, required=True, metavar='DIR', help='where the files go')
    add('--hand', choices=('two_pins', 'three_pins'), default='two_pins', help='default two_pins')
    add('--number', type=_count, default=100, metavar='N', help='grasps (default 100)')
    add('--seed', type=int, default=0, metavar='S', help='of the sampling (default 0)')
    add('--mu', type=not_negative, default=0.5, help='coefficient of friction (default 0.5)')
    add('--mu-sigma', type=not_negative, default=0.1, help='its sigma (default 0.1)')
    add('--mass', type=not_negative, default=0.0, metavar='KG', help='mass to lift (default 0)')
    add('--down', type=float, nargs=3, default=(0.0, 0.0, -1.0), metavar=('X', 'Y', 'Z'),
        help='direction of its weight in the frame of the object (default 0 0 -1)')  # fmt: skip
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument(
        '--depth', type=above_zero, metavar='M', help='depth of each pin [m] (default 0.004)'
    )
    amount.add_argument('--force', type=above_zero, metavar='N', help='push of each pin [N]')
    add('--lean', type=not_negative, default=20.0, metavar='DEGREES',
        help='largest angle of a line of pins to the normal (default 20)')  # fmt: skip
    add('--pin-radius', type=above_zero, default=2e-3, metavar='M', help='[m] (default 0.002)')
    add('--strain-limit', type=above_zero, default=0.2, help='of the wall [-] (default 0.2)')
    add('--vertices', type=_count, metavar='N', help='control vertices (default: as the object)')
    add('--theory', default='koiter', help='strain measure (default koiter)')
    add('--processes', type=_count, default=1, metavar='N', help='grasps at once (default 1)')
    add('--scheduler', metavar='ADDRESS', help='Dask scheduler, for example tcp://host:8786')
    add('--json', action='store_true', help='print the map as JSON on stdout')
    return parser


MOST = 1_000_000


def _count(text: str) -> int:
    value = int(text)
    if not 1 <= value <= MOST:
        raise argparse.ArgumentTypeError(f'{text} is not between 1 and {MOST}')
    return value


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
