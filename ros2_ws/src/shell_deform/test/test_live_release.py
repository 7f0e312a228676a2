# SPDX-License-Identifier: Apache-2.0
"""Fingers that let go: slowly, faster than the background process, and one before the other."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from live_hand import SURE

from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.release import pressing
from shell_deform.live.tick.sample import FLAG_NO_GAUGE
from shell_deform.theory.gas import Gas

R, H = 31.25e-3, 2.5e-3
OUTER = R + 0.5 * H


@pytest.fixture(scope='module')
def model(sphere):
    return sphere(R, H, subdivisions=2, young=12.75e6, gas=Gas('sealed'))


def squeeze(force, depth, **options):
    """Opposite fingers with pushes [N] at travels [m]."""
    return live_hand.opposed(np.array(force, float), depth, OUTER, radius=3e-3, **options)


@pytest.fixture
def deep(model):
    """A pipeline whose background process has solved a dent of 8 mm and then stands still."""
    pipeline = live_hand.pipeline(model, ErrorModel())
    assert pipeline.settle(squeeze([18.0, 18.0], [8e-3, 8e-3])).max_displacement > 7e-3
    return pipeline


def test_a_finger_behind_its_first_touch_without_a_push_has_left():
    sample = squeeze([0.1, 0.1], [-5e-4, 1e-4])
    assert pressing(sample, ErrorModel()).finger.tolist() == [2]


def test_a_finger_behind_its_first_touch_that_still_pushes_stays():
    """The other finger may have moved the object."""
    sample = squeeze([3.0, 3.0], [-5e-4, 2e-3])
    assert pressing(sample, ErrorModel()).finger.tolist() == [1, 2]


def test_a_finger_without_a_gauge_has_left_by_its_motion_alone():
    sample = squeeze([3.0, 3.0], [-5e-4, 1e-4])
    blind = replace(sample, flags=sample.flags | FLAG_NO_GAUGE)
    assert pressing(blind, ErrorModel()).finger.tolist() == [2]


def test_by_force_the_gauge_alone_says_who_presses():
    sample = squeeze([0.1, 0.1], [-5e-4, -5e-4])
    assert len(pressing(sample, ErrorModel(drive='force')).finger) == 2


def test_fingers_that_have_left_pull_nothing_along(deep):
    served = deep.tick(squeeze([0.05, -0.05], [-8e-4, -8e-4]))
    assert served.max_displacement == 0.0


def test_one_finger_that_lets_go_first_leaves_no_dent_behind(deep):
    both = squeeze([0.2, 0.2], [3e-4, 3e-4])
    served = deep.tick(both.rows(np.array([0])))
    assert served.max_displacement < 5e-4


@pytest.mark.parametrize('drive', ['force', 'motion', 'fused'])
@pytest.mark.parametrize('depth', [3e-4, 1e-3])
def test_released_at_once_the_shell_is_served_as_converged_within_its_sigma(model, drive, depth):
    errors = replace(SURE, drive=drive)
    slow = live_hand.pipeline(model, ErrorModel(drive='motion'))
    soft = squeeze([2.0, 2.0], [depth, depth])
    converged = slow.settle(soft, rounds=4)
    surface, force = converged.packed[:, :3].copy(), converged.force
    fast = live_hand.pipeline(model, errors)
    fast.settle(squeeze([18.0, 18.0], [8e-3, 8e-3]))
    served = fast.tick(squeeze(force, [depth, depth]))
    error = np.linalg.norm(served.packed[:, :3] - surface, axis=1)
    assert np.all(error < 2.0 * served.packed[:, 7] + 1e-5)
    assert error.max() < 0.3 * depth
