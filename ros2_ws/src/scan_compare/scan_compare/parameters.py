# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the `scan_compare` node: name, default, range, and what it means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasp_common import parameter_table
from grasp_common.parameter_table import Parameter, ParameterError
from scan_compare.rigid import Pose, rotation_from_quaternion
from scan_compare.units import METRES_PER_UNIT

# This table is a usage text, too: what needs the solver is imported where it is used.
FARTHEST_M = 10.0
"""As far as an object and a scanner may be from their frames, as for the live node."""

SCANNER_SIGMA_M = 0.127e-3
"""As the registration has it."""

IDENTITY_NUMBERS = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


PARAMETERS: tuple[Parameter, ...] = (
    Parameter('object', 'tennis_ball', 'name of a shipped object, or an object file'),
    Parameter(
        'object_pose',
        IDENTITY_NUMBERS,
        'object in the frame of the contacts: x y z (m) qx qy qz qw; start for scans in '
        'object_frame',
    ),
    Parameter('object_frame', 'object', 'frame id of scans that are given in the object frame'),
    Parameter(
        'scan_start',
        'auto',
        'where registration starts: auto (same frame as the surface: there; object_frame: '
        'object_pose; any other: search), given (scan_pose) or search (all rotations)',
        choices=('auto', 'given', 'search'),
    ),
    Parameter(
        'scan_pose',
        IDENTITY_NUMBERS,
        'scanner in the frame of the contacts, for scan_start given: x y z (m) qx qy qz qw',
    ),
    Parameter(
        'scanner_sigma', SCANNER_SIGMA_M, 'noise of a scan point along the normal (m)', 1e-6, 0.01
    ),
    Parameter('outlier_distance', 0.0, 'points further away are no part of the object (m); 0: a '
              'quarter of its extent', 0.0, 1.0),
    Parameter('surface_tolerance', 0.5, 'a surface further from the scan is noted (s)', 0.0, 1e6),
    Parameter('surface_wait', 1.0, 'longest wait for a surface of the scan (s)', 0.0, 60.0),
    Parameter(
        'waiting_memory', 250.0, 'scans that wait to be compared may take this much (MB, 24 bytes '
        'a point); beyond it the one that has waited longest is dropped', 0.0, 1e6,
    ),
    Parameter('history', 30.0, 'surfaces of this many seconds are kept (s)', 0.0, 3600.0),
    Parameter('scan_file', '', 'scan file that scan/compare reads when no scan has arrived'),
    Parameter(
        'scan_unit', 'm', 'unit of scan/points', choices=tuple(METRES_PER_UNIT)
    ),
    Parameter('undeformed_scan_file', '', 'scan of the undeformed object; empty: the last scan '
              'taken while the model was undeformed'),
    Parameter('report_directory', '', 'write a report of each comparison here; empty: none'),
)  # fmt: skip


def validate(values: Mapping[str, Any]) -> None:
    """Raise ParameterError unless every value, by name, can be used."""
    parameter_table.check_known(PARAMETERS, values)
    for name in ('object_pose', 'scan_pose'):
        if name in values:
            pose(name, values[name])
    if 'object' in values:
        from shell_deform.objects import ObjectError, load_object

        try:
            load_object(values['object'])
        except (ObjectError, OSError) as error:
            raise ParameterError(f'object: {error}') from error


def pose(name: str, numbers: Any) -> Pose:
    """Return the pose of seven numbers x y z qx qy qz qw; raises ParameterError."""
    values = np.asarray(list(numbers), float)
    if values.shape != (7,) or not np.all(np.isfinite(values)):
        raise ParameterError(f'{name} is {list(numbers)}; it needs x y z (m) qx qy qz qw')
    if np.abs(values[:3]).max() > FARTHEST_M:
        raise ParameterError(
            f'{name} is {values[:3].tolist()} m away; within {FARTHEST_M:g} m is allowed'
        )
    length = float(np.linalg.norm(values[3:]))
    if not 0.99 < length < 1.01:
        raise ParameterError(f'{name} has a quaternion of length {length:.4g}; it must be 1')
    return Pose(rotation_from_quaternion(values[3:]), values[:3])


def usage() -> str:
    """What `scan_compare --help` prints: every parameter with its unit, range and default."""
    return parameter_table.usage(
        'scan_compare', 'The deformed surface against every scan on scan/points.', PARAMETERS
    )
