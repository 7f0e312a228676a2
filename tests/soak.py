# SPDX-License-Identifier: Apache-2.0
"""`make soak`: the long form of the checks that `make test` runs short; the table goes to docs/.

10^6 mutations, ten-minute runs, 200 seeds: hours on two cores. `soak.py serial scan` runs only
those and keeps the rows of the others. The figures that they print stand below the table.
"""

import re
import sys
import time
from pathlib import Path

from benchmarks.run import markdown, shown

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / 'docs' / 'soak.md'
BRIDGE = 'ros2_ws/src/barrett_hand_bridge/test'
PYTEST = ('-m', 'pytest', '--timeout', '14400', '-q')
CHECKS: dict[str, tuple[str, tuple[str, ...]]] = {
    'marked': ('tests marked soak', (*PYTEST, '-m', 'soak')),
    'codecs': (
        '10^6 mutations of every hand protocol',
        (*PYTEST, f'{BRIDGE}/test_fuzz.py'),
    ),
    'serial': (
        'ten minutes of BH8-262 cycles at the fastest rate',
        ('tests/benchmarks/hand.py', '--seconds', '600', 'serial'),
    ),
    'can': (
        'ten minutes of BH8-280 cycles',
        ('tests/benchmarks/hand.py', '--seconds', '600', 'can'),
    ),
    'force': (
        'recovered force over 200 hands',
        ('tests/benchmarks/hand.py', '--seeds', '200', 'force'),
    ),
    'live': (
        'five 60 s latency runs, ten minutes of replay through the deformation node',
        (
            'tests/benchmarks/live_node.py',
            *('--seconds', '60', '--runs', '5', '--replay-seconds', '600'),
        ),
    ),
    'messages': (
        '10^5 generated messages over every topic of every node; every odd parameter',
        (*PYTEST, 'tests/test_message_campaign.py'),
    ),
    'kills': (
        'kill -9 and SIGHUP of every node at 200 random moments',
        (*PYTEST, 'tests/test_kill_campaign.py'),
    ),
    'suite': (
        'the whole suite for 30 minutes with one busy core',
        ('tests/endurance.py', '--minutes', '30'),
    ),
    'scan': ('10^6 mutations of scan files', ('tests/benchmarks/scan.py', 'damage', '--long')),
    'bags': (
        '10^6 mutations, a 1 GB bag, 20 equal reports, 10 live runs',
        ('tests/benchmarks/bags.py', '--long'),
    ),
}


def kept() -> tuple[dict[str, str], dict[str, str]]:
    """Rows of the table and printed figures of earlier runs, by the name of the check."""
    text = TABLE.read_text() if TABLE.exists() else ''
    rows = {row[1]: row[0] for row in re.finditer(r'^\| `(\w+)` \|.*$', text, re.MULTILINE)}
    sections = re.findall(r'^## (\w+)\n\n(.*?)(?=\n+## |\n*\Z)', text, re.MULTILINE | re.DOTALL)
    return rows, dict(sections)


def main() -> int:
    """Run the wanted checks and write their rows and figures; 1 if one failed."""
    wanted = sys.argv[1:] or list(CHECKS)
    unknown = sorted(set(wanted) - set(CHECKS))
    if unknown:
        print(f'no check {", ".join(unknown)}; there are {", ".join(CHECKS)}')
        return 2
    failed = False
    for name in wanted:
        title, arguments = CHECKS[name]
        print(f'== {name}: {title}', flush=True)
        start = time.monotonic()
        code, printed = shown(arguments, SOAK='1')
        failed |= code != 0
        result = 'passed' if code == 0 else f'failed ({code})'
        seconds = time.monotonic() - start
        rows, figures = kept()
        rows[name] = f'| `{name}` | {title} | {seconds:.0f} | {result} |'
        figures[name] = markdown(printed)
        names = [check for check in CHECKS if check in rows]
        TABLE.write_text(
            '# Long checks\n\n`make soak` runs them; a row is of the last run of its check.\n\n'
            '| check | what | seconds | result |\n|---|---|---:|---|\n'
            + ''.join(f'{rows[check]}\n' for check in names)
            + ''.join(f'\n## {check}\n\n{figures[check]}\n' for check in names)
        )
    print(f'table in {TABLE}')
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
