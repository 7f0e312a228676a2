# SPDX-License-Identifier: Apache-2.0
"""What shell_solve does with the grips of an object: twist, bend, pull, or turn all of them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_common.terminal import fixed, significant
from shell_deform.commands.console import CommandError
from shell_deform.contact.friction_share import FrictionShare, friction_share
from shell_deform.contact.loads import ContactPatch
from shell_deform.model import ShellModel
from shell_deform.readout import TORN_STRAIN, principal, read_out
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, forced, gripped
from shell_deform.supports.grips import arc_motion, line_of, turned_together
from shell_deform.surface.frames import lateral_vectors

Array = NDArray[np.float64]

WAYS = ('twist', 'bend', 'pull', 'turn')


@dataclass(frozen=True)
class GripSweep:
    """Poses of the grips of a model, one after the other.

    Attributes:
        model: what is held. way: one of `WAYS`. values: how far [rad], `pull` [m].
        moved: which grip moves; the others stay, but for `turn`. line: (3,) from what else holds
            to it. about: (3,) axis of the turn, or the line along which it pulls. axial: force [N]
            along the line on the grip that moves, or None. contacts: what else touches, with what
            `push` [N].
    """

    model: ShellModel
    way: str
    values: tuple[float, ...]
    moved: int
    line: Array
    about: Array
    axial: float | None = None
    contacts: tuple[ContactPatch, ...] = ()
    push: float = 0.0

    @property
    def length(self) -> float:
        """Length [m] of what bends, from what else holds to the grip that moves."""
        grips = self.model.grips
        others = [grip.origin for k, grip in enumerate(grips) if k != self.moved]
        start = np.mean(others, axis=0) if others else self.model.rest.mean(axis=0)
        return float((grips[self.moved].origin - start) @ self.line)

    def case(self, value: float) -> LoadCase:
        """The load case at one of the values."""
        grips = self.model.grips
        motion = np.zeros((len(grips), 6))
        if self.way == 'turn':
            motion = turned_together(grips, grips[self.moved].origin, value * self.about)
        elif self.way == 'bend':
            motion[self.moved] = arc_motion(self.line, self.about, self.length, value)
        elif self.way == 'twist':
            motion[self.moved, 3:] = value * self.about
        else:
            motion[self.moved, :3] = value * self.about
        force = np.zeros((len(grips), 3))
        if self.axial is not None:
            force[self.moved] = self.axial * self.line
        if not self.contacts:
            return gripped(motion, force)
        pushed = forced(self.contacts, [self.push] * len(self.contacts))
        return replace(pushed, grip_motion=motion, grip_force=force)

    def said(self, value: float) -> str:
        """The value in words."""
        if self.way == 'pull':
            return f'a pull of {value:g} m'
        return f'a {self.way} of {np.degrees(value):g} degrees'

    def refuse_torn(self, state: Equilibrium, value: float) -> None:
        """Raise CommandError where the wall is stretched beyond `TORN_STRAIN`."""
        faces = read_out(self.model, state.unknowns)
        strain = max(float(principal(e).max()) for e in (faces.outer_strain, faces.inner_strain))
        if strain > TORN_STRAIN:
            raise CommandError(
                f'the grips tear the object apart: at {self.said(value)} its wall is stretched by '
                f'{100 * strain:.0f} %'
            )

    def point(self, value: float, state: Equilibrium) -> dict[str, Any]:
        """What the grips do at a state, for the JSON document."""
        key = 'pull_m' if self.way == 'pull' else f'{self.way}_rad'
        share = self.friction_share(state)
        slip = (
            {}
            if share is None
            else {
                'slip': {
                    'torque_nm': share.torque,
                    'capacity_nm': share.capacity,
                    'share': share.share,
                    'warning': share.slips,
                }
            }
        )
        told = zip(self.model.grips, state.grip_pose, state.grip_wrench, strict=True)
        return {
            key: value,
            'grips': [
                {
                    'name': grip.name,
                    'about_m': (grip.origin + pose[:3]).tolist(),
                    'shift_m': pose[:3].tolist(),
                    'turn_rad': pose[3:].tolist(),
                    'force_n': wrench[:3].tolist(),
                    'torque_nm': wrench[3:].tolist(),
                }
                for grip, pose, wrench in told
            ],
            **slip,
        }

    def friction_share(self, state: Equilibrium) -> FrictionShare | None:
        """Friction of the contacts about the axis of the turn; None where nothing rubs."""
        friction = [c.body.friction for c in self.contacts if c.body is not None]
        if self.way == 'pull' or not any(friction):
            return None
        origin = self.model.grips[self.moved].origin
        return friction_share(state.touches, friction, origin, self.about)

    def slip_warning(self, results: Sequence[tuple[float, Equilibrium]]) -> str | None:
        """A sentence where what touches is about to slip, from the first pose where it is."""
        for value, state in results:
            share = self.friction_share(state)
            if share is not None and share.slips:
                return (
                    f'the contacts are about to slip from {self.said(value)} on: they give '
                    f'{share.torque:.3g} of the {share.capacity:.3g} N m that friction allows'
                )
        return None

    def row(self, value: float, state: Equilibrium, largest: tuple[float, float]) -> list[str]:
        """Cells of `headings`; `largest` force [N] and torque [N m] of the table."""
        wrench, pose = state.grip_wrench[self.moved], state.grip_pose[self.moved]
        about = self.line if self.way == 'pull' else self.about
        return [
            fixed(1e3 * value if self.way == 'pull' else float(np.degrees(value)), 3),
            significant(float(wrench[3:] @ about), 5, largest[1]),
            significant(float(wrench[:3] @ self.line), 5, largest[0]),
            fixed(1e3 * float(pose[:3] @ self.line), 4),
        ]

    @property
    def headings(self) -> tuple[str, ...]:
        """Of the columns of `row`."""
        first = 'pull [mm]' if self.way == 'pull' else f'{self.way} [degrees]'
        return first, 'torque [N m]', 'axial force [N]', 'axial shift [mm]'


def grip_sweep(
    options: argparse.Namespace, name: str, model: ShellModel, contacts: tuple[ContactPatch, ...]
) -> GripSweep | None:
    """What the options ask of the grips of the object `name`; None where they ask nothing.

    Raises CommandError for an object without grips, or options that do not go together.
    """
    way = next((way for way in WAYS if getattr(options, way) is not None), None)
    if way is None:
        if options.axial is not None or options.grip is not None or options.about is not None:
            raise CommandError('--axial, --grip and --about go with --twist, --bend or --pull')
        return None
    grips = model.grips
    if not grips:
        raise CommandError(
            f'{name}: nothing holds it; add a contact {{kind: grip, where: …}} to the object file'
        )
    names = [grip.name for grip in grips]
    if options.grip is not None and options.grip not in names:
        known = ', '.join(names)
        raise CommandError(f'{name} has no grip {options.grip!r}; its grips are {known}')
    if options.displacement_sweep is not None or len(options.force or [0.0]) != 1:
        raise CommandError('beside grips that move give one --force for the contacts, or none')
    moved = len(grips) - 1 if options.grip is None else names.index(options.grip)
    values = np.array(getattr(options, way))
    line = line_of(grips, moved, model.rest.mean(axis=0))
    about = line
    if options.about is not None:
        about = np.array(options.about)
    elif way == 'bend':
        about = lateral_vectors(line)[0]
    free = grips[moved].free
    if way == 'pull' and np.any(np.abs(free @ about) > 1e-9):
        raise CommandError(
            f'{name}: grip {names[moved]} is free along the line in which it is pulled; prescribe '
            'the force there with --axial, or do not free it'
        )
    if way == 'bend' and abs(about @ line) > 1e-9:
        about = about - (about @ line) * line
        if not np.linalg.norm(about) > 1e-6:
            raise CommandError('--about lies along the line that is to bend; give one across it')
        about = about / np.linalg.norm(about)
    return GripSweep(
        model,
        way,
        tuple((values if way == 'pull' else np.radians(values)).tolist()),
        moved,
        line,
        about,
        options.axial,
        contacts if options.force else (),
        options.force[0] if options.force else 0.0,
    )
