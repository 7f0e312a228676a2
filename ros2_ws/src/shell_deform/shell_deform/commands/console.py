# SPDX-License-Identifier: Apache-2.0
"""What every command does alike: one clear sentence on failure, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

from grasp_common.terminal import complain


class CommandError(Exception):
    """The job cannot be done; the message is the sentence the user reads."""


def run(program: str, job: Callable[[], None]) -> int:
    """Exit code of `job`: 0 when done, 1 with one sentence on stderr when it failed."""
    try:
        job()
    except (CommandError, ValueError, OSError) as error:
        complain(program, error)
        return 1
    return 0


def print_json(document: Any) -> None:
    """One JSON document on stdout."""
    json.dump(document, sys.stdout, ensure_ascii=True, allow_nan=False)
    sys.stdout.write('\n')
