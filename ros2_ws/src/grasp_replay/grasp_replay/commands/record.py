"""`record`: the node as a command."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `record`; returns the exit code."""
    # Nothing is open while this imports for a second: the signal may end it as it stands.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from grasp_replay import record_node

    return record_node.main(arguments)


if __name__ == '__main__':
    sys.exit(main())
