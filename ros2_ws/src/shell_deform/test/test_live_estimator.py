# SPDX-License-Identifier: Apache-2.0
"""Solver and tick together, in one process: what is served, its error, and the awkward cases."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from live_hand import SURE

from shell_deform.building import build_model
from shell_deform.live.background.condensed import contact_rows
from shell_deform.live.background.energy_density import EnergyDensity
from shell_deform.live.background.shear_dent import ShearDent
from shell_deform.live.background.tracked_state import Target
from shell_deform.live.background.tracking import EquilibriumTracker
from shell_deform.live.pose import Pose, rotation_of
from shell_deform.live.tick.estimator import Settings
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.grasp import GraspTask
from shell_deform.live.tick.sample import FLAG_CONTACT
from shell_deform.node.parameters import PARAMETERS, grasp_task, settings
from shell_deform.objects import load_object
from shell_deform.theory.gas import Gas

R, H = 31.25e-3, 2.5e-3
OUTER = R + 0.5 * H


@pytest.fixture(scope='module')
def model(sphere):
    return sphere(R, H, subdivisions=2, young=12.75e6, gas=Gas('sealed'))


class Truth:
    """Equilibria of opposite pins at given depths."""

    def __init__(self, model, radius=3e-3):
        self.model = model
        self.tracker = EquilibriumTracker(model)
        patches = tuple(model.contact(np.array([x, 0.0, 0.0]), radius) for x in (R, -R))
        self.tracker.set_contacts(contact_rows(model, patches), np.zeros(2))

    def at(self, depth):
        """Push per finger [N] and limit surface (n, 3) at a depth [m]."""
        here = self.tracker.present(np.ones(2, bool))
        target = Target(here.force, np.full(2, depth), here.driven, here.rigid, here.held)
        assert self.tracker.advance(target) == 1.0
        self.tracker.condense()
        return self.tracker.state.force, self.model.surface.limit_positions(self.tracker.positions)


@pytest.fixture(scope='module')
def truth(model):
    return Truth(model)


def squeeze(force, depth, **options):
    return live_hand.opposed(force, [depth, depth], OUTER, radius=3e-3, **options)


def error(packed, surface):
    """Largest distance [m] of served positions from a surface."""
    return float(np.linalg.norm(packed[:, :3] - surface, axis=1).max())


def test_what_the_node_is_told_by_default_is_what_the_estimator_takes_without_it():
    told = {one.name: one.default for one in PARAMETERS}
    assert grasp_task(told) == GraspTask()
    found = settings(told)
    # A quantum of zero is asked of the hand.
    assert found.errors.quantum == 0.0
    errors = replace(found.errors, quantum=ErrorModel().quantum)
    assert replace(found, errors=errors) == Settings()


@pytest.mark.parametrize('drive', ['force', 'motion', 'fused'])
def test_at_rest_of_all_errors_the_served_surface_is_the_converged_one(model, truth, drive):
    force, surface = truth.at(5e-3)
    pipeline = live_hand.pipeline(model, replace(SURE, drive=drive))
    served = pipeline.settle(squeeze(force, 5e-3), rounds=4)
    assert error(served.packed, surface) < 2e-5
    assert served.max_displacement == pytest.approx(5e-3, rel=0.01)


def test_between_results_the_tangent_carries_a_small_step(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, _ = truth.at(4e-3)
    pipeline.settle(squeeze(force, 4e-3))
    force, surface = truth.at(4.3e-3)
    served = pipeline.tick(squeeze(force, 4.3e-3, stamp=2))
    assert error(served.packed, surface) < 0.127e-3 / 4


def test_the_error_of_the_linear_step_is_reported_honestly(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    for depth in (3e-3, 3.5e-3):
        force, _ = truth.at(depth)
        pipeline.settle(squeeze(force, depth))
    force, surface = truth.at(4.5e-3)
    served = pipeline.tick(squeeze(force, 4.5e-3, stamp=3))
    real = error(served.packed, surface)
    assert 0.3 * real < served.extrapolation < 5.0 * real


@pytest.fixture
def truly_thin(monkeypatch):
    """The truth is a thin wall: what such a wall lacks of a solid is no error."""
    monkeypatch.setattr(ShearDent, 'travel', lambda _, force, radius: 0.0 * force)


@pytest.mark.parametrize('step', [1e-3, 2e-3, 4e-3])
def test_sigma_grows_with_the_error_of_a_solver_that_is_left_behind(
    model, truth, truly_thin, step
):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    for depth in (2e-3, 2.5e-3):
        force, _ = truth.at(depth)
        pipeline.settle(squeeze(force, depth))
    force, surface = truth.at(2.5e-3 + step)
    served = pipeline.tick(squeeze(force, 2.5e-3 + step, stamp=3))
    real = error(served.packed, surface)
    assert 0.5 * real < served.packed[:, 7].max() < 8.0 * real


def test_gauges_do_not_outvote_encoders_where_the_tangent_is_left_behind(model, truth):
    errors = {}
    for drive in ('motion', 'fused'):
        pipeline = live_hand.pipeline(
            model, ErrorModel(drive=drive, mounting=1e-6, modulus=1e-3, model=0.0, mesh=0.0)
        )
        for depth in (2e-3, 2.5e-3):
            force, _ = truth.at(depth)
            pipeline.settle(squeeze(force, depth))
        force, surface = truth.at(4.5e-3)
        served = pipeline.tick(squeeze(force, 4.5e-3, stamp=3))
        errors[drive] = error(served.packed, surface)
    assert errors['fused'] < 1.2 * errors['motion'] + 1e-5


def test_new_contacts_on_a_shell_at_rest_already_know_their_second_order(model, truth):
    force, _ = truth.at(1e-5)
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    pipeline.settle(squeeze(force, 1e-5), rounds=1)
    force, surface = truth.at(0.8e-3)
    served = pipeline.tick(squeeze(force, 0.8e-3, stamp=2))
    adopted = pipeline.estimator.adopted
    bent = error(served.packed, surface)
    adopted.slot.bend[:] = 0.0
    straight = error(pipeline.tick(squeeze(force, 0.8e-3, stamp=3)).packed, surface)
    assert bent < 0.5 * straight


def test_the_energy_density_adds_up_to_the_work_of_the_fingers(model, truth):
    force, _ = truth.at(3e-3)
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    pipeline.settle(squeeze(force, 3e-3))
    positions = pipeline.solver.tracker.positions
    field = EnergyDensity(model)
    total = float(field.areas @ pipeline.estimator.nonlinear()[:, 8].astype(float))
    assert total == pytest.approx(model.shell.energy('koiter', positions), rel=1e-5)


def test_free_fingers_leave_the_shell_at_rest(model, truth):
    pipeline = live_hand.pipeline(model)
    force, _ = truth.at(3e-3)
    pipeline.settle(squeeze(force, 3e-3))
    free = squeeze([0.0, 0.0], 0.0, flags=0)
    assert pipeline.tick(free).max_displacement == 0.0
    pipeline.refresh()
    assert pipeline.tick(free).max_displacement == 0.0


def test_the_answer_is_in_the_frame_of_the_contacts(model, truth):
    force, surface = truth.at(2e-3)
    pose = Pose(rotation_of(np.array([0.3, -0.5, 0.2])), np.array([0.1, 0.0, 0.2]))
    there = squeeze(force, 2e-3)
    turned = replace(
        there,
        point=pose.from_object(there.point),
        normal=there.normal @ pose.rotation.T,
        force=there.force @ pose.rotation.T,
    )
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    pipeline.estimator.pose = pose
    served = pipeline.settle(turned)
    assert error(served.packed, pose.from_object(surface)) < 2e-5


def test_a_sliding_contact_keeps_being_followed(model):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    depth, generations = 2e-3, set()
    for step in range(12):
        angle = 0.03 * step
        outward = np.array(
            [[np.cos(angle), np.sin(angle), 0], [-np.cos(angle), -np.sin(angle), 0]]
        )
        contacts = live_hand.sample(
            OUTER * outward, -outward, [8.0, 8.0], [depth, depth], stamp=step + 1, radius=3e-3
        )
        pipeline.tick(contacts)
        pipeline.refresh()
        generations.add(pipeline.solver.generation)
    served = pipeline.tick(contacts)
    assert served.displacement == pytest.approx([depth, depth], rel=0.05)
    deepest = pipeline.memory.rest[int(np.argmax(served.packed[:, 6]))]
    assert len(generations) > 3
    assert np.degrees(np.arccos(abs(deepest @ outward[0]) / np.linalg.norm(deepest))) < 10.0
    assert pipeline.solver.share == 1.0


def test_a_third_finger_is_taken_up_and_dropped_again(model):
    outward = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]])

    def contacts(fingers, stamp):
        return live_hand.sample(
            OUTER * outward[:fingers],
            -outward[:fingers],
            [8.0] * fingers,
            [1.5e-3] * fingers,
            stamp=stamp,
            radius=3e-3,
        )

    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    served = pipeline.settle(contacts(3, 1))
    assert served.displacement == pytest.approx([1.5e-3] * 3, abs=1e-5)
    assert served.force[0] == pytest.approx(served.force[1], rel=1e-3)
    alone = pipeline.settle(contacts(2, 2))
    assert len(alone.force) == 2
    served = pipeline.tick(contacts(3, 3))
    assert served.unknown == (3,)
    served = pipeline.settle(contacts(3, 4))
    assert served.unknown == ()
    # The others have bulged the shell at the third: its travel counts from there.
    assert served.displacement[:2] == pytest.approx([1.5e-3] * 2, abs=1e-5)
    assert 1.0e-3 < served.displacement[2] < 1.5e-3
    assert pipeline.solver.share == 1.0


def test_a_wrong_modulus_is_a_contradiction_between_force_and_motion(model, truth):
    force, _ = truth.at(4e-3)
    sure = ErrorModel(drift=0.02, modulus=0.02, model=0.0, mesh=0.0)
    pipeline = live_hand.pipeline(model, sure)
    assert pipeline.settle(squeeze(force, 4e-3)).contradiction < 1.0
    pipeline = live_hand.pipeline(model, sure)
    served = pipeline.settle(squeeze(1.5 * force, 4e-3))
    assert served.contradiction > 3.0
    assert served.suspect


def test_force_alone_is_worse_than_both_beyond_five_millimetres(model, truth):
    force, surface = truth.at(7e-3)
    quantum, drift = 0.2, 0.3
    measured = np.round((force + drift) / quantum) * quantum
    errors = {}
    for drive in ('force', 'fused'):
        pipeline = live_hand.pipeline(
            model, ErrorModel(drive=drive, drift=drift, quantum=quantum, mesh=0.0)
        )
        served = pipeline.settle(squeeze(measured, 7e-3 + 2e-5), rounds=4)
        errors[drive] = error(served.packed, surface)
    assert errors['fused'] < 0.5 * errors['force']


def test_the_energy_served_from_rest_is_the_work_of_the_fingers(model, truth):
    depth = 0.05e-3
    force, _ = truth.at(depth)
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    served = pipeline.tick(squeeze(force, depth))
    assert served.strain_energy == pytest.approx(0.5 * float(force.sum()) * depth, rel=0.1)


def test_the_sigma_of_the_nonlinear_surface_is_that_of_what_is_served_with_it(model, truth):
    force, _ = truth.at(2e-3)
    pipeline = live_hand.pipeline(model, ErrorModel(drive='fused'))
    served = pipeline.settle(squeeze(force, 2e-3))
    sigma = pipeline.estimator.nonlinear()[:, 7]
    assert sigma.max() > 1e-6
    assert sigma.max() == pytest.approx(served.packed[:, 7].max(), rel=0.5)


def test_the_linear_answer_is_proportional_to_the_force(model, truth):
    force, _ = truth.at(6e-3)
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    pipeline.settle(squeeze(force, 6e-3), rounds=4)
    first = pipeline.estimator.linear()[:, 3:6].copy()
    served = pipeline.tick(squeeze(force, 6e-3))
    small, _ = truth.at(0.01e-3)
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    pipeline.settle(squeeze(small, 0.01e-3), rounds=3)
    second = pipeline.estimator.linear()[:, 3:6]
    ratio = float(force[0] / small[0])
    assert np.abs(first - ratio * second).max() < 0.03 * np.abs(first).max()
    assert served.linearity > 0.3


def test_a_pressurised_ball_is_measured_from_its_inflated_shape(sphere):
    inflated = sphere(R, H, subdivisions=2, young=12.75e6, gas=Gas('sealed', 50e3))
    pipeline = live_hand.pipeline(inflated)
    radius = np.linalg.norm(pipeline.memory.rest, axis=1)
    assert radius.min() > R
    assert pipeline.tick(squeeze([0, 0], 0.0, flags=0)).max_displacement == 0.0


def test_reset_forgets_the_contacts(model, truth):
    force, _ = truth.at(3e-3)
    pipeline = live_hand.pipeline(model)
    pipeline.settle(squeeze(force, 3e-3))
    pipeline.estimator.forget()
    pipeline.solver.take(replace(pipeline.solver._load, reset=True, touches=(), stamp=9))
    assert pipeline.solver.contacts.contacts == ()
    assert np.abs(pipeline.solver.tracker.state.moved).max() == 0.0


def test_warming_up_leaves_the_shell_at_rest(model):
    pipeline = live_hand.pipeline(model)
    pipeline.solver.warm_up()
    assert pipeline.solver.contacts.contacts == ()
    assert np.abs(pipeline.solver.tracker.state.moved).max() == 0.0


def coverage(model, truth, seeds, drive='fused'):
    """Share of vertices whose true normal error lies in the 90 % band, over random truths."""
    inside, count, sigmas = 0, 0, []
    errors = replace(
        SURE, drift=0.15, quantum=0.2, mounting=5e-5, modulus=0.05, outside=1e-3, drive=drive
    )
    for seed in range(seeds):
        random = np.random.default_rng(seed)
        depth = random.uniform(1e-3, 8e-3)
        force, surface = truth.at(depth)
        # A shell that is softer by a share needs that share less force for the same shape.
        push = force * (1.0 + 0.05 * random.normal())
        push = push + 0.15 * random.normal(size=2) + 0.05 * random.normal(size=2)
        push = np.round(push / 0.2) * 0.2
        travel = depth + np.hypot(2e-5, 5e-5) * random.normal(size=2)
        contacts = replace(
            live_hand.opposed(push, travel, OUTER, radius=3e-3, sigma_n=0.05),
            travel=travel,
        )
        pipeline = live_hand.pipeline(model, errors)
        served = pipeline.settle(contacts, rounds=3)
        normals = pipeline.estimator.adopted.slot.normals
        miss = np.abs(np.einsum('ni,ni->n', served.packed[:, :3] - surface, normals))
        sigma = served.packed[:, 7]
        inside += int(np.sum(miss <= 1.645 * sigma))
        count += len(miss)
        sigmas.append(float(sigma.max()))
    return inside / count, float(np.mean(sigmas))


def test_the_ninety_percent_band_covers_about_ninety_percent(sphere, truly_thin):
    hollow = sphere(R, H, subdivisions=2, young=12.75e6)
    share, _ = coverage(hollow, Truth(hollow), 20)
    assert 0.80 <= share <= 0.995


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_the_ninety_percent_band_covers_over_two_hundred_seeds(sphere, truly_thin):
    hollow = sphere(R, H, subdivisions=2, young=12.75e6)
    share, _ = coverage(hollow, Truth(hollow), 200)
    assert 0.85 <= share <= 0.95


def test_flags_of_contact_are_what_counts(model):
    pipeline = live_hand.pipeline(model)
    served = pipeline.tick(squeeze([5.0, 5.0], 1e-3, flags=[FLAG_CONTACT, 0]))
    assert served.unknown == (1,)


def test_where_the_last_grasp_had_carried_the_object_is_no_part_of_the_next(model):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    for angle in np.linspace(0.0, 0.3, 11):
        outward = np.array([[np.cos(angle), np.sin(angle), 0.0], [-1.0, 0.0, 0.0]])
        pipeline.tick(
            live_hand.sample(OUTER * outward, -outward, [7.0, 7.0], [1.5e-3] * 2, radius=3e-3)
        )
        pipeline.refresh()
    carried = pipeline.solver.tracker.positions - model.rest
    assert np.abs(carried.mean(axis=0)).max() > 1e-5
    pipeline.estimator.forget()
    pipeline.jump()
    pipeline.tick(squeeze([0.0, 0.0], 0.0))
    pipeline.refresh()
    assert np.abs(pipeline.estimator.adopted.response.force).max() < 1e-3
    assert error(pipeline.tick(squeeze([0.0, 0.0], 0.0)).packed, pipeline.memory.rest) < 1e-6


@pytest.mark.parametrize('start', [1e-3, 5e-3])
def test_a_grasp_taken_up_from_the_shape_of_another_knows_how_wrong_its_first_steps_are(
    model, truth, start
):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, _ = truth.at(start)
    pipeline.settle(squeeze(force, start))
    # time jumps to a lighter grasp of the same fingers
    force, _ = truth.at(0.5e-3)
    pipeline.estimator.forget()
    pipeline.jump()
    pipeline.tick(squeeze(force, 0.5e-3))
    pipeline.refresh()
    for depth in (1.5e-3, 3e-3):
        force, surface = truth.at(depth)
        served = pipeline.tick(squeeze(force, depth, stamp=3))
        wrong = np.linalg.norm(served.packed[:, :3] - surface, axis=1)
        assert (wrong < 3.0 * served.packed[:, 7] + 2e-5).all()


@pytest.mark.parametrize('refreshes', [1, 2])
def test_a_pair_after_eight_fingers_on_one_flank_is_the_pair_it_was(refreshes):
    def fingers(count, of):
        turns = 2.0 * np.pi * np.arange(count) / of
        outward = np.stack([np.cos(turns), np.sin(turns), np.zeros(count)], axis=1)
        push, travel = np.full(count, 8.0), np.full(count, 1.5e-3)
        return live_hand.sample(OUTER * outward, -outward, push, travel)

    ball = build_model(load_object('tennis_ball'), theory='koiter', control_vertices=150)
    rehearsal = live_hand.pipeline(ball, ErrorModel())
    for _ in range(3):
        rehearsal.tick(fingers(2, 2))
        rehearsal.refresh()
    before = rehearsal.tick(fingers(2, 2)).displacement
    for _ in range(refreshes):
        rehearsal.tick(fingers(8, 255))
        rehearsal.refresh()
    # Finger 2 presses the far side now: of that nothing is known yet.
    assert rehearsal.tick(fingers(2, 2)).unknown == (2,)
    rehearsal.refresh()
    rehearsal.tick(fingers(2, 2))
    rehearsal.refresh()
    after = rehearsal.tick(fingers(2, 2)).displacement
    assert after == pytest.approx(before, rel=1e-3)
