# SPDX-License-Identifier: Apache-2.0
"""The grasp beside the tick: rows by field name, on deformed normals, always numbers."""

from dataclasses import replace
from time import perf_counter
from types import SimpleNamespace

import live_hand
import numpy as np
import pytest
from live_hand import SURE

from shell_deform.grasp.capacity import DIRECTIONS
from shell_deform.grasp.reading import read_contacts, read_response
from shell_deform.grasp.slip import first_slips
from shell_deform.grasp.stiffness import adversary_work, grasp_stiffness
from shell_deform.live.tick.grasp import GRASP_FIELDS, WHOLE, GraspTask, GraspTick
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.theory.gas import Gas

R, H = 31.25e-3, 2.5e-3
NEAR = 5e-3
"""A state that moves by less than a thousandth of the wall keeps what was told of its grasp."""
OUTER = R + 0.5 * H


@pytest.fixture(scope='module')
def pipeline(sphere):
    model = sphere(R, H, subdivisions=2, young=12.75e6, gas=Gas('sealed'))
    return live_hand.pipeline(model, replace(SURE, drive='motion'))


def opposed(depth, stamp=1):
    return live_hand.opposed([15.0, 15.0], [depth, depth], OUTER, radius=3e-3, stamp=stamp)


def column(rows, name):
    return rows[:, GRASP_FIELDS.index(name)]


def test_a_row_a_finger_and_one_for_the_whole(pipeline):
    pipeline.settle(opposed(4e-3), rounds=3)
    tick = GraspTick()
    tick.task = GraspTask(friction=0.4, mass=0.058, down=(0.0, 0.0, -1.0))
    rows = tick.rows(pipeline.estimator)
    assert rows.shape == (3, len(GRASP_FIELDS))
    assert column(rows, 'finger').tolist() == [1.0, 2.0, WHOLE]
    assert np.all(np.isfinite(rows))
    assert column(rows, 'closed')[-1] == 1.0
    assert column(rows, 'on_deformed_normals')[-1] == 1.0
    assert column(rows, 'closure_probability')[-1] > 0.99
    push = column(rows, 'push')[:2]
    # Two pins face to face lift twice the friction of one.
    assert column(rows, 'gravity_capacity')[-1] == pytest.approx(2.0 * 0.4 * push.mean(), rel=0.02)
    lifted = column(rows, 'liftable_mass')[-1]
    assert column(rows, 'least_push')[-1] == pytest.approx(push.mean() * 0.058 / lifted, rel=1e-4)


def test_the_worst_direction_is_found_at_once_and_kept_up_to_date(pipeline):
    tick = GraspTick()
    pipeline.settle(opposed(3e-3), rounds=3)
    first = tick.rows(pipeline.estimator)
    for stamp in range(5):
        pipeline.tick(opposed(3e-3 + 2e-5 * stamp, stamp + 2))
        rows = tick.rows(pipeline.estimator)
    anew = GraspTick().rows(pipeline.estimator)
    worst = column(rows, 'worst_capacity')[-1]
    assert worst == pytest.approx(column(anew, 'worst_capacity')[-1], rel=1e-2)
    assert column(first, 'worst_capacity')[-1] <= column(first, 'gravity_capacity')[-1] + 1e-4


def test_what_is_kept_between_samples_is_what_a_new_tick_finds(pipeline):
    """Closure is kept as long as its equilibrium, the task and the pressing fingers are."""
    tick = GraspTick()
    pipeline.settle(opposed(2e-3), rounds=3)
    tick.task = GraspTask(friction=0.4, mass=0.058)
    for stamp, (depth, friction) in enumerate(
        [(3e-3, 0.4), (3e-3, 0.2), (5e-3, 0.2), (1e-3, 0.3)]
    ):
        tick.task = replace(tick.task, friction=friction)
        pipeline.settle(opposed(depth, stamp + 2), rounds=3)
        for _ in range(60):
            rows = tick.rows(pipeline.estimator)
        anew = GraspTick()
        anew.task = tick.task
        np.testing.assert_allclose(rows, anew.rows(pipeline.estimator), rtol=1e-4, atol=1e-6)


def test_a_grasp_that_needs_no_friction_says_so_within_the_sigma_of_its_normals(pipeline):
    pipeline.settle(opposed(4e-3), rounds=3)
    rows = GraspTick().rows(pipeline.estimator)
    assert column(rows, 'needed_friction')[-1] < 0.01
    assert 0.0 < column(rows, 'needed_friction_sigma')[-1] < 0.1


def test_first_slip_is_that_of_the_whole_solve(pipeline):
    """What the background condenses says the same as the tangent solved with standing fingers."""
    pipeline.settle(opposed(4e-3), rounds=4)
    tick = GraspTick()
    tick.task = GraspTask(friction=0.3, down=(0.6, 0.0, -0.8))
    row = tick.rows(pipeline.estimator)[-1]
    solver = pipeline.solver
    tracker, patches = solver.tracker, solver.contacts.patches
    state = SimpleNamespace(
        positions=tracker.positions, unknowns=tracker.unknowns, force=tracker.state.force,
        multipliers=tracker.state.multipliers,
    )  # fmt: skip
    grasp = read_contacts(solver.model, patches, state, 0.3)
    found = read_response(EquilibriumSolver(solver.model), patches, state, grasp)
    loads = np.zeros((27, 6))
    loads[0, :3], loads[1:, :3] = tick.task.down, DIRECTIONS
    factor, contact, _ = first_slips(grasp, found.sharing, loads)
    told = dict(zip(GRASP_FIELDS, row.tolist(), strict=True))
    assert told['gravity_slip'] == pytest.approx(factor[0], rel=NEAR)
    assert told['worst_slip'] == pytest.approx(factor[1:].min(), rel=NEAR)
    assert told['slip_finger'] in (1.0, 2.0)
    assert contact[0] in (0, 1)
    stiff = grasp_stiffness(found.compliance, told['epsilon_length']).smallest
    assert told['smallest_stiffness'] == pytest.approx(stiff, rel=NEAR)
    assert told['adversary_work'] == pytest.approx(adversary_work(found.compliance, 1.0), rel=NEAR)
    assert 0.0 < told['epsilon'] <= told['worst_capacity'] * 1.001
    assert told['rigid_share'] < 1e-3


def test_the_wall_under_a_pin_narrower_than_itself_is_said_not_to_be_resolved(pipeline):
    pipeline.settle(opposed(2e-3), rounds=3)
    tick = GraspTick()
    tick.yield_stress = 3e6
    row = dict(zip(GRASP_FIELDS, tick.rows(pipeline.estimator)[-1].tolist(), strict=True))
    assert row['yield_share'] > 0.0
    assert row['dent_push'] == pytest.approx(15.0 / row['yield_share'], rel=0.5)
    assert row['most_push'] <= row['dent_push'] * 1.0001
    # 3 mm pins on a wall of 2.5 mm.
    assert row['stress_resolved'] == 0.0
    assert row['yield_share_sigma'] > row['yield_share']
    assert 0.0 < row['strain_share'] < 1.0


@pytest.mark.parametrize(
    ('places', 'why'), [([0], 'one contact holds nothing'), ([0, 0], 'in one place')]
)
def test_contacts_that_let_the_object_rock_have_no_stiffness_and_say_why(sphere, places, why):
    model = sphere(R, H, subdivisions=2, young=12.75e6)
    hand = live_hand.pipeline(model, replace(SURE, drive='motion', outside=100.0))
    at = np.array(places)
    hand.settle(replace(opposed(2e-3).rows(at), finger=np.arange(1, len(at) + 1)), rounds=3)
    tick = GraspTick()
    rows = tick.rows(hand.estimator)
    told = dict(zip(GRASP_FIELDS, rows[-1].tolist(), strict=True))
    assert np.all(np.isfinite(rows))
    assert tick.told.startswith('not closed: ') and why in tick.told
    assert told['on_deformed_normals'] == 1.0
    assert (told['smallest_stiffness'], told['adversary_work'], told['gravity_slip']) == (0, 0, 0)
    assert 0.1 < told['snap_margin'] < 2.0


def test_two_of_three_pins_in_one_place_hold_like_one(sphere):
    model = sphere(R, H, subdivisions=2, young=12.75e6)
    found = []
    for places in ([0, 1], [0, 1, 1]):
        hand = live_hand.pipeline(model, replace(SURE, drive='motion', outside=100.0))
        at = np.array(places)
        hand.settle(replace(opposed(2e-3).rows(at), finger=np.arange(1, len(at) + 1)), rounds=3)
        row = dict(zip(GRASP_FIELDS, GraspTick().rows(hand.estimator)[-1].tolist(), strict=True))
        found.append([row[name] for name in ('closed', 'smallest_stiffness', 'adversary_work')])
    assert found[0][0] == 1.0 and found[0][1] > 0.0
    assert found[1] == pytest.approx(found[0], rel=1e-3)


def test_nothing_in_the_hand_is_no_grasp_and_no_nan(sphere):
    model = sphere(R, H, subdivisions=2, young=12.75e6)
    hand = live_hand.pipeline(model, SURE)
    rows = GraspTick().rows(hand.estimator)
    assert rows.shape == (1, len(GRASP_FIELDS))
    assert np.all(np.isfinite(rows))
    assert column(rows, 'closed')[-1] == 0.0
    assert column(rows, 'liftable_mass')[-1] == 0.0


@pytest.mark.parametrize('friction', [0.0, 10.0])
@pytest.mark.parametrize('mass', [-1.0, 0.0])
def test_absurd_tasks_give_numbers(pipeline, friction, mass):
    pipeline.settle(opposed(2e-3), rounds=2)
    tick = GraspTick()
    tick.task = GraspTask(friction=friction, mass=mass)
    rows = tick.rows(pipeline.estimator)
    assert np.all(np.isfinite(rows))
    assert column(rows, 'closed')[-1] == float(friction > 0.0)


def test_the_grasp_adds_little_to_a_tick_of_three_pins(pipeline):
    """A guard on a busy machine; `docs` has the figure of a quiet one."""
    turn = np.radians([0.0, 120.0, 240.0])
    normal = -np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    three = live_hand.sample(-OUTER * normal, normal, [8.0] * 3, [4e-3] * 3, radius=3e-3, stamp=9)
    pipeline.settle(three, rounds=3)
    tick = GraspTick()
    tick.task = GraspTask(mass=0.058)
    for _ in range(30):
        tick.rows(pipeline.estimator)
    times = []
    for _ in range(100):
        began = perf_counter()
        tick.rows(pipeline.estimator)
        times.append(perf_counter() - began)
    print(f'grasp: {1e3 * np.median(times):.3f} ms')
    assert np.median(times) < 3e-3
