# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the `deformation` node: name, default, range, and what it means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from grasp_common import parameter_table
from grasp_common.parameter_table import Parameter, ParameterError
from shell_deform.live.pose import PoseError, pose_of
from shell_deform.theory import AUTO, DEFAULT_THEORY, THEORY_NAMES, is_linear

if TYPE_CHECKING:
    from shell_deform.live.tick.estimator import Settings
    from shell_deform.live.tick.grasp import GraspTask

# This table is a usage text, too: what needs the solver is imported where it is used.
DRIVES = ('force', 'motion', 'fused')
NONLINEAR = (*(name for name in THEORY_NAMES if not is_linear(name)), AUTO)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter('object', 'tennis_ball', 'name of a shipped object, or an object file'),
    Parameter(
        'theory',
        DEFAULT_THEORY,
        'strain measure of the nonlinear answer; auto: thick where koiter is off by more than 2 %',
        choices=NONLINEAR,
    ),
    Parameter('control_vertices', 0, "control vertices; 0: the object file's own", 0, 20000),
    Parameter(
        'background_niceness',
        10,
        'niceness of the background process; above 0 it works in the idle class where it can',
        0,
        19,
    ),
    Parameter(
        'object_pose',
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        'object in the frame of the contacts: x y z (m) qx qy qz qw; the topic object_pose wins',
    ),
    Parameter(
        'placement',
        'given',
        'given: pose from topic or parameter; first_touch: fitted to the contacts',
        choices=('given', 'first_touch'),
    ),
    Parameter(
        'pose_from',
        'fingers',
        'whence a given pose is known: fingers: it follows from their points, and is off as they '
        'are (sigma_point); elsewhere: a camera, say, and it is exact',
        choices=('fingers', 'elsewhere'),
    ),
    Parameter(
        'drive',
        'fused',
        'what drives the surface: force, motion (travel of the contacts), or both by their sigmas',
        choices=DRIVES,
    ),
    Parameter('pin_radius', 0.002, 'radius of contacts that come without one (m)', 1e-4, 0.05),
    Parameter('gauge_drift', 0.1, 'sigma of the zero drift of a force (N)', 0.0, 10.0),
    Parameter('gauge_quantum', 0.0, 'one count of the gauge (N), if sigma_n leaves it out', 0, 10),
    Parameter('tendon_compliance', 0.0, 'stretch of the tendons at the contact (m/N)', 0.0, 0.01),
    Parameter('tendon_sigma', 0.3, 'relative sigma of tendon_compliance (-)', 0.0, 2.0),
    Parameter('mounting_sigma', 5e-5, 'pin mounting and moment of touch, sigma (m)', 0.0, 0.01),
    Parameter('slip_sigma', 1e-4, 'lateral slip of a held contact, sigma (m)', 1e-7, 0.01),
    Parameter('travel_sigma', 2e-5, 'sigma of travel that comes without one (m)', 1e-7, 0.01),
    Parameter('object_shift_sigma', 5e-3, 'shift of the object in the hand, sigma (m)', 1e-6, 0.1),
    Parameter('outside_force_sigma', 0.3, 'forces beside the fingers, weight (N)', 1e-3, 100.0),
    Parameter('modulus_sigma', 0.05, "relative sigma of Young's modulus (-)", 0.0, 1.0),
    Parameter('model_sigma', 0.03, 'relative stiffness bias of shell theory (-)', 0.0, 1.0),
    Parameter(
        'estimate_modulus',
        True,
        "learn Young's modulus from force and travel of a squeeze: deformation/modulus (Pa) and "
        'deformation/modulus_sigma (Pa); the served surface keeps the modulus of the object file',
    ),
    Parameter('stale_periods', 3.0, 'silence that is STALE (sample periods)', 1.0, 100.0),
    Parameter('stale_floor', 0.02, 'but no shorter than this (s)', 0.0, 10.0),
    Parameter(
        'follow_contacts',
        True,
        'grade the mesh anew where fingers rest and it is too coarse; the answer then has other '
        'vertices, and deformation/mesh comes again',
    ),
    Parameter(
        'wait_for_take_up',
        0.0,
        'longest wait of a sample for the equilibrium of its contacts (s); 0: none; for lockstep',
        0.0,
        600.0,
    ),
    Parameter(
        'finger_body',
        '',
        'rigid body that the fingers carry: a name (barrett_fingertip), a file, or NUMBER: BODY, '
        'NUMBER: BODY; empty: pins',
    ),
    Parameter(
        'pins_slide',
        False,
        'whether fingers without a finger_body do not rub, so that what they press slides freely '
        'sideways under them; false: it is held there',
    ),
    Parameter(
        'load_shape',
        'body',
        'where fingers with a finger_body press: body: where contact with it says; cells: where '
        'hand/tactile measures, without friction',
        choices=('body', 'cells'),
    ),
    Parameter(
        'path_step',
        2e-4,
        'way of a finger with a body between two load cases; none is overtaken (m)',
        1e-6,
        0.01,
    ),
    Parameter('friction', 0.5, 'coefficient of friction at the fingers, an input (-)', 0.0, 10.0),
    Parameter('friction_sigma', 0.1, 'sigma of friction (-)', 0.0, 10.0),
    Parameter('normal_sigma', 0.02, 'sigma of the deformed normals (rad)', 0.0, 1.0),
    Parameter('mass', 0.0, 'mass of the object that the grasp is to lift (kg)', 0.0, 1000.0),
    Parameter('strain_limit', 0.2, 'largest strain that the wall is to bear (-)', 1e-4, 10.0),
    Parameter(
        'gravity', [0.0, 0.0, -1.0], 'direction of its weight in the frame of the contacts (-)'
    ),
    Parameter('marker_rate', 2.0, 'highest rate of deformation/marker (Hz), 0: never', 0.0, 10.0),
    Parameter('frame', '', 'frame of the answers; empty: that of the contacts'),
)


# Zero has a meaning of its own; from there to these values nothing works.
ZERO_OR_FROM = {'control_vertices': 12, 'marker_rate': 0.01}


def validate(values: Mapping[str, Any]) -> None:
    """Raise ParameterError unless every value, by name, can be used."""
    parameter_table.check_known(PARAMETERS, values)
    for name, lowest in ZERO_OR_FROM.items():
        if 0 < values.get(name, 0) < lowest:
            raise ParameterError(f'{name} is {values[name]}; it must be 0 or at least {lowest:g}')
    if 'object' in values:
        from shell_deform.objects import ObjectError, load_object

        try:
            load_object(values['object'])
        except (ObjectError, OSError) as error:
            raise ParameterError(f'object: {error}') from error
    if values.get('finger_body'):
        from shell_deform.contact.finger_bodies import read_finger_bodies
        from shell_deform.objects import ObjectError

        try:
            bodies = read_finger_bodies(str(values['finger_body'])).loaded()
        except (ObjectError, OSError) as error:
            raise ParameterError(f'finger_body: {error}') from error
        without = [body.name for body in bodies.values() if not len(body.cells)]
        if values.get('load_shape') == 'cells' and without:
            raise ParameterError(
                f'load_shape is cells, but {without[0]} has no touch cells; take load_shape body, '
                'or give its cells_m'
            )
        if values.get('pins_slide') and values.get('load_shape') != 'cells':
            raise ParameterError(
                'pins_slide is for fingers that carry nothing; a finger_body slides by its '
                'friction: take friction 0'
            )
    elif values.get('load_shape') == 'cells' and 'finger_body' in values:
        raise ParameterError('load_shape is cells: finger_body must name a body with touch cells')
    if 'gravity' in values:
        grasp_task({**{p.name: p.default for p in PARAMETERS}, **values})
    if 'object_pose' in values:
        try:
            pose_of(list(values['object_pose']))
        except PoseError as error:
            raise ParameterError(f'object_pose: {error}') from error


def settings(values: Mapping[str, Any]) -> Settings:
    """Settings of the tick from parameter values."""
    from shell_deform.live.tick.estimator import Settings
    from shell_deform.live.tick.fusion import ErrorModel

    return Settings(
        errors=ErrorModel(
            drive=str(values['drive']),
            drift=float(values['gauge_drift']),
            quantum=float(values['gauge_quantum']),
            tendon=float(values['tendon_compliance']),
            tendon_relative=float(values['tendon_sigma']),
            mounting=float(values['mounting_sigma']),
            slip=float(values['slip_sigma']),
            rigid=float(values['object_shift_sigma']),
            outside=float(values['outside_force_sigma']),
            modulus=float(values['modulus_sigma']),
            model=float(values['model_sigma']),
            default_travel=float(values['travel_sigma']),
        ),
        default_radius=float(values['pin_radius']),
        pose_from_fingers=values['pose_from'] == 'fingers',
    )


def grasp_task(values: Mapping[str, Any]) -> GraspTask:
    """What the grasp is for, from parameter values; raises ParameterError."""
    from shell_deform.live.tick.grasp import GraspTask

    down = [float(one) for one in values['gravity']]
    size = math.hypot(*down) if len(down) == 3 else 0.0
    if not (math.isfinite(size) and size > 0.0):
        raise ParameterError(f'gravity is {down}; a direction of three numbers is needed')
    return GraspTask(
        float(values['friction']),
        float(values['friction_sigma']),
        float(values['normal_sigma']),
        float(values['mass']),
        (down[0] / size, down[1] / size, down[2] / size),
        float(values['strain_limit']),
    )


def usage() -> str:
    """What `deformation --help` prints: every parameter with its unit, range and default."""
    return parameter_table.usage(
        'deformation',
        'The deformed surface for every sample of hand/contacts. With --standby alone it loads '
        'everything, builds the shell that a line on stdin names (JSON: {"object": ..., '
        '"theory": ...}), and begins with the arguments that another line brings (a JSON list).',
        PARAMETERS,
    )
