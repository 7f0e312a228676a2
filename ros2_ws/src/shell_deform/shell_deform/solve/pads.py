# SPDX-License-Identifier: Apache-2.0
"""What rigid pads add to the tangent and to the state of a shell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shell_deform.contact.pad_contact import PadField, Press, add_point_blocks
from shell_deform.model import Tangent
from shell_deform.solve.equilibrium import Equilibrium


def pressed_tangent(tangent: Tangent, pads: PadField, press: Press) -> Tangent:
    """The shell's tangent with the pads' part."""
    data = tangent.stiffness.data.copy()
    add_point_blocks(pads.shell, press.stiffness, data)
    return replace(
        tangent,
        gradient=tangent.gradient + press.gradient.reshape(-1),
        stiffness=pads.shell.pattern.matrix(data),
        pad_rows=press.rows,
        pad_corner=press.corner,
    )


def pressed_state(state: Equilibrium, pads: PadField, press: Press) -> Equilibrium:
    """The state with the pads' forces, depths and nodal loads."""
    force, depth = state.force.copy(), state.displacement.copy()
    force[pads.contacts] = press.force[pads.contacts]
    depth[pads.contacts] = press.depth[pads.contacts]
    load = -press.gradient.reshape(-1)
    pressed = tuple(int(np.count_nonzero(row)) for row in press.pressure)
    return replace(state, force=force, displacement=depth, pad_load=load, pressed_points=pressed)
