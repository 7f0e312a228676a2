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


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='shell_solve',
        description='Squeeze one object at its contacts and print what it answers. SI units.',
    )
    parser.add_argument('--object', required=True, help='name or object file; see shell_objects')
    load = parser.add_mutually_exclusive_group(required=True)
    load.add_argument(
        '--displacement-sweep',
        type=_sweep,
        metavar='START:STOP:STEPS',
        help='displacement of each contact along its inward axis [m], START included',
    )
    load.add_argument('--force', type=_forces, metavar='F1,F2,…', help='push per contact [N]')
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
    parser.add_argument('--gas', choices=('none', 'open', 'sealed'), help='air inside')
    parser.add_argument('--mesh', type=Path, metavar='FILE', help='last surface (PLY, STL, OBJ)')
    parser.add_argument('--picture', type=Path, metavar='FILE', help='picture of it (PNG)')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
