# SPDX-License-Identifier: Apache-2.0
"""The command line of shell_solve; nothing here loads the solver."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from grasp_common.command_line import usage_of
from grasp_common.options import add
from shell_deform.commands.arguments import (
    DEFAULT_CONTACT_RADIUS_M,
    above_zero,
    contact,
    direction,
    finite,
    poisson,
)
from shell_deform.theory import AUTO, DEFAULT_THEORY, THEORY_NAMES


def _sweep(text: str) -> list[float]:
    parts = text.split(':')
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f'{text!r}: give START:STOP:STEPS, for example 0:0.01:20')
    try:
        start, stop, steps = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r}: {error}') from error
    if steps < 1 or not np.isfinite([start, stop]).all():
        raise argparse.ArgumentTypeError(f'{text!r}: STEPS must be at least 1, ends finite')
    return [float(value) for value in np.linspace(start, stop, steps + 1)]


def _forces(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(',')]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r}: {error}') from error
    if not np.isfinite(values).all():
        raise argparse.ArgumentTypeError(f'{text!r}: forces must be finite')
    return values


def _add_grips(parser: argparse.ArgumentParser) -> None:
    """Options that move the contacts of kind grip."""
    grips = parser.add_argument_group('grips', 'move what holds the object; START included')
    ways = grips.add_mutually_exclusive_group()
    for way, what in (
        ('twist', 'turn one grip about the line from the others to it [degrees]'),
        ('bend', 'turn it across that line, along a circular arc [degrees]'),
        ('pull', 'shift it along that line, negative to push [m]'),
        ('turn', 'turn all grips together, with what they hold [degrees]'),
    ):
        ways.add_argument(f'--{way}', type=_sweep, metavar='START:STOP:STEPS', help=what)
    grips.add_argument('--grip', metavar='NAME', help='which one moves; default the last')
    grips.add_argument('--about', type=direction, metavar='X,Y,Z', help='another axis of it')
    grips.add_argument(
        '--axial', type=finite, metavar='N', help='force on it along the line, where free [N]'
    )


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='shell_solve',
        description='Squeeze one object at its contacts and print what it answers. SI units.',
    )
    add(parser, '--object', required=True)
    load = parser.add_mutually_exclusive_group()
    load.add_argument(
        '--displacement-sweep',
        type=_sweep,
        metavar='START:STOP:STEPS',
        help='displacement of each contact along its inward axis [m], START included',
    )
    add(load, '--force', ', one after the other', type=_forces, metavar='N,N,…')
    parser.add_argument(
        '--hold', type=above_zero, metavar='S',
        help='keep the last displacement, force or pose so long [s] while the wall relaxes',
    )  # fmt: skip
    add(
        parser,
        '--contact',
        ', instead of the contacts of the object. Its radius is '
        f'{1e3 * DEFAULT_CONTACT_RADIUS_M:g} mm unless stated. May be repeated',
        type=contact,
        action='append',
        default=[],
    )
    add(parser, '--pin-radius', type=above_zero)
    parser.add_argument(
        '--pins-slide',
        action='store_true',
        help='pins do not rub: what they press slides sideways; else it is held there',
    )
    add(parser, '--young', type=above_zero)
    add(parser, '--poisson', type=poisson)
    add(parser, '--thickness', type=above_zero)
    add(parser, '--vertices', type=int)
    add(
        parser,
        '--theory',
        '; auto: thick where a thin wall is off by more than 2 %%, else koiter',
        choices=(*THEORY_NAMES, AUTO),
        default=DEFAULT_THEORY,
    )
    add(parser, '--gas', choices=('none', 'open', 'sealed', 'liquid'))
    parser.add_argument(
        '--pressure', type=finite, metavar='PA', help='constant, inside over outside [Pa]'
    )
    _add_grips(parser)
    parser.add_argument('--mesh', type=Path, metavar='FILE', help='last surface (PLY, STL, OBJ)')
    parser.add_argument('--picture', type=Path, metavar='FILE', help='picture of it (PNG)')
    add(parser, '--json')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
