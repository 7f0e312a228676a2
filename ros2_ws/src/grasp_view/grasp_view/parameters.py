# SPDX-License-Identifier: Apache-2.0
"""Every parameter of `grasp_view`: name, default, range, and what it means."""

from __future__ import annotations

from grasp_common import parameter_table
from grasp_common.parameter_table import Parameter

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        'host',
        '127.0.0.1',
        'address to serve on; 0.0.0.0 lets a tablet in, and everybody else on that network',
        settable='start',
    ),
    Parameter('port', 8080, 'TCP port of the page', 1024, 65535, settable='start'),
    Parameter('rate', 20.0, 'pictures sent to the browsers (Hz)', 1.0, 60.0, settable='start'),
    Parameter(
        'history', 60.0, 'kept for the time slider and the plots (s)', 5.0, 600.0, settable='start'
    ),
    Parameter(
        'hand_frame',
        'hand_base',
        "frame id of the hand; every other counts as the object's",
    ),
    Parameter(
        'object_pose',
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        'object in the hand frame until object_pose comes by topic: x y z (m) qx qy qz qw',
    ),
    Parameter(
        'replay_node', 'replay', 'name of the replay node that the page steers', settable='start'
    ),
    Parameter(
        'what_if',
        False,
        'no hand: place fingers in the page, solved by a deformation process of its own',
        settable='start',
    ),
    Parameter(
        'object',
        'tennis_ball',
        'object of what_if at start: name or object file',
        settable='start',
    ),
)


def usage() -> str:
    """What `grasp_view --help` prints: every parameter with its unit, range and default."""
    return parameter_table.usage(
        'grasp_view', 'A live page of a grasp in the browser.', PARAMETERS
    )
