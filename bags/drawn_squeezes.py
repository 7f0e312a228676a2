# SPDX-License-Identifier: Apache-2.0
"""The served surface under hands that are drawn: does its sigma hold?

Each seed draws a hand (gauges, mounting of the pins, tendons, weights), which squeezes a ball to
several forces. What the driver tells of its contacts goes through tick and solver as in the node.
The ball is the thin shell that the node assumes, solved by itself: a known truth. Or it is a
finite-element solid of the same size: a truth that thin-shell theory does not hold. Its pose is
the true one, as a camera would give it, or the one that the pins tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bags.live_bias import DENT, SAMPLES_PER_REFRESH, Wall, along_normals, outer_face
from bags.settings import ball_between_two_pins
from bags.stage import along_pins, force_table
from bags.surfaces import BallTruth, Surface
from barrett_hand_bridge.emulator.squeeze import ForceTable
from barrett_hand_bridge.observer import Observation
from barrett_hand_bridge.trial import Trial
from scan_compare.deformed_surface import DeformedSurface
from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.live.pose import Pose
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.live.tick.sample import ContactSample
from shell_deform.node.parameters import PARAMETERS, settings
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

Array = NDArray[np.float64]

DEEPEST_M, DEPTHS = 11e-3, 23
STEPS = 60


@dataclass(frozen=True)
class Ball:
    """What is squeezed: how it resists, and its outer face (object frame) at a force [N]."""

    table: ForceTable
    face: Callable[[float], Surface]


@cache
def solid_ball() -> Ball:
    """The finite-element ball of the recordings, with a wall that shears and is squeezed."""
    truth, turn = BallTruth(), ball_between_two_pins().from_solution
    return Ball(force_table(truth), lambda force: truth.surface(force).moved(turn, np.zeros(3)))


@cache
def thin_ball() -> Ball:
    """The ball that the node assumes: Koiter's, solved by itself at every depth."""
    shell = load_object('tennis_ball')
    model = build_model(shell)
    pins, solver = object_contacts(shell, model), EquilibriumSolver(model)
    depths = np.linspace(0.0, DEEPEST_M, DEPTHS)
    states = solver.sweep([displaced(pins, [depth, depth]) for depth in depths[1:]])
    forces = (0.0, *(float(state.force.mean()) for state in states))
    table = ForceTable(tuple(depths), forces, 'Koiter')

    def face(force: float) -> Surface:
        depth = table.displacement(force)
        start = states[max(int(np.searchsorted(depths, depth)) - 2, 0)]
        state = solver.solve(displaced(pins, [depth, depth]), start)
        samples = DeformedSurface(
            model.surface, model.rest, state.positions, shell.thickness_m
        ).samples
        return Surface(samples.position, samples.normal, np.zeros((0, 3), int))

    return Ball(table, face)


@dataclass(frozen=True)
class Drawn:
    """Served minus true outer face along the normals (n,) [m], sigma (n,), which lie in dents."""

    seed: int
    force: float
    served: Array
    sigma: Array
    dent: NDArray[np.bool_]


def squeezes(
    ball: Ball,
    seeds: range,
    loads: tuple[float, ...],
    wall: Wall,
    misfit: str = 'none',
    pose_from: str = 'elsewhere',
) -> Iterator[Drawn]:
    """Each hand squeezes the ball to each load, the first to show the play of its tendons.

    `pose_from`: as the parameter of the node.
    """
    shell = with_material(load_object('tennis_ball'), wall.young, wall.poisson_ratio)
    model = build_model(shell, wall.theory)
    values = {one.name: one.default for one in PARAMETERS}
    options = settings({**values, 'pose_from': pose_from})
    for seed in seeds:
        trial = Trial(seed, misfit=misfit, table=ball.table)
        if trial.tare():
            continue
        trial.close_slowly(max(loads), steps=STEPS, samples=1)
        for load in loads:
            player = _Player(trial, Rehearsal(model, options))
            trial.close_slowly(load, steps=STEPS, samples=1, watch=player)
            yield player.judged(ball, shell.thickness_m)


class _Player:
    """Carries what a hand observes to the live estimator, and keeps the truth of the last look."""

    def __init__(self, trial: Trial, live: Rehearsal) -> None:
        self._trial, self._live = trial, live
        self._number = 0

    def __call__(self, seen: Observation) -> None:
        truths = [self._trial.mechanics.truth(finger) for finger in (1, 2)]
        first, second = (np.array(truth.pin_tip) for truth in truths)
        self._force = float(truths[0].force_n)
        self._pose = _between(first, second)
        self._sample = _sample(seen, round(1e9 * self._trial.mechanics.time_s))
        told = self._pose
        if self._live.estimator.settings.pose_from_fingers:
            told = _between(*self._sample.point)
        self._live.estimator.pose = told
        self._live.tick(self._sample)
        self._number += 1
        if self._number % SAMPLES_PER_REFRESH == 0:
            self._live.refresh()

    def judged(self, ball: Ball, thickness: float) -> Drawn:
        """What is served of the last look, beside the truth."""
        served = self._live.settle(self._sample)
        packed, points = outer_face(self._live, served, thickness)
        face = ball.face(self._force).moved(self._pose.rotation, self._pose.translation)
        return Drawn(
            self._trial.seed, self._force, along_normals(points, face)[0], packed[:, 7],
            packed[:, 6] > DENT * packed[:, 6].max(),
        )  # fmt: skip


def _between(first: Array, second: Array) -> Pose:
    """The pose of a ball between two pins (3,)."""
    return Pose(along_pins(first, second), 0.5 * (first + second))


def _sample(seen: Observation, stamp: int) -> ContactSample:
    """What an observed hand publishes of its contacts."""
    contacts = [seen.fingers[finger].contact for finger in (1, 2)]

    def column(name: str, kind: type = float) -> Any:
        return np.array([getattr(contact, name) for contact in contacts], kind)

    return ContactSample(
        stamp, column('finger', np.int64), column('flags', np.int64), column('point'),
        column('normal'), column('force'), column('sigma_normal_n'),
        column('sigma_tangential_n'), column('radius_m'), column('travel_m'),
        column('sigma_travel_m'), column('along'), column('sigma_point_m'),
    )  # fmt: skip
