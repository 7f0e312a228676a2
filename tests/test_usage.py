# SPDX-License-Identifier: Apache-2.0
"""Usage texts: quick, and what they repeat without loading a solver is what the solver has."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ('numba', 'scipy', 'rclpy', 'matplotlib', 'trimesh', 'viser', 'rosbags')
# The others need what they show, as the faults of the emulator; `test_options.py` has their time.
LIGHT = {
    'barrett_hand_bridge.programs': ('hand_bridge', 'hand_calibrate'),
    'shell_deform.commands.programs': (
        *(
            'deformation',
            'shell_solve',
            'shell_objects',
            'shell_identify',
            'object_prepare',
            'shell_verify',
        ),
    ),
    'scan_compare.programs': ('scan_compare', 'scan_error'),
    'grasp_replay.programs': ('grasp_report', 'record'),
    'grasp_view.programs': ('grasp_view',),
}
ALL = [(module, name) for module, names in LIGHT.items() for name in names]


@pytest.mark.parametrize(('module', 'name'), ALL, ids=[name for _, name in ALL])
def test_a_usage_text_loads_no_solver_and_no_ros(module: str, name: str) -> None:
    code = (
        f'import sys; from {module} import {name} as run\n'
        f"try: run(['--help'])\nexcept SystemExit: pass\n"
        f'loaded = [one for one in {HEAVY} if one in sys.modules]\n'
        'sys.exit(f"loads {loaded}" if loaded else 0)'
    )
    asked = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=False
    )
    assert asked.returncode == 0, asked.stderr
    assert asked.stdout.startswith('usage: ') and '--version' in asked.stdout


def test_what_is_said_twice_is_the_same() -> None:
    from grasp_replay import record_options
    from grasp_replay.bag_writer import COMPRESSIONS
    from scan_compare import parameters
    from scan_compare.registration import SCANNER_SIGMA
    from shell_deform.commands import arguments
    from shell_deform.live.tick.fusion import DRIVES
    from shell_deform.node import parameters as node_parameters
    from shell_deform.objects.shell_object import DEFAULT_CONTACT_RADIUS_M

    assert parameters.SCANNER_SIGMA_M == SCANNER_SIGMA
    assert arguments.DEFAULT_CONTACT_RADIUS_M == DEFAULT_CONTACT_RADIUS_M
    assert node_parameters.DRIVES == DRIVES
    (compression,) = (a for a in record_options.build_parser()._actions if a.dest == 'compression')
    assert list(compression.choices or ()) == sorted(COMPRESSIONS)
