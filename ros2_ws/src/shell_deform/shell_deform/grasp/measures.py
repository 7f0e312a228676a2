# SPDX-License-Identifier: Apache-2.0
"""All measures of one grasp, together: what is published live, written off-line and ranked."""

from __future__ import annotations

from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shell_deform.grasp.capacity import (
    DIRECTIONS,
    GRAVITY,
    bounds_sigma,
    epsilon,
    force_capacities,
    forces,
)
from shell_deform.grasp.closure import closure
from shell_deform.grasp.cone import ConeError
from shell_deform.grasp.contacts import GraspContacts, GraspError, contact_wrenches
from shell_deform.grasp.margins import Margins, margins
from shell_deform.grasp.probability import Sigmas, closure_probability, closure_sigma
from shell_deform.grasp.slip import (
    Sharing,
    Slipping,
    slip_rates,
    slip_sigma,
    slipping_regions,
    slips_along,
)
from shell_deform.grasp.stiffness import adversary_work, grasp_stiffness
from shell_deform.grasp.window import UNLIMITED, Limits, SqueezeWindow, squeeze_window

Array = NDArray[np.float64]

HONESTY = (
    'tangential force and spin are values of the model, no gauge sees them; friction is an input'
)


@dataclass(frozen=True)
class Task:
    """What the grasp is for.

    Attributes:
        mass: of the object [kg]. down: (3,) unit direction of its weight.
        friction_sigma: of the coefficient, the same at all contacts [-].
        adversary: push that the grasp is to withstand [N].
        length: at which moments count as forces [m]; 0: half the largest distance of contacts.
    """

    mass: float = 0.0
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    friction_sigma: float = 0.0
    adversary: float = 1.0
    length: float = 0.0

    def __post_init__(self) -> None:
        for name in ('mass', 'friction_sigma', 'adversary', 'length'):
            value = getattr(self, name)
            number = isinstance(value, Real) and not isinstance(value, bool)
            # What a mass that is none means is told with the squeeze window.
            if not number or not (name in ('mass', 'friction_sigma') or np.isfinite(value)):
                raise GraspError(f'{name} of a grasp is {value!r}; it must be a finite number')
        down = np.asarray(self.down)
        if down.shape != (3,) or down.dtype.kind not in 'iuf':
            raise GraspError(f'the direction of the weight is {self.down!r}; it has three numbers')


@dataclass(frozen=True)
class Doubt:
    """Sigmas of the contacts' values, (k,) each: [N], [N], [m], [rad].

    That of a push that no gauge feels may be infinite; no other, and none negative (GraspError).
    """

    push: Array
    tangential: Array
    point: Array
    normal: Array

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            values = np.asarray(getattr(self, name), float)
            right = (values >= 0.0) & (np.isfinite(values) | (name == 'push'))
            if not right.all():
                raise GraspError(
                    f'the sigma of a {name} is {values.tolist()}; it must be zero or more'
                )


@dataclass(frozen=True)
class Measures:
    """Of one grasp; every number is finite.

    Attributes:
        contacts: what they are of. per_finger: margins of each.
        closed, why: force closure, and why not. needed_friction, needed_sigma: coefficient that
            closure needs [-]. closure_probability: [-].
        gravity_capacity: weight that the present squeeze can carry [N]; its worst of 26
            directions and that direction; each with a sigma. epsilon: Ferrari and Canny's [N]
            at `length` [m].
        gravity_slip: weight at first slip while the fingers stand still [N] with its sigma,
            which finger; worst of 26 directions [N] with its sigma. Zero without a known sharing.
        window: the squeeze window. smallest_stiffness: [N/m]. adversary_work: [J].
        energy: strain and gas energy [J]. snap_margin: [-].
    """

    contacts: GraspContacts
    per_finger: Margins
    closed: bool
    why: str
    needed_friction: float
    needed_sigma: float
    closure_probability: float
    gravity_capacity: float
    gravity_capacity_sigma: float
    worst_capacity: float
    worst_capacity_sigma: float
    worst_direction: Array
    epsilon: float
    length: float
    gravity_slip: float
    gravity_slip_sigma: float
    slip_contact: int
    worst_slip: float
    worst_slip_sigma: float
    window: SqueezeWindow
    smallest_stiffness: float
    adversary_work: float
    energy: float
    snap_margin: float
    note: str = field(default=HONESTY)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, SI."""
        contacts, own = self.contacts, self.per_finger
        fingers = [
            {
                'point_m': contacts.point[i].tolist(),
                'normal': contacts.normal[i].tolist(),
                'push_n': float(contacts.push[i]),
                'tangential_n': float(np.linalg.norm(contacts.tangential[i])),
                'tangential_sigma_n': float(own.tangential_sigma[i]),
                'spin_nm': float(contacts.spin[i]),
                'needed_angle_rad': float(own.needed_angle[i]),
                'slip_margin_n': float(own.slip_margin[i]),
                'slip_margin_sigma_n': float(own.slip_sigma[i]),
                'soft_margin': float(own.soft_margin[i]),
            }
            for i in range(contacts.count)
        ]
        return {
            'closed': self.closed,
            'why': self.why,
            'needed_friction': self.needed_friction,
            'needed_friction_sigma': self.needed_sigma,
            'closure_probability': self.closure_probability,
            'gravity_capacity_n': self.gravity_capacity,
            'gravity_capacity_sigma_n': self.gravity_capacity_sigma,
            'worst_capacity_n': self.worst_capacity,
            'worst_capacity_sigma_n': self.worst_capacity_sigma,
            'worst_direction': self.worst_direction.tolist(),
            'epsilon_n': self.epsilon,
            'length_m': self.length,
            'gravity_slip_n': self.gravity_slip,
            'gravity_slip_sigma_n': self.gravity_slip_sigma,
            'slip_contact': self.slip_contact,
            'worst_slip_n': self.worst_slip,
            'worst_slip_sigma_n': self.worst_slip_sigma,
            'least_push_n': self.window.least,
            'most_push_n': self.window.most,
            'limit': self.window.limit,
            'liftable_mass_kg': self.window.liftable,
            'liftable_mass_sigma_kg': self.gravity_capacity_sigma / GRAVITY,
            'liftable_share': self.window.share,
            'smallest_stiffness_n_m': self.smallest_stiffness,
            'adversary_work_j': self.adversary_work,
            'energy_j': self.energy,
            'snap_margin': self.snap_margin,
            'note': self.note,
            'fingers': fingers,
        }


@dataclass(frozen=True)
class Held:
    """What is known of the object between the fingers besides its contacts.

    Attributes:
        centre: (3,) where weight and pushes act [m]. sharing, compliance: see `reading.Response`,
            None where not known. energy: [J]. limits: how near the wall is to what it bears.
        slipping: of contacts that are regions, None where they are pins or it is not known.
    """

    centre: Array
    sharing: Sharing | None = None
    compliance: Array | None = None
    energy: float = 0.0
    limits: Limits = field(default_factory=Limits)
    slipping: Slipping | None = None


def measure(grasp: GraspContacts, held: Held, task: Task, doubt: Doubt) -> Measures:
    """All measures of a grasp; a sigma that is not known is told as `UNLIMITED`.

    Raises GraspError for a direction of the weight or a sigma of the friction that is none.
    """
    if not 0.0 <= task.friction_sigma < np.inf:
        raise GraspError(
            f'the sigma of the friction is {task.friction_sigma}; it must be zero or more'
        )
    push_sigma = np.minimum(doubt.push, UNLIMITED)
    down = np.asarray(task.down, float)
    size = float(np.linalg.norm(down))
    if not (np.isfinite(size) and size > 0.0):
        raise GraspError(f'the direction of the weight is {task.down}; it must not be zero')
    down = down / size
    found = closure(grasp)
    relative = task.friction_sigma / max(float(grasp.friction.max(initial=0.0)), 1e-12)
    sigmas = Sigmas(doubt.point, doubt.normal, relative)
    known = len(found.squeeze) > 0
    friction = float(grasp.friction.max(initial=0.0))
    needed = found.needed_friction(grasp)
    directions = np.concatenate([down[None], DIRECTIONS])
    capacity, capacity_sigma, why = _capacities(
        grasp, held.centre, directions, push_sigma, task.friction_sigma
    )
    length = task.length if task.length > 0.0 else _half_width(grasp)
    quality = epsilon(grasp, held.centre, length)[0] if found.closed else 0.0
    regions = slipping_regions(grasp, held.slipping)
    slips, slip_doubt, slipping = _slips(regions, held.sharing, directions, relative)
    first = 1 + int(np.argmin(slips[1:]))
    push = float(grasp.push.mean()) if grasp.count else 0.0
    worst = 1 + int(np.argmin(capacity[1:]))
    stiff = work = 0.0
    if held.compliance is not None:
        stiff = grasp_stiffness(held.compliance, length).smallest
        work = adversary_work(held.compliance, task.adversary)
    return Measures(
        contacts=grasp,
        per_finger=margins(grasp, push_sigma, doubt.tangential, task.friction_sigma, doubt.normal),
        closed=found.closed,
        why=found.why or why,
        needed_friction=needed,
        needed_sigma=friction * closure_sigma(grasp, found, Sigmas(doubt.point, doubt.normal, 0.0))
        if known
        else 0.0,
        closure_probability=closure_probability(grasp, found, sigmas),
        gravity_capacity=float(capacity[0]),
        gravity_capacity_sigma=float(capacity_sigma[0]),
        worst_capacity=float(capacity[worst]),
        worst_capacity_sigma=float(capacity_sigma[worst]),
        worst_direction=directions[worst],
        epsilon=quality,
        length=length,
        gravity_slip=float(slips[0]),
        gravity_slip_sigma=float(slip_doubt[0]),
        slip_contact=int(slipping[0]),
        worst_slip=float(slips[first]),
        worst_slip_sigma=float(slip_doubt[first]),
        window=squeeze_window(push, float(capacity[0]) / GRAVITY, task.mass, held.limits),
        smallest_stiffness=stiff,
        adversary_work=work,
        energy=held.energy,
        snap_margin=held.limits.snap_margin,
    )


def _capacities(
    grasp: GraspContacts,
    centre: Array,
    directions: Array,
    push_sigma: Array,
    friction_sigma: float,
) -> tuple[Array, Array, str]:
    """Capacities along directions (d, 3) with sigmas [N], and why there are none."""
    nothing = np.zeros(len(directions))
    if grasp.count < 2:
        return nothing, nothing, ''
    try:
        factor, proofs = force_capacities(grasp, directions, centre)
    except ConeError as error:
        return nothing, nothing, str(error)
    basis = contact_wrenches(grasp, centre, 1.0)
    sigma = bounds_sigma(grasp, proofs, forces(directions), basis, push_sigma, friction_sigma)
    return factor, sigma, ''


def _slips(
    grasp: GraspContacts, sharing: Sharing | None, directions: Array, friction_share: float
) -> tuple[Array, Array, NDArray[np.int64]]:
    """First slips along directions (d, 3), their sigmas, and which contacts."""
    if sharing is None or grasp.count < 2:
        nothing = np.zeros(len(directions))
        return nothing, nothing, np.full(len(directions), -1)
    rates = slip_rates(grasp, sharing, forces(directions))
    factor, contact, _ = slips_along(grasp, rates)
    return factor, slip_sigma(grasp, rates, factor, contact, friction_share), contact


def _half_width(grasp: GraspContacts) -> float:
    if grasp.count < 2:
        return 1.0
    apart = np.linalg.norm(grasp.point[:, None] - grasp.point[None], axis=2).max()
    return 0.5 * float(apart) if apart > 0.0 else 1.0
