# SPDX-License-Identifier: Apache-2.0
"""How rigid bodies press on a shell: pressure, friction, force, tangent.

The half wall between middle surface and outer face is an elastic layer, which no thin-shell theory
has: a body that the outer face of the theory overlaps by d presses with p = k d, and rubs with
t = k_t s, s the slip since a point stuck, returned to the cone |t| <= mu p. So a pressure has a
width, where Kirchhoff-Love theory alone concentrates it on lines. The stiffnesses are those of the
layer, E / (1 - nu^2) and G over half the wall. What slips carries its friction on as the stretch
of the layer: a state under loads that do not change stays as it is. A point that touches for the
first time within a load step sticks from where it came to touch. The tangent leaves out that the
bound grows with the pressure: it is symmetric, its inertia counts stability. Source of the
return map: T. A. Laursen and J. C. Simo, Int. J. Numer. Meth. Eng. 36:3451 (1993),
doi:10.1002/nme.1620362005.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shell_deform.assemble.discretisation import Discretisation
from shell_deform.contact.bodies import Body, Distance, Pose
from shell_deform.contact.depth_of_force import depth_of_force
from shell_deform.contact.outer_face import FacePoints
from shell_deform.contact.thick_face import ThickFacePoints

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

# A coefficient of friction that nothing exceeds.
ROUGH = 1e9
# Points further from a body than this share of the shell do not come to touch it in one step.
FAR = 0.1


class Face(Protocol):
    """What bodies touch, an `OuterFace` or a `ThickFace`; positions are all unknowns (N, 3)."""

    @property
    def shell(self) -> Discretisation:
        """The shell whose face it is."""

    @property
    def weights(self) -> Array:
        """(p,) undeformed area of each point [m^2]."""

    @property
    def element(self) -> Index:
        """(p,) element of each point."""

    def positions(self, control: Array) -> Array:
        """(p, 3) all points [m]."""

    def at(self, control: Array, points: Index) -> Any:
        """The chosen points with their derivatives."""

    def moved(self, face: Any, step: Array) -> Array:
        """(p, 3) how the chosen points move with the unknowns (N, 3), to first order."""

    def forces(self, face: Any, force: Array) -> Array:
        """(N, 3) what forces (p, 3) [N] at the chosen points do on the unknowns."""

    def blocks(self, face: Any, stiffness: Array, force: Array) -> Array:
        """Second derivative of a potential of the places, by what these depend on."""

    def add(self, face: Any, blocks: Array, data: Array) -> None:
        """Add blocks to the values of the shell's pattern."""


@dataclass(frozen=True)
class Memory:
    """What k bodies and p contact points remember of a state; in the frames of the bodies.

    Attributes:
        distance: (k, p) from the body [m]. anchor: (k, p, 3) the places on the body from which
            the layer is stretched [m]; of points that do not touch, where they are.
    """

    distance: Array
    anchor: Array


@dataclass(frozen=True)
class Touch:
    """One body against the points of the face that it presses.

    Attributes:
        body: its number among the bodies. pose: where it is. face: the pressed points.
        pressure: (p,) [Pa]. friction: (p, 3) that holds the face back [Pa], world axes.
        sticking: (p,) which points do not slip. traction: (p, 3) on the face [Pa].
        stiffness: (p, 3, 3) minus its derivative by the position [Pa/m], but for `growth`
            (p, 3, 3) of it: what the friction that slips gains with the pressure.
        weights: (p,) area [m^2].
    """

    body: int
    pose: Pose
    face: FacePoints | ThickFacePoints
    pressure: Array
    friction: Array
    sticking: Flags
    traction: Array
    stiffness: Array
    growth: Array
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

    @property
    def slips(self) -> bool:
        """Whether anything slips that is pressed."""
        return any(bool(np.any(touch.growth)) for touch in self.touches)

    def follow(self, step: Array, missing: Array) -> Array:
        """Change of all depths where control points move by `step` (N,): forced bodies follow.

        They push with what was `missing` (c,) then, too.
        """
        change = np.zeros_like(self.depth)
        change[self.touching] = (missing[self.touching] - self.rows.T @ step) / self.corner
        return change


@dataclass(frozen=True)
class ContactField:
    """Bodies against one shell.

    Attributes:
        bodies: k rigid bodies. contacts: (k,) their numbers among all contacts of a load case.
        driven: (k,) whether the depth is prescribed, else the force. face: the contact points.
        stiffness: (p,) across the face, slip_stiffness: (p,) along it [Pa/m].
        memory: what was known when the step began.
    """

    bodies: tuple[Body, ...]
    contacts: Index
    driven: Flags
    face: Face
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
        if memory is not None and memory.distance.shape == self.memory.distance.shape:
            return replace(self, memory=memory)
        places = self.face.positions(control)
        poses = [
            body.posed(float(depth[c]), motion[c])
            for body, c in zip(self.bodies, self.contacts, strict=True)
        ]
        return replace(self, memory=self._remembered(poses, places))

    def _remembered(self, poses: list[Pose], places: Array) -> Memory:
        """The memory of points (p, 3) whose layer is not stretched."""
        # Further away than any step goes a bound will do.
        far = FAR * float(np.ptp(places, axis=0).max())
        distances = []
        for pose, body in zip(poses, self.bodies, strict=True):
            distance = pose.at_least(body.shape, places)
            near = np.flatnonzero(distance < far)
            distance[near] = body.shape.distance(pose.inside(places[near])).value
            distances.append(distance)
        return Memory(np.stack(distances), np.stack([pose.inside(places) for pose in poses]))

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
            at, distance = self._pressed(pose, body, places)
            if not self.driven[k] and not len(at):
                depths[c] = self._depth(k, places, float(depths[c]), float(force[c]), motion[c])
                pose = body.posed(float(depths[c]), motion[c])
                at, distance = self._pressed(pose, body, places)
            touch = self._touch(k, pose, control, at, distance)
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

    @property
    def sticking(self) -> ContactField:
        """The same with friction that lets nothing slip further than it has."""
        rough = tuple(
            replace(body, friction=ROUGH) if body.friction > 0.0 else body for body in self.bodies
        )
        return replace(self, bodies=rough)

    def carried(self, press: Press, depth: Array, motion: Array) -> Array:
        """(N,) nodal forces of bodies that go on to their depths (c,) and motions (c, 6).

        To first order, from where they are in `press`; who touches, sticks and slips stays.
        """
        result = np.zeros(press.gradient.size)
        for touch in press.touches:
            c, places = int(self.contacts[touch.body]), touch.face.position
            there = self.bodies[touch.body].posed(float(depth[c]), motion[c])
            way = there.outside(touch.pose.inside(places)) - places
            force = touch.weights[:, None] * np.einsum('pij,pj->pi', touch.stiffness, way)
            result += self.face.forces(touch.face, force).reshape(-1)
        return result

    def _pressed(self, pose: Pose, body: Body, places: Array) -> tuple[Index, Distance]:
        """Which points a body overlaps, and their distances."""
        near = np.flatnonzero(pose.at_least(body.shape, places) < 0.0)
        found = body.shape.distance(pose.inside(places[near]))
        inside = np.flatnonzero(found.value < 0.0)
        chosen = Distance(found.value[inside], found.normal[inside], found.hessian[inside])
        return near[inside], chosen.turned(pose.turn)

    def _touch(self, k: int, pose: Pose, control: Array, at: Index, distance: Distance) -> Touch:
        """Tractions and their derivatives where body k presses the points `at`."""
        face = self.face.at(control, at)
        pressure, normal = -self.stiffness[at] * distance.value, distance.normal
        crossing = np.einsum('pi,pj->pij', normal, normal)
        stiffness = self.stiffness[at, None, None] * crossing
        stiffness -= pressure[:, None, None] * distance.hessian
        traction = pressure[:, None] * normal
        friction, sticking = np.zeros_like(traction), np.zeros(len(at), dtype=bool)
        growth = np.zeros_like(stiffness)
        mu = self.bodies[k].friction
        if mu > 0.0:
            flat = np.eye(3) - crossing
            # Where a point came to touch within this step: this share of the way along it.
            before = np.maximum(self.memory.distance[k, at], 0.0)
            left = 1.0 - before / np.maximum(before - distance.value, 1e-300)
            hard = left * self.slip_stiffness[at]
            slip = face.position - pose.outside(self.memory.anchor[k, at])
            trial = hard[:, None] * np.einsum('pij,pj->pi', flat, slip)
            size, bound = np.linalg.norm(trial, axis=1), mu * pressure
            sticking = size <= bound
            share = np.where(sticking, 1.0, bound / np.maximum(size, 1e-300))
            friction = share[:, None] * trial
            unit = trial / np.maximum(size, 1e-300)[:, None]
            lost = np.where(sticking, 0.0, 1.0)[:, None, None]
            along = flat - lost * np.einsum('pi,pj->pij', unit, unit)
            stiffness += (share * hard)[:, None, None] * along
            traction = traction - friction
            growth = (mu * self.stiffness[at])[:, None, None] * np.einsum(
                'pi,pj->pij', np.where(sticking, 0.0, 1.0)[:, None] * unit, normal
            )
        weights = self.face.weights[at]
        return Touch(
            k, pose, face, pressure, friction, sticking, traction, stiffness, growth, weights
        )

    def add(self, press: Press, data: Array) -> None:
        """Add the contacts' stiffness to the values of the shell's pattern."""
        for touch in press.touches:
            if not len(touch.pressure):
                continue
            weighted = touch.weights[:, None, None] * touch.stiffness
            self.face.add(touch.face, self.face.blocks(touch.face, weighted, touch.forces), data)

    def grown(self, press: Press, step: Array, missing: Array) -> Array:
        """(N,) nodal forces that a step (N,) adds by what the touches' stiffness leaves out.

        Forced bodies follow the step, and push with what was `missing` (c,), see `Press.follow`.
        """
        result, depth = np.zeros_like(step), press.follow(step, missing)
        for touch in press.touches:
            moved = self.face.moved(touch.face, step.reshape(-1, 3))
            moved = moved - depth[self.contacts[touch.body]] * self.bodies[touch.body].axis
            force = touch.weights[:, None] * np.einsum('pij,pj->pi', touch.growth, moved)
            result += self.face.forces(touch.face, force).reshape(-1)
        return result

    def remembered(self, press: Press, control: Array) -> Memory:
        """The memory of a converged state, from which the next step starts.

        The layer of points that touch stays stretched as their friction stretches it.
        """
        places = self.face.positions(control)
        memory = self._remembered([touch.pose for touch in press.touches], places)
        for touch in press.touches:
            at = touch.face.at
            stretch = touch.friction / self.slip_stiffness[at, None]
            memory.anchor[touch.body, at] -= stretch @ touch.pose.turn
        return memory

    def _depth(self, k: int, places: Array, start: float, force: float, motion: Array) -> float:
        """Depth [m] at which body k pushes with `force` [N] on a surface that does not yield."""
        body, weights = self.bodies[k], self.face.weights

        def excess(depth: float) -> tuple[float, float]:
            there = body.posed(depth, motion).distance(body.shape, places)
            pressure = np.maximum(0.0, -self.stiffness * there.value)
            slope = there.normal @ body.axis
            bend = np.einsum('i,pij,j->p', body.axis, there.hessian, body.axis)
            rate = np.where(pressure > 0.0, self.stiffness * slope**2 - pressure * bend, 0.0)
            return float(weights @ (pressure * slope)) - force, float(weights @ rate)

        return depth_of_force(excess, start, force, float(np.ptp(places, axis=0).max()))


@dataclass(frozen=True)
class WallStiffness:
    """How stiff the half wall under the outer face is, per area [Pa/m].

    Attributes: `across` (p,) and `along` (p,) the face, at the contact points.
    """

    across: Array
    along: Array


def wall_stiffness(face: Face) -> WallStiffness:
    """Of the half wall of an undeformed shell, at the points of its outer face and its edges."""
    shell = face.shell
    first = shell.point_offsets[:-1][face.element]
    wall = shell.thickness[first]
    law = shell.membrane[first] / (0.5 * wall**2)[:, None, None]
    return WallStiffness(law[:, 0, 0], law[:, 2, 2])


def contact_field(
    face: Face,
    wall: WallStiffness,
    bodies: dict[int, Body],
    driven: Flags,
) -> ContactField:
    """Bodies by contact number against a face, with nothing to remember.

    `driven`: for all contacts, whether the displacement is prescribed.
    """
    contacts = np.array(sorted(bodies), dtype=np.int64)
    count, points = len(contacts), len(face.weights)
    return ContactField(
        tuple(bodies[int(c)] for c in contacts),
        contacts,
        driven[contacts],
        face,
        wall.across,
        wall.along,
        Memory(np.full((count, points), np.inf), np.zeros((count, points, 3))),
    )
