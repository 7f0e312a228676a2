# SPDX-License-Identifier: Apache-2.0
"""The tick: fusion of force and motion, the served field, and their compiled forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.live.tick import fusion, fusion_plain
from shell_deform.live.tick.fusion import ErrorModel, fuse
from shell_deform.live.tick.fusion_types import Measured, Response, Widths
from shell_deform.live.tick.sample import FLAG_CONTACT, FLAG_SATURATED
from shell_deform.live.tick.serve_kernel import serve, serve_numpy


def response(k=2, r=1, seed=0):
    """A plausible condensed response: contact compliance near 1 mm/N."""
    random = np.random.default_rng(seed)
    j = 3 * k + r + 1
    by = 1e-5 * random.normal(size=(k, j))
    by[:, :k] = 1e-3 * np.eye(k) + 1e-4
    by[:, -1] = -1e-3
    balance = 1e-3 * random.normal(size=(r, j))
    balance[:, 0], balance[:, k - 1] = 0.04, balance[:, k - 1] - 0.04
    return Response(
        force=np.full(k, 5.0),
        displacement=np.full(k, 5e-3),
        travel_offset=np.zeros(k),
        rigid=np.zeros(r),
        rigid_scale=25.0,
        reaction=np.zeros(2 * k),
        lateral=np.tile(np.eye(3)[:2], (k, 1)),
        rigid_reaction=np.zeros(r),
        displacement_by=by,
        reaction_by=random.normal(size=(2 * k, j)),
        rigid_by=balance,
    )


def measured(push, travel, k=2, **changes):
    values = Measured(
        finger=np.arange(1, k + 1),
        flags=np.full(k, FLAG_CONTACT),
        present=np.ones(k, bool),
        push=np.asarray(push, float),
        sigma_push=np.full(k, 0.05),
        travel=np.asarray(travel, float),
        sigma_travel=np.full(k, 2e-5),
        tangential=np.zeros(2 * k),
        sigma_tangential=np.full(2 * k, np.inf),
    )
    return values._replace(**changes)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    k=st.integers(1, 4),
    r=st.integers(0, 3),
    drive=st.sampled_from(fusion.DRIVES),
    flags=st.integers(0, 63),
    tangential=st.booleans(),
)
def test_the_compiled_fusion_equals_the_plain_one(seed, k, r, drive, flags, tangential):
    def plainly(*arguments):
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(fusion, 'least_squares', fusion_plain.least_squares)
            return fuse(*arguments)

    random = np.random.default_rng(seed)
    errors = ErrorModel(drive=drive, tendon=1e-4)
    data = measured(random.uniform(0, 9, k), random.uniform(0, 9e-3, k), k)
    data.flags[0] = flags
    data.travel[random.integers(k)] = np.nan
    data.present[random.integers(k)] = random.random() < 0.7
    if tangential:
        data.sigma_tangential[:] = 0.1
    fast = fuse(errors, response(k, r, seed), data)
    plain = plainly(errors, response(k, r, seed), data)
    assert fast.inputs == pytest.approx(plain.inputs, rel=1e-6, abs=1e-9)
    covariance = plain.root @ plain.root.T
    size = np.sqrt(np.diag(covariance))
    error = np.abs(fast.root @ fast.root.T - covariance) / np.outer(size, size)
    assert error.max() < 1e-6
    assert fast.contradiction == pytest.approx(plain.contradiction, rel=1e-6, abs=1e-9)
    assert fast.suspect == plain.suspect


def test_every_width_reaches_the_kernel_under_its_own_name():
    errors = ErrorModel(**{name: 1.0 + i for i, name in enumerate(reversed(Widths._fields))})
    assert {name: getattr(errors, name) for name in Widths._fields} == errors.widths._asdict()


def test_drive_by_force_follows_the_gauges():
    errors = ErrorModel(drive='force', outside=10.0, modulus=1e-6, model=0.0)
    answer = fuse(errors, response(), measured([5.5, 5.5], [9e-3, 9e-3]))
    assert answer.inputs[:2] == pytest.approx([0.5, 0.5], abs=0.02)


def test_drive_by_motion_follows_the_travel():
    errors = ErrorModel(drive='motion')
    state = response()
    answer = fuse(errors, state, measured([0.1, 0.1], [5.4e-3, 5.4e-3]))
    moved = state.displacement + state.displacement_by @ answer.inputs
    assert moved == pytest.approx([5.4e-3, 5.4e-3], abs=5e-5)


def test_both_together_are_more_certain_than_either():
    spread = {}
    for drive in fusion.DRIVES:
        answer = fuse(ErrorModel(drive=drive), response(), measured([5, 5], [5e-3, 5e-3]))
        by = response().displacement_by @ answer.root
        spread[drive] = np.sqrt(np.sum(by**2, axis=1)).max()
    assert spread['fused'] <= spread['motion']
    assert spread['fused'] < 0.5 * spread['force']


def test_a_clipped_gauge_is_overruled_by_motion():
    state = response()
    data = measured([2.0, 2.0], [6e-3, 6e-3], flags=np.full(2, FLAG_CONTACT | FLAG_SATURATED))
    answer = fuse(ErrorModel(), state, data)
    moved = state.displacement + state.displacement_by @ answer.inputs
    assert moved == pytest.approx([6e-3, 6e-3], abs=1e-4)


def test_agreeing_force_and_motion_do_not_contradict():
    answer = fuse(ErrorModel(), response(), measured([5.0, 5.0], [5e-3, 5e-3]))
    assert answer.contradiction < 0.1
    assert answer.suspect == ''


def test_a_gauge_that_lies_is_found_and_named():
    answer = fuse(ErrorModel(), response(), measured([5.0, 15.0], [5e-3, 5e-3]))
    assert answer.contradiction > 3.0
    assert 'finger 2' in answer.suspect or answer.suspect == 'balance of the forces'


def test_tendon_stretch_is_taken_off_the_travel():
    errors = ErrorModel(drive='motion', tendon=1e-4, tendon_relative=0.0)
    state = response()
    answer = fuse(errors, state, measured([5.0, 5.0], [5e-3 + 5e-4, 5e-3 + 5e-4]))
    moved = state.displacement + state.displacement_by @ answer.inputs
    assert moved == pytest.approx([5e-3, 5e-3], abs=5e-5)


def test_a_finger_that_left_pushes_no_more():
    answer = fuse(
        ErrorModel(drive='force', outside=100.0),
        response(),
        measured([5.0, 5.0], [np.nan] * 2, present=np.array([True, False])),
    )
    assert answer.inputs[1] == pytest.approx(-5.0, abs=0.05)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), j=st.integers(1, 12), pose=st.integers(0, 6))
def test_the_compiled_field_equals_the_plain_one(seed, j, pose):
    random = np.random.default_rng(seed)
    n = 7
    normals = random.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    arguments = (
        random.normal(size=(n, 3)),
        random.normal(size=(n, 3)),
        normals,
        random.normal(size=(n, 3, j)),
        random.normal(size=j),
        np.triu(random.normal(size=(j, j))),
        random.normal(size=(n, 3)),
        0.3,
        0.2,
        np.abs(random.normal(size=n)),
        0.1,
        0.05,
        np.abs(random.normal(size=n)),
        rotation,
        random.normal(size=3),
        random.normal(size=(6, pose)),
    )
    fast, plain = np.zeros((n, 8), np.float32), np.zeros((n, 8), np.float32)
    largest = serve(*arguments, fast)
    assert largest == pytest.approx(serve_numpy(*arguments, plain))
    assert fast == pytest.approx(plain, rel=1e-5, abs=1e-5)
