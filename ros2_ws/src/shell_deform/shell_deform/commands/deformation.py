# SPDX-License-Identifier: Apache-2.0
"""`deformation`: the live node as a command."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from shell_deform.live.background.worker_link import WorkerProcess


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if {'-h', '--help'} & set(given):
        from shell_deform.node import parameters

        print(parameters.usage())
        return 0
    # Both processes need a second for their imports: the background process starts first, and
    # hears what to build once the node knows.
    ahead = WorkerProcess()
    try:
        from shell_deform.node import deformation_node

        return deformation_node.run(given, ahead)
    finally:
        ahead.stop(0.0)


if __name__ == '__main__':
    sys.exit(main())
