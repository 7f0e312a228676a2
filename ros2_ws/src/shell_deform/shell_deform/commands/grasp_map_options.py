# SPDX-License-Identifier: Apache-2.0
"""The command line of grasp_map; nothing here loads a solver."""

from __future__ import annotations

import argparse

from grasp_common.command_line import usage_of
from grasp_common.options import add
from shell_deform.commands.arguments import above_zero, count, direction, not_negative
from shell_deform.theory import AUTO, KOITER, THEORY_NAMES

MOST = 1_000_000


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='grasp_map',
        description='Sample grasps of an object, squeeze each, and rank them by what they hold: '
        'map.json, map.csv and map.html.',
        epilog='Friction is an input and tangential forces are values of the model. A map that '
        'was interrupted goes on where it was; the number of workers changes no byte.',
    )
    own = parser.add_argument
    own('object', metavar='OBJECT', help='name or object file; see shell_objects')
    add(parser, '--out', required=True)
    add(
        parser, '--hand', ' (default two_pins)',
        choices=('two_pins', 'three_pins', 'two_fingertips', 'three_fingertips'),
        default='two_pins',
    )  # fmt: skip
    own('--finger-body', metavar='BODY',
        help='rigid body of fingertips: a name, a file, or NUMBER: BODY, NUMBER: BODY '
        '(default barrett_fingertip)')  # fmt: skip
    own('--number', type=count(1, MOST), default=100, metavar='COUNT', help='grasps (default 100)')
    add(parser, '--seed', ' (default 0)', type=count(0, 2**63), default=0)
    own('--mu', type=not_negative, default=0.5, metavar='SHARE',
        help='coefficient of friction [-] (default 0.5)')  # fmt: skip
    own('--mu-sigma', type=not_negative, default=0.1, metavar='SHARE',
        help='its sigma [-] (default 0.1)')  # fmt: skip
    own('--mass', type=not_negative, default=0.0, metavar='KG',
        help='mass to lift [kg] (default 0)')  # fmt: skip
    own('--down', type=direction, default=(0.0, 0.0, -1.0), metavar='X,Y,Z',
        help='direction of its weight in the frame of the object (default 0,0,-1)')  # fmt: skip
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument(
        '--depth',
        type=above_zero,
        metavar='M',
        help='depth of each finger from first touch [m] (default 0.004)',
    )
    add(amount, '--force', type=above_zero)
    own('--lean', type=not_negative, default=20.0, metavar='DEGREES',
        help='largest angle of a line of pins to the normal [degrees] (default 20)')  # fmt: skip
    add(parser, '--pin-radius', ' (default 0.002)', type=above_zero, default=2e-3)
    own('--strain-limit', type=above_zero, default=0.2, metavar='SHARE',
        help='of the wall [-] (default 0.2)')  # fmt: skip
    add(parser, '--vertices', ' (default: as the object)', type=count(1, MOST))
    add(
        parser, '--theory', ' (default koiter: a thick wall takes four times as long)',
        choices=(*THEORY_NAMES, AUTO), default=KOITER,
    )  # fmt: skip
    add(parser, '--processes', ' (default 1)', type=count(1, MOST), default=1)
    add(parser, '--scheduler')
    add(parser, '--json')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
