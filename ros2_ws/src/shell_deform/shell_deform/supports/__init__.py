# SPDX-License-Identifier: Apache-2.0
"""What holds a shell: springs at boundary points, rigid grips; motions that nothing prevents."""

from .springs import (
    GRIP_TOLERANCE,
    SupportError,
    SupportRows,
    clamp,
    free_rigid_modes,
    hold_position,
    hold_shear,
    hold_slope,
    isostatic_dofs,
    joined,
    rigid_modes,
    symmetry,
    vertex_parameters,
)

__all__ = [
    'GRIP_TOLERANCE',
    'SupportError',
    'SupportRows',
    'clamp',
    'free_rigid_modes',
    'hold_position',
    'hold_shear',
    'hold_slope',
    'isostatic_dofs',
    'joined',
    'rigid_modes',
    'symmetry',
    'vertex_parameters',
]
