# SPDX-License-Identifier: Apache-2.0
"""One grasp of a map: sampled, squeezed and measured; the same bytes wherever it is worked out."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.building import build_model
from shell_deform.contact.bodies import BodyError
from shell_deform.contact.finger_bodies import of_finger, read_finger_bodies
from shell_deform.contact.loads import ContactPatch
from shell_deform.factor.base import FactorError
from shell_deform.grasp.capacity import liftable_mass
from shell_deform.grasp.cone import ConeError
from shell_deform.grasp.contacts import GraspError
from shell_deform.grasp.measures import Doubt, Held, Task, measure
from shell_deform.grasp.reading import normal_sigma, wall_reader
from shell_deform.grasp.sampling import FINGERTIPS, SampledGrasp, SamplingError, sample_grasp
from shell_deform.grasp.stiffness import rigid_share, squeeze_work
from shell_deform.grasp.touching import read_grasp, read_response
from shell_deform.grasp.window import UNLIMITED, Limits, window_of_curve
from shell_deform.model import ShellModel
from shell_deform.objects import ShellObject, load_object
from shell_deform.solve.equilibrium import Equilibrium, LoadCase, displaced, forced
from shell_deform.solve.first_touch import FirstTouchError, first_touch
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.solve.step_system import NewtonOptions

Array = NDArray[np.float64]

STEPS = 4
BODY_STEPS = 8
"""Friction remembers its way."""

POINT_SIGMA = 2e-4
"""Of contacts of the model: half a pin's mounting [m]."""


@dataclass(frozen=True)
class MapRequest:
    """Everything that decides what a map holds.

    Attributes:
        object_name: name or file. hand: key of `HANDS`. number: grasps. seed: of the sampling.
        friction, friction_sigma: [-]. mass: [kg]. down: direction of the weight.
        depth: of each pin [m], or force: push of each [N]; exactly one is above zero.
        lean: largest angle of a line to the normal [rad]. pin_radius: [m]. vertices: control
            vertices, 0 for those of the file. theory: strain measure.
        strain_limit: largest strain of the wall [-], for rubber. body: what fingertips carry, as
            `read_finger_bodies` takes it.
    """

    object_name: str
    hand: str = 'two_pins'
    number: int = 100
    seed: int = 0
    friction: float = 0.5
    friction_sigma: float = 0.1
    mass: float = 0.0
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    depth: float = 4e-3
    force: float = 0.0
    lean: float = 0.35
    pin_radius: float = 2e-3
    vertices: int = 0
    theory: str = 'koiter'
    strain_limit: float = 0.2
    body: str = 'barrett_fingertip'


@dataclass(frozen=True)
class Workplace:
    """What all grasps of a map share: object, model, solvers, and the surface to sample.

    `judge` counts negative modes as well: of the last state alone, they cost as much as a step.
    """

    shell: ShellObject
    model: ShellModel
    solver: EquilibriumSolver
    judge: EquilibriumSolver
    points: Array
    triangles: NDArray[np.int64]


@lru_cache(maxsize=2)
def workplace(object_name: str, vertices: int, theory: str) -> Workplace:
    """Built once in each process; an even mesh, since grasps are everywhere."""
    shell = replace(load_object(object_name), contacts=())
    model = build_model(shell, theory, vertices or None)
    mesh = model.shell.mesh
    points = model.surface.limit_positions(model.rest)
    triangles = np.asarray(mesh.triangles[mesh.active], np.int64)
    solver = EquilibriumSolver(model)
    judge = EquilibriumSolver(model, NewtonOptions(stability=True))
    return Workplace(shell, model, solver, judge, points, triangles)


def map_grasp(request: MapRequest, number: int) -> dict[str, Any]:
    """Grasp `number` of a map as plain numbers; what cannot be squeezed says why."""
    place = workplace(request.object_name, request.vertices, request.theory)
    try:
        sampled = sample_grasp(
            place.points, place.triangles, request.hand, request.lean, (request.seed, number)
        )
    except SamplingError as error:
        return {'number': number, 'failed': str(error)}
    result: dict[str, Any] = {
        'number': number, 'at_m': sampled.at.tolist(), 'axis': sampled.axis.tolist(),
    }  # fmt: skip
    try:
        patches = _patches(request, place.model, sampled)
        squeeze = _squeezed(request, place, patches)
        if isinstance(squeeze, str):
            return {**result, 'failed': squeeze}
        return {**result, **_measured(request, place, sampled, squeeze)}
    except (BodyError, FirstTouchError, FactorError, ConeError, GraspError) as error:
        return {**result, 'failed': str(error)}


@dataclass(frozen=True)
class Squeeze:
    """A grasp as it is squeezed: its contacts, their depths (k,) at first touch [m], states."""

    patches: tuple[ContactPatch, ...]
    touch: Array
    states: list[Equilibrium]


def _patches(
    request: MapRequest, model: ShellModel, sampled: SampledGrasp
) -> tuple[ContactPatch, ...]:
    """Pins, or bodies that face along their pushes."""
    places = list(zip(sampled.at, sampled.axis, strict=True))
    if request.hand not in FINGERTIPS:
        return tuple(model.contact(at, request.pin_radius, axis) for at, axis in places)
    carried = read_finger_bodies(request.body).loaded()
    patches = []
    for number, (at, axis) in enumerate(places, 1):
        body = of_finger(carried, number)
        if body is None:
            raise BodyError(f'finger {number} carries no body in {request.body!r}')
        patches.append(
            model.touched_by(
                body.shape, at, body.size, sampled.along, request.friction, towards=axis
            )
        )
    return tuple(patches)


def _squeezed(
    request: MapRequest, place: Workplace, patches: tuple[ContactPatch, ...]
) -> Squeeze | str:
    """States of the squeeze, or why there are none."""
    alone, touch = first_touch(place.solver, patches)
    start = replace(alone, force=np.zeros(len(patches)), displacement=touch)
    steps = STEPS if patches[0].body is None else BODY_STEPS
    amount, count = request.depth or request.force, len(patches)

    def case(share: float) -> LoadCase:
        value = np.full(count, share * amount)
        return displaced(patches, touch + value) if request.depth else forced(patches, value)

    states: list[Equilibrium] = []
    for share in np.linspace(0.0, 1.0, steps + 1)[1:].tolist():
        solver = place.solver if share < 1.0 else place.judge
        found = solver.solve(case(share), states[-1] if states else start)
        if not found.converged:
            return found.message
        states.append(found)
    return Squeeze(patches, touch, states)


def _measured(
    request: MapRequest,
    place: Workplace,
    sampled: SampledGrasp,
    squeeze: Squeeze,
) -> dict[str, Any]:
    patches, states, count = squeeze.patches, squeeze.states, len(squeeze.patches)
    model = place.model.on_contacts(patches)
    grasps = [read_grasp(model, patches, state, request.friction) for state in states]
    response = read_response(place.solver, patches, states[-1], grasps[-1])
    reader = wall_reader(model, patches)
    moved = [state.displacement - squeeze.touch for state in states]
    walls = [reader.at(state.unknowns, state.force, state.displacement) for state in states]
    yielding = place.shell.yield_stress_pa or 0.0
    slope = states[0].force.sum() / max(float(moved[0].sum()), 1e-12)
    limits = []
    before = np.zeros(count), np.zeros(count)
    for state, way, wall in zip(states, moved, walls, strict=True):
        push, step = state.force - before[0], way - before[1]
        stiff = push.sum() / step.sum() / slope if step.sum() else 1.0
        limits.append(
            Limits(
                float(min(stiff, 1.0)),
                wall.stress / yielding if yielding else 0.0,
                wall.strain / request.strain_limit,
            )
        )
        before = state.force, way
    task = Task(request.mass, request.down, request.friction_sigma)
    doubt = Doubt(
        np.zeros(count),
        np.zeros(count),
        np.full(count, POINT_SIGMA),
        np.full(count, normal_sigma(model)),
    )
    held = Held(
        response.centre, response.sharing, response.compliance, states[-1].energy, limits[-1],
        response.slipping,
    )  # fmt: skip
    told = measure(grasps[-1], held, task, doubt).to_json()
    down = np.array(request.down) / np.linalg.norm(request.down)
    lifted = np.array([liftable_mass(grasp, down, response.centre) for grasp in grasps])
    mean = np.array([float(grasp.push.mean()) for grasp in grasps])
    told['least_push_n'], told['most_push_n'], told['limit'] = window_of_curve(
        mean, lifted, request.mass, limits
    )
    rest = np.zeros((1, count))
    work = squeeze_work(
        np.concatenate([rest, moved]),
        np.concatenate([rest, [state.force for state in states]]),
    )
    motion = moved[-1][:, None] * sampled.axis
    return {
        **told,
        'stable': bool(states[-1].stable),
        'push_n': float(mean[-1]),
        'depth_m': float(moved[-1].mean()),
        'contact_points': min(states[-1].pressed_points, default=0),
        'largest_stress_pa': walls[-1].stress,
        'largest_strain': walls[-1].strain,
        'dent_push_n': _dent(mean, walls, yielding),
        'stress_sigma_pa': walls[-1].stress * walls[-1].doubt,
        'stress_unresolved': walls[-1].unresolved,
        'squeeze_work_j': work,
        'rigid_share': rigid_share(sampled.at, motion),
    }


def _dent(push: Array, walls: list[Any], yielding: float) -> float:
    """Push [N] at which the wall begins to yield; `UNLIMITED` if it does not or is not known."""
    from shell_deform.grasp.window import crossing

    stress = np.array([wall.stress for wall in walls])
    return crossing(push, stress / yielding, 1.0) if yielding else UNLIMITED


def ranking(grasps: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Grasps with the best first: stable ones by the force that the worst of 26 directions needs.

    Equal ones stand in the order of their numbers, so that a ranking has one order only.
    """
    good = [one for one in grasps if 'failed' not in one]
    return sorted(
        good, key=lambda one: (not one['stable'], -one['worst_capacity_n'], one['number'])
    )


def described(request: MapRequest) -> dict[str, Any]:
    """The request as plain numbers."""
    return {**asdict(request), 'down': list(request.down)}
