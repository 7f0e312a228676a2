# SPDX-License-Identifier: Apache-2.0
"""The command line of object_prepare; nothing here reads a scan."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from grasp_common.command_line import usage_of
from shell_deform.commands.arguments import (
    DEFAULT_CONTACT_RADIUS_M,
    UNITS,
    above_zero,
    not_negative,
)


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
    parser.add_argument('--unit', choices=UNITS, required=True, help='unit of the scan')
    parser.add_argument('--name', help="name of the object (default: the scan file's)")
    parser.add_argument('--out', type=Path, default=Path(), help='folder for the results')
    wall = parser.add_mutually_exclusive_group(required=True)
    wall.add_argument('--thickness-m', type=above_zero, metavar='M', help='wall thickness [m]')
    wall.add_argument(
        '--thickness-file',
        type=Path,
        help='wall thickness at places: a table of x y z thickness, all in m, comma separated',
    )
    parser.add_argument(
        '--face',
        choices=['outer', 'middle'],
        default='outer',
        help='what the scan shows (default: outer, half the thickness outside the middle)',
    )
    _add_material(parser)
    parser.add_argument(
        '--vertices', type=_count, help='about how many control vertices (default: 640)'
    )
    parser.add_argument(
        '--error-m',
        type=above_zero,
        help='instead: as many as leave no more than this systematic error [m]',
    )
    parser.add_argument(
        '--close-holes-m',
        type=not_negative,
        help='close holes with a rim up to this length [m] (default: half the size of the '
        'object); longer rims stay open',
    )
    parser.add_argument(
        '--contact',
        type=_contact,
        action='append',
        default=[],
        metavar='X,Y,Z[,RADIUS]',
        help='a pin on the outer face [m], in the frame of the scan; triangles are small there. '
        f'Its radius is {1e3 * DEFAULT_CONTACT_RADIUS_M:g} mm unless stated. May be repeated',
    )
    parser.add_argument(
        '--gas',
        choices=['none', 'open', 'sealed'],
        help='what fills the object (default: not stated, none)',
    )
    parser.add_argument(
        '--gauge-pressure-pa', type=float, metavar='PA', help='of sealed gas, above ambient [Pa]'
    )
    parser.add_argument(
        '--size-m',
        type=above_zero,
        metavar='M',
        help='largest side of the object [m]: the scan must be about that large in its unit '
        '(default: what a hand can hold, 0.02 to 0.5 m)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document')
    return parser


def _add_material(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        *('--young-modulus-pa', '--young'),
        type=above_zero,
        required=True,
        metavar='PA',
        help="Young's modulus [Pa]",
    )
    parser.add_argument(
        *('--poisson-ratio', '--poisson'),
        metavar='NU',
        type=_poisson,
        required=True,
        help="Poisson's ratio, above -1, up to 0.5",
    )


def _poisson(text: str) -> float:
    value = float(text)
    if not -1.0 < value <= 0.5:
        raise argparse.ArgumentTypeError(f'{text} is not above -1 and up to 0.5')
    return value


def _count(text: str) -> int:
    value = int(text)
    if not 40 <= value <= 100_000:
        raise argparse.ArgumentTypeError(f'{text} is not between 40 and 100000')
    return value


def _contact(text: str) -> tuple[float, float, float, float]:
    try:
        parts = [float(part) for part in text.split(',')]
    except ValueError:
        parts = []
    if len(parts) == 3:
        parts.append(DEFAULT_CONTACT_RADIUS_M)
    if len(parts) != 4 or not all(map(math.isfinite, parts)) or parts[3] <= 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not X,Y,Z,RADIUS with a radius above zero')
    return parts[0], parts[1], parts[2], parts[3]


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
