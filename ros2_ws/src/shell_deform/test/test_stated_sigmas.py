# SPDX-License-Identifier: Apache-2.0
"""Sigmas of what is identified and served beside their formulas, with other numbers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from shell_deform.identify import dent_profile
from shell_deform.identify.dent_profile import ThicknessFit, interval_above_zero
from shell_deform.identify.hold_regression import Binned, Mixture, regression, wander
from shell_deform.identify.modulus import (
    SqueezeData,
    cross_validate,
    identify,
    squeeze_data,
    with_thickness,
)
from shell_deform.identify.relaxation import HeldPushes, find_levels
from shell_deform.identify.squeeze_bag import binned
from shell_deform.live.background import shear_dent
from shell_deform.live.background.outer_field import unmodelled
from shell_deform.live.background.shear_dent import ShearDent
from shell_deform.live.tick.adopted import Adopted
from shell_deform.live.tick.at_rest import AtRest
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.fusion_plain import _design, _push_sigma
from shell_deform.live.tick.fusion_types import (
    BALANCE,
    GAUGE,
    MODULUS,
    MOTION,
    SHIFT,
    SLIP,
    TANGENTIAL,
    Measured,
    Response,
)
from shell_deform.live.tick.linearity import linear_error
from shell_deform.live.tick.modulus import CURVED, ModulusFilter
from shell_deform.live.tick.sample import FLAG_CONTACT, FLAG_NO_GAUGE, FLAG_SATURATED

NINETY = 1.6448536269514722


# ---- the modulus from a squeeze


class Spring:
    """A shell that pushes back in proportion to modulus and travel: 4 kN/m at 10 MPa."""

    force_sigma, excess_stiffness = 0.03, 0.2
    shell_object = SimpleNamespace(
        name='spring', young_modulus_pa=10e6, thickness_m=2e-3,
        gas=SimpleNamespace(kind='none', gauge_pressure_pa=0.0, ambient_pa=101_325.0),
    )  # fmt: skip

    def force(self, displacement: np.ndarray, young: float, _gauge: float = 0.0) -> np.ndarray:
        return 4_000.0 * young / 10e6 * displacement


DEPTH = np.linspace(1e-3, 6e-3, 9)


def squeezed(zero: float = 0.15, gain: float = 0.02) -> SqueezeData:
    off = np.array([1, -1, 0, 1, 0, -1, 1, -1, 0.5]) * 0.08
    return SqueezeData(
        5_000.0 * DEPTH + 0.1 + off, DEPTH, np.full(9, 0.1), np.full(9, 3e-5), zero, gain
    )


def test_the_modulus_is_as_sure_as_generalised_least_squares_say() -> None:
    data = squeezed()
    found = identify(Spring(), data)
    young = found.values[0]
    # Per relative change of the modulus; zero and gain, and what the theory may be off, in common.
    by = Spring().force(DEPTH, young)
    sigma = np.hypot(0.1, by / DEPTH * 3e-5)
    spread = np.diag(sigma**2) + 0.15**2 + (0.02**2 + 0.03**2) * np.outer(by, by)
    relative = 1.0 / np.sqrt(by @ np.linalg.solve(spread, by))
    assert found.sigma[0] == pytest.approx(young * relative, rel=2e-3)
    assert young == pytest.approx(12.5e6, rel=0.03)
    left = data.force - found.fitted_force - found.zero_force
    assert abs(found.zero_force) > 0.01
    assert found.reduced_chi_square == pytest.approx(
        ((left / sigma) ** 2).sum() / 8.0 + (found.zero_force / 0.15) ** 2 / 8.0, rel=0.05
    )
    assert found.stiffness_product == pytest.approx(young * 2e-3**2.5)


def test_the_material_lies_anywhere_between_none_and_all_of_the_excess() -> None:
    found = identify(Spring(), squeezed())
    young, sigma = found.values[0], found.sigma[0]
    assert found.solid_modulus == pytest.approx(1.1 * young)
    assert found.solid_sigma == pytest.approx(np.hypot(sigma, 0.2 * young / np.sqrt(12.0)))
    factor = np.exp(NINETY * sigma / young)
    assert found.interval('young_modulus_pa') == pytest.approx((young / factor, young * factor))
    factor = np.exp(NINETY * found.solid_sigma / found.solid_modulus)
    low, high = found.interval('solid_modulus_pa')
    assert (low, high) == pytest.approx(
        (found.solid_modulus / factor, found.solid_modulus * factor)
    )


def test_without_shared_errors_only_noise_and_travel_count() -> None:
    curve = Spring()
    curve.force_sigma = 0.0
    found = identify(curve, squeezed(0.0, 0.0))
    by = curve.force(DEPTH, found.values[0])
    sigma = np.hypot(0.1, by / DEPTH * 3e-5)
    assert found.sigma[0] / found.values[0] == pytest.approx(
        1.0 / np.linalg.norm(by / sigma), rel=2e-3
    )
    assert found.zero_force == 0.0


def test_predicted_forces_stand_on_the_zero_that_the_fit_found() -> None:
    found, told = cross_validate(Spring(), squeezed(), 6)
    assert told == pytest.approx(found.zero_force + Spring().force(DEPTH[6:], found.values[0]))


def test_forces_and_dents_together_trade_modulus_for_thickness() -> None:
    found = identify(Spring(), squeezed())
    fit = ThicknessFit(2e-3, 1e-4, 2.2e-3, 1.2e-4, np.array([5e-3]), 1e-5, 1.0)
    both = with_thickness(found, fit, 2.4)
    young, sigma = found.values[0], found.sigma[0]
    traded = 2.4 * young * 1e-4 / 2e-3
    assert both.sigma == pytest.approx([np.hypot(sigma, traded), 1e-4])
    assert both.correlation[0, 1] == pytest.approx(-traded / np.hypot(sigma, traded))
    assert both.solid_modulus == pytest.approx(found.solid_modulus * (2.0 / 2.2) ** 2.4)
    relative = np.hypot(found.solid_sigma / found.solid_modulus, 2.4 * 1.2e-4 / 2.2e-3)
    assert both.solid_sigma == pytest.approx(both.solid_modulus * relative)
    # 2 (2.2 / 2 - 1) = 0.2 too stiff: 1 - 1 / 1.2.
    assert 'low by up to 17 %' in both.statement[1]


@pytest.mark.parametrize(('relative', 'told'), [(0.24, 'are separable'), (0.26, 'are NOT')])
def test_a_quarter_is_the_limit_of_separable(relative: float, told: str) -> None:
    fit = ThicknessFit(2e-3, relative * 2e-3, 2e-3, 1e-4, np.array([5e-3]), 1e-5, 1.0)
    assert told in with_thickness(identify(Spring(), squeezed()), fit, 2.5).statement[0]


def test_a_table_may_leave_its_sigmas_to_the_options() -> None:
    table = np.array([[1.0, 2e-3, 0.3, 4e-5], [2.0, 4e-3, 0.5, 6e-5]])
    own, given = squeeze_data(table, 9.0, 9.0, 0.1, 0.2), squeeze_data(table[:, :2], 0.7, 8e-5)
    assert own.sigma_force.tolist() == [0.3, 0.5]
    assert own.sigma_displacement.tolist() == [4e-5, 6e-5]
    assert (own.sigma_zero, own.sigma_gain) == (0.1, 0.2)
    assert given.sigma_force.tolist() == [0.7, 0.7]
    assert given.sigma_displacement.tolist() == [8e-5, 8e-5]
    assert (given.sigma_zero, given.sigma_gain) == (0.0, 0.0)


def test_bins_of_a_squeeze_keep_their_sigma_and_part_the_gain_from_it() -> None:
    travel = np.linspace(0.0, 12e-3, 1_200, endpoint=False) + 5e-6
    force = 1_000.0 * travel
    sigma = np.hypot(0.3, 0.02 * force)
    data = binned(travel, force, sigma, np.full(1_200, 7e-5))
    assert data is not None
    # Twelve bins, of which the first is left out.
    assert data.displacement == pytest.approx(1e-3 * (np.arange(1, 12) + 0.5), rel=1e-3)
    assert data.force == pytest.approx(1_000.0 * data.displacement)
    assert data.sigma_displacement == pytest.approx(np.full(11, 7e-5))
    gain = np.min(np.hypot(0.3, 0.02 * data.force) / data.force)
    assert data.sigma_gain == pytest.approx(gain, rel=1e-3)
    own = np.sqrt(np.maximum(0.09 + (0.02**2 - gain**2) * data.force**2, 0.05**2))
    assert data.sigma_force == pytest.approx(own, rel=0.02)


def test_the_interval_of_what_is_fitted_as_a_logarithm_is_even_in_it() -> None:
    low, high = interval_above_zero(2.0, 0.5)
    assert np.log(high / 2.0) == pytest.approx(NINETY * 0.25)
    assert low * high == pytest.approx(4.0)


def test_a_ring_is_as_sure_as_its_sectors_scatter_and_never_surer_than_its_points() -> None:
    sector = np.repeat(np.arange(4), 5)
    level = np.array([1.0, -1.0, 2.0, 0.0])
    found = dent_profile._mean_sigma(level[sector], sector, 1e-3)
    assert found == pytest.approx(np.std(level, ddof=1) / 2.0)
    assert dent_profile._mean_sigma(np.zeros(20), sector, 0.3) == pytest.approx(0.3 / np.sqrt(20))
    assert dent_profile._mean_sigma(np.zeros(20), sector % 2, 0.3) == 0.3


# ---- relaxation


def test_a_line_whose_slope_walks_varies_with_the_third_power_of_the_way() -> None:
    assert wander(np.array(2.0), np.array(2.0)) == pytest.approx(8.0 / 3.0)
    assert wander(np.array(3.0), np.array(1.0)) == pytest.approx((9.0 - 1.0) / 6.0)
    assert wander(np.array(0.0), np.array(5.0)) == 0.0
    # By its definition: the integral of (s - u)(t - u) over u from 0 to the smaller.
    u = (np.arange(20_000) + 0.5) * 1e-4
    integral = np.sum((2.0 - u) * (3.5 - u)) * 1e-4
    assert wander(np.array(2.0), np.array(3.5)) == pytest.approx(integral, rel=1e-6)


def bins(drift: float = 0.05) -> Binned:
    time = np.geomspace(1.0, 300.0, 12)
    push = 10.0 * (1.0 - 0.04 * np.log10(time / 0.5))
    return Binned(
        time, push, np.full(12, 0.02**2), np.zeros(12, np.int64), np.array([0.0]), 0.5, drift
    )


def test_the_share_a_decade_is_as_sure_as_the_noise_and_walk_of_the_gauge_let_it() -> None:
    data = bins()
    found = regression(data, walks=2.0)
    rate, step = found.values
    decades = np.log10(data.time / 0.5)
    assert (rate, step) == pytest.approx((0.04, 10.0), rel=1e-2)
    walk = (2.0 * 0.05) ** 2 / 60.0 * np.minimum.outer(data.time, data.time)
    spread = np.diag(data.spread) + walk
    by = np.column_stack((-decades * step, 1.0 - rate * decades))
    information = by.T @ np.linalg.solve(spread, by) + np.diag([1.0 / 0.3**2, 0.0])
    assert found.covariance == pytest.approx(np.linalg.inv(information), rel=1e-6)
    mean, variance = found.share(2.0)
    assert (mean, variance) == pytest.approx((rate, found.covariance[0, 0]))


def test_a_reading_later_walks_on_and_a_force_does_not() -> None:
    data = bins()
    found = regression(data, walks=2.0)
    push, sure = found.push(3_000.0, 0, read=False)
    rate, step = found.values
    by = np.array([-np.log10(6_000.0) * step, 1.0 - rate * np.log10(6_000.0)])
    assert push == pytest.approx(step * by[1])
    assert sure == pytest.approx(by @ found.covariance @ by)
    # The walk from the last bin on comes on top of what it was there.
    last = found.push(300.0, 0, read=True)[1]
    read = found.push(3_000.0, 0, read=True)[1]
    assert read > (2.0 * 0.05) ** 2 / 60.0 * 2_700.0
    assert read > sure > last


def test_half_of_the_interval_of_a_mixture_is_ninety_percent() -> None:
    parts = [SimpleNamespace(mean=0.0, sigma=1.0), SimpleNamespace(mean=0.0, sigma=3.0)]
    mixed = Mixture(parts, np.array([1.0, 0.0]))
    ask = lambda part: (part.mean, part.sigma**2)  # noqa: E731
    assert mixed.told(ask) == pytest.approx((0.0, 1.0), abs=1e-6)
    both = Mixture(parts, np.array([0.5, 0.5])).told(ask)[1]
    assert 1.0 < both < 3.0


def test_rounding_that_noise_does_not_dither_stays_in_a_mean() -> None:
    empty = np.zeros((1, 1))
    held = HeldPushes(np.zeros(1), empty, empty, 0.05, 0.2, 0.02)
    expected = 0.2 / (np.sqrt(2.0) * np.pi) * np.exp(-2.0 * (np.pi * 0.05 / 0.2) ** 2)
    assert held.stuck == pytest.approx(expected)


def test_a_level_stands_for_five_seconds_within_a_tenth_of_a_millimetre() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    travel = np.where(time < 2.0, 1e-3 * time, 2e-3)[:, None]
    (level,) = find_levels(HeldPushes(time, travel, travel, 0.1, 0.2, 0.02))
    assert level.began == pytest.approx(1.0, abs=0.15)
    # Three times the two seconds of the ramp after it came to rest.
    assert level.first == pytest.approx(2.0 + 3.0 * 2.0, abs=0.5)
    assert level.last == pytest.approx(19.9)
    short = time < 6.8
    assert find_levels(HeldPushes(time[short], travel[short], travel[short], 0.1, 0.2, 0.02)) == ()


# ---- the modulus while it is squeezed

ERRORS = ErrorModel(
    force_floor=0.02, drift=0.3, quantum=0.5, tendon=1e-4, tendon_relative=0.4, mounting=6e-5,
    slip=2e-4, rigid=4e-3, outside=0.6, modulus=0.06, model=0.04, default_travel=3e-5, mesh=0.5,
)  # fmt: skip


def one_contact(force: float = 5.0) -> Response:
    """One contact that gives way by 1 mm/N, 1 mm less per relative modulus and newton."""
    by = np.array([[1e-3, 2e-4, -3e-4, -1e-3 * force]])
    return Response(
        force=np.array([force]), displacement=np.array([4e-3]), travel_offset=np.array([1e-4]),
        rigid=np.zeros(0), rigid_scale=25.0, reaction=np.zeros(2), lateral=np.eye(3)[:2],
        rigid_reaction=np.zeros(0), displacement_by=by, reaction_by=np.zeros((2, 4)),
        rigid_by=np.zeros((0, 4)),
    )  # fmt: skip


def felt(push: float, travel: float, **changes: object) -> Measured:
    values = Measured(
        finger=np.array([2]), flags=np.array([FLAG_CONTACT]), present=np.array([True]),
        push=np.array([push]), sigma_push=np.array([0.1]), travel=np.array([travel]),
        sigma_travel=np.array([5e-5]), tangential=np.zeros(2), sigma_tangential=np.full(2, np.inf),
    )  # fmt: skip
    return values._replace(**changes)


def test_one_sample_moves_the_modulus_as_bayes_says() -> None:
    learning, response, seen = ModulusFilter(8e6, ERRORS), one_contact(), felt(6.0, 4.3e-3)
    inputs = np.array([9.0, 1e-3, -2e-3, 9.0])
    assert learning.update(response, inputs, seen)
    stretch = 1e-4 * 6.0
    moved = 4.3e-3 + 1e-4 - stretch - 4e-3 - (2e-4 * 1e-3 + 3e-4 * 2e-3)
    beyond, growth = 1_000.0 * moved, 5.0
    noise = 0.1**2 + 0.3**2 + 0.5**2 / 12.0
    noise += (1_000.0 * np.hypot(5e-5, 0.4 * stretch)) ** 2 + (CURVED * beyond) ** 2
    by = np.array([growth, 1.0, 1_000.0])
    prior = np.diag([1.0, 0.3**2, 6e-5**2])
    covariance = np.linalg.inv(np.linalg.inv(prior) + np.outer(by, by) / noise)
    mean = covariance @ by * (6.0 - 5.0 - beyond) / noise
    found = learning.estimate
    assert found.samples == 1
    assert found.value == pytest.approx(8e6 * (1.0 + mean[0]))
    spread = np.hypot(np.sqrt(covariance[0, 0]), (1.0 + mean[0]) * 0.04)
    assert found.sigma == pytest.approx(8e6 * spread)


def test_a_sample_counts_when_the_push_has_grown_by_its_sigma() -> None:
    learning, response = ModulusFilter(8e6, ERRORS), one_contact()
    sigma = np.sqrt(0.1**2 + 0.3**2 + 0.5**2 / 12.0)
    assert learning.update(response, np.zeros(4), felt(6.0, 4.3e-3))
    assert not learning.update(response, np.zeros(4), felt(6.0 + 0.99 * sigma, 4.3e-3))
    assert learning.update(response, np.zeros(4), felt(6.0 + 1.01 * sigma, 4.3e-3))
    assert learning.estimate.samples == 2


# ---- the fusion of a tick


def test_a_push_is_as_sure_as_gauge_drift_and_count() -> None:
    rows = np.array([0.005, 0.4, np.inf])
    plain = np.sqrt(np.array([0.02, 0.4, 1e6]) ** 2 + 0.3**2 + 0.5**2 / 12.0)
    assert ERRORS.push_sigma(rows) == pytest.approx(plain)
    many = Measured(
        finger=np.arange(6), flags=np.array([1, 1, 1 | FLAG_SATURATED, 1 | FLAG_NO_GAUGE, 1, 1]),
        present=np.array([True, True, True, True, True, False]),
        push=np.array([1.0, 2.0, 9.0, 0.2, 3.0, 4.0]), sigma_push=np.full(6, 0.4),
        travel=np.zeros(6), sigma_travel=np.zeros(6), tangential=np.zeros(12),
        sigma_tangential=np.zeros(12),
    )  # fmt: skip
    travelled = np.array([True, False, False, False, True, False])
    usual = plain[1]
    found = _push_sigma(True, travelled, ERRORS.widths, many)
    assert found == pytest.approx([usual, usual, 4.5, usual, usual, 0.02])
    by_motion = _push_sigma(False, travelled, ERRORS.widths, many)
    assert by_motion == pytest.approx([1e3, usual, 4.5, usual, 1e3, 0.02])


def test_every_observation_of_a_tick_weighs_by_its_own_width() -> None:
    response = replace_rigid(one_contact())
    seen = felt(6.0, 4.3e-3, tangential=np.array([0.2, 0.3]), sigma_tangential=np.full(2, 0.05))
    design = _design(True, True, ERRORS.widths, response, seen)
    size = {}
    for kind, row in zip(design.kinds.tolist(), design.rows, strict=True):
        size[kind] = row
    gauge = np.sqrt(0.1**2 + 0.3**2 + 0.5**2 / 12.0)
    assert size[GAUGE] == pytest.approx(np.eye(5)[0] / gauge)
    motion = np.sqrt(5e-5**2 + 6e-5**2 + (1e-4 * 6.0 * 0.4) ** 2)
    rows = response.displacement_by[0] + [1e-4, 0, 0, 0, 0]
    assert size[MOTION] == pytest.approx(rows / motion)
    value = 4.3e-3 + 1e-4 - 1e-4 * 5.0 - 4e-3
    assert design.values[design.kinds == MOTION] == pytest.approx(value / motion)
    assert design.values[design.kinds == GAUGE] == pytest.approx(1.0 / gauge)
    assert size[SLIP] == pytest.approx(np.eye(5)[2] / 2e-4)
    assert size[TANGENTIAL] == pytest.approx(response.reaction_by[1] / np.hypot(0.05, 0.02))
    assert design.values[design.kinds == TANGENTIAL] == pytest.approx(
        (np.array([0.2, 0.3]) - response.reaction) / np.hypot(0.05, 0.02)
    )
    assert size[BALANCE] == pytest.approx(response.rigid_by[0] * 25.0 / 0.6)
    assert design.values[design.kinds == BALANCE] == pytest.approx(-0.7 * 25.0 / 0.6)
    assert size[SHIFT] == pytest.approx(np.eye(5)[3] / (4e-3 * 25.0))
    assert design.values[design.kinds == SHIFT] == pytest.approx(-0.02 / (4e-3 * 25.0))
    assert size[MODULUS] == pytest.approx(np.eye(5)[4] / np.hypot(0.06, 0.04), rel=1e-6)


def replace_rigid(response: Response) -> Response:
    """The same with one free motion of the body and lateral reactions."""
    by = np.array([[1e-3, 2e-4, -3e-4, 4e-3, -5e-3]])
    return response._replace(
        rigid=np.array([0.02]), rigid_reaction=np.array([0.7]), displacement_by=by,
        reaction=np.array([0.1, -0.1]), reaction_by=np.arange(10.0).reshape(2, 5) + 1.0,
        rigid_by=np.array([[0.1, 0.2, 0.3, 0.4, 0.5]]),
    )  # fmt: skip


def test_without_motion_the_object_stays_where_it_is() -> None:
    still = felt(6.0, np.nan)
    design = _design(True, True, ERRORS.widths, replace_rigid(one_contact()), still)
    (row,) = design.rows[design.kinds == SHIFT]
    assert row[3] == pytest.approx(1.0 / (4e-3 * 25.0 * 1e-3))
    assert design.values[design.kinds == SHIFT] == pytest.approx(0.0)
    unknown = felt(6.0, 4.3e-3, sigma_travel=np.array([np.nan]))
    design = _design(True, True, ERRORS.widths, one_contact(), unknown)
    motion = np.sqrt(3e-5**2 + 6e-5**2 + (1e-4 * 6.0 * 0.4) ** 2)
    (row,) = design.rows[design.kinds == MOTION]
    assert row[0] == pytest.approx((1e-3 + 1e-4) / motion)


def test_a_coarse_mesh_adds_to_what_the_theory_is_off() -> None:
    coarse = ERRORS.on_mesh(np.array([0.02, 0.1]))
    assert coarse.model == pytest.approx(np.hypot(0.04, 0.5 * 0.1))
    assert ERRORS.on_mesh(np.zeros(0)).model == pytest.approx(0.04)


# ---- what linear theory misses

REST = AtRest(
    np.array([1]), np.array([[1e-3]]), np.array([[1e-4]]), np.zeros((1, 3, 1)), np.eye(3)[:2],
    np.array([2e-4]), np.zeros(1),
)  # fmt: skip


def test_linear_theory_misses_what_the_second_order_says() -> None:
    # w = a F + b F^2 at 2 N: q = (b / a^2) w = 0.2 of the linear depth.
    missed = 1.0 - 1.0 / (1.0 + 0.2 + 0.02)
    assert linear_error(REST.compliance, REST.second_order, np.array([2.0])) == pytest.approx(
        missed
    )
    deeper = 1.0 - 1.0 / (1.0 + 0.3 + 0.045)
    found = REST.linearisation_error(np.array([2.0]), np.array([3e-3]))
    assert found == pytest.approx(deeper)
    assert linear_error(REST.compliance, -REST.second_order, np.array([2.0])) == pytest.approx(0.2)
    assert REST.error(np.array([2e-3])) == pytest.approx(missed * 2e-3)


def test_gauges_widen_by_what_linear_theory_invents_of_the_motion() -> None:
    wide = REST.widened(felt(2.0, 1.8e-3))
    missed = 1.0 - 1.0 / 1.22
    assert wide.sigma_push == pytest.approx([np.hypot(0.1, missed * 2.0)])
    assert REST.widened(felt(2.0, np.nan)).sigma_push == pytest.approx([0.1])


def test_a_first_dent_is_in_doubt_by_what_is_missed_and_by_what_was_seen_otherwise() -> None:
    missed = 1.0 - 1.0 / 1.22
    assert REST.doubt(np.array([2.0]), felt(2.0, 1.8e-3), True) == pytest.approx(missed * 2e-3)
    # The encoders say 5 mm where the push says 2.
    assert REST.doubt(np.array([2.0]), felt(2.0, 4.8e-3), True) == pytest.approx(3e-3)
    assert REST.doubt(np.zeros(1), felt(0.0, 0.0), False) == 0.0


def stepped(**changes: object) -> Adopted:
    """A result whose second order was measured over 1 mm along one contact's way."""
    known = Adopted.__new__(Adopted)
    values = {
        'bend_direction': np.array([1.0]), 'bend_offset': 1e-3, 'bend_reach': 1e-3,
        'third_reach': 2e-3, 'worst_bend': 10.0, 'worst_third': 1e3,
    }  # fmt: skip
    known.__dict__.update(values | changes)
    return known


def cube(step: float) -> float:
    return step**3 / (1.0 + abs(step) / 2e-3)


def test_the_second_order_serves_along_its_way_as_far_as_three_steps() -> None:
    value, error, third = stepped().bend(np.array([2e-3]))
    assert (value, error) == pytest.approx((3e-3**2 - 1e-3**2, 0.0))
    assert third == pytest.approx(cube(3e-3) - cube(1e-3))
    value, error, _ = stepped().bend(np.array([-5e-3]))
    assert (value, error) == pytest.approx((2e-3**2 - 1e-3**2, 5e-3**2 - 3e-3**2))
    expected = 10.0 * error + 1e3 * abs(cube(-4e-3) - cube(1e-3))
    assert stepped().linearisation_error(np.array([-5e-3])) == pytest.approx(expected)


def test_without_a_way_all_of_the_second_order_is_error() -> None:
    value, error, third = stepped(bend_direction=np.zeros(1)).bend(np.array([-2e-3]))
    assert (value, error) == pytest.approx((0.0, 3e-3**2 - 1e-3**2))
    assert third == pytest.approx(cube(3e-3) - cube(1e-3))


def test_gauges_of_a_tangent_widen_with_the_square_of_its_step_up_to_a_newton() -> None:
    known = stepped(push_bend=np.array([-2e5]), response=one_contact())
    step = 4.3e-3 + 1e-4 - 4e-3
    wide = known.widened(felt(6.0, 4.3e-3)).sigma_push
    assert wide == pytest.approx([np.hypot(0.1, 2e5 * step**2)])
    assert known.widened(felt(6.0, 9e-3)).sigma_push == pytest.approx([np.hypot(0.1, 1.0)])
    absent = felt(6.0, 9e-3, present=np.array([False]))
    assert known.widened(absent).sigma_push == pytest.approx([0.1])


# ---- what no shell has beside a pin


def test_the_edge_of_a_stamp_is_in_doubt_within_two_walls_of_it() -> None:
    patch = SimpleNamespace(point=np.zeros(3), radius=1e-3)
    x = np.array([0.0, 1e-3, 3e-3, 4e-3, 5e-3, 6e-3])
    places = np.column_stack((x, np.zeros((6, 2))))
    full = 0.055 * 2e-3 * 1.5 / (1.5 + 0.6)
    found = unmodelled(places, 2e-3, (patch,), np.array([3e-3]))
    assert found == pytest.approx(full * np.array([1.0, 1.0, 1.0, 0.5, 0.0, 0.0]))
    deeper = unmodelled(places, 2e-3, (patch, patch), np.array([3e-3, 6e-3]))
    assert deeper == pytest.approx(found * (3.0 / 3.6) / (1.5 / 2.1))
    assert not unmodelled(places, 2e-3, (patch,), np.array([-1e-3])).any()


def test_what_a_thin_wall_lacks_is_the_shear_dent_of_its_pins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A wall of 2 mm and 4 MPa of shear whose radius is 32 mm: a dent reaches 8 mm.
    membrane = np.zeros((2, 3, 3))
    membrane[:, 2, 2] = 4e6 * 2e-3
    shell = SimpleNamespace(membrane=membrane, thickness=np.full(2, 2e-3))
    monkeypatch.setattr(shear_dent, 'wall_ratio', lambda _model: 1.0 / 16.0)
    box = np.array([[0.0, 0.0, 0.0], [0.05, 0.06, 0.04]])
    known = ShearDent(SimpleNamespace(shell=shell, rest=box))
    force, radius = np.array([10.0, 20.0]), np.array([1e-3, 20e-3])
    lost = force / (2.0 * np.pi * 5.0 / 6.0 * 8e3) * np.array([np.log(8.0) + 0.5, 0.5])
    assert known.travel(force, radius) == pytest.approx(lost)
    monkeypatch.setattr(shear_dent, 'wall_ratio', lambda _model: 0.0)
    flat = ShearDent(SimpleNamespace(shell=shell, rest=box)).travel(force, radius)
    assert flat / lost == pytest.approx((np.log([60.0, 3.0]) + 0.5) / (np.log([8.0, 1.0]) + 0.5))
    # Each pin moves its own vertex by 2 mm/N and goes in by 1 mm/N; along the surface, that is
    # no error of its shape.
    columns = np.zeros((3, 3, 2))
    columns[0, 2, 0] = columns[1, 0, 1] = columns[2, 1, 1] = 2e-3
    normals = np.array([[0.0, 0.6, -0.8], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = known.sigma(force, radius, columns, 1e-3 * np.eye(2), normals)
    assert found == pytest.approx([2.0 * 0.8 * lost[0], 2.0 * lost[1], 0.0])
    nobody = np.zeros(0)
    free = known.sigma(nobody, nobody, columns[..., :0], np.zeros((0, 0)), normals)
    assert free.shape == (3,)
