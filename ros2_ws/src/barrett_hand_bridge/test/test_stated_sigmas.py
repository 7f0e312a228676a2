# SPDX-License-Identifier: Apache-2.0
"""Every stated sigma of the driver beside its formula, written out with other numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from barrett_hand_bridge.calibration import NO_GAUGE, GaugeCalibration
from barrett_hand_bridge.contacts import (
    FLAG_CONTACT,
    FLAG_NOT_TARED,
    FLAG_SATURATED,
    TouchSettings,
    TouchTracker,
    normal_force,
)
from barrett_hand_bridge.fit import Weighing, fit_gauge
from barrett_hand_bridge.hand import HandSample
from barrett_hand_bridge.observer import HandObserver, ObserverSettings
from barrett_hand_bridge.tare import ExpectedZero, take_zero
from barrett_hand_bridge.tendon import Squeezing, TendonPlay
from barrett_hand_bridge.zero import DriftModel, ZeroTracker

QUANTISATION = 1.0 / math.sqrt(12.0)
MODEL = DriftModel(0.3, 0.2, slope_decay_minutes=12.0, floor_counts=0.07)
NORMAL = np.array([1.0, 0.0, 0.0])


# ---- the zero


def tared(sigma: float = 0.1, doubt: float = 0.0) -> ZeroTracker:
    zero = ZeroTracker(MODEL)
    zero.tare(120.0, sigma, 30.0, doubt)
    return zero


def test_a_zero_left_alone_walks_and_slopes() -> None:
    zero = tared()
    zero.advance(30.0 + 600.0)
    carried = 12.0 * (1.0 - math.exp(-10.0 / 12.0))
    variance = 0.1**2 + 0.07**2 + (0.2 * carried) ** 2 + 0.3**2 * 10.0
    assert zero.drift_sigma_counts == pytest.approx(math.sqrt(variance), rel=1e-12)


def test_the_slope_dies_away_and_walks_too() -> None:
    zero = tared()
    for time_s in (330.0, 930.0):
        zero.advance(time_s)
    first, second = 12.0 * (1.0 - np.exp(-np.array([5.0, 10.0]) / 12.0))
    slope = 0.2**2 * math.exp(-10.0 / 12.0) + (0.05 * 0.2) ** 2 * 5.0
    common = 0.2**2 * math.exp(-5.0 / 12.0) * first
    variance = 0.1**2 + 0.07**2 + (0.2 * first) ** 2 + 0.3**2 * 15.0
    variance += 2.0 * second * common + second**2 * slope
    assert zero.drift_sigma_counts == pytest.approx(math.sqrt(variance), rel=1e-12)


def test_a_zero_does_not_grow_surer_backwards_in_time() -> None:
    zero = tared()
    before = zero.sigma_counts
    zero.advance(10.0)
    assert zero.sigma_counts == before


def block(zero: ZeroTracker, counts: float, start: float = 31.0, **posture: object) -> bool:
    """One block: 101 readings in one second."""
    adopted = [zero.free_reading(counts, 0.5, start + 0.01 * i, **posture) for i in range(101)]
    return any(adopted)


@pytest.mark.parametrize('off', [0.1, -0.35])
def test_a_reading_moves_the_zero_by_the_gain_of_a_fading_filter(off: float) -> None:
    zero, alone = tared(), tared()
    alone.advance(32.0)
    block(zero, 120.0 + off)
    before, reading = alone.drift_sigma_counts**2, (0.5**2 + 1.0 / 12.0) / 101 + 0.07**2
    misfit = max(1.0, 1.0 + 0.1 * (off**2 / (before + reading) - 1.0))
    gain = misfit * before / (misfit * before + reading)
    assert (misfit > 1.0) is (off < 0.0)
    assert zero.counts == pytest.approx(120.0 + gain * off, rel=1e-9)
    assert zero.drift_sigma_counts**2 == pytest.approx(misfit * before * (1.0 - gain), rel=1e-9)
    # From then on drift is taken for as much larger.
    zero.advance(92.0)
    grown = zero.drift_sigma_counts**2 - misfit * before * (1.0 - gain)
    assert grown > misfit * 0.3**2


def test_a_zero_that_behaves_again_is_believed_again() -> None:
    zero, calm = tared(), tared()
    block(zero, 120.35)
    for second in range(60):
        for one in (zero, calm):
            block(one, one.counts, start=33.0 + 1.5 * second)
    assert zero.drift_sigma_counts == pytest.approx(calm.drift_sigma_counts, rel=0.02)


def test_an_adopted_step_is_as_sure_as_its_block_and_in_doubt_by_its_size() -> None:
    zero = tared()
    assert not block(zero, 125.0, steps_counts=(-9.0, 9.0))
    assert block(zero, 125.0, start=33.0, steps_counts=(-9.0, 9.0))
    own = math.sqrt((0.5**2 + 1.0 / 12.0) / 101 + 0.07**2)
    assert zero.counts == pytest.approx(125.0, abs=1e-9)
    assert zero.drift_sigma_counts == pytest.approx(own, rel=1e-9)
    assert zero.sigma_counts == pytest.approx(math.hypot(own, 5.0), rel=1e-9)


def test_the_doubts_of_a_tare_and_of_a_step_add_in_squares() -> None:
    zero = tared(doubt=3.0)
    for start in (31.0, 33.0):
        block(zero, 124.0, start=start, steps_counts=(-9.0, 9.0))
    assert zero.doubt_counts == pytest.approx(5.0, rel=1e-9)


@pytest.mark.parametrize(('way', 'ends'), [(4.9e-3, False), (5.1e-3, True)])
def test_five_millimetres_end_a_doubt(way: float, ends: bool) -> None:
    zero = tared(doubt=3.0)
    block(zero, 120.0, place=np.zeros(3))
    block(zero, 120.0, start=33.0, place=way * NORMAL)
    assert (zero.doubt_counts == 0.0) is ends


# ---- the tare

GAUGE = GaugeCalibration('cubic', coefficients_nm=(-1.2, 0.01), no_load_counts=(100.0, 140.0))
GAUGES = {1: GAUGE, 2: NO_GAUGE, 3: NO_GAUGE}


def outcome(known: ExpectedZero, counts: int = 120, gauge: GaugeCalibration = GAUGE) -> object:
    still = [
        HandSample(10_000_000 * i, (5000, 5000, 0), 1575, (counts, None, None)) for i in range(100)
    ]
    return take_zero(still, GAUGES | {1: gauge}, {1: known})


@pytest.mark.parametrize('sign', [-1.0, 1.0])
@pytest.mark.parametrize(('off', 'loaded'), [(2.9, False), (3.1, True)])
def test_a_touching_finger_is_loaded_beyond_five_sigma_and_a_count_and_a_half(
    sign: float, off: float, loaded: bool
) -> None:
    refused = outcome(ExpectedZero(120.0 - sign * off, 0.3, True)).refusal
    assert ('is loaded' in refused) is loaded


@pytest.mark.parametrize(('off', 'loaded'), [(4.9, False), (5.1, True)])
def test_what_rose_by_more_than_a_gauge_plays_since_the_hand_stood_open_is_a_load(
    off: float, loaded: bool
) -> None:
    found = outcome(ExpectedZero(120.0 - off, 0.3, False, tared=False, doubt_counts=1.0))
    assert ('since it stood open' in found.refusal) is loaded
    if not loaded:
        assert found.zeros[1].doubt_counts == pytest.approx(math.hypot(1.0, off))


@pytest.mark.parametrize(
    ('counts', 'taken'), [(99, False), (100, True), (140, True), (141, False)]
)
def test_the_ends_of_the_unloaded_band_belong_to_it(counts: int, taken: bool) -> None:
    assert bool(outcome(ExpectedZero(None, 0.0, False), counts).zeros) is taken


# ---- the calibration


def test_a_straight_law_says_how_well_its_slope_is_known() -> None:
    torque = np.linspace(-1.0, 1.0, 9)
    off = 0.3 * np.array([1, -1, 1, -1, 0, 1, -1, 1, -1.0])
    fit = fit_gauge(
        [Weighing(t, 120.0 + 100.0 * t + d, 1.5) for t, d in zip(torque, off, strict=True)],
        degree=1,
    )
    counts = 120.0 + 100.0 * torque + off
    design = np.column_stack((np.ones(9), counts))
    law, (left,), _, _ = np.linalg.lstsq(design, torque, rcond=None)
    student = 1.894579 / 1.644854
    scatter = max(student * math.sqrt(left / 7.0), 0.5 * 1.5 * 2.0 / np.ptp(counts))
    inverse = np.linalg.inv(design.T @ design)
    largest = design[0]
    assert fit.gauge.coefficients_nm == pytest.approx(law)
    assert fit.gauge.residual_nm == pytest.approx(scatter, rel=1e-5)
    assert fit.gauge.relative_sigma == pytest.approx(
        scatter * math.sqrt(largest @ inverse @ largest) / 1.0, rel=1e-5
    )
    assert fit.gauge.noise_counts == pytest.approx(math.sqrt(1.5**2 - 1.0 / 12.0))
    wide = 0.1 / fit.gauge.slope(120.0, 120.0)
    assert fit.gauge.no_load_counts == pytest.approx((120.0 - wide, 120.0 + wide))
    assert fit.gauge.valid_torque_nm == 1.0


def test_readings_quieter_than_a_count_have_no_noise_beside_their_rounding() -> None:
    torque = np.linspace(0.0, 1.0, 6)
    quiet = fit_gauge([Weighing(t, 120.0 + 100.0 * t, 0.2) for t in torque])
    assert quiet.gauge.noise_counts == 0.0


def test_a_table_is_as_sure_as_its_neighbours_tell_and_its_span_is_long() -> None:
    torque = np.linspace(0.0, 1.0, 5)
    off = np.array([0.0, 2.0, -2.0, 2.0, 0.0])
    table = fit_gauge(
        [Weighing(t, 100.0 + 80.0 * t + d, 0.0) for t, d in zip(torque, off, strict=True)],
        kind='table',
    ).gauge
    counts = 100.0 + 80.0 * torque + off
    told = np.array(
        [np.interp(counts[k], counts[[k - 1, k + 1]], torque[[k - 1, k + 1]]) for k in (1, 2, 3)]
    )
    student = 2.353363 / 1.644854
    scatter = student * math.sqrt(np.mean((told - torque[1:-1]) ** 2))
    assert table.residual_nm == pytest.approx(scatter, rel=1e-5)
    assert table.relative_sigma == pytest.approx(1.0 / (math.sqrt(12.0) * 80.0))


@pytest.mark.parametrize(('counts', 'kept'), [(253.2, True), (253.4, False)])
def test_a_mean_within_three_noises_and_a_half_of_an_end_is_clipped(
    counts: float, kept: bool
) -> None:
    torque = np.linspace(0.0, 1.0, 8)
    inner = [Weighing(t, 60.0 + 100.0 * t, 0.4) for t in torque]
    fit = fit_gauge([*inner, Weighing(1.9, counts, 0.4)])
    assert (len(fit.weighings) == 9) is kept
    low = fit_gauge([*inner, Weighing(-0.6, 255.0 - counts, 0.4)])
    assert (len(low.weighings) == 9) is kept


# ---- force and touch


def test_torque_and_arm_both_make_a_force_uncertain() -> None:
    force = normal_force(0.6, 0.012, 0.04, 0.0008)
    assert force.force_n == pytest.approx(15.0)
    assert force.sigma_n == pytest.approx(math.hypot(0.012, 15.0 * 0.0008) / 0.04)


@pytest.mark.parametrize(('arm', 'known'), [(4.9e-3, False), (5.1e-3, True)])
def test_an_arm_of_five_millimetres_is_one(arm: float, known: bool) -> None:
    assert math.isfinite(normal_force(0.1, 0.01, arm, 0.0).sigma_n) is known


def pressed(tracker: TouchTracker, rising: int, noise: float, resolution: float) -> np.ndarray:
    """Ten samples without force, then 2 N more at every 0.1 mm."""
    point = np.zeros(3)
    for i in range(10 + rising):
        point = 1e-4 * i * NORMAL
        tracker.update(point, 2.0 * max(i - 9, 0), noise, resolution)
    return point


def test_the_place_of_first_touch_is_as_sure_as_noise_step_and_resolution_let_it() -> None:
    tracker = TouchTracker(TouchSettings(begin_samples=4))
    end = pressed(tracker, 4, 0.3, 0.5)
    travel, sigma = tracker.travel(end, NORMAL)
    assert travel == pytest.approx(4e-4)
    slope = 2.0 / 1e-4
    assert sigma == pytest.approx(math.hypot(2.0 * 0.3 / slope / 2.0, 1e-4, 0.5 / slope))
    tracker.travel(-2e-3 * NORMAL, NORMAL)
    assert tracker.withdrawn_m == pytest.approx(2e-3 + 9e-4)


def test_a_touch_takes_three_samples_and_a_release_ten() -> None:
    tracker = TouchTracker(TouchSettings())
    begun = [tracker.update(1e-5 * i * NORMAL, 1.0, 0.1) for i in range(4)]
    assert begun == [False, False, True, True]
    assert [tracker.update(np.zeros(3), 0.0, 0.1) for _ in range(10)].count(True) == 9


def test_samples_above_the_threshold_count_only_one_after_another() -> None:
    tracker = TouchTracker(TouchSettings())
    for force in (1.0, 1.0, 0.0, 1.0, 1.0):
        assert not tracker.update(np.zeros(3), force, 0.1)


# ---- the observer

LAW = GaugeCalibration(
    'cubic', coefficients_nm=(-1.2, 0.01), reference_counts=120.0, no_load_counts=(100.0, 140.0),
    noise_counts=0.4, residual_nm=0.003, relative_sigma=0.02, valid_torque_nm=1.0,
)  # fmt: skip


def observer(**changes: object) -> HandObserver:
    settings = ObserverSettings(dict.fromkeys((1, 2, 3), LAW), gravity=(0.0, 0.0, 0.0))
    return HandObserver(replace(settings, **{'opposed_fingers': None} | changes))


def sample(counts: int, number: int = 0) -> HandSample:
    return HandSample(10_000_000 * number, (5000, 5000, 5000), 1575, (counts, counts, counts))


def test_a_torque_holds_noise_zero_fit_and_slope() -> None:
    reading = observer().observe(sample(170)).fingers[1]
    white = 0.01 * math.hypot(0.4, QUANTISATION)
    zero = 0.01 * 20.0
    scatter = math.sqrt(2.0) * 0.003
    assert reading.torque_nm == pytest.approx(0.5)
    assert reading.sigma_torque_nm == pytest.approx(math.hypot(white, zero, scatter, 0.02 * 0.5))
    pin = ObserverSettings({}).pins[1]
    reach = np.linalg.norm(reading.contact.point - reading.frames.joint_3[:3, 3])
    arm = math.hypot(pin.position_sigma_m, reach * pin.direction_sigma_rad)
    assert reading.contact.sigma_normal_n == pytest.approx(
        math.hypot(reading.sigma_torque_nm, 0.5 / reading.arm_m * arm) / reading.arm_m
    )
    assert reading.contact.sigma_point_m == pytest.approx(
        math.hypot(pin.position_sigma_m, 0.13 * math.radians(0.1))
    )
    assert reading.contact.sigma_direction_rad == pin.direction_sigma_rad


def test_a_tared_torque_counts_from_its_zero_and_holds_its_sigma() -> None:
    hand = observer()
    assert hand.tare([sample(130, i) for i in range(100)]).refusal == ''
    assert not hand.observe(sample(130, 99)).fingers[1].contact.flags & FLAG_NOT_TARED
    reading = hand.observe(sample(180, 99)).fingers[1]
    zero = hand.zeros[1].sigma_counts
    assert zero > 10.0
    assert reading.torque_nm == pytest.approx(0.5)
    assert reading.sigma_torque_nm == pytest.approx(
        math.hypot(
            0.01 * math.hypot(0.4, QUANTISATION),
            0.01 * zero,
            math.sqrt(2.0) * 0.003,
            0.02 * 0.5,
        )
    )


@pytest.mark.parametrize(
    ('counts', 'near', 'saturated'),
    [(209, False, False), (211, True, False), (219, True, False), (221, True, True),
     (31, False, False), (29, True, False), (0, True, True)],
)  # fmt: skip
def test_the_end_of_the_known_torques_is_told(counts: int, near: bool, saturated: bool) -> None:
    reading = observer().observe(sample(counts)).fingers[1]
    assert reading.near_saturation is near
    assert bool(reading.contact.flags & FLAG_SATURATED) is saturated


@pytest.mark.parametrize(
    ('counts', 'saturated'), [(254, False), (255, True), (1, False), (0, True)]
)
def test_a_count_at_either_end_of_the_scale_is_saturated(counts: int, saturated: bool) -> None:
    wide = dict.fromkeys((1, 2, 3), replace(LAW, valid_torque_nm=5.0))
    reading = observer(calibrations=wide).observe(sample(counts)).fingers[1]
    assert bool(reading.contact.flags & FLAG_SATURATED) is saturated


def test_travel_is_as_sure_as_first_touch_tendon_and_encoder() -> None:
    hand = observer()
    for number in range(6):
        reading = hand.observe(sample(170, number)).fingers[1]
    assert reading.contact.flags & FLAG_CONTACT
    origin = hand.touches[1].travel(reading.contact.point, reading.contact.normal)[1]
    stretch = 0.02 * reading.torque_nm
    lag = min(2.0 * 0.0035, stretch)
    tendon = math.hypot(0.004 * reading.torque_nm, 0.02 * reading.sigma_torque_nm, lag)
    reach = np.linalg.norm(reading.contact.point - reading.frames.joint_3[:3, 3])
    encoder = math.radians(140.0) / 17500.0 * QUANTISATION * 2.0 * reach
    assert reading.contact.sigma_travel_m == pytest.approx(
        math.hypot(origin, reading.arm_m * tendon, encoder)
    )


@pytest.mark.parametrize('pair', [(1, 2), (2, 1)])
def test_normals_of_two_facing_pins_are_as_sure_as_both_ends_across_their_gap(
    pair: tuple[int, int],
) -> None:
    found = observer(opposed_fingers=pair).observe(sample(120)).fingers
    gap = found[2].contact.point - found[1].contact.point
    for finger, towards in ((1, gap), (2, -gap)):
        contact = found[finger].contact
        assert contact.normal == pytest.approx(towards / np.linalg.norm(gap))
        sigma = math.sqrt(2.0) * 0.0005 / np.linalg.norm(gap)
        assert contact.sigma_direction_rad == pytest.approx(sigma)
    assert found[3].contact.sigma_direction_rad == math.radians(3.0)


def test_pins_that_do_not_face_each_other_push_along_themselves() -> None:
    beside = replace(sample(120), spread_counts=0)
    contact = observer(opposed_fingers=(1, 2)).observe(beside).fingers[1].contact
    assert contact.sigma_direction_rad == math.radians(3.0)


# ---- play in the tendons


def test_a_known_lag_holds_its_loop_and_the_spread_of_what_it_may_be() -> None:
    play = TendonPlay(0.0035, 0.2, half_width_rad=0.003, spread_rad=0.001, _loops=[(0, 0, 1)])
    assert play.lag_sigma(0.1) == pytest.approx(math.hypot(0.006, 2.0 / math.sqrt(3.0) * 0.001))
    assert play.lag_sigma(-0.004) == pytest.approx(math.hypot(0.004, 0.002 / math.sqrt(3.0)))
    assert TendonPlay(0.0035, 0.2).lag_sigma(0.1) == pytest.approx(0.007)


def looped(loop_rad: float, stretch_rad: float, expected_rad: float = 0.0035) -> TendonPlay:
    """A squeeze to 10 N and a release whose way is everywhere that much longer, 0.1 m of arms."""
    play = TendonPlay(expected_rad, 0.2)
    for push in np.linspace(0.1, 10.0, 40):
        play.see((1, 2), Squeezing(push, 1e-4 * push, 0.1, stretch_rad * push / 10.0))
    for push in np.linspace(9.4, 0.5, 20):
        way = 1e-4 * push + 0.1 * loop_rad
        play.see((1, 2), Squeezing(push, way, 0.1, stretch_rad * push / 10.0))
    play.see((), Squeezing(0.0, 0.0, 0.0, 0.0))
    return play


def test_a_loop_bounds_the_play_from_both_sides() -> None:
    play = looped(0.009, 0.02)
    low, high = 0.5 * 0.009, 0.5 * (0.02 * 1.2 - 0.009)
    assert play.releases == 1
    assert play.half_width_rad == pytest.approx(0.5 * (low + high))
    assert play.spread_rad == pytest.approx(0.5 * (high - low))


def test_a_play_far_beyond_the_expected_one_is_out_of_the_question() -> None:
    # (0.03 - 0.008) / 2 = 0.011, 3.1 times what is expected.
    assert looped(0.008, 0.03).half_width_rad == pytest.approx(0.004)
    # 2.9 times: it stays open which of the two it is.
    assert looped(0.0034, 0.0236).releases == 0


@pytest.mark.parametrize(('loop', 'shut'), [(0.0009, True), (0.0016, False)])
def test_a_shut_loop_is_no_play_where_the_other_would_be_twice_the_expected(
    loop: float, shut: bool
) -> None:
    assert (looped(loop, 0.0165).releases == 1) is shut
