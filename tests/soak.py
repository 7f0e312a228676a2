"""`make soak`: the long form of the checks that `make test` runs short; the table goes to docs/.

10^6 mutations, ten-minute runs, 200 seeds: hours on two cores. `soak.py hand scan` runs only
those.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / 'docs' / 'soak.md'
BRIDGE = 'ros2_ws/src/barrett_hand_bridge/test'
PYTEST = ('-m', 'pytest', '--timeout', '14400', '-q')
CHECKS: dict[str, tuple[str, tuple[str, ...]]] = {
    'marked': ('tests marked soak', (*PYTEST, '-m', 'soak')),
    'codecs': (
        '10^6 mutations of every hand protocol, 200 seeds of recovered force',
        (*PYTEST, f'{BRIDGE}/test_fuzz.py', f'{BRIDGE}/test_force_chain.py'),
    ),
    'hand': (
        'ten-minute cycles of both hands, 200 seeds',
        ('tests/benchmarks/hand.py', '--seconds', '600', '--seeds', '200'),
    ),
    'scan': ('10^6 mutations of scan files', ('tests/benchmarks/scan.py', '--long')),
    'bags': ('10^5 mutations, a 1 GB bag', ('tests/benchmarks/bags.py', '--long')),
}


def main() -> int:
    """Run the wanted checks and write their table; 1 if one failed."""
    wanted = sys.argv[1:] or list(CHECKS)
    unknown = sorted(set(wanted) - set(CHECKS))
    if unknown:
        print(f'no check {", ".join(unknown)}; there are {", ".join(CHECKS)}')
        return 2
    lines = ['# Long checks', '', '| check | seconds | result |', '|---|---:|---|']
    failed = False
    for name in wanted:
        title, arguments = CHECKS[name]
        print(f'== {name}: {title}', flush=True)
        start = time.monotonic()
        done = subprocess.run(
            [sys.executable, *arguments], cwd=ROOT, env={**os.environ, 'SOAK': '1'}, check=False
        )
        failed |= done.returncode != 0
        result = 'passed' if done.returncode == 0 else f'failed ({done.returncode})'
        lines.append(f'| {title} | {time.monotonic() - start:.0f} | {result} |')
        TABLE.write_text('\n'.join([*lines, '']))
    print(f'table in {TABLE}')
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
