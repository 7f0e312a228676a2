"""Force and motion together: the small weighted least-squares problem of every tick.

Unknown are the inputs of the condensed response (pushes, lateral slips, free rigid motion,
relative modulus) away from the last equilibrium. Gauges measure the pushes, encoders the
displacement of the contacts less what the tendons stretch under the push, and everything else has
a prior width: pin mounting and slip, an object that may shift between the fingers, a modulus that
is known to a few percent, outside forces that nearly balance. What the drive does not use is left
out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.compiled.cache import HAVE_NUMBA
from shell_deform.live.tick.sample import FLAG_NO_GAUGE, FLAG_SATURATED

if HAVE_NUMBA:
    from shell_deform.live.tick import fusion_kernel

Array = NDArray[np.float64]

DRIVES = ('force', 'motion', 'fused')
SOURCES = (
    'gauge of finger',
    'motion of finger',
    'slip of finger',
    'tangential force of finger',
    'balance of the forces',
    'shift of the object',
    'modulus',
)
"""What an observation is, by its code."""


@dataclass(frozen=True)
class ErrorModel:
    """Standard deviations that no message carries.

    Attributes:
        drive: 'force', 'motion' or 'fused'.
        force_floor: smallest sigma of a push [N]. drift: zero drift of a gauge [N].
        quantum: one count of the gauge [N], uniform inside.
        tendon: stretch of the tendons at the contact [m/N]. tendon_relative: its relative sigma.
        mounting: along the normal, pin mounting and moment of first touch [m].
        slip: lateral motion of a held patch [m].
        rigid: shift of the object between the fingers [m]. outside: forces beside the fingers [N].
        modulus: relative sigma of Young's modulus. model: relative stiffness bias of the theory.
        default_travel: sigma of a travel that comes without one [m].
    """

    drive: str = 'fused'
    force_floor: float = 0.01
    drift: float = 0.1
    quantum: float = 0.2
    tendon: float = 0.0
    tendon_relative: float = 0.3
    mounting: float = 5e-5
    slip: float = 1e-4
    rigid: float = 5e-3
    outside: float = 0.3
    modulus: float = 0.05
    model: float = 0.03
    default_travel: float = 2e-5

    @property
    def numbers(self) -> Array:
        """All widths in the order of the fields."""
        return np.array([getattr(self, name) for name in self.__dataclass_fields__][1:], float)

    def push_sigma(self, reported: Array) -> Array:
        """Sigma of the gauges' pushes [N] from what the hand reports."""
        reported = np.where(np.isfinite(reported), reported, 1e6)
        return np.sqrt(
            np.maximum(reported, self.force_floor) ** 2 + self.drift**2 + self.quantum**2 / 12.0
        )


@dataclass(frozen=True)
class Response:
    """Condensed outputs about the last equilibrium for k contacts and r rigid motions.

    Attributes:
        force, displacement: (k,) there [N], [m]. travel_offset: (k,) displacement minus travel.
        rigid: (r,) amplitudes; rigid_scale: amplitude of a shift by one metre.
        reaction: (2 k,) lateral [N]; lateral: (2 k, 3) their directions.
        rigid_reaction: (r,). displacement_by, reaction_by, rigid_by: their change per input.
    """

    force: Array
    displacement: Array
    travel_offset: Array
    rigid: Array
    rigid_scale: float
    reaction: Array
    lateral: Array
    rigid_reaction: Array
    displacement_by: Array
    reaction_by: Array
    rigid_by: Array


@dataclass(frozen=True)
class Measured:
    """What the hand says about the same k contacts.

    Attributes:
        finger, flags: (k,). present: (k,) whether the finger touches in this sample.
        push, sigma_push: (k,) [N]. travel, sigma_travel: (k,) [m], NaN where unknown.
        tangential: (2 k,) forces along the lateral directions [N], sigma (2 k,) infinite if none.
    """

    finger: NDArray[np.int64]
    flags: NDArray[np.int64]
    present: NDArray[np.bool_]
    push: Array
    sigma_push: Array
    travel: Array
    sigma_travel: Array
    tangential: Array
    sigma_tangential: Array


@dataclass(frozen=True)
class Posterior:
    """The answer.

    Attributes:
        inputs: (j,) away from the equilibrium. root: (j, j) upper root of their covariance.
        contradiction: root mean square of the normalised residuals over the degrees of freedom.
        suspect: the observation that strains most: '', 'gauge of finger 1', 'modulus', ...
    """

    inputs: Array
    root: Array
    contradiction: float
    suspect: str


def fuse(model: ErrorModel, response: Response, measured: Measured) -> Posterior:
    """Most probable inputs under all observations and priors."""
    if not HAVE_NUMBA:
        return fuse_numpy(model, response, measured)
    k, r = len(response.force), len(response.rigid)
    j = 3 * k + r + 1
    rows = np.empty((6 * k + 2 * r + 1, j))
    values = np.empty(len(rows))
    kinds = np.empty(len(rows), np.int64)
    owners = np.empty(len(rows), np.int64)
    count = fusion_kernel.assemble(
        model.drive != 'motion',
        model.drive != 'force',
        model.numbers,
        response.force,
        response.displacement,
        response.travel_offset,
        response.rigid,
        response.rigid_scale,
        response.reaction,
        response.rigid_reaction,
        response.displacement_by,
        response.reaction_by,
        response.rigid_by,
        measured.flags,
        measured.present,
        measured.push,
        measured.sigma_push,
        measured.travel,
        measured.sigma_travel,
        measured.tangential,
        measured.sigma_tangential,
        rows,
        values,
        kinds,
        owners,
    )
    inputs, root = np.empty(j), np.empty((j, j))
    chi, worst = fusion_kernel.solve(rows, values, count, inputs, root)
    return _posterior(
        inputs, root, chi, count - j, int(kinds[worst]), int(owners[worst]), measured
    )


def _posterior(
    inputs: Array,
    root: Array,
    chi: float,
    freedom: int,
    kind: int,
    owner: int,
    measured: Measured,
) -> Posterior:
    contradiction = float(np.sqrt(chi / max(1, freedom)))
    suspect = ''
    if contradiction > 1.0:
        suspect = SOURCES[kind] + (f' {measured.finger[owner]}' if owner >= 0 else '')
    return Posterior(inputs, root, contradiction, suspect)


def fuse_numpy(model: ErrorModel, response: Response, measured: Measured) -> Posterior:
    """`fuse` in plain numpy."""
    k, r = len(response.force), len(response.rigid)
    j = 3 * k + r + 1
    identity = np.eye(j)
    contacts = np.arange(k)
    blocks: list[tuple[int, NDArray[np.int64], Array, Array, Array]] = []

    use_force = model.drive != 'motion'
    use_travel = model.drive != 'force'
    blind = (measured.flags & (FLAG_SATURATED | FLAG_NO_GAUGE)) != 0
    travelled = np.isfinite(measured.travel) & measured.present & use_travel
    sigma = model.push_sigma(measured.sigma_push)
    # A clipped gauge is a lower bound; it counts only where nothing else speaks.
    clipped = np.where(travelled, 1e3, np.maximum(sigma, 0.5 * measured.push))
    sigma = np.where(blind, clipped, sigma)
    if not use_force:
        sigma = np.where(travelled, 1e3, sigma)
    sigma = np.where(measured.present, sigma, model.force_floor)
    push = np.where(measured.present, measured.push, 0.0)
    blocks.append((0, contacts, identity[:k], push - response.force, sigma))

    spread = np.where(
        np.isfinite(measured.sigma_travel), measured.sigma_travel, model.default_travel
    )
    stretch = model.tendon * np.abs(measured.push) * model.tendon_relative
    observed = measured.travel + response.travel_offset - model.tendon * response.force
    design = response.displacement_by + model.tendon * identity[:k]
    sigma = np.sqrt(spread**2 + model.mounting**2 + stretch**2)
    blocks.append(
        (
            1,
            contacts[travelled],
            design[travelled],
            (observed - response.displacement)[travelled],
            sigma[travelled],
        )
    )
    pairs = contacts.repeat(2)
    width = np.full(2 * k, model.slip)
    blocks.append((2, pairs, identity[k : 3 * k], np.zeros(2 * k), width))
    seen = np.isfinite(measured.sigma_tangential) & np.repeat(measured.present, 2)
    sigma = np.hypot(measured.sigma_tangential, model.force_floor)
    missing = measured.tangential - response.reaction
    blocks.append((3, pairs[seen], response.reaction_by[seen], missing[seen], sigma[seen]))
    nobody = np.full(r, -1)
    scale = response.rigid_scale
    outside = np.full(r, model.outside / scale)
    blocks.append((4, nobody, response.rigid_by, -response.rigid_reaction, outside))
    # Without motion data nothing tells a shift: the object stays where it is.
    moving = bool(travelled.any())
    width = np.full(r, model.rigid * scale * (1.0 if moving else 1e-3))
    shift = -response.rigid if moving else np.zeros(r)
    blocks.append((5, nobody, identity[3 * k : 3 * k + r], shift, width))
    stiffness = np.array([np.hypot(model.modulus, model.model) + 1e-9])
    blocks.append((6, np.array([-1]), identity[-1:], np.zeros(1), stiffness))

    weight = 1.0 / np.concatenate([block[4] for block in blocks])
    rows = np.concatenate([block[2] for block in blocks]) * weight[:, None]
    right = np.concatenate([block[3] for block in blocks]) * weight
    kinds = np.concatenate([np.full(len(block[1]), block[0]) for block in blocks])
    owners = np.concatenate([block[1] for block in blocks])
    scaling = 1.0 / np.sqrt(np.einsum('mj,mj->j', rows, rows))
    scaled = rows * scaling
    lower = np.linalg.cholesky(scaled.T @ scaled)
    half = np.linalg.inv(lower).T
    inputs = half @ (half.T @ (scaled.T @ right))
    residual = scaled @ inputs - right
    worst = int(np.argmax(residual**2))
    return _posterior(
        inputs * scaling,
        half * scaling[:, None],
        float(residual @ residual),
        len(right) - j,
        int(kinds[worst]),
        int(owners[worst]),
        measured,
    )
