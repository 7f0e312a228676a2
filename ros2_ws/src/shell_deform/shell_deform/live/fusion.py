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

from shell_deform.live.sample import FLAG_NO_GAUGE, FLAG_SATURATED

Array = NDArray[np.float64]

DRIVES = ('force', 'motion', 'fused')


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
        inputs: (j,) away from the equilibrium. root: (j, j) lower root of their covariance.
        contradiction: root mean square of the normalised residuals over the degrees of freedom.
        suspect: the observation that strains most: '', 'gauge of finger 1', 'modulus', ...
    """

    inputs: Array
    root: Array
    contradiction: float
    suspect: str


def fuse(model: ErrorModel, response: Response, measured: Measured) -> Posterior:
    """Most probable inputs under all observations and priors."""
    k, r = len(response.force), len(response.rigid)
    j = 3 * k + r + 1
    rows: list[Array] = []
    values: list[Array] = []
    sigmas: list[Array] = []
    names: list[tuple[str, NDArray[np.int64]]] = []
    finger, nobody = measured.finger, np.zeros(0, np.int64)
    identity = np.eye(j)

    use_force = model.drive != 'motion'
    use_travel = model.drive != 'force'
    blind = (measured.flags & (FLAG_SATURATED | FLAG_NO_GAUGE)) != 0
    travelled = np.isfinite(measured.travel) & measured.present & use_travel
    sigma = model.push_sigma(measured.sigma_push)
    # A clipped gauge is a lower bound; it counts only where nothing else speaks.
    sigma = np.where(
        blind, np.where(travelled, 1e3, np.maximum(sigma, 0.5 * measured.push)), sigma
    )
    if not use_force:
        sigma = np.where(travelled, 1e3, sigma)
    sigma = np.where(measured.present, sigma, model.force_floor)
    rows.append(identity[:k])
    values.append(np.where(measured.present, measured.push, 0.0) - response.force)
    sigmas.append(sigma)
    names.append(('gauge of finger', finger))

    if travelled.any():
        spread = np.where(
            np.isfinite(measured.sigma_travel), measured.sigma_travel, model.default_travel
        )
        stretch = model.tendon * np.abs(measured.push) * model.tendon_relative
        observed = (
            measured.travel + response.travel_offset - model.tendon * response.force
        ) - response.displacement
        rows.append((response.displacement_by + model.tendon * identity[:k])[travelled])
        values.append(observed[travelled])
        sigmas.append(np.sqrt(spread**2 + model.mounting**2 + stretch**2)[travelled])
        names.append(('motion of finger', finger[travelled]))

    rows.append(identity[k : 3 * k])
    values.append(np.zeros(2 * k))
    sigmas.append(np.full(2 * k, model.slip))
    names.append(('slip of finger', finger.repeat(2)))

    seen = np.isfinite(measured.sigma_tangential) & np.repeat(measured.present, 2)
    if seen.any():
        rows.append(response.reaction_by[seen])
        values.append((measured.tangential - response.reaction)[seen])
        sigmas.append(np.hypot(measured.sigma_tangential, model.force_floor)[seen])
        names.append(('tangential force of finger', finger.repeat(2)[seen]))

    if r:
        scale = response.rigid_scale
        rows.append(response.rigid_by)
        values.append(-response.rigid_reaction)
        sigmas.append(np.full(r, model.outside / scale))
        names.append(('balance of the forces', nobody))
        rows.append(identity[3 * k : 3 * k + r])
        # Without motion data nothing tells a shift: the object stays where it is.
        free = model.rigid if travelled.any() else 1e-3 * model.rigid
        values.append(-response.rigid if travelled.any() else np.zeros(r))
        sigmas.append(np.full(r, free * scale))
        names.append(('shift of the object', nobody))

    rows.append(identity[-1:])
    values.append(np.zeros(1))
    sigmas.append(np.array([np.hypot(model.modulus, model.model) + 1e-9]))
    names.append(('modulus', nobody))

    weight = 1.0 / np.concatenate(sigmas)
    design = np.concatenate(rows) * weight[:, None]
    right = np.concatenate(values) * weight
    scale_inputs = 1.0 / np.sqrt(np.einsum('mj,mj->j', design, design))
    scaled = design * scale_inputs
    covariance = np.linalg.inv(scaled.T @ scaled)
    inputs = covariance @ (scaled.T @ right)
    residual = scaled @ inputs - right
    freedom = max(1, len(right) - j)
    contradiction = float(np.sqrt(residual @ residual / freedom))
    root = np.linalg.cholesky(0.5 * (covariance + covariance.T)) * scale_inputs[:, None]
    return Posterior(
        inputs * scale_inputs,
        root,
        contradiction,
        _suspect(residual, values, names) if contradiction > 1.0 else '',
    )


def _suspect(
    residual: Array, values: list[Array], names: list[tuple[str, NDArray[np.int64]]]
) -> str:
    """Name of the observation with the largest normalised residual."""
    worst = int(np.argmax(np.abs(residual)))
    for (name, owners), block in zip(names, values, strict=True):
        if worst < len(block):
            return f'{name} {owners[worst]}' if len(owners) else name
        worst -= len(block)
    return ''
