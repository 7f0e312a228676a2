# SPDX-License-Identifier: Apache-2.0
"""Where the executables under test are: of a colcon install, else beside this interpreter."""

from __future__ import annotations

import os
import sys
from pathlib import Path

# The commands of the contract, by package.
EXECUTABLES = {
    'barrett_hand_bridge': ('hand_bridge', 'hand_emulator', 'hand_calibrate'),
    'shell_deform': (
        'deformation',
        'shell_solve',
        'shell_verify',
        'shell_objects',
        'shell_identify',
        'object_prepare',
        'grasp_map',
    ),
    'scan_compare': ('scan_compare', 'scan_error'),
    'grasp_replay': ('replay', 'record', 'grasp_report', 'bag_check'),
    'grasp_view': ('grasp_view',),
}


def executable(name: str) -> str:
    """The path of an executable; that of a built workspace comes first, as `ros2 run` has it."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        for found in Path(prefix).glob(f'lib/*/{name}') if prefix else ():
            return str(found)
    return str(Path(sys.executable).parent / name)
