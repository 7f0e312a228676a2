# SPDX-License-Identifier: Apache-2.0
"""How rigid bodies press on a shell: pressure, friction, force, tangent.

At every contact point of the outer face the pressure is p = max(0, l - e g) with distance g from
the body, stiffness e and multiplier l, and the friction is the return map of t = m + e_t s to the
cone |t| <= mu l, with slip s since the point began to stick and multiplier m. That is the
augmented Lagrangian: multipliers take over what was found until points neither sink in nor creep.
The bound of friction uses the pressure of the pass before (algorithmic symmetrisation): the
tangent is symmetric, its inertia counts stability; at the end both pressures are one. A point
that touches for the first time within a load step sticks from where it was before. Sources: J. C.
Simo and T. A. Laursen, Comput. Struct. 42:97 (1992), doi:10.1016/0045-7949(92)90540-G; T. A.
Laursen and J. C. Simo, Int. J. Numer. Meth. Eng. 36:3451 (1993), doi:10.1002/nme.1620362005.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shell_deform.contact.bodies import Body, Distance, Pose
from shell_deform.contact.depth_of_force import depth_of_force
from shell_deform.contact.outer_face import FacePoints, OuterFace

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Stiffness of the contact over that of the wall around one control point: across the face, and
# along it, where the wall is stiff by its membrane.
PRESS_STIFFNESS, SLIP_STIFFNESS = 10.0, 30.0
# Control points with less of the edge than this feel nothing of what presses on it.
EDGE_SHARE = 1e-2


@dataclass(frozen=True)
class Memory:
    """What k bodies and p contact points remember of a state; in the frames of the bodies.

    Attributes:
        pressure: (k, p) [Pa]. traction: (k, p, 3) friction that holds the face back [Pa].
        anchor: (k, p, 3) where a point began to stick [m]; of one that does not, where it is.
    """

    pressure: Array
    traction: Array
    anchor: Array


@dataclass(frozen=True)
class Touch:
    """One body against the points of the face that it presses.

    Attributes:
        body: its number among the bodies. pose: where it is. face: the pressed points.
        pressure: (p,) [Pa]. friction: (p, 3) that holds the face back [Pa], world axes.
        sticking: (p,) which points do not slip. traction: (p, 3) on the face [Pa].
        stiffness: (p, 3, 3) minus its derivative by the position [Pa/m].
        weights: (p,) area [m^2].
    """

    body: int
    pose: Pose
    face: FacePoints
    pressure: Array
    friction: Array
    sticking: Flags
    traction: Array
    stiffness: Array
    weights: Array

    @property
    def forces(self) -> Array:
        """(p, 3) on the face [N]."""
        return self.weights[:, None] * self.traction

    @property
    def force(self) -> Array:
        """(3,) on the shell [N]."""
        return np.asarray(self.forces.sum(axis=0))

    def moment(self, about: Array) -> Array:
        """(3,) on the shell about a point [N m]."""
        return np.asarray(np.cross(self.face.position - about, self.forces).sum(axis=0))


@dataclass(frozen=True)
class Press:
    """What k bodies do to a shell at one state; N = 3 n dofs.

    Attributes:
        touches: of each body.
        gradient: (n, 3) minus the nodal forces of the contacts [N].
        force: push of each body along its axis [N]. depth: of each body [m]; both for all contacts
            of the load case, those that are no bodies as they were given.
        rows: (N, f), corner: (f,) how the depths of the f forced bodies that touch take part:
            eliminating them from [[K, rows], [rows^T, corner]] gives the stiffness at given force.
        touching: (f,) which contacts those are. missing: what the push of each contact lacks of
            its prescribed force [N].
    """

    touches: tuple[Touch, ...]
    gradient: Array
    force: Array
    depth: Array
    rows: Array
    corner: Array
    touching: Index
    missing: Array

    def eliminated(self, now: Press) -> Array:
        """(N,) nodal forces of `now.missing` when this tangent's depths are eliminated."""
        return np.asarray(self.rows @ (now.missing[self.touching] / self.corner))

    def follow(self, now: Press, step: Array) -> Array:
        """Depths of all contacts after the control points moved by `step` (N,) from `now`."""
        depth = now.depth.copy()
        depth[self.touching] += (now.missing[self.touching] - self.rows.T @ step) / self.corner
        return depth


@dataclass(frozen=True)
class ContactField:
    """Bodies against one shell.

    Attributes:
        bodies: k rigid bodies. contacts: (k,) their numbers among all contacts of a load case.
        driven: (k,) whether the depth is prescribed, else the force. face: the contact points.
        stiffness: (p,) across the face, slip_stiffness: (p,) along it [Pa/m].
        memory: what was known when the step began; its pressure and traction are the multipliers.
    """

    bodies: tuple[Body, ...]
    contacts: Index
    driven: Flags
    face: OuterFace
    stiffness: Array
    slip_stiffness: Array
    memory: Memory

    def started(
        self, memory: Memory | None, control: Array, depth: Array, motion: Array
    ) -> ContactField:
        """The field at the begin of a step: with the memory of the last state, if it fits.

        Else with bodies that have not touched: points stick from where they are at control
        positions (n, 3), with the bodies at their depths (c,) and motions (c, 6).
        """
        if memory is not None and memory.pressure.shape == self.memory.pressure.shape:
            return replace(self, memory=memory)
        places = self.face.positions(control)
        poses = [
            body.posed(float(depth[c]), motion[c])
            for body, c in zip(self.bodies, self.contacts, strict=True)
        ]
        anchor = np.stack([pose.inside(places) for pose in poses])
        return replace(self, memory=replace(self.memory, anchor=anchor))

    def start(self, moved: Array, displacement: Array) -> Array:
        """Depth of every contact to start from: as prescribed, else where the body is now."""
        depth = np.array(displacement, dtype=float)
        driven = self.contacts[self.driven]
        depth[driven] = moved[driven]
        return depth

    def press(self, control: Array, depth: Array, force: Array, motion: Array) -> Press:
        """Bodies on control positions (n, 3): driven ones at `depth` [m], others at `force` [N].

        Both, and the `motion` (k, 6) beside the depth, are given for all contacts. A forced body
        is taken at `depth` as well, and tells what its push lacks; only where it would not touch
        is it first moved until it carries its force.
        """
        places = self.face.positions(control)
        gradient = np.zeros_like(control)
        forces, depths = np.array(force, dtype=float), np.array(depth, dtype=float)
        rows, corner, touching, missing = [], [], [], np.zeros_like(depths)
        touches = []
        for k, body in enumerate(self.bodies):
            c = int(self.contacts[k])
            pose = body.posed(float(depths[c]), motion[c])
            distance = pose.distance(body.shape, places)
            pressure = self._pressure(k, distance.value)
            if not self.driven[k] and not np.any(pressure > 0.0):
                depths[c] = self._depth(k, places, float(depths[c]), float(force[c]), motion[c])
                pose = body.posed(float(depths[c]), motion[c])
                distance = pose.distance(body.shape, places)
                pressure = self._pressure(k, distance.value)
            touch = self._touch(k, pose, control, distance, pressure)
            touches.append(touch)
            gradient -= self.face.forces(touch.face, touch.forces)
            forces[c] = float(touch.force @ body.axis)
            if self.driven[k] or not len(touch.pressure):
                continue
            stiff = touch.weights[:, None] * (touch.stiffness @ body.axis)
            rows.append(-self.face.forces(touch.face, stiff).reshape(-1))
            corner.append(float((stiff @ body.axis).sum()))
            touching.append(c)
            missing[c] = force[c] - forces[c]
        return Press(
            tuple(touches),
            gradient,
            forces,
            depths,
            np.stack(rows, axis=1) if rows else np.zeros((control.size, 0)),
            np.array(corner),
            np.array(touching, dtype=np.int64),
            missing,
        )

    def _pressure(self, k: int, distance: Array) -> Array:
        return np.maximum(0.0, self.memory.pressure[k] - self.stiffness * distance)

    def _touch(
        self, k: int, pose: Pose, control: Array, distance: Distance, pressure: Array
    ) -> Touch:
        """Tractions and their derivatives where body k presses."""
        at = np.flatnonzero(pressure > 0.0)
        face = self.face.at(control, at)
        pressure, normal = pressure[at], distance.normal[at]
        crossing = np.einsum('pi,pj->pij', normal, normal)
        stiffness = self.stiffness[at, None, None] * crossing
        stiffness -= pressure[:, None, None] * distance.hessian[at]
        traction = pressure[:, None] * normal
        friction, sticking = np.zeros_like(traction), np.zeros(len(at), dtype=bool)
        mu, memory = self.bodies[k].friction, self.memory
        if mu > 0.0:
            flat = np.eye(3) - crossing
            slip = face.position - pose.outside(memory.anchor[k, at])
            hard = self.slip_stiffness[at]
            known = memory.traction[k, at] @ pose.turn.T
            trial = np.einsum('pij,pj->pi', flat, known + hard[:, None] * slip)
            size, bound = np.linalg.norm(trial, axis=1), mu * memory.pressure[k, at]
            sticking = size <= bound
            share = np.where(size <= bound, 1.0, bound / np.maximum(size, 1e-300))
            friction = share[:, None] * trial
            unit = trial / np.maximum(size, 1e-300)[:, None]
            lost = np.where(sticking, 0.0, 1.0)[:, None, None]
            along = flat - lost * np.einsum('pi,pj->pij', unit, unit)
            stiffness += (share * hard)[:, None, None] * along
            traction = traction - friction
        weights = self.face.weights[at]
        return Touch(k, pose, face, pressure, friction, sticking, traction, stiffness, weights)

    def add(self, press: Press, data: Array) -> None:
        """Add the contacts' stiffness to the values of the shell's pattern."""
        for touch in press.touches:
            if not len(touch.pressure):
                continue
            weighted = touch.weights[:, None, None] * touch.stiffness
            self.face.add(touch.face, self.face.blocks(touch.face, weighted, touch.forces), data)

    def augmented(self, press: Press) -> ContactField:
        """The field whose multipliers are the tractions found."""
        pressure = np.zeros_like(self.memory.pressure)
        traction = np.zeros_like(self.memory.traction)
        for touch in press.touches:
            pressure[touch.body, touch.face.at] = touch.pressure
            traction[touch.body, touch.face.at] = touch.friction @ touch.pose.turn
        return replace(self, memory=replace(self.memory, pressure=pressure, traction=traction))

    def stiffer(self, factor: float) -> ContactField:
        """The field with `factor` times the stiffness across the face."""
        return replace(self, stiffness=factor * self.stiffness)

    def unsettled(self, press: Press) -> tuple[float, float, float]:
        """What augmenting would still move: sinking in [m], creep [m], share of the force [-]."""
        now = self.augmented(press).memory
        change = np.abs(now.pressure - self.memory.pressure)
        sliding = np.linalg.norm(now.traction - self.memory.traction, axis=2)
        for touch in press.touches:
            # What slips turns towards its slip; what it lacks of that is no creep.
            sliding[touch.body, touch.face.at[~touch.sticking]] = 0.0
        total = float((now.pressure @ self.face.weights).sum())
        gained = np.abs((now.pressure - self.memory.pressure) @ self.face.weights).sum()
        gained += np.abs(
            np.einsum('kpi,p->ki', now.traction - self.memory.traction, self.face.weights)
        ).sum()
        return (
            float((change / self.stiffness).max(initial=0.0)),
            float((sliding / self.slip_stiffness).max(initial=0.0)),
            float(gained) / total if total > 0.0 else 0.0,
        )

    def remembered(self, press: Press, control: Array) -> Memory:
        """The memory of a converged state, from which the next step starts.

        A point that slips, or does not touch, sticks from where it is now.
        """
        memory = self.augmented(press).memory
        anchor = np.empty_like(memory.anchor)
        places = self.face.positions(control)
        for touch in press.touches:
            k, sticking = touch.body, touch.face.at[touch.sticking]
            anchor[k] = touch.pose.inside(places)
            anchor[k, sticking] = self.memory.anchor[k, sticking]
        return replace(memory, anchor=anchor)

    def _depth(self, k: int, places: Array, start: float, force: float, motion: Array) -> float:
        """Depth [m] at which body k pushes with `force` [N] on a surface that does not yield."""
        body, weights = self.bodies[k], self.face.weights

        def excess(depth: float) -> tuple[float, float]:
            there = body.posed(depth, motion).distance(body.shape, places)
            pressure = self._pressure(k, there.value)
            slope = there.normal @ body.axis
            bend = np.einsum('i,pij,j->p', body.axis, there.hessian, body.axis)
            rate = np.where(pressure > 0.0, self.stiffness * slope**2 - pressure * bend, 0.0)
            return float(weights @ (pressure * slope)) - force, float(weights @ rate)

        return depth_of_force(excess, start, force, float(np.ptp(places, axis=0).max()))


@dataclass(frozen=True)
class WallStiffness:
    """What a contact is stiff against: the wall around one control point, per area [Pa/m].

    Attributes: `across` (p,) and `along` (p,) the face, at the contact points.
    """

    across: Array
    along: Array


def wall_stiffness(face: OuterFace, normals: Array) -> WallStiffness:
    """Stiffness of the undeformed shell's control points (n, 3: their normals), by area."""
    shell, matrix = face.shell, face.matrices[0]
    area = np.maximum(np.asarray(matrix.T @ face.weights), 1e-30)
    values = shell.tangent('koiter', shell.mesh.vertices)[2]
    pattern = shell.pattern.matrix(values)
    blocks = pattern.tobsr((3, 3))
    row = np.repeat(np.arange(len(normals)), np.diff(blocks.indptr))
    own = blocks.data[row == blocks.indices]
    across = np.einsum('ni,nij,nj->n', normals, own, normals)
    along = 0.5 * (np.trace(own, axis1=1, axis2=2) - across)
    pressed = np.asarray(matrix @ (np.maximum(across, 0.0) / area))
    rubbed = np.asarray(matrix @ (np.maximum(along, 0.0) / area))
    # An edge is pressed in its own plane, on the end of the wall.
    edge = np.flatnonzero(face.half == 0.0)
    if len(edge):
        ends = np.maximum(np.asarray(matrix[edge].T @ face.weights[edge]), 1e-30)
        used = np.asarray(matrix[edge].sum(axis=0)).ravel() > EDGE_SHARE
        pressed[edge] = matrix[edge] @ np.where(used, np.maximum(along, 0.0) / ends, 0.0)
    return WallStiffness(pressed, rubbed)


def contact_field(
    face: OuterFace,
    wall: WallStiffness,
    bodies: dict[int, Body],
    driven: Flags,
) -> ContactField:
    """Bodies by contact number against a face, with nothing to remember.

    `driven`: for all contacts, whether the displacement is prescribed.
    """
    contacts = np.array(sorted(bodies), dtype=np.int64)
    count, points = len(contacts), len(face.weights)
    nothing = np.zeros((count, points, 3))
    return ContactField(
        tuple(bodies[int(c)] for c in contacts),
        contacts,
        driven[contacts],
        face,
        PRESS_STIFFNESS * wall.across,
        SLIP_STIFFNESS * wall.along,
        Memory(np.zeros((count, points)), nothing, nothing),
    )
