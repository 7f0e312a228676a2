# SPDX-License-Identifier: Apache-2.0
"""The command line of shell_solve; nothing here loads the solver."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from grasp_common.command_line import usage_of
from shell_deform.theory import AUTO, THEORY_NAMES


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


def _positive(text: str) -> float:
    value = float(text)
    if not (np.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f'{text}: must be positive and finite')
    return value


def _direction(text: str) -> list[float]:
    try:
        values = np.array([float(part) for part in text.split(',')])
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{text!r}: {error}') from error
    length = float(np.linalg.norm(values))
    if values.shape != (3,) or not 0.0 < length < np.inf:
        raise argparse.ArgumentTypeError(f'{text!r}: give a direction X,Y,Z')
    return [float(value) for value in values / length]


def _finite(text: str) -> float:
    value = float(text)
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text}: must be finite')
    return value


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
    grips.add_argument('--about', type=_direction, metavar='X,Y,Z', help='another axis of it')
    grips.add_argument(
        '--axial', type=_finite, metavar='N', help='force on it along the line, where free [N]'
    )


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='shell_solve',
        description='Squeeze one object at its contacts and print what it answers. SI units.',
    )
    parser.add_argument('--object', required=True, help='name or object file; see shell_objects')
    load = parser.add_mutually_exclusive_group()
    load.add_argument(
        '--displacement-sweep',
        type=_sweep,
        metavar='START:STOP:STEPS',
        help='displacement of each contact along its inward axis [m], START included',
    )
    load.add_argument('--force', type=_forces, metavar='F1,F2,…', help='push per contact [N]')
    parser.add_argument(
        '--hold', type=_positive, metavar='SECONDS',
        help='keep the last displacement or force so long [s] while the wall relaxes',
    )  # fmt: skip
    parser.add_argument('--pin-radius', type=_positive, metavar='M', help='contact radius [m]')
    parser.add_argument('--young', type=_positive, metavar='PA', help="Young's modulus [Pa]")
    parser.add_argument('--poisson', type=float, metavar='NU', help="Poisson's ratio [-]")
    parser.add_argument('--thickness', type=_positive, metavar='M', help='wall thickness [m]')
    parser.add_argument('--vertices', type=int, metavar='N', help='control vertices, about')
    parser.add_argument(
        '--theory',
        choices=(*THEORY_NAMES, AUTO),
        default='koiter',
        help='auto: thick where a thin wall is off by more than 2 %%, else koiter',
    )
    parser.add_argument(
        '--gas', choices=('none', 'open', 'sealed', 'liquid'), help='air or liquid inside'
    )
    parser.add_argument(
        '--pressure', type=_finite, metavar='PA', help='constant, inside over outside [Pa]'
    )
    _add_grips(parser)
    parser.add_argument('--mesh', type=Path, metavar='FILE', help='last surface (PLY, STL, OBJ)')
    parser.add_argument('--picture', type=Path, metavar='FILE', help='picture of it (PNG)')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
