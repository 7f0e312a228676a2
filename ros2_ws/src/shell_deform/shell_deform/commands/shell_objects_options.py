# SPDX-License-Identifier: Apache-2.0
"""The command line of shell_objects; nothing here loads an object."""

from __future__ import annotations

import argparse
from pathlib import Path

from grasp_common.command_line import usage_of
from grasp_common.options import add

RENAMED = {'--mesh': '--mesh-fit'}
"""A mesh is a file to write in the other commands."""


def build_parser() -> argparse.ArgumentParser:
    """Options and arguments."""
    parser = argparse.ArgumentParser(
        prog='shell_objects', description='The known thin shells and their numbers.'
    )
    parser.add_argument(
        'objects', nargs='*', metavar='NAME|FILE', help='objects to show (default: all shipped)'
    )
    parser.add_argument(
        '--mesh-fit',
        action='store_true',
        help='also build each control mesh and show how well it fits (edges and errors in m)',
    )
    parser.add_argument(
        '--copy', metavar='NAME', help='write the object file of a shipped object to change it'
    )
    add(parser, '--out', ' that --copy writes (default: .)', default=Path())
    parser.add_argument(
        '--schema',
        action='store_true',
        help='print the JSON Schema of object files, by which editors check and complete them',
    )
    add(parser, '--json')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('shell_deform', build_parser())
