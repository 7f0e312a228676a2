# SPDX-License-Identifier: Apache-2.0
"""Finding the zeros of a BH8-280, and the proof that it was done since power-up.

A puck that is awake may never have been homed: the bridge before this one may only have woken it.
The proof is a close target (CT) that only our own homing writes; it is lost with the power. Order
and times after the maker's reset strategy: fingers 1, 2, 3 one after the other, three times over
(fingers that start crossed need it), then the spread, 10 s each.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from barrett_hand_bridge.hand import FINGERS, SPREAD, HandError
from barrett_hand_bridge.puck import properties
from barrett_hand_bridge.puck.pucks import MOTORS_ALL, Pucks

ROUNDS = 3
MOTOR_TIMEOUT_S = 10.0
# A motor that has just been told to move may still call itself idle.
STARTING_S = 0.2
POLL_S = 0.02
# The maker's stall times in ms: homing ends by a stall.
STALL_MS = {1: 50, 2: 50, 3: 50, SPREAD: 150}
# Close targets of the maker, and ours: a few counts beside, 0.01 degrees.
UNPROVEN_COUNTS = {1: 195_000, 2: 195_000, 3: 195_000, SPREAD: 35_950}
PROVEN_COUNTS = {1: 195_017, 2: 195_017, 3: 195_017, SPREAD: 35_947}


def homed(pucks: Pucks) -> bool:
    """Whether all motors carry the mark of a homing since they were last switched on."""
    return all(pucks.get(motor, 'CT') == PROVEN_COUNTS[motor] for motor in MOTORS_ALL)


def home(pucks: Pucks, stopped: Callable[[], bool]) -> None:
    """Let all motors find their zero; every error leaves them idle and the hand unproven.

    Raises:
        HandError: a motor does not finish in time, `stopped` says so, or the bus fails.
    """
    try:
        for motor in MOTORS_ALL:
            pucks.set(motor, 'CT', UNPROVEN_COUNTS[motor])
            pucks.set(motor, 'TSTOP', STALL_MS[motor])
        for _ in range(ROUNDS):
            for finger in FINGERS:
                _home_one(pucks, finger, stopped)
        _home_one(pucks, SPREAD, stopped)
        for motor in MOTORS_ALL:
            pucks.set(motor, 'CT', PROVEN_COUNTS[motor])
    except HandError:
        pucks.idle()
        raise


def _home_one(pucks: Pucks, motor: int, stopped: Callable[[], bool]) -> None:
    pucks.set(motor, 'CMD', properties.COMMAND_INITIALISE)
    began = time.monotonic()
    while True:
        # It may be told to stop at any time, also while nothing is to be seen yet.
        if stopped():
            raise HandError('initialisation was stopped')
        passed = time.monotonic() - began
        if passed > STARTING_S and at_rest(pucks, motor):
            return
        if passed > MOTOR_TIMEOUT_S:
            raise HandError(
                f'{pucks.name(motor)} did not finish initialising in {MOTOR_TIMEOUT_S:g} s: all '
                'motors were stopped; free the fingers and call hand/initialize again'
            )
        time.sleep(POLL_S)


def at_rest(pucks: Pucks, motor: int) -> bool:
    """Whether a motor has done what it was told: idle, or holding its position because HOLD is on.

    Position control without HOLD is a finger that still travels.
    """
    mode = pucks.get(motor, 'MODE')
    if mode == properties.MODE_PID:
        return bool(pucks.get(motor, 'HOLD'))
    return mode == properties.MODE_IDLE
