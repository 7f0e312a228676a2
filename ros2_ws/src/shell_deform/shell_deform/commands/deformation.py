# SPDX-License-Identifier: Apache-2.0
"""`deformation`: the live node as a command."""

from __future__ import annotations

import json
import select
import signal
import sys
from collections.abc import Sequence

from grasp_common.watchdog import is_stopped
from shell_deform.live.background.worker_link import LOOKED_AFTER_S, WorkerProcess

STANDBY = '--standby'
"""Alone: load everything, and begin with the arguments that a line on stdin brings (JSON)."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if {'-h', '--help'} & set(given):
        from shell_deform.node import parameters

        print(parameters.usage())
        return 0
    standing_by = given == [STANDBY]
    # Both processes need a second for their imports: the background process starts first, and
    # hears what to build once the node knows.
    ahead = WorkerProcess()
    try:
        from shell_deform.node import deformation_node

        if standing_by:
            line = _told(ahead)
            if not line:
                return 0
            given = json.loads(line)
        return deformation_node.run(given, ahead)
    finally:
        ahead.stop(0.0)


def _told(ahead: WorkerProcess) -> str:
    """A line from stdin; '' where whoever needs this one has ended, or `ahead` is of no use."""
    # Nothing is open meanwhile: a signal may end it as it stands.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    while not select.select([sys.stdin], [], [], LOOKED_AFTER_S)[0]:
        if not ahead.alive or is_stopped(ahead.process.pid):
            return ''
    line = sys.stdin.readline()
    signal.signal(signal.SIGINT, before)
    return line


if __name__ == '__main__':
    sys.exit(main())
