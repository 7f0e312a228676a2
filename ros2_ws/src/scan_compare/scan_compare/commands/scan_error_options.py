# SPDX-License-Identifier: Apache-2.0
"""The command line of scan_error; nothing here reads a scan."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from grasp_common.command_line import usage_of
from grasp_common.options import UNIT_NAMES, add
from scan_compare.parameters import SCANNER_SIGMA_M
from scan_compare.rigid import IDENTITY, Pose, rotation_from_quaternion


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='scan_error',
        description='Compare a 3-D scan with the outer face of a deformed shell: rigid '
        'registration on the undeformed region, distances to the smooth surface, statistics '
        'with their noise floor. Lengths in metres unless stated.',
    )
    parser.add_argument(
        'scan', nargs='+', type=Path, help='scan file (STL, PLY, OBJ, OFF, PCD, VRML 2 or '
        'a table of text, also gzipped); several are views of one object and are merged',
    )  # fmt: skip
    add(parser, '--object', required=True)
    parser.add_argument(
        '--surface', type=Path, metavar='FILE', help='mesh file with the deformed limit '
        'positions of the control vertices on the middle surface; without it the object at rest',
    )  # fmt: skip
    parser.add_argument('--rest', type=Path, metavar='FILE', help='the same mesh at rest')
    parser.add_argument(
        '--against', type=Path, metavar='FILE', help='a second deformed surface: say which '
        'of the two fits the scan better, if the scan can tell',
    )  # fmt: skip
    parser.add_argument(
        '--surface-unit', default='m', choices=UNIT_NAMES, help='unit of --surface and --rest'
    )
    parser.add_argument(
        '--undeformed', type=Path, nargs='+', metavar='FILE', help='scan of the undeformed '
        'object: depth of the dent is counted from it',
    )  # fmt: skip
    parser.add_argument(
        '--undeformed-region', type=Path, metavar='FILE', help='copy of the scan cropped to the '
        'region that is undeformed: registration uses its points only (default: found from the '
        'model)',
    )  # fmt: skip
    add(parser, '--unit', ' files; inferred from the size of the object when left out')
    add(
        parser, '--scanner-sigma', ' (default %(default)s)',
        type=_positive, default=SCANNER_SIGMA_M,
    )  # fmt: skip
    parser.add_argument(
        '--start', type=_start, default=IDENTITY, metavar='POSE', help='pose of the scan in the '
        'object frame to start from: "x y z qx qy qz qw" [m], or "search" for all rotations '
        '(default: identity)',
    )  # fmt: skip
    parser.add_argument(
        '--contacts', type=Path, metavar='FILE', help='start from contact points known in both '
        'frames: text file, six numbers a line, x y z in the scan frame and x y z in the object '
        'frame [m]',
    )  # fmt: skip
    parser.add_argument(
        '--outlier', type=_positive, metavar='M', help='points further from the surface are '
        'no part of the object [m] (default: a quarter of its extent)',
    )  # fmt: skip
    add(parser, '--out', ' of a report (default: none)')
    add(parser, '--json')
    parser.add_argument('--quiet', action='store_true', help='no progress bar')
    return parser


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not (np.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f'{text!r} is not a positive length in metres')
    return value


def _start(text: str) -> Pose | None:
    if text == 'search':
        return None
    try:
        values = np.array([float(word) for word in text.replace(',', ' ').split()])
    except ValueError:
        values = np.empty(0)
    if values.size != 7 or not np.all(np.isfinite(values)) or not np.any(values[3:]):
        raise argparse.ArgumentTypeError(
            f'{text!r} is not "x y z qx qy qz qw" with a quaternion, nor "search"'
        )
    return Pose(rotation_from_quaternion(values[3:]), values[:3])


def usage() -> str:
    """The usage text."""
    return usage_of('scan_compare', build_parser())
