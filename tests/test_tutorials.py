# SPDX-License-Identifier: Apache-2.0
"""The tutorials are run as they are written, each in an empty folder beside the recordings."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TUTORIALS = sorted((ROOT / 'docs' / 'tutorials').glob('*.md'))
BLOCK = re.compile(r'^```(python|sh)\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def test_there_are_three() -> None:
    assert len(TUTORIALS) == 3


@pytest.mark.parametrize('page', TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs_as_written(page: Path, tmp_path: Path, domain_id: int) -> None:
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']])
    environment = {**os.environ, 'PATH': path, 'MPLBACKEND': 'Agg'}
    # Blocks of one language that follow each other are one script, as a reader runs them.
    blocks = groupby(BLOCK.findall(page.read_text()), key=itemgetter(0))
    for number, (language, parts) in enumerate(blocks):
        text = '\n'.join(part for _, part in parts)
        program = [sys.executable, '-c'] if language == 'python' else ['sh', '-e', '-c']
        with (tmp_path / f'log_{number}').open('w+') as log:
            done = subprocess.run(
                [*program, text],
                cwd=tmp_path,
                env=environment,
                stdout=log,
                stderr=log,
                check=False,
            )
            log.seek(0)
            assert done.returncode == 0, f'{text}\n{log.read()}'
