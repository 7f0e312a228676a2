# SPDX-License-Identifier: Apache-2.0
"""The end of processes that a recording, a picture or a benchmark has started."""

from __future__ import annotations

import signal
import subprocess


def end_process(process: subprocess.Popen[bytes], seconds: float = 20.0) -> None:
    """Interrupt a process, and kill it where it has not ended after so many seconds."""
    if process.poll() is not None:
        return
    process.send_signal(signal.SIGINT)
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
