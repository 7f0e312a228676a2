# SPDX-License-Identifier: Apache-2.0
"""How the fingers move and when is scanned: the programmes of the recordings.

Every programme begins with the tare and a scan of the undeformed object.
"""

from __future__ import annotations

from collections.abc import Callable

from bags import solid_ball
from bags.session import Session
from bags.settings import HOLD_LAPSE

TIME_LAPSE = 60.0
HELD_N = 16.0


def begin(session: Session) -> None:
    """Tare and scan the undeformed object."""
    session.hold(1.4)
    session.scan('undeformed')


def hold_and_scan(
    session: Session, force_n: float, before_s: float, after_s: float, **facts: object
) -> None:
    """Hold a force and scan within: so many seconds before and after the scan."""
    with session.held(force_n, **facts):
        session.hold(before_s)
        session.scan('held')
        session.hold(after_s)


def release(session: Session, seconds: float, rest_s: float = 0.5) -> None:
    """Let go within `seconds` and rest."""
    session.move_to(0.0, seconds)
    session.hold(rest_s)


def published_loads(object_name: str, first_s: float) -> Callable[[Session], None]:
    """The published forces of an object, each held for 3 s; the first is reached in `first_s`."""

    def programme(session: Session) -> None:
        begin(session)
        session.hold(0.2)
        for number, row in enumerate(solid_ball.published_rows(object_name)):
            session.move_to(row['force_n'], 2.0 if number else first_s)
            hold_and_scan(session, row['force_n'], 1.5, 1.5, published_row=row['row'])
        release(session, 3.0)

    return programme


def loads(*forces: float) -> Callable[[Session], None]:
    """Every force, each held for 2 s."""

    def programme(session: Session) -> None:
        begin(session)
        session.hold(0.2)
        for force in forces:
            session.move_to(force, 3.0)
            hold_and_scan(session, force, 1.0, 1.0)
        release(session, 3.0)

    return programme


def fast_squeezes(session: Session) -> None:
    """Squeezes and releases from one second down to a tenth, with short holds between."""
    begin(session)
    for seconds in (1.0, 0.5, 0.25, 0.15, 0.1):
        session.move_to(16.0, seconds)
        with session.held(16.0):
            session.hold(0.5)
        release(session, seconds, 0.7)
    session.scan('undeformed')
    session.hold(0.3)


def slide_and_regrasp(session: Session) -> None:
    """Squeeze, let the ball slip 12 degrees under the pins, let go, grasp it turned by 30."""
    begin(session)
    session.move_to(12.0, 3.0)
    hold_and_scan(session, 12.0, 0.8, 0.7)
    session.slide((0.0, 1.0, 0.0), 12.0, 2.0)
    hold_and_scan(session, 12.0, 0.8, 0.7, after='a slip of 12 degrees about y')
    release(session, 2.0)
    session.slide((0.0, 0.0, 1.0), 30.0, 1.0)
    session.hold(0.5)
    session.move_to(17.0, 3.0)
    hold_and_scan(session, 17.0, 0.8, 0.7, after='a turn of 30 degrees about z while free')
    release(session, 2.5, 0.3)


def drift(session: Session) -> None:
    """Five squeezes in what the gauges take for half an hour; free for a while between them."""
    begin(session)
    session.stage.time_lapse = TIME_LAPSE
    force = solid_ball.published_rows('tennis_ball')[0]['force_n']
    for number in range(5):
        session.move_to(force, 1.0)
        with session.held(force):
            session.hold(3.0)
            if number == 4:
                session.scan('held')
        release(session, 1.0, 1.0)


def long_hold(session: Session) -> None:
    """Squeeze, then hold the travel for ten minutes of the rubber and of the gauges."""
    begin(session)
    session.stage.time_lapse = HOLD_LAPSE
    session.move_to(HELD_N, 1.0)
    with session.held(HELD_N, relaxes=True):
        session.hold(36.0)
        session.scan('held')


def saturation(session: Session) -> None:
    """Past the end of the gauges and back: 255 counts, then a force that can be trusted again."""
    begin(session)
    session.move_to(16.0, 3.0)
    with session.held(16.0):
        session.hold(1.5)
    session.move_to(31.0, 3.0)
    hold_and_scan(session, 31.0, 1.0, 1.0, gauge='at its end')
    session.move_to(16.0, 2.0)
    with session.held(16.0, after='saturation'):
        session.hold(1.5)
    release(session, 2.5)
