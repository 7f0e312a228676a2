# SPDX-License-Identifier: Apache-2.0
"""The command line of object_prepare; nothing here reads a scan."""

from __future__ import annotations

import argparse
from pathlib import Path

from grasp_common.command_line import usage_of
from grasp_common.options import add
from shell_deform.commands.arguments import (
    DEFAULT_CONTACT_RADIUS_M,
    above_zero,
    contact,
    count,
    finite,
    not_negative,
    poisson,
)

RENAMED = {'--error-m': '--error', '--close-holes-m': '--close-holes', '--size-m': '--size'}
"""A unit stands in the help of an option, not in its name."""


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='object_prepare',
        description='Make an object file from a scan of the undeformed object: the scan is '
        'cleaned, oriented, remeshed and fitted by a Loop control mesh whose limit surface is '
        'the middle of the wall. Primitives need no scan: write their object file by hand.',
    )
    parser.add_argument(
        'scan', type=Path, help='triangles: STL, PLY, OBJ, OFF or VRML 2, also gzipped'
    )
    add(parser, '--unit', required=True)
    parser.add_argument(
        '--name', metavar='NAME', help="name of the object (default: the scan file's)"
    )
    add(parser, '--out', ' (default: .)', default=Path())
    wall = parser.add_mutually_exclusive_group(required=True)
    add(wall, '--thickness', type=above_zero)
    wall.add_argument(
        '--thickness-file',
        type=Path,
        metavar='FILE',
        help='wall thickness at places: a table of x y z thickness, all in m, comma separated',
    )
    parser.add_argument(
        '--face',
        choices=['outer', 'middle'],
        default='outer',
        help='what the scan shows (default: outer, half the thickness outside the middle)',
    )
    add(parser, '--young', type=above_zero, required=True)
    add(parser, '--poisson', type=poisson, required=True)
    add(parser, '--vertices', ' (default: 640)', type=count(40, 100_000))
    parser.add_argument(
        '--error',
        type=above_zero,
        metavar='M',
        help='instead of --vertices: as many as leave no more than this systematic error [m]',
    )
    parser.add_argument(
        '--close-holes',
        type=not_negative,
        metavar='M',
        help='close holes with a rim up to this length [m] (default: half the size of the '
        'object); longer rims stay open',
    )
    add(
        parser,
        '--contact',
        ', in the frame of the scan; triangles are small there. Its radius is '
        f'{1e3 * DEFAULT_CONTACT_RADIUS_M:g} mm unless stated. May be repeated',
        type=contact,
        action='append',
        default=[],
    )
    add(parser, '--gas', ' (default: none)', choices=('none', 'open', 'sealed'))
    parser.add_argument(
        *('--gauge-pressure', '--gauge-pressure-pa'), type=finite, metavar='PA',
        help='of sealed gas, above ambient [Pa]',
    )  # fmt: skip
    parser.add_argument(
        '--size',
        type=above_zero,
        metavar='M',
        help='largest side of the object [m]: the scan must be about that large in its unit '
        '(default: what a hand can hold, 0.02 to 0.5 m)',
    )
    add(parser, '--json')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
