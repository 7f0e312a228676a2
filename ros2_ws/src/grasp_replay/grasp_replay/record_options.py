# SPDX-License-Identifier: Apache-2.0
"""The command line of `record`; nothing here loads ROS or a writer of bags."""

from __future__ import annotations

import argparse
from pathlib import Path

from grasp_common.command_line import usage_of
from grasp_common.options import add


def build_parser() -> argparse.ArgumentParser:
    """The command line of `record`."""
    parser = argparse.ArgumentParser(
        prog='record', description='Record topics into a crash-safe MCAP bag (rosbag2 layout).'
    )
    parser.add_argument(
        'topics', nargs='*', metavar='TOPIC', help='topics to record (absolute names)'
    )
    parser.add_argument('-a', '--all', action='store_true', help='every topic that is not hidden')
    parser.add_argument(
        *('-o', '--output'), type=Path, metavar='BAG', help='new bag (default: by the date)'
    )
    add(parser, '--regex', ', beside those named', short=('-e',))
    add(parser, '--exclude-regex', short=('-x',))
    add(parser, '--exclude-topics', default=[])
    parser.add_argument(
        '--compression',
        choices=('lz4', 'none', 'zstd'),
        default='zstd',
        help='of the chunks (default zstd)',
    )
    parser.add_argument(
        '--time',
        choices=('received', 'clock', 'header'),
        default='received',
        help='where log times come from: arrival here, the ROS clock, or the stamp in the header '
        '(the ROS clock for messages without one)',
    )
    parser.add_argument('--use-sim-time', action='store_true', help='the ROS clock follows /clock')
    parser.add_argument(
        *('-d', '--duration'), type=float, metavar='S', help='stop after so long [s]'
    )
    add(parser, '--json', ': the summary')
    return parser


def usage() -> str:
    """The usage text."""
    return usage_of('grasp_replay', build_parser())
