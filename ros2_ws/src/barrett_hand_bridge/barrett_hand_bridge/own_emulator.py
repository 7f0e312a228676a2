# SPDX-License-Identifier: Apache-2.0
"""The emulated hand that the bridge starts for itself (backend `emulator`), as a process."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from pathlib import Path

from barrett_hand_bridge.calibration import NO_GAUGE, HandCalibration
from barrett_hand_bridge.fit import fit_hand, read_weighings
from barrett_hand_bridge.hand import FINGERS, HandError
from grasp_common.watchdog import is_stopped, wake_with_parent

START_TIMEOUT_S = 20.0


class OwnEmulator:
    """A `hand_emulator` process, ended with the node, and the calibration of its gauges.

    Where it has ended, or somebody stopped it, another one takes its place at the next connection:
    a hand that was switched off and on.
    """

    def __init__(self, object_file: str, seed: int) -> None:
        """Start it and fit a calibration to known weights hung on its gauges.

        Raises:
            HandError: it does not start.
        """
        self._object_file, self._seed = object_file, seed
        self._begin()

    def now(self) -> str:
        """The port to open now; raises HandError if no emulated hand starts."""
        if self._process.poll() is not None or is_stopped(self._process.pid):
            self._process.kill()
            self.stop()
            self._begin()
        return self.port

    def look_after(self) -> None:
        """End a process that somebody stopped: the line is lost, and another one starts."""
        if is_stopped(self._process.pid):
            self._process.kill()

    def _begin(self) -> None:
        # Memory that both see as a file, without a name: whoever is killed leaves nothing behind.
        table = os.memfd_create('weighings')
        try:
            self._start(table)
        finally:
            os.close(table)

    def _start(self, table: int) -> None:
        weighings = Path(f'/proc/self/fd/{table}')
        command = [
            sys.executable,
            '-m',
            'barrett_hand_bridge.commands.hand_emulator',
            '--json',
            '--until-eof',
        ]
        command += ['--seed', str(self._seed), '--weigh', str(weighings)]
        if self._object_file:
            command += ['--squeezed', self._object_file]
        self._process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.PIPE,
            pass_fds=(table,),
            preexec_fn=wake_with_parent,
            start_new_session=True,
        )
        try:
            self.port = self._read_port()
            fits = fit_hand(read_weighings(weighings), kind='cubic', degree=3, zero='difference')
        except (ValueError, HandError) as error:
            self.stop()
            raise HandError(f'the emulated hand did not start: {error}') from error
        self.calibration = HandCalibration(
            'BH8-262',
            str(self._seed),
            {finger: fits[finger].gauge if finger in fits else NO_GAUGE for finger in FINGERS},
            'weights hung on the emulated hand',
        )

    def _read_port(self) -> str:
        assert self._process.stdout is not None and self._process.stderr is not None
        deadline = time.monotonic() + START_TIMEOUT_S
        line = b''
        while not line.endswith(b'\n'):
            left = deadline - time.monotonic()
            ready, _, _ = select.select([self._process.stdout], [], [], max(left, 0.0))
            fresh = os.read(self._process.stdout.fileno(), 4096) if ready else b''
            if not fresh:
                self._process.kill()
                complaint = self._process.stderr.read().decode(errors='replace').strip()
                raise HandError(complaint or 'it said nothing')
            line += fresh
        return str(json.loads(line)['port'])

    def stop(self) -> None:
        """End the process."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()
