# SPDX-License-Identifier: Apache-2.0
"""Runs a command that ends with the process that started it, and removes a folder then.

`python -m grasp_view.with_parent FOLDER COMMAND ...`: the command gets what comes by stdin, and
when that ends, however its writer died, it is asked to end and then made to. A signal to this
process does the same, and where this process is killed the kernel ends the command. A command
that somebody stopped (SIGSTOP) is ended, so that whoever started it can start it anew.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence

from grasp_common.watchdog import end_with_parent, is_stopped, wake_with_parent

PATIENCE_S = 5.0
LOOK_S = 0.2


def start(folder: str, command: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start `command` so that it ends, and `folder` goes, with this process."""
    return subprocess.Popen(
        [sys.executable, '-m', 'grasp_view.with_parent', folder, *command],
        stdin=subprocess.PIPE,
        preexec_fn=wake_with_parent,
        start_new_session=True,
    )


def stop(process: subprocess.Popen[bytes]) -> None:
    """End what `start` started, also where somebody has stopped it."""
    process.send_signal(signal.SIGCONT)
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(2.0 * PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def main(arguments: Sequence[str]) -> int:
    """Wait for the command or for the end of stdin; returns the exit code of the command."""
    folder, *command = arguments
    process = subprocess.Popen(
        command, bufsize=0, stdin=subprocess.PIPE, preexec_fn=end_with_parent
    )
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: process.terminate())
    threading.Thread(target=_hand_on, args=(process,), daemon=True).start()
    try:
        return _code_of(process)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _code_of(process: subprocess.Popen[bytes]) -> int:
    """Wait for its end; a process that is stopped does not go on by itself."""
    while True:
        try:
            return process.wait(LOOK_S)
        except subprocess.TimeoutExpired:
            if is_stopped(process.pid):
                process.kill()


def _hand_on(process: subprocess.Popen[bytes]) -> None:
    """Give the command what comes by stdin; end it when that ends."""
    assert process.stdin is not None
    # Not through sys.stdin: its lock, held by this thread, would break the end of the interpreter.
    while data := os.read(0, 4096):
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(data)
    process.terminate()
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
