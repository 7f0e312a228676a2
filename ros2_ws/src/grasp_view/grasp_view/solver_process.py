# SPDX-License-Identifier: Apache-2.0
"""A `deformation` process of the page's own, with everything loaded before it is needed."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from grasp_common.watchdog import is_stopped

from . import with_parent


class WhatIfError(RuntimeError):
    """The what-if solver cannot run; the text names what is missing."""


def executable(package: str, name: str) -> str:
    """An executable of the workspace: beside this interpreter, of a colcon install, on PATH.

    Raises WhatIfError if it is nowhere.
    """
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    folders = [str(Path(sys.executable).parent)]
    folders += [str(Path(prefix) / 'lib' / package) for prefix in prefixes if prefix]
    found = shutil.which(name, path=os.pathsep.join(folders)) or shutil.which(name)
    if found is None:
        raise WhatIfError(f'what_if needs the executable {name} of package {package}')
    return found


class SolverProcess:
    """Stands by once it is made, begins when it is told how, and is ended once.

    `folder` is there for what it shall read, and goes with it.
    """

    def __init__(self) -> None:
        """Start it; raises WhatIfError where there is no such executable."""
        command = [executable('shell_deform', 'deformation'), '--standby']
        self.folder = Path(tempfile.mkdtemp(prefix='what_if_'))
        self._process = with_parent.start(str(self.folder), command)

    @property
    def alive(self) -> bool:
        """Whether it runs: it has not ended, and nobody has stopped it."""
        return self._process.poll() is None and not is_stopped(self._process.pid)

    def prepare(self, object_file: Path, theory: str) -> None:
        """Let it build a shell while it stands by."""
        self._say({'object': str(object_file), 'theory': theory})

    def begin(self, arguments: Sequence[str]) -> None:
        """Let it serve with these arguments."""
        self._say(list(arguments))

    def _say(self, what: object) -> None:
        """One line of JSON; one that has died is found dead later."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(what).encode() + b'\n')
            self._process.stdin.flush()

    def drop(self) -> None:
        """End one that is of no use any more, at once."""
        self._process.kill()
        self.end()

    def end(self) -> None:
        """Ask it to end, and see that it does."""
        with_parent.stop(self._process)
        shutil.rmtree(self.folder, ignore_errors=True)
