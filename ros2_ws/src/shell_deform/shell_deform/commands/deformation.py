# SPDX-License-Identifier: Apache-2.0
"""`deformation`: the live node as a command."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from collections.abc import Sequence

from grasp_common.watchdog import is_stopped
from shell_deform.live.background.worker_link import LOOKED_AFTER_S, Build, WorkerProcess

STANDBY = '--standby'
"""Alone: load everything, and do what lines of JSON on stdin say; see `StandBy`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if {'-h', '--help'} & set(given):
        from shell_deform.node import parameters

        print(parameters.usage())
        return 0
    # Both processes need a second for their imports: the background process starts first, and
    # hears what to build once the node knows.
    standing_by = StandBy()
    try:
        from shell_deform.node import deformation_node

        if given == [STANDBY]:
            told = standing_by.wait()
            if told is None:
                return 0
            given = told
        return deformation_node.run(given, standing_by.ahead)
    finally:
        standing_by.ahead.stop(0.0)


class StandBy:
    """A background process that was started ahead, and what stdin says before a node needs it.

    A line with a mapping of `object` and `theory` has that shell built meanwhile, the last one
    that came; a line with a list are the arguments to begin with.
    """

    def __init__(self, stdin: int = 0) -> None:
        self.ahead = WorkerProcess()
        self._stdin = stdin
        self._heard = b''

    def wait(self) -> list[str] | None:
        """The arguments to begin with; None where whoever would give them has ended."""
        # Nothing is open meanwhile: a signal may end it as it stands.
        before = signal.signal(signal.SIGINT, signal.SIG_DFL)
        while line := self._line():
            said = json.loads(line)
            if isinstance(said, list):
                signal.signal(signal.SIGINT, before)
                return said
            if self.ahead.build is not None:
                self._renew()
            self.ahead.start(Build(said['object'], said['theory']))
        return None

    def _line(self) -> bytes:
        """The next line; empty at the end of stdin, or where `ahead` is of no use."""
        while b'\n' not in self._heard:
            while not select.select([self._stdin], [], [], LOOKED_AFTER_S)[0]:
                if self.ahead.build is not None and not self.ahead.alive:
                    # The shell could not be built: whoever needs it will be told why.
                    self._renew()
                if not self.ahead.alive or is_stopped(self.ahead.process.pid):
                    return b''
            # Not through sys.stdin: it may hold a second line, of which select knows nothing.
            if not (data := os.read(self._stdin, 65536)):
                return b''
            self._heard += data
        line, _, self._heard = self._heard.partition(b'\n')
        return line

    def _renew(self) -> None:
        self.ahead.stop(0.0)
        self.ahead = WorkerProcess()


if __name__ == '__main__':
    sys.exit(main())
