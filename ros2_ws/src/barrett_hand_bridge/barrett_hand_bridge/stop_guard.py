# SPDX-License-Identifier: Apache-2.0
"""A small process that stops the hand when the bridge dies without being able to do so itself.

It waits on a pipe from the bridge. A word of farewell means that all is well; an end without it
means that the bridge was killed, and the guard then stops the motors: Ctrl-C on the serial line
(whose open port it inherits), all motors idle on the CAN bus (which it opens only then). A guard
that dies itself, or no longer answers, is replaced by whoever asks for it (`watch`).
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence

from grasp_common.watchdog import Watchdog, wake_with_parent

FAREWELL = b'done'
CALL = b'.'
STOP_SERIAL = b'\x03'


class StopGuard:
    """The guard of one connection."""

    def __init__(self, arguments: list[str], inherited: tuple[int, ...] = ()) -> None:
        """Start it; `inherited` file descriptors stay open in it."""
        self._arguments = arguments
        self._inherited = inherited
        self._begin()

    def _begin(self) -> None:
        self._process = self._started()
        self._answered = 0
        self._watchdog = Watchdog(self._process.pid)

    def _started(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, '-m', 'barrett_hand_bridge.stop_guard', *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=self._inherited,
            preexec_fn=wake_with_parent,
            start_new_session=True,
        )

    def watch(self) -> bool:
        """Call it; start another one if it is gone or hangs. Returns whether that was so."""
        if self._process.poll() is None and self._answers():
            return False
        self._process.kill()
        self._process.wait()
        self._let_go()
        self._begin()
        return True

    def _answers(self) -> bool:
        """Whether it answers, or would if it found a processor; calls it again."""
        assert self._process.stdin is not None and self._process.stdout is not None
        if select.select([self._process.stdout], [], [], 0.0)[0]:
            self._answered += len(os.read(self._process.stdout.fileno(), 64))
        self._watchdog.look(self._answered, time.monotonic())
        try:
            os.write(self._process.stdin.fileno(), CALL)
        except OSError:
            return False
        return not self._watchdog.hopeless

    def _let_go(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()

    def dismiss(self) -> None:
        """The bridge has stopped the hand itself: the guard leaves without a word."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(FAREWELL)
            self._process.stdin.close()
            self._process.wait(5.0)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        finally:
            self._let_go()


def guard_serial(descriptor: int) -> StopGuard:
    """Guard a hand on an open serial port."""
    return StopGuard(['serial', str(descriptor)], (descriptor,))


def guard_can(
    interface: str, channel: str, port: int, nodes: Sequence[int] = (11, 12, 13, 14)
) -> StopGuard:
    """Guard a hand on a CAN bus, by the nodes of its four motors."""
    return StopGuard(['can', interface, channel, str(port), *map(str, nodes)])


def main(arguments: list[str]) -> int:
    """Wait for the end of the bridge; returns the exit code."""
    heard = b''
    while said := os.read(sys.stdin.fileno(), 64):
        heard = (heard + said)[-len(FAREWELL) :]
        with contextlib.suppress(OSError):
            os.write(sys.stdout.fileno(), CALL)
    if heard == FAREWELL:
        return 0
    if arguments[0] == 'serial':
        # A line whose other end is gone too has no hand to stop.
        with contextlib.suppress(OSError):
            os.write(int(arguments[1]), STOP_SERIAL)
        return 0
    from barrett_hand_bridge.puck.bus import open_bus
    from barrett_hand_bridge.puck.driver import CanHand
    from barrett_hand_bridge.puck.frames import HandAddresses

    _, interface, channel, port, *nodes = arguments
    first, second, third, spread = map(int, nodes)
    CanHand.stop_all(
        open_bus(interface, channel, int(port)), HandAddresses((first, second, third, spread))
    )
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
