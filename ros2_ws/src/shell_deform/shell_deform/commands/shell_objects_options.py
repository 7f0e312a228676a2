# SPDX-License-Identifier: Apache-2.0
"""The command line of shell_objects; nothing here loads an object."""

from __future__ import annotations

import argparse
from pathlib import Path

from grasp_common.command_line import usage_of


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='shell_objects', description='The known thin shells and their numbers.'
    )
    parser.add_argument(
        'objects', nargs='*', metavar='NAME|FILE', help='objects to show (default: all shipped)'
    )
    parser.add_argument(
        '--mesh',
        action='store_true',
        help='also build each control mesh and show how well it fits (edges and errors in m)',
    )
    parser.add_argument(
        '--copy', metavar='NAME', help='write the object file of a shipped object to change it'
    )
    parser.add_argument(
        '--out', type=Path, default=Path(), metavar='DIR', help='where --copy writes (default: .)'
    )
    parser.add_argument(
        '--schema',
        action='store_true',
        help='print the JSON Schema of object files, by which editors check and complete them',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON document')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
