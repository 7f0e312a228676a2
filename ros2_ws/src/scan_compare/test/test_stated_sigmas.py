# SPDX-License-Identifier: Apache-2.0
"""Weights, covariances and verdicts beside their formulas, written out with other numbers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator
from scipy.stats import t as student

from scan_compare import fit_check, pose_covariance
from scan_compare.fit_check import check_fit
from scan_compare.observability import (
    describe_direction,
    information,
    motion_rows,
    split_by_contacts,
)
from scan_compare.pose_covariance import Influence, covariance, groups_alike, slope_matrix
from scan_compare.ranking import rank
from scan_compare.robust import (
    partialled_out,
    robust_weights,
    spread_of,
    tukey,
    tukey_slope,
    weight_beside_depth,
)
from scan_compare.uncertainty import mean_error_sigma, pose_sigma

SIGMA = 0.1e-3


@pytest.fixture
def random() -> Generator:
    return np.random.default_rng(18)


# ---- robust weights


def test_the_spread_is_that_of_a_normal_distribution_and_never_less_than_stated() -> None:
    assert spread_of(np.array([-3.0, 1.0, 2.0, -4.0, 0.5]), 0.1) == pytest.approx(1.4826 * 2.0)
    assert spread_of(np.zeros(5), 0.1) == 0.1


def test_tukeys_weight_falls_to_nothing_at_his_constant() -> None:
    at = np.array([0.0, 0.5, -0.5, 1.0, -2.0]) * 4.685 * 0.3
    assert tukey(at, 0.3) == pytest.approx([1.0, 0.5625, 0.5625, 0.0, 0.0])


def test_the_slope_is_that_of_weight_times_distance() -> None:
    at, step = np.linspace(-3.0, 3.0, 31), 1e-6
    ahead, behind = ((at + d) * tukey(at + d, 0.5) for d in (step, -step))
    assert tukey_slope(at, 0.5) == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-6)


def patches(count: int = 12, members: int = 40) -> np.ndarray:
    """Points (n, 3) in patches of 5 mm along x."""
    x = np.repeat(np.arange(count), members) * 5e-3 + 2.5e-3
    return np.column_stack((x, np.full((len(x), 2), 1e-3)))


def test_a_patch_that_is_off_as_a_whole_is_left_out(random: Generator) -> None:
    points = patches()
    distance = SIGMA * random.standard_normal(len(points))
    distance[:40] += SIGMA
    rigid = np.ones(len(points), bool)
    rigid[-3:] = False
    found = robust_weights(points, distance, rigid, SIGMA)
    assert found.weight[:40].max() == 0.0
    assert found.weight[40:-3].mean() > 0.7
    assert np.all(found.weight[-3:] == 0.0)


def test_the_pull_of_a_patch_is_how_its_weight_follows_its_mean(
    random: Generator,
) -> None:
    points = patches()
    distance = SIGMA * random.standard_normal(len(points)) + 0.03e-3 * np.sin(points[:, 0] * 900.0)
    rigid = np.ones(len(points), bool)
    found = robust_weights(points, distance, rigid, SIGMA)
    mean = np.bincount(found.patch, distance) / 40.0
    # What the module takes for the centre and spread of the patches, kept as the means move.
    middle = float(np.median(mean))
    spread = max(1.4826 * np.median(np.abs(mean - middle)), SIGMA / np.sqrt(40.0))
    single = tukey(distance, spread_of(distance, SIGMA))
    sums = np.bincount(found.patch, single * distance)
    step = 1e-9
    slope = (tukey(mean + step - middle, spread) - tukey(mean - step - middle, spread)) / 2e-9
    moves = np.abs(mean - middle) > 1e-7
    assert np.count_nonzero(moves) > 8
    assert found.pull[moves] == pytest.approx((slope * sums)[moves], rel=1e-4)
    assert found.weight == pytest.approx(single * tukey(mean - middle, spread)[found.patch])


def test_a_dent_of_a_wrong_depth_keeps_its_weight_and_a_finger_does_not(
    random: Generator,
) -> None:
    depth = np.linspace(0.0, 5e-3, 200)
    distance = -0.2 * depth + SIGMA * random.standard_normal(200)
    distance[150:160] += 2e-3
    weight = weight_beside_depth(distance, depth, SIGMA)
    assert weight[150:160].max() == 0.0
    assert np.delete(weight, np.arange(150, 160)).mean() > 0.8


def test_what_columns_explain_is_gone_from_rows(random: Generator) -> None:
    rows, columns = random.standard_normal((50, 3)), random.standard_normal((50, 2))
    weight = random.random(50)
    left = partialled_out(rows, columns, weight)
    assert np.abs((columns * weight[:, None]).T @ left).max() < 1e-12
    assert np.linalg.matrix_rank(np.column_stack((rows - left, columns))) == 2


# ---- covariance of the pose


def influence(random: Generator, n: int = 400, free: int = 0) -> Influence:
    """Least squares of six motions, and of `free` columns beside them, from n distances."""
    rows = random.standard_normal((n, 6))
    columns = np.ones((n, free))
    whole = np.column_stack((rows, columns))
    solution = np.linalg.solve(whole.T @ whole, whole.T).T
    return Influence(rows, solution[:, :6], np.zeros(n), columns, solution[:, 6:])


@pytest.mark.parametrize('free', [0, 1])
def test_alone_noise_gives_the_covariance_of_least_squares_by_its_freedom(
    random: Generator, free: int
) -> None:
    fit = influence(random, 60, free)
    distance = SIGMA * random.standard_normal(60)
    whole = np.column_stack((fit.rows, fit.free))
    distance -= whole @ np.linalg.lstsq(whole, distance, rcond=None)[0]
    fit = Influence(fit.rows, fit.pose, distance, fit.free, fit.fitted)
    found = covariance(fit, np.zeros((60, 3)), 1.0, None, 1.0)
    pulled = fit.pose * distance[:, None]
    assert found == pytest.approx(pulled.T @ pulled * 60.0 / (60.0 - 6.0 - free))


def test_views_that_are_off_give_the_pose_what_that_makes_of_it(
    random: Generator,
) -> None:
    """120 draws of ten views: what the pose scatters by beside what is stated."""
    fit, view = influence(random, 400), np.arange(400) % 10
    poses, stated = [], []
    for seed in range(120):
        draw = np.random.default_rng([seed, 611])
        off = [1.0, 1.0, 1.0, 3.0, 3.0, 3.0] * draw.standard_normal((10, 6))
        distance = draw.standard_normal(400) + np.sum(fit.rows * off[view], axis=1)
        pose = fit.pose.T @ distance
        left = Influence(fit.rows, fit.pose, distance - fit.rows @ pose, fit.free, fit.fitted)
        poses.append(pose)
        stated.append(np.diag(covariance(left, np.zeros((400, 3)), 1.0, view, 1.0)))
    ratio = np.mean(np.square(poses), axis=0) / np.mean(stated, axis=0)
    assert 0.75 < ratio[:3].mean() < 1.3
    assert 0.75 < ratio[3:].mean() < 1.3


def test_scatter_beyond_the_scanners_is_taken_for_six_mixed_views(
    random: Generator,
) -> None:
    fit = influence(random, 600)
    distance = 3.0 * random.standard_normal(600)
    used = np.ones(600, bool)
    wide = Influence(fit.rows, fit.pose, distance, fit.free, fit.fitted)
    found = pose_covariance._mixed(wide, used, 1.0)
    parts = [
        (fit.pose[k::6].T @ fit.rows[k::6])[:, 3:] for k in range(pose_covariance.FEWEST_VIEWS)
    ]
    expected = (np.mean(distance**2) - 1.0) * sum(part @ part.T for part in parts)
    assert found == pytest.approx(expected)
    # Within two of its own standard deviations the scatter is the scanner's.
    edge = np.sqrt(1.0 + 2.0 * np.sqrt(2.0 / 600.0))
    for size, shown in ((0.999 * edge, False), (1.001 * edge, True)):
        even = Influence(fit.rows, fit.pose, np.full(600, size), fit.free, fit.fitted)
        assert bool(pose_covariance._mixed(even, used, 1.0).any()) is shown


def test_weights_that_do_not_move_leave_the_normal_matrix_of_least_squares(
    random: Generator,
) -> None:
    rows, weight = random.standard_normal((80, 3)), random.random(80)
    patch = np.arange(80) % 4
    fixed = (rows * weight[:, None]).T @ rows
    assert slope_matrix(rows, weight, weight, patch, np.zeros(4)) == pytest.approx(fixed)
    followed = (rows * (0.5 * weight)[:, None]).T @ rows
    pull = np.array([0.3, -0.1, 0.2, 0.4])
    for k in range(4):
        mean = rows[patch == k].mean(axis=0)
        followed = followed + pull[k] * np.outer(mean, mean)
    assert slope_matrix(rows, weight, 0.5 * weight, patch, pull) == pytest.approx(followed)


def test_no_direction_is_taken_for_more_than_twice_as_uncertain(
    random: Generator,
) -> None:
    rows, weight = random.standard_normal((80, 3)), random.random(80)
    fixed = (rows * weight[:, None]).T @ rows
    found = slope_matrix(rows, weight, -weight, np.zeros(80, int), np.zeros(1))
    assert found == pytest.approx(0.25 * fixed)


def test_numbered_views_are_the_groups_and_patches_of_three_sizes_stand_in(
    random: Generator,
) -> None:
    views = np.array([7, 7, 2, 9, 2])
    (group,) = groups_alike(np.zeros((5, 3)), 1.0, views)
    assert group.tolist() == [1, 1, 0, 2, 0]
    foot = random.uniform(-1.0, 1.0, (3_000, 3))
    sizes = [int(group.max()) + 1 for group in groups_alike(foot, 1.0, None)]
    # Cubes of half, one and two radii, with a corner of each at the origin.
    assert sizes == [64, 8, 8]
    # Of a smaller object 512 patches are too many to be views.
    assert [int(g.max()) + 1 for g in groups_alike(foot, 0.5, None)] == [64, 8]
    assert [int(g.max()) + 1 for g in groups_alike(foot + 4.0, 3.0, None)] == [8]


# ---- sigma of a point, of a mean


def pose_known(covariance_of: np.ndarray) -> Any:
    return SimpleNamespace(
        centre=np.array([0.0, 0.0, 1.0]), covariance=covariance_of, radius_m=1.0
    )


def test_a_point_turns_and_shifts_with_both_poses() -> None:
    spread = np.diag([4.0, 0.0, 0.0, 0.0, 9.0, 0.0])
    found = pose_known(spread)
    # Along y, two above the centre: turns about x count by their arm, shifts along y as they are.
    point, along = np.array([5.0, 0.0, 3.0]), np.array([0.0, 1.0, 0.0])
    one = np.sqrt(4.0 * 2.0**2 + 9.0)
    assert pose_sigma((found,), point, along) == pytest.approx(one)
    assert pose_sigma((found, None, found), point, along) == pytest.approx(np.sqrt(2.0) * one)


def distances_of(value: np.ndarray, foot: np.ndarray, normal: np.ndarray) -> Any:
    return SimpleNamespace(distance=value, foot=foot, normal=normal)


def test_the_mean_error_is_as_sure_as_its_views_and_the_pose(random: Generator) -> None:
    n, view = 60, np.arange(60) % 5
    foot, normal = random.standard_normal((n, 3)), random.standard_normal((n, 3))
    value = random.standard_normal(n) + (view - 2.0)
    root = random.standard_normal((6, 6))
    used = np.arange(n) != 3
    sign = np.sign(value)[used]
    arms = foot[used] - [0.0, 0.0, 1.0]
    rows = np.column_stack((np.cross(arms, normal[used]), normal[used]))
    gradient = (sign[:, None] * rows).mean(axis=0)
    excess = np.abs(value[used]) - np.abs(value[used]).mean()
    sums = np.array([excess[view[used] == k].sum() for k in range(5)])
    scatter = max(excess @ excess, sums @ sums * 5.0 / 4.0)
    expected = np.sqrt(gradient @ root @ root.T @ gradient + scatter / (n - 1) ** 2)
    found = mean_error_sigma(
        distances_of(value, foot, normal), used, pose_known(root @ root.T), view
    )
    assert found == pytest.approx(expected)


# ---- the check of a fit


def judged(
    monkeypatch: pytest.MonkeyPatch, rms: float, explained: float, mirrored: bool = False
) -> fit_check.FitCheck:
    monkeypatch.setattr(fit_check, '_mirror_fits_better', lambda *_: mirrored)
    far = np.full(1_000, 2.9 * SIGMA)
    far[round(1_000 * explained) :] = -3.1 * SIGMA
    outside = np.ones(1_200, bool)
    outside[1_000:] = False
    points = np.zeros((1_200, 3))
    return check_fit(points, None, np.r_[far, np.ones(200)], outside, rms * SIGMA, SIGMA)


def test_three_sigma_and_half_of_the_scan_are_what_a_fit_must_reach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert judged(monkeypatch, 2.9, 0.51).doubts == ()
    assert 'rms 0.31 mm at a scanner sigma of 0.100 mm' in judged(monkeypatch, 3.1, 0.51).doubts[0]
    assert 'only 49 %' in judged(monkeypatch, 2.9, 0.49).doubts[0]
    assert judged(monkeypatch, 1.0, 0.7).explained == pytest.approx(0.7)


def test_the_mirror_is_held_up_from_two_sigma_on(monkeypatch: pytest.MonkeyPatch) -> None:
    assert judged(monkeypatch, 1.9, 1.0, mirrored=True).doubts == ()
    assert 'mirror image' in judged(monkeypatch, 2.1, 1.0, mirrored=True).doubts[0]


@pytest.mark.parametrize(('share', 'better'), [(0.69, True), (0.71, False)])
def test_a_mirror_image_must_fit_by_a_third_better(
    random: Generator, monkeypatch: pytest.MonkeyPatch, share: float, better: bool
) -> None:
    points = random.standard_normal((2_000, 3))
    seen = []

    def search(few: np.ndarray, *_: object) -> Any:
        seen.append(few)
        return SimpleNamespace(rms_m=1.0 if len(seen) % 2 else share)

    monkeypatch.setattr(fit_check, 'search_pose', search)
    assert fit_check._mirror_fits_better(points, None, SIGMA) is better
    assert np.linalg.det(np.linalg.lstsq(seen[0], seen[1], rcond=None)[0]) == pytest.approx(-1.0)


# ---- the verdict


def compared(error: np.ndarray, floor: float = 0.0, residual: float | None = None) -> Any:
    place = np.column_stack((np.repeat(np.arange(20), 10) * 5e-3 + 1e-3, np.full((200, 2), 1e-3)))
    return SimpleNamespace(
        points=place, used=np.ones(200, bool), distances=distances_of(error, place, place),
        noise_floor_m=floor, undeformed_residual_m=residual,
    )  # fmt: skip


def test_the_verdict_is_students_paired_test_over_patches(random: Generator) -> None:
    difference = np.repeat(0.2 + 0.5 * random.standard_normal(20), 10)
    base = 3.0 + 0.1 * random.standard_normal(200)
    verdict = rank(compared(base + difference), compared(-base))
    patch = difference[::10]
    ratio = abs(patch.mean()) / (patch.std() / np.sqrt(20.0))
    assert verdict.patches == 20
    assert verdict.p_value == pytest.approx(2.0 * student.sf(ratio, 19.0))
    assert verdict.difference_m == pytest.approx(patch.mean())


@pytest.mark.parametrize(
    ('floor', 'residuals', 'better'),
    [(0.9, (None, None), 'B'), (1.1, (None, None), None), (0.5, (1.1, 1.2), None),
     (0.5, (1.1, 0.9), 'B'), (0.5, (1.1, None), None)],
)  # fmt: skip
def test_a_difference_counts_beyond_the_noise_and_the_better_residual(
    random: Generator,
    floor: float,
    residuals: tuple[float | None, float | None],
    better: str | None,
) -> None:
    off = 1.0 + 0.01 * np.repeat(random.standard_normal(20), 10)
    verdict = rank(
        compared(2.0 + off, floor, residuals[0]), compared(np.full(200, 2.0), floor, residuals[1])
    )
    assert verdict.better == better
    assert verdict.floor_m == max(floor, min([r for r in residuals if r is not None], default=0.0))


# ---- what motions change


def test_rows_are_what_a_small_motion_changes(random: Generator) -> None:
    points, normals = random.standard_normal((30, 3)), random.standard_normal((30, 3))
    motions = motion_rows(points, normals)
    arms = points - points.mean(axis=0)
    assert motions.radius == pytest.approx(np.sqrt(np.mean(np.sum(arms**2, axis=1))))
    turn, shift = random.standard_normal(3), random.standard_normal(3)
    moved = np.cross(turn / motions.radius, arms) + shift
    changed = np.einsum('ni,ni->n', moved, normals)
    assert motions.rows @ np.r_[turn, shift] == pytest.approx(changed)
    weight = random.random(30)
    mean = sum(w * np.outer(r, r) for w, r in zip(weight, motions.rows, strict=True))
    assert information(motions.rows, weight) == pytest.approx(mean / weight.sum())
    assert not information(motions.rows, np.zeros(30)).any()


def test_three_contacts_fix_every_turn_and_two_leave_the_spin() -> None:
    turns = np.eye(6)[:, :3]
    corners = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    fixed, open_ = split_by_contacts(turns, corners, np.zeros(3), 1.0)
    assert (fixed.shape[1], open_.shape[1]) == (3, 0)
    fixed, open_ = split_by_contacts(turns, np.array([[0, 0, 1.0], [0, 0, -1.0]]), np.zeros(3), 1)
    assert (fixed.shape[1], open_.shape[1]) == (2, 1)
    assert abs(open_[2, 0]) == pytest.approx(1.0)


def test_a_screw_is_told_by_its_axis() -> None:
    # A turn about z through (0, 3 mm) seen from the origin: one radian a metre of radius.
    turn, radius = np.array([0.0, 0.0, 1.0]), 0.5
    shift = -np.cross(turn / radius, np.array([0.0, 3e-3, 0.0]))
    told = describe_direction(np.r_[turn, shift], np.zeros(3), radius)
    assert told == 'rotation about (0.00, 0.00, 1.00) through (0.00, 3.00, 0.00) mm'
    told = describe_direction(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 2.0]), np.zeros(3), radius)
    assert told == 'translation along (0.00, 0.00, 1.00)'
