# SPDX-License-Identifier: Apache-2.0
"""The command line of shell_identify; nothing here loads the solver."""

from __future__ import annotations

import argparse
from pathlib import Path

from grasp_common.command_line import usage_of
from grasp_common.options import add
from shell_deform.commands.arguments import above_zero, not_negative, poisson
from shell_deform.theory import AUTO, KOITER, THEORY_NAMES, is_linear

THEORIES = (*(name for name in THEORY_NAMES if not is_linear(name)), AUTO)

# One count of the 8-bit gauge at 50 mm, as a standard deviation; a twentieth of a millimetre.
DEFAULT_SIGMA_FORCE_N = 0.06
DEFAULT_SIGMA_DISPLACEMENT_M = 5e-5
# A zero that drifts by half a count during a grasp; a calibration with known weights.
DEFAULT_SIGMA_ZERO_N = 0.1
DEFAULT_SIGMA_GAIN = 0.01
# A tenth of a count of 0.2 N.
DEFAULT_SIGMA_DRIFT_N = 0.02
# The scanner of the published experiment; what a fit of a dense scan leaves of its place.
DEFAULT_SCANNER_SIGMA_M = 0.127e-3
DEFAULT_SIGMA_REGISTRATION_M = 5e-5


RENAMED = {'--thickness': '--fit-thickness', '--pressure': '--fit-pressure'}
"""Switches whose names are values in the other commands."""


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='shell_identify',
        description='Identify the stiffness of a shell from how it was squeezed. SI units.',
    )
    parser.add_argument(
        'data',
        type=Path,
        help='CSV with force_n, displacement_m [, sigma_force_n, sigma_displacement_m] per '
        'contact and perhaps a column headed scan with files, or a bag with hand/contacts that '
        'carry travel',
    )
    add(parser, '--object', required=True)
    add(parser, '--pin-radius', type=above_zero)
    add(
        parser, '--theory', choices=THEORIES, default=KOITER,
        more='; auto: thick where koiter would be off by more than 2 %%, which '
        'finds the modulus of the material itself and takes minutes (default %(default)s)',
    )  # fmt: skip
    add(parser, '--poisson', ", instead of the object file's", type=poisson)
    second = parser.add_mutually_exclusive_group()
    second.add_argument(
        '--fit-pressure', action='store_true', help='identify the gauge pressure [Pa] too'
    )
    second.add_argument(
        '--fit-thickness', action='store_true',
        help='identify the wall thickness [m] too, from the scans that the table names, in the '
        'frame of the object (error.ply of scan_error --out)',
    )  # fmt: skip
    second.add_argument(
        '--relaxation', action='store_true',
        help='identify how the wall relaxes, from a bag in which the travel stands still',
    )  # fmt: skip
    parser.add_argument(
        '--sigma-drift', type=above_zero, default=DEFAULT_SIGMA_DRIFT_N, metavar='N',
        help="drift of the gauge's zero in a root minute [N], for --relaxation "
        '(default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--until', type=above_zero, metavar='S',
        help='of --relaxation: use the samples up to here and predict the later ones [s]',
    )  # fmt: skip
    add(parser, '--scan-unit', ' (default m)', default='m')
    add(
        parser, '--scanner-sigma', ' (default %(default)s)',
        type=above_zero, default=DEFAULT_SCANNER_SIGMA_M,
    )  # fmt: skip
    parser.add_argument(
        '--sigma-registration', type=above_zero, default=DEFAULT_SIGMA_REGISTRATION_M,
        metavar='M', help='of a scan at a contact [m] (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--fit-rows', type=int, metavar='COUNT', help='smallest loads to cross-validate from'
    )
    parser.add_argument(
        '--sigma-force', type=above_zero, default=DEFAULT_SIGMA_FORCE_N, metavar='N',
        help='gauge uncertainty [N] where the table has none (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--sigma-displacement', type=above_zero, default=DEFAULT_SIGMA_DISPLACEMENT_M,
        metavar='M',
        help='displacement uncertainty [m] where the table has none (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--sigma-zero', type=not_negative, default=DEFAULT_SIGMA_ZERO_N, metavar='N',
        help="zero of the gauge, the same error in all rows [N] (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        '--sigma-gain', type=not_negative, metavar='SHARE',
        help="relative uncertainty of the gauge's gain [-] (default: "
        f'{DEFAULT_SIGMA_GAIN} for a table, what its sigma_n says for a bag)',
    )  # fmt: skip
    add(parser, '--plot', ' of the curves with bands')
    add(parser, '--json')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
