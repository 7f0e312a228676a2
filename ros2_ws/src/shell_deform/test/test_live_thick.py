# SPDX-License-Identifier: Apache-2.0
"""The live pipeline on a thick wall: its settled answers are the equilibria."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from live_hand import SURE

from shell_deform.building import build_model, object_contacts, with_material
from shell_deform.contact.loads import contact_patch
from shell_deform.live.pose import pose_of
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.modulus import ModulusFilter
from shell_deform.objects import load_object
from shell_deform.readout import read_out, von_mises
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

RADIUS = 1e-3


@pytest.fixture(scope='module')
def ball():
    return with_material(load_object('tennis_ball'), poisson_ratio=0.49)


@pytest.fixture(scope='module')
def model(ball):
    return build_model(ball, 'thick', control_vertices=250)


@pytest.fixture(scope='module')
def truth(ball, model):
    """Forces [N] and limit surface (n, 3) at a travel [m], by the offline solver."""
    solver = EquilibriumSolver(model)
    contacts = object_contacts(ball, model, RADIUS)

    def at(travel):
        state = solver.solve(displaced(contacts, [travel, travel]))
        assert state.converged
        return state.force, model.surface.limit_positions(state.positions)

    return at


def test_an_open_thick_wall_is_served_and_pressed_from_inside(tmp_path):
    path = tmp_path / 'tube.yaml'
    path.write_text(
        'name: tube\nsurface: {cylinder: {outer_diameter_m: 0.05, length_m: 0.05, ends: open}}\n'
        'thickness_m: 0.002\nyoung_modulus_pa: 1.0e+6\npoisson_ratio: 0.45\n'
        'supports: [{kind: clamped, where: lower}]\n'
        'contacts: [{at_m: [0.025, 0.0, 0.0], radius_m: 0.003, kind: pin}]\n'
    )
    tube = build_model(load_object(path), 'thick', control_vertices=120)
    shell = tube.on_contacts(object_contacts(load_object(path), tube)).shell
    volume, load = shell.volume(shell.start)
    assert volume == 0.0
    outward = load[: len(tube.rest), :2] * tube.rest[:, :2]
    assert outward.sum() == pytest.approx(2 * np.pi * 0.024**2 * 0.05, rel=0.02)
    assert not load[len(tube.rest) :].any()
    pipeline = live_hand.pipeline(tube, SURE)
    assert np.isfinite(pipeline.memory.rest_outer).all()


def squeeze(force, travel, **options):
    return live_hand.opposed(force, [travel, travel], radius=RADIUS, **options)


def error(packed, surface):
    return float(np.linalg.norm(packed[:, :3] - surface, axis=1).max())


@pytest.mark.parametrize('drive', ['force', 'motion', 'fused'])
def test_the_settled_answer_is_the_equilibrium(model, truth, drive):
    force, surface = truth(3e-3)
    pipeline = live_hand.pipeline(model, replace(SURE, drive=drive))
    served = pipeline.settle(squeeze(force, 3e-3), rounds=5)
    assert error(served.packed, surface) < 3e-5


def test_a_small_step_is_carried_by_the_tangent_of_the_stamps(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, _ = truth(2e-3)
    pipeline.settle(squeeze(force, 2e-3), rounds=4)
    force, surface = truth(2.2e-3)
    served = pipeline.tick(squeeze(force, 2.2e-3, stamp=2))
    assert error(served.packed, surface) < 0.03e-3


def test_a_release_ends_at_rest_and_the_next_grasp_is_the_first_again(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, surface = truth(2e-3)
    pipeline.settle(squeeze(force, 2e-3), rounds=4)
    pipeline.settle(squeeze([0.0, 0.0], 0.0, flags=0, stamp=2))
    rest = pipeline.tick(squeeze([0.0, 0.0], 0.0, flags=0, stamp=3))
    assert rest.max_displacement < 1e-6
    served = pipeline.settle(squeeze(force, 2e-3, stamp=4), rounds=4)
    assert error(served.packed, surface) < 3e-5


def slid(angle, travel, stamp):
    """Two opposite pins at an angle [rad] from the graded poles."""
    out = np.array([[np.cos(angle), np.sin(angle), 0.0]]) * np.array([[1.0], [-1.0]])
    point = (0.0325 - travel) * out
    return live_hand.sample(point, -out, [5.0] * 2, [travel] * 2, radius=RADIUS, stamp=stamp)


def test_fingers_that_slide_are_followed_with_the_unknowns_of_their_new_pins(model):
    """The way of the last pins, which had other unknowns, leads nowhere under these."""
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    for stamp, travel in enumerate((2e-4, 4e-4, 6e-4, 8e-4), 1):
        pipeline.settle(slid(0.0, travel, stamp), rounds=1)
    laid = pipeline.solver.generation
    for stamp, angle in enumerate((0.02, 0.08, 0.3), 5):
        served = pipeline.settle(slid(angle, 9e-4, stamp), rounds=2)
        assert served.answer == 'nonlinear' and not pipeline.solver.message
        assert pipeline.solver.share == 1.0
    assert pipeline.solver.generation > laid


def test_a_pin_that_slides_in_its_dent_closes_the_gaps_under_it_in_steps(model):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    depths = np.r_[np.arange(0.25, 3.1, 0.25), [3.0] * 7] * 1e-3
    slides = np.r_[np.zeros(13), np.arange(0.2, 1.3, 0.2)] * 1e-3
    for stamp, (depth, slide) in enumerate(zip(depths, slides, strict=True), 1):
        angle = slide / 0.0325
        out = np.array([[np.cos(angle), 0.0, np.sin(angle)], [-1.0, 0.0, 0.0]])
        point = (0.0325 - depth) * out
        pipeline.tick(
            live_hand.sample(point, -out, [5.0] * 2, [depth] * 2, radius=RADIUS, stamp=stamp)
        )
        pipeline.refresh()
        assert (pipeline.solver.share, pipeline.solver.message) == (1.0, '')


@pytest.fixture(scope='module')
def small(ball):
    return build_model(ball, 'thick', control_vertices=100)


def sliding(slide, stamp, depth=2e-3):
    """A pin that has slid [m] across the ball in its dent, and an opposite one that stays."""
    angle = slide / 0.0325
    out = np.array([[np.cos(angle), 0.0, np.sin(angle)], [-1.0, 0.0, 0.0]])
    return live_hand.sample(0.0325 * out, -out, [9.0] * 2, [depth] * 2, radius=RADIUS, stamp=stamp)


def test_a_pin_that_slid_presses_on_where_it_has_pressed(ball, small):
    """Most of its push is there at once; the rest is let go in steps."""
    pins = object_contacts(ball, small, RADIUS)
    solver = EquilibriumSolver(small)
    state = solver.solve(displaced(pins, [2e-3, 2e-3]))
    across = 0.25 * RADIUS * pins[0].lateral[0]
    slid = contact_patch(small.surface, pins[0].point + across, RADIUS, pins[0].axis)
    other = small.on_contacts((slid, pins[1]))
    unknowns = other.shell.continued(solver.model.shell, state.unknowns)
    _, gradient = other.gradient(unknowns)
    gaps = other.pressure_equations(unknowns)
    loose = gradient - gaps.pull(gaps.missing, gradient.size)
    first = other.shell.first_pin
    carried = loose[3 * first : 3 * first + 6 : 3]
    assert carried[1] == pytest.approx(state.force[1], rel=1e-3)
    assert carried[0] == pytest.approx(state.force[0], rel=0.1)


def test_a_slide_that_no_one_can_follow_leaves_the_pin_where_it_was(small):
    """The shell stays pressed, `sigma` says what the place costs, and the next slide is tried."""
    pipeline = live_hand.pipeline(small, replace(SURE, drive='motion'))
    before = pipeline.settle(sliding(0.0, 1), rounds=3).packed.copy()
    tracker = pipeline.solver.tracker
    places, options = pipeline.estimator.adopted.places, tracker.options
    tracker.options = replace(options, iterations=1, tangents=0)
    served = pipeline.settle(sliding(0.5e-3, 2), rounds=1)
    adopted = pipeline.estimator.adopted
    assert (adopted.share, adopted.message) == (1.0, '')
    assert np.array_equal(adopted.places, places)
    assert served.packed[:, :3] == pytest.approx(before[:, :3], abs=2e-5)
    assert np.max(served.packed[:, 7] - before[:, 7]) > 0.05e-3
    tracker.options = options
    pipeline.settle(sliding(1.0e-3, 3), rounds=1)
    adopted = pipeline.estimator.adopted
    assert (adopted.share, adopted.message) == (1.0, '')
    assert np.linalg.norm(adopted.places - places, axis=1)[0] > 0.7e-3


def test_a_pin_that_slides_where_none_can_lie_stays_where_it_was(model):
    """Far from the fine mesh a needle would press on fewer than three points."""
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))

    def pressed(slide, stamp):
        return replace(sliding(slide, stamp, 0.05e-3), radius=np.full(2, 0.02e-3))

    pipeline.settle(pressed(0.0, 1), rounds=1)
    places = pipeline.estimator.adopted.places
    pipeline.settle(pressed(5e-3, 2), rounds=1)
    adopted = pipeline.estimator.adopted
    assert (adopted.share, adopted.message) == (1.0, '')
    assert np.array_equal(adopted.places, places)


def test_a_wall_that_was_lost_is_found_again_when_the_fingers_come_back(small):
    """Told that both fingers met beyond its middle, it had no way back from where it ended."""
    pipeline = live_hand.pipeline(small, replace(SURE, drive='motion'))
    good = pipeline.settle(sliding(0.0, 1), rounds=3).packed.copy()
    pipeline.settle(sliding(0.0, 2, 40e-3), rounds=2)
    adopted = pipeline.estimator.adopted
    assert adopted.share < 1.0 and adopted.message
    served = pipeline.settle(sliding(0.0, 3), rounds=2)
    adopted = pipeline.estimator.adopted
    assert (adopted.share, adopted.message) == (1.0, '')
    assert served.packed[:, :3] == pytest.approx(good[:, :3], abs=2e-5)


@pytest.fixture(scope='module')
def outer(ball, model):
    """Outer face (n, 3) [m] at a travel [m], by the offline solver."""
    solver = EquilibriumSolver(model)
    contacts = object_contacts(ball, model, RADIUS)

    def at(travel):
        state = solver.solve(displaced(contacts, [travel, travel]))
        return solver.model.shell.outer_face(state.unknowns)

    return at


def face_error(packed, face):
    return float(np.linalg.norm(packed[:, -3:] - face, axis=1).max())


def test_the_outer_face_of_the_thick_wall_is_served_beside_its_middle(model, truth, outer):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, _ = truth(3e-3)
    served = pipeline.settle(squeeze(force, 3e-3), rounds=5)
    assert face_error(served.packed, outer(3e-3)) < 3e-5
    assert face_error(pipeline.estimator.nonlinear(), outer(3e-3)) < 3e-5


def test_at_rest_the_outer_face_is_half_a_wall_outside(model, ball):
    pipeline = live_hand.pipeline(model)
    rest = pipeline.tick(squeeze([0.0, 0.0], 0.0, flags=0))
    half = np.linalg.norm(rest.packed[:, -3:] - rest.packed[:, :3], axis=1)
    assert half == pytest.approx(0.5 * ball.thickness_m, rel=1e-4)


def test_between_two_equilibria_the_outer_face_goes_on_as_it_did(model, truth, outer):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    for stamp, travel in enumerate((2e-3, 2.4e-3), 1):
        force, _ = truth(travel)
        pipeline.settle(squeeze(force, travel, stamp=stamp), rounds=4)
    force, _ = truth(2.8e-3)
    served = pipeline.tick(squeeze(force, 2.8e-3, stamp=9))
    assert face_error(served.packed, outer(2.8e-3)) < 0.06e-3


def test_a_turned_object_has_a_turned_outer_face(model, truth, outer):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    turned = pose_of([0.1, -0.2, 0.3, 0.0, 0.0, np.sin(0.4), np.cos(0.4)])
    pipeline.estimator.pose = turned
    force, _ = truth(2e-3)
    here = squeeze(force, 2e-3)
    there = replace(
        here,
        point=turned.from_object(here.point),
        normal=here.normal @ turned.rotation.T,
        force=here.force @ turned.rotation.T,
    )
    served = pipeline.settle(there, rounds=5)
    assert face_error(served.packed, turned.from_object(outer(2e-3))) < 3e-5


def test_sigma_beside_a_pin_has_what_no_shell_has(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    for travel, least in ((0.25e-3, 0.01e-3), (1e-3, 0.03e-3), (6e-3, 0.09e-3)):
        force, _ = truth(travel)
        served = pipeline.settle(squeeze(force, travel), rounds=5)
        sigma = served.packed[:, 7]
        assert least < sigma.max() < 0.15e-3
        assert sigma[np.abs(served.packed[:, 0]) < 0.01].max() < 0.02e-3


def test_the_snap_margin_is_what_is_left_of_the_stiffness(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    force, _ = truth(3e-3)
    served = pipeline.settle(squeeze(force, 3e-3), rounds=5)
    step = 0.1e-3
    here = truth(3e-3 + step)[0].mean() - truth(3e-3 - step)[0].mean()
    at_rest = 2.0 * truth(0.01e-3)[0].mean() * step / 0.01e-3
    assert served.snap_margin == pytest.approx(here / at_rest, rel=0.05)


def test_the_gauge_of_linearity_is_the_error_of_linear_theory(model, truth):
    pipeline = live_hand.pipeline(model, replace(SURE, drive='motion'))
    stiffness = truth(0.01e-3)[0].mean() / 0.01e-3
    for travel in (1e-3, 2e-3):
        force, _ = truth(travel)
        served = pipeline.settle(squeeze(force, travel), rounds=5)
        missed = abs(force.mean() / stiffness - travel) / travel
        assert served.linearity == pytest.approx(missed, abs=0.1)


@pytest.mark.parametrize('ratio', [0.8, 1.25])
def test_the_modulus_is_learned_while_a_thick_wall_is_squeezed(ball, model, truth, ratio):
    errors = ErrorModel(drift=0.1, quantum=0.0, mounting=5e-5)
    pipeline = live_hand.pipeline(model, errors)
    own = ball.modulus('thick')
    modulus = ModulusFilter(own, errors)
    other = replace(model, shell=model.shell.stiffened(ratio))
    solver, state = EquilibriumSolver(other), None
    contacts = object_contacts(ball, other, RADIUS)
    for stamp, travel in enumerate(np.linspace(4e-4, 5e-3, 10), 1):
        state = solver.solve(displaced(contacts, [travel, travel]), state)
        sample = squeeze(state.force, travel, stamp=stamp, sigma_n=0.1)
        pipeline.settle(sample, rounds=1)
        estimator = pipeline.estimator
        modulus.update(estimator.adopted.response, estimator.posterior.inputs, estimator.measured)
    found = modulus.estimate
    assert found.value == pytest.approx(ratio * own, rel=0.04)
    assert found.samples > 5


def test_the_outer_face_of_an_inflated_thick_sphere_has_the_stress_of_lame(ball):
    # tangential stress at the outer radius b of a sphere under inner pressure p:
    # 3/2 p a^3 / (b^3 - a^3)
    pressure = 1e3
    described = with_material(ball, gas_kind='none')
    model = replace(build_model(described, 'thick', 250), pressure=pressure)
    state = EquilibriumSolver(model).solve(displaced((), []))
    found = read_out(model, state.unknowns)
    b = 0.5 * ball.surface.outer_diameter_m
    a = b - ball.thickness_m
    exact = 1.5 * pressure * a**3 / (b**3 - a**3)
    assert np.median(von_mises(found.outer_stress)) == pytest.approx(exact, rel=0.01)
    assert np.median(found.inner_stress[:, 0]) > exact


def test_the_energy_that_is_read_out_is_that_of_the_squeeze(ball, model):
    solver = EquilibriumSolver(model)
    contacts = object_contacts(ball, model, RADIUS)
    state = solver.solve(displaced(contacts, [2e-3, 2e-3]))
    found = read_out(solver.model, state.unknowns)
    energy, _ = solver.model.shell.gradient('thick', state.unknowns)
    assert found.energy_density @ solver.model.shell.weights == pytest.approx(energy, rel=1e-2)
