# SPDX-License-Identifier: Apache-2.0
"""Where the executables under test are: of a colcon install, else beside this interpreter."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def executable(name: str) -> str:
    """The path of an executable; that of a built workspace comes first, as `ros2 run` has it."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        for found in Path(prefix).glob(f'lib/*/{name}') if prefix else ():
            return str(found)
    return str(Path(sys.executable).parent / name)
