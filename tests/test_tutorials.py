# SPDX-License-Identifier: Apache-2.0
"""The tutorials are run as they are written, each in an empty folder beside the recordings."""

from __future__ import annotations

import os
import re
import subprocess
import sys
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
    python: list[str] = []
    for number, (language, text) in enumerate(BLOCK.findall(page.read_text())):
        if language == 'python':
            # Blocks of one page go on where the one before stopped.
            python.append(text)
            command = [sys.executable, '-c', '\n'.join(python)]
        else:
            command = ['sh', '-e', '-c', text]
        with (tmp_path / f'log_{number}').open('w+') as log:
            done = subprocess.run(
                command, cwd=tmp_path, env=environment, stdout=log, stderr=log, check=False
            )
            log.seek(0)
            assert done.returncode == 0, f'{text}\n{log.read()}'
