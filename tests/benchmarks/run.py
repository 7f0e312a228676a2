# SPDX-License-Identifier: Apache-2.0
"""`make bench`: every benchmark table, one after the other; `run.py solver live` only those.

Each benchmark is a module of this folder that prints a Markdown table of figures and goals; it
runs as a process of its own, so that none heats the caches of another. What they print is
docs/benchmarks.md, each part under its command, the date and the load of the machine; a part that
was not run again is kept.
"""

import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parents[1] / 'docs' / 'benchmarks.md'
HEADING = """# Benchmarks

What `make bench` printed, part by part. `python tests/benchmarks/run.py NAME` renews one part.
Walls and latencies of a machine with a load above its cores mean little; processor times hold.
"""


def names() -> list[str]:
    """The benchmarks there are."""
    return sorted({path.stem for path in FOLDER.glob('*.py')} - {'run', 'figures'})


def shown(arguments: Sequence[str | Path], **environment: str) -> tuple[int, list[str]]:
    """Run a Python program; returns its exit code and its lines, which are shown as they come."""
    with subprocess.Popen(
        [sys.executable, *arguments],
        cwd=FOLDER.parents[1],
        env={**os.environ, **environment, 'PYTHONUNBUFFERED': '1'},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        printed = []
        for line in process.stdout:
            print(line, end='', flush=True)
            printed.append(line.rstrip())
    return process.returncode, printed


def markdown(printed: Iterable[str]) -> str:
    """Printed lines as Markdown: tables as they are, anything else as it was printed."""
    blocks = [
        '\n'.join(lines if table else ['```', *lines, '```'])
        for table, lines in groupby(printed, lambda line: line.startswith('|'))
    ]
    return '\n\n'.join(blocks)


def run(name: str) -> tuple[int, str]:
    """Run one benchmark; returns its exit code and its part of the page."""
    load = os.getloadavg()[0]
    code, printed = shown([FOLDER / f'{name}.py'])
    machine = (
        f'`python tests/benchmarks/{name}.py`, {time.strftime("%Y-%m-%d", time.gmtime())}, '
        f'{os.cpu_count()} cores, load {load:.1f} before, Python {platform.python_version()}'
    )
    if code:
        machine += f'; ended with exit code {code}'
    return code, '\n\n'.join([f'## {name}', machine, markdown(printed)])


def parts(text: str) -> dict[str, str]:
    """The parts of a page by the names of their benchmarks."""
    found = re.split(r'^(?=## )', text, flags=re.MULTILINE)[1:]
    return {part.split('\n', 1)[0].removeprefix('## '): part.rstrip() for part in found}


def main() -> int:
    """Run the wanted benchmarks and renew their parts of the page; 1 if one of them failed."""
    wanted = sys.argv[1:] or names()
    unknown = sorted(set(wanted) - set(names()))
    if unknown:
        print(f'no benchmark {", ".join(unknown)}; there are {", ".join(names())}')
        return 2
    failed = []
    for name in wanted:
        print(f'== {name}', flush=True)
        code, part = run(name)
        if code:
            failed.append(name)
        kept = parts(PAGE.read_text()) if PAGE.is_file() else {}
        kept[name] = part
        PAGE.write_text(
            '\n\n'.join([HEADING.rstrip(), *(kept[key] for key in sorted(kept))]) + '\n'
        )
    print(f'figures in {PAGE}')
    if failed:
        print(f'failed: {", ".join(failed)}')
    return int(bool(failed))


if __name__ == '__main__':
    sys.exit(main())
