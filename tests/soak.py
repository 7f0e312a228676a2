"""`make soak`: the long form of the checks that `make test` runs short; the table goes to docs/.

Tests marked `soak` read GRASP_SOAK=1 and run their full figures: 10^6 mutations, ten-minute runs,
200 seeds. They are left out of `make test`.
"""

import os
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / 'docs' / 'soak.md'


def main() -> int:
    """Run the long checks and write their table."""
    report = ROOT / 'out' / 'soak.xml'
    report.parent.mkdir(exist_ok=True)
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-m', 'soak', '--timeout', '7200', '--junitxml', report],
        cwd=ROOT,
        env={**os.environ, 'GRASP_SOAK': '1'},
        check=False,
    )
    lines = ['# Long checks', '', '| check | seconds | result |', '|---|---:|---|']
    for case in ElementTree.parse(report).iter('testcase'):
        result = 'failed' if case.find('failure') is not None else 'passed'
        if case.find('skipped') is not None:
            result = 'skipped'
        name = case.get('name', '').removeprefix('test_').replace('_', ' ')
        lines.append(f'| {name} | {float(case.get("time", 0)):.0f} | {result} |')
    lines += ['', f'{time.monotonic() - start:.0f} s in all.', '']
    TABLE.write_text('\n'.join(lines))
    print(f'table in {TABLE}')
    return done.returncode


if __name__ == '__main__':
    sys.exit(main())
