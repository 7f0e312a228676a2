# SPDX-License-Identifier: Apache-2.0
"""The project's pictures again: `make pictures`, or `python -m docs.make_pictures squeeze force`.

squeeze: the ball between two fingers, nonlinear beside linear, from our own solver (GIF).
force: force over displacement of each theory beside the published rows.
report, view, what_if: screenshots of the report, of the live page while the recorded ball is
replayed (light, dark, on a tablet, on a phone), and of fingers placed by hand; they need a
Chromium, the first two the recording.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

from docs.make_pictures import BAG, PICTURES, ROOT
from docs.make_pictures.screenshots import draw_report, draw_view, draw_what_if
from docs.make_pictures.squeeze import draw_force, draw_squeeze
from tests.chromium import installed

DRAWERS = {
    'squeeze': draw_squeeze,
    'force': draw_force,
    'report': draw_report,
    'view': draw_view,
    'what_if': draw_what_if,
}
NEED_BROWSER = ('report', 'view', 'what_if')
NEED_RECORDING = ('report', 'view')


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw all pictures, or those named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('names', nargs='*', metavar='NAME', help=', '.join(DRAWERS))
    chosen = parser.parse_args(arguments).names or list(DRAWERS)
    unknown = sorted(set(chosen) - set(DRAWERS))
    if unknown:
        parser.error(f'no picture {", ".join(unknown)}; there are {", ".join(DRAWERS)}')
    # Ending by SIGTERM must end the started nodes too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in chosen:
        missing = [
            what
            for what, needed in (
                ('a chromium', name in NEED_BROWSER and not installed()),
                (f'bags/{BAG.name}', name in NEED_RECORDING and not BAG.is_dir()),
            )
            if needed
        ]
        if missing:
            print(f'{name}: left out, it needs {" and ".join(missing)}')
            continue
        for path in DRAWERS[name]():
            print(f'{path.relative_to(ROOT)}: {path.stat().st_size / 1e3:.0f} kB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
