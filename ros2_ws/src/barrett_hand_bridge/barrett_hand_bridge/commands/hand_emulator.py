# SPDX-License-Identifier: Apache-2.0
"""A BarrettHand that is not there: a BH8-262 on a pty, or a BH8-280 on a CAN channel."""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from barrett_hand_bridge.emulator.can_hand import CELLS, CanHand
from barrett_hand_bridge.emulator.faults import FAULTS, Fault, FaultError, parse_fault
from barrett_hand_bridge.emulator.mechanics import SCALE_262, SCALE_280, HandBody, HandMechanics
from barrett_hand_bridge.emulator.pty_port import PtyPort
from barrett_hand_bridge.emulator.serial_hand import SerialHand
from barrett_hand_bridge.emulator.squeeze import SqueezeError, read_squeezed
from barrett_hand_bridge.emulator.weighing import weighing_table
from barrett_hand_bridge.options import add_hand
from grasp_common.command_line import parse
from grasp_common.options import add
from grasp_common.terminal import complain

if TYPE_CHECKING:
    from barrett_hand_bridge.emulator.can_port import CanPort, SlcanPort


def _firmware(text: str) -> tuple[int, int, int]:
    match = re.fullmatch(r'(\d{1,2})\.(\d{1,2})\.(\d{1,2})', text)
    if match is None:
        raise argparse.ArgumentTypeError(f'{text!r} is no version such as 4.3.1')
    return int(match.group(1)), int(match.group(2)), int(match.group(3))


def _press(text: str) -> tuple[int, int, float]:
    match = re.fullmatch(r'([1-4]):(\d{1,2}):(\d+(?:\.\d+)?)', text)
    if match is None or int(match.group(2)) >= CELLS:
        raise argparse.ArgumentTypeError(
            f'{text!r} is not FINGER:CELL:PRESSURE with a finger 1 to 4 and a cell 0 to 23'
        )
    return int(match.group(1)), int(match.group(2)), float(match.group(3))


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} is no whole number from 0 on')
    return int(text)


def _fault(text: str) -> Fault:
    try:
        return parse_fault(text)
    except FaultError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _add_can(command: argparse.ArgumentParser) -> None:
    """Options of a hand on CAN."""
    command.add_argument(
        '--interface',
        default='udp_multicast',
        metavar='NAME',
        help='python-can interface; slcan: a pty (280)',
    )
    command.add_argument(
        '--channel', default='239.74.163.2', metavar='NAME', help='python-can channel (280)'
    )
    command.add_argument(
        '--can-port', type=int, default=43113, metavar='PORT', help='UDP port (280)'
    )
    command.add_argument(
        '--puck-firmware',
        type=int,
        default=190,
        metavar='NUMBER',
        help='firmware of the motor controllers (280)',
    )
    command.add_argument(
        '--first-node',
        type=int,
        choices=range(1, 29),
        metavar='1..28',
        default=11,
        help='node of finger 1; fingers 2, 3 and the spread follow (280)',
    )
    command.add_argument(
        '--press',
        type=_press,
        action='append',
        default=[],
        metavar='FINGER:CELL:PRESSURE',
        help='pressure in N/cm2 on a touch cell, 0 to 23; finger 4 is the palm (280)',
    )


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    faults = '; '.join(f'{name}: {text}' for name, text in FAULTS.items())
    command = argparse.ArgumentParser(prog='hand_emulator', description=__doc__)
    add_hand(command)
    command.add_argument(
        '--squeezed',
        type=Path,
        metavar='FILE',
        help='forces of what it squeezes over displacement (YAML, CSV, or JSON of shell_solve; '
        'default: nothing)',
    )
    add(command, '--seed', ' of every gauge (default 1)', type=_seed, default=1)
    command.add_argument(
        '--link', type=Path, metavar='PATH', help='name that keeps pointing to the pty (262)'
    )
    command.add_argument(
        '--unpaced', action='store_true', help='bytes take no time instead of 10 bits each (262)'
    )
    command.add_argument(
        '--firmware',
        type=_firmware,
        default='4.4.0',
        metavar='VERSION',
        help='firmware version (262), e.g. 4.3.1',
    )
    _add_can(command)
    command.add_argument(
        '--fault',
        type=_fault,
        action='append',
        default=[],
        metavar='KIND@WHEN[:VALUE]',
        help='a fault that many seconds after start, or at the next SIGUSR1 when WHEN is '
        f'"signal"; kinds: {faults}',
    )
    command.add_argument(
        '--weigh',
        type=Path,
        metavar='FILE',
        help='hang known weights on the gauges, write the table (CSV), then go on',
    )
    command.add_argument(
        '--once', action='store_true', help='leave after --weigh instead of serving'
    )
    command.add_argument(
        '--until-eof', action='store_true', help='leave when stdin ends (its starter is gone)'
    )
    add(command, '--json', ': where the hand is')
    return command


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until SIGINT, SIGTERM or SIGHUP; returns the exit code."""
    options = parse('barrett_hand_bridge', build_parser(), arguments, {'--object': '--squeezed'})
    # Not for a usage text: python-can takes longer to load than all the rest.
    from can import CanError

    try:
        return _serve(options)
    except (SqueezeError, OSError, ValueError, CanError) as error:
        complain('hand_emulator', error)
        return 1


def _serve(options: argparse.Namespace) -> int:
    squeezed = None if options.squeezed is None else read_squeezed(options.squeezed)
    scale = SCALE_262 if options.hand == '262' else SCALE_280
    mechanics = HandMechanics(HandBody(scale=scale), options.seed, squeezed)
    if options.weigh is not None:
        lines = weighing_table(mechanics, options.seed)
        options.weigh.write_text('\n'.join(lines) + '\n', encoding='utf-8')
        if options.once:
            return 0
    port, where = (
        _serial_port(options, mechanics)
        if options.hand == '262'
        else _can_port(options, mechanics)
    )
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: ended.set())
    signal.signal(signal.SIGUSR1, lambda *_: port.faults.strike())
    port.start()
    text = f'BH8-{options.hand} on {where}'
    print(json.dumps({'port': where}) if options.json else text, flush=True)
    if options.until_eof:
        threading.Thread(target=_leave_at_eof, args=(ended,), daemon=True).start()
    ended.wait()
    port.stop()
    return 0


def _serial_port(options: argparse.Namespace, mechanics: HandMechanics) -> tuple[PtyPort, str]:
    port = PtyPort(
        SerialHand(mechanics, firmware=options.firmware, serial_number=options.seed),
        paced=not options.unpaced,
        link=options.link,
        faults=options.fault,
    )
    return port, str(options.link or port.path)


def _can_port(
    options: argparse.Namespace, mechanics: HandMechanics
) -> tuple[CanPort | SlcanPort, str]:
    import can

    from barrett_hand_bridge.emulator.can_port import BusSchedule, CanPort, SlcanPort

    hand = CanHand(mechanics, firmware=options.puck_firmware, first_node=options.first_node)
    hand.pressing = options.press
    if all(fault.kind != 'press' for fault in options.fault):
        hand.press()
    schedule = BusSchedule(hand, paced=not options.unpaced, faults=options.fault)
    if options.interface == 'slcan':
        stick = SlcanPort(schedule)
        return stick, stick.path
    settings: dict[str, object] = {'interface': options.interface, 'channel': options.channel}
    if options.interface == 'udp_multicast':
        settings |= {'port': options.can_port, 'hop_limit': 0}
    return (
        CanPort(schedule, lambda: can.Bus(**settings)),  # type: ignore[arg-type]
        f'{options.interface} {options.channel}',
    )


def _leave_at_eof(ended: threading.Event) -> None:
    # Not through sys.stdin: its lock, held by this thread, would break the end of the interpreter.
    while os.read(sys.stdin.fileno(), 4096):
        continue
    ended.set()


if __name__ == '__main__':
    sys.exit(main())
