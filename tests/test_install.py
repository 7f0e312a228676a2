# SPDX-License-Identifier: Apache-2.0
"""requirements/install.sh, which every environment here comes from."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_the_kernels_can_be_compiled_before_any_of_our_packages_is_installed():
    script = (ROOT / 'requirements/install.sh').read_text()
    path, module = re.search(r'^PYTHONPATH=(\S+) .* -m (\S+) &$', script, re.MULTILINE).groups()
    # -S: nothing that is installed, so not numba either.
    run = subprocess.run(
        [sys.executable, '-S', '-m', module],
        cwd=ROOT,
        env={'PYTHONPATH': path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert 'There is no numba' in run.stderr
