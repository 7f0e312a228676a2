# SPDX-License-Identifier: Apache-2.0
"""Processes of a test by the kernel's own tables: who descends from whom, and what each holds."""

from __future__ import annotations

import os
from pathlib import Path


def descendants(pid: int) -> list[int]:
    """Living processes below one, children before grandchildren."""
    found = []
    tasks = Path(f'/proc/{pid}/task')
    for task in tasks.iterdir() if tasks.exists() else ():
        try:
            found += [int(child) for child in (task / 'children').read_text().split()]
        except OSError:
            continue
    return [*found, *(below for child in found for below in descendants(child))]


def living(pid: int) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
    except OSError:
        return False


def resident_mb(pid: int) -> float:
    """Memory of a process and all below it in MB."""
    total = 0
    for one in (pid, *descendants(pid)):
        try:
            total += int(Path(f'/proc/{one}/statm').read_text().split()[1])
        except OSError:
            continue
    return total * os.sysconf('SC_PAGE_SIZE') / 1e6
