# SPDX-License-Identifier: Apache-2.0
"""The command line of `replay`: rosbag2's options, and a few that it lacks."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from grasp_common.command_line import parse, usage_of
from grasp_common.options import add
from grasp_replay.errors import BagError
from grasp_replay.lockstep import LockstepRule, parse_rule
from grasp_replay.qos import QosProfile, read_overrides
from grasp_replay.replay_core import Choice, check_rate, parse_remap
from grasp_replay.topic_selection import TopicSelection, absolute


@dataclass(frozen=True)
class ReplayOptions:
    """How a bag is replayed; times in s, `clock` in Hz (None: no clock)."""

    bag: Path
    choice: Choice = field(default_factory=Choice)
    rate: float = 1.0
    loop: bool = False
    delay: float = 0.0
    start_paused: bool = False
    clock: float | None = None
    qos_overrides: dict[str, QosProfile] = field(default_factory=dict)
    wait: float = 5.0
    wait_for: tuple[str, ...] = ()
    late_after: float = 0.005
    acknowledge_seconds: float = 2.0
    lockstep: tuple[LockstepRule, ...] = ()
    lockstep_timeout: float = 10.0
    json: bool = False


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < 1e9:
        raise argparse.ArgumentTypeError(f'{text} is no number of seconds >= 0')
    return value


def build_parser() -> argparse.ArgumentParser:
    """The command line of `replay`."""
    parser = argparse.ArgumentParser(
        prog='replay',
        description='Send a recorded bag to its topics: stored bytes, undecoded, in order.',
        epilog='services: ~/pause ~/resume ~/toggle_paused ~/step ~/stop (std_srvs/Trigger); '
        'parameters, also while it runs: rate (bag seconds per second), position_s (s from the '
        'start of the bag: setting it goes on from there)',
    )
    own = parser.add_argument
    own('bag', type=Path, help='bag directory, .mcap or .db3 file')
    own(
        '-r',
        '--rate',
        type=float,
        default=1.0,
        metavar='FACTOR',
        help='bag seconds per second (default 1)',
    )
    own('--topics', nargs='+', default=[], metavar='TOPIC', help='only these')
    add(parser, '--regex', ', and no others', short=('-e',))
    add(parser, '--exclude-topics', default=[])
    add(parser, '--exclude-regex', short=('-x',))
    own(
        *('-m', '--remap'), nargs='+', default=[], metavar='OLD:=NEW',
        help='publish a topic by another name',
    )  # fmt: skip
    own('-l', '--loop', action='store_true', help='begin again at the end')
    own('-d', '--delay', type=_seconds, default=0.0, metavar='S', help='wait before the start [s]')
    own('--start-offset', type=_seconds, default=0.0, metavar='S', help='where to begin [s]')
    own('--playback-duration', type=_seconds, metavar='S', help='how much to play [s]')
    own('--playback-until-sec', type=_seconds, metavar='S', help='where to stop [s]')
    own('-p', '--start-paused', action='store_true', help='wait for ~/resume')
    own(
        '--clock',
        nargs='?',
        type=float,
        const=40.0,
        metavar='HZ',
        help='publish /clock before each message and at this rate between [Hz] (default 40)',
    )
    own('--qos-profile-overrides-path', type=Path, metavar='FILE', help='YAML, as for rosbag2')
    own(
        '--wait',
        type=_seconds,
        default=5.0,
        metavar='S',
        help='wait at most so long for subscribers of all topics [s] (default 5)',
    )
    own('--wait-for', nargs='+', default=[], metavar='TOPIC', help='only these must have one')
    own(
        '--late-after',
        type=_seconds,
        default=0.005,
        metavar='S',
        help='late from here on [s] (default 0.005)',
    )
    own(
        '--wait-for-all-acked',
        type=_seconds,
        default=2000.0,
        metavar='MS',
        help='at the end, wait so long until all was received [ms] (default 2000)',
    )
    own(
        '--lockstep',
        nargs='+',
        default=[],
        metavar='INPUT:=ANSWER[,ANSWER]',
        help='unpaced: after each message on INPUT wait until each ANSWER came with its stamp',
    )
    own(
        '--lockstep-timeout', type=_seconds, default=10.0, metavar='S',
        help='longest wait for an answer [s] (default 10)',
    )  # fmt: skip
    add(parser, '--json', ': the summary')
    return parser


def parse_options(arguments: Sequence[str]) -> ReplayOptions:
    """The options of a command line without ROS arguments; ends the program on wrong ones."""
    parser = build_parser()
    given = parse('grasp_replay', parser, arguments)
    everything = not (given.topics or given.regex)
    try:
        selection = TopicSelection(
            tuple(given.topics),
            everything,
            given.regex,
            tuple(given.exclude_topics),
            given.exclude_regex,
        )
        if given.clock is not None and not 0.0 < given.clock <= 1e4:
            raise BagError(f'--clock {given.clock} Hz is not in (0, 10000]')
        overrides = given.qos_profile_overrides_path
        return ReplayOptions(
            bag=given.bag,
            choice=Choice(
                selection,
                parse_remap(given.remap),
                given.start_offset,
                given.playback_duration,
                given.playback_until_sec,
            ),
            rate=check_rate(given.rate),
            loop=given.loop,
            delay=given.delay,
            start_paused=given.start_paused,
            clock=given.clock,
            qos_overrides={} if overrides is None else read_overrides(overrides),
            wait=given.wait,
            wait_for=tuple(map(absolute, given.wait_for)),
            late_after=given.late_after,
            acknowledge_seconds=given.wait_for_all_acked * 1e-3,
            lockstep=tuple(map(parse_rule, given.lockstep)),
            lockstep_timeout=given.lockstep_timeout,
            json=given.json,
        )
    except re.error as error:
        parser.error(f'{error.pattern!r} is no regular expression: {error}')
    except BagError as error:
        parser.error(str(error))


def usage() -> str:
    """The usage text."""
    return usage_of('grasp_replay', build_parser())
