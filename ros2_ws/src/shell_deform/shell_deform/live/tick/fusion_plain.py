# SPDX-License-Identifier: Apache-2.0
"""The fusion in plain numpy: the oracle of the compiled one, and its stand-in without numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.tick.fusion_types import (
    BALANCE,
    GAUGE,
    MODULUS,
    MOTION,
    SHIFT,
    SLIP,
    TANGENTIAL,
    Array,
    Design,
    LeastSquares,
    Measured,
    Response,
    Widths,
)
from shell_deform.live.tick.sample import FLAG_NO_GAUGE, FLAG_SATURATED


def least_squares(
    use_force: bool, use_travel: bool, widths: Widths, response: Response, measured: Measured
) -> LeastSquares:
    """Most probable inputs of the response; which of gauges and motion count is given."""
    return _solved(_design(use_force, use_travel, widths, response, measured))


def _design(
    use_force: bool, use_travel: bool, widths: Widths, response: Response, measured: Measured
) -> Design:
    k, r = len(response.force), len(response.rigid)
    identity = np.eye(3 * k + r + 1)
    contacts, nobody = np.arange(k), np.full(r, -1)
    travelled = np.isfinite(measured.travel) & measured.present & use_travel
    moving = bool(travelled.any())
    parts = []

    def observe(
        kind: int,
        owners: NDArray[np.int64],
        rows: Array,
        values: Array,
        sigma: Array,
        known: NDArray[np.bool_] | slice = slice(None),
    ) -> None:
        weight = 1.0 / sigma[known]
        owners = owners[known]
        weighted = rows[known] * weight[:, None]
        kinds = np.full(len(owners), kind)
        parts.append(Design(weighted, values[known] * weight, kinds, owners))

    push = np.where(measured.present, measured.push, 0.0)
    sigma = _push_sigma(use_force, travelled, widths, measured)
    observe(GAUGE, contacts, identity[:k], push - response.force, sigma)

    spread = np.where(
        np.isfinite(measured.sigma_travel), measured.sigma_travel, widths.default_travel
    )
    stretch = widths.tendon * np.abs(measured.push) * widths.tendon_relative
    observed = measured.travel + response.travel_offset - widths.tendon * response.force
    rows = response.displacement_by + widths.tendon * identity[:k]
    values = observed - response.displacement
    sigma = np.sqrt(spread**2 + widths.mounting**2 + stretch**2)
    observe(MOTION, contacts, rows, values, sigma, travelled)

    pairs = contacts.repeat(2)
    observe(SLIP, pairs, identity[k : 3 * k], np.zeros(2 * k), np.full(2 * k, widths.slip))
    known = np.isfinite(measured.sigma_tangential) & np.repeat(measured.present, 2)
    sigma = np.hypot(measured.sigma_tangential, widths.force_floor)
    values = measured.tangential - response.reaction
    observe(TANGENTIAL, pairs, response.reaction_by, values, sigma, known)

    sigma = np.full(r, widths.outside / response.rigid_scale)
    observe(BALANCE, nobody, response.rigid_by, -response.rigid_reaction, sigma)
    # Without motion data nothing tells a shift: the object stays where it is.
    sigma = np.full(r, widths.rigid * response.rigid_scale * (1.0 if moving else 1e-3))
    shift = -response.rigid if moving else np.zeros(r)
    observe(SHIFT, nobody, identity[3 * k : 3 * k + r], shift, sigma)
    sigma = np.array([np.hypot(widths.modulus, widths.model) + 1e-9])
    observe(MODULUS, np.array([-1]), identity[-1:], np.zeros(1), sigma)
    return Design(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _push_sigma(
    use_force: bool, travelled: NDArray[np.bool_], widths: Widths, measured: Measured
) -> Array:
    """Sigma of the gauges' pushes (k,) [N]."""
    reported = np.where(np.isfinite(measured.sigma_push), measured.sigma_push, 1e6)
    floor = np.maximum(reported, widths.force_floor)
    sigma = np.sqrt(floor**2 + widths.drift**2 + widths.quantum**2 / 12.0)
    blind = (measured.flags & (FLAG_SATURATED | FLAG_NO_GAUGE)) != 0
    # A clipped gauge is a lower bound; it counts only where nothing else speaks.
    clipped = np.where(travelled, 1e3, np.maximum(sigma, 0.5 * measured.push))
    sigma = np.where(blind, clipped, sigma)
    if not use_force:
        sigma = np.where(travelled, 1e3, sigma)
    return np.where(measured.present, sigma, widths.force_floor)


def _solved(design: Design) -> LeastSquares:
    """By the normal equations, scaled to a unit diagonal."""
    rows, right = design.rows, design.values
    scaling = 1.0 / np.sqrt(np.einsum('mj,mj->j', rows, rows))
    scaled = rows * scaling
    lower = np.linalg.cholesky(scaled.T @ scaled)
    half = np.linalg.inv(lower).T
    inputs = half @ (half.T @ (scaled.T @ right))
    residual = scaled @ inputs - right
    worst = int(np.argmax(residual**2))
    return LeastSquares(
        inputs * scaling,
        half * scaling[:, None],
        float(residual @ residual),
        len(right) - len(inputs),
        int(design.kinds[worst]),
        int(design.contacts[worst]),
    )
