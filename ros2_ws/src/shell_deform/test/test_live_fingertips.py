# SPDX-License-Identifier: Apache-2.0
"""Fingertips in the live estimator without processes: regions that grow, stick and slip."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shell_deform.building import build_model
from shell_deform.contact.body_file import load_body
from shell_deform.contact.finger_bodies import OTHERS, read_finger_bodies
from shell_deform.grasp.capacity import DIRECTIONS
from shell_deform.grasp.slip import first_slips, slipping_regions
from shell_deform.grasp.touching import read_grasp, read_response
from shell_deform.live.background.contact_tracking import Touch
from shell_deform.live.background.fingertips import FingertipSolver
from shell_deform.live.background.load_case import Load
from shell_deform.live.exchange import REQUEST, TAXEL_FIELDS
from shell_deform.live.pose import IDENTITY, pose_of
from shell_deform.live.tick.grasp import GRASP_FIELDS, GraspTask, GraspTick
from shell_deform.live.tick.load_path import MOST_WAITING, LoadPath
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.objects import load_object
from shell_deform.solve.newton import EquilibriumSolver

MU = 0.4
STEP = 2e-4
TIPS = read_finger_bodies('barrett_fingertip')


@pytest.fixture(scope='module')
def model():
    ball = load_object('tennis_ball')
    return build_model(TIPS.on(ball), control_vertices=300)


@pytest.fixture
def tips(model):
    return Rehearsal(model, live_hand.Settings(live_hand.SURE), TIPS.loaded())


def squeeze(depth, turn=0.0, stamp=1, force=5.0):
    """Two tips on the x axis, along z; the first turned about it [rad]."""
    sample = live_hand.opposed([force] * 2, [depth] * 2, stamp=stamp, radius=7.5e-3)
    along = np.array([[0.0, -np.sin(turn), np.cos(turn)], [0.0, 0.0, 1.0]])
    return replace(sample, along=along)


def followed(tips, samples, friction=MU):
    path = LoadPath(STEP, 0.0225)
    return [tips.follow(sample, path, friction) for sample in samples]


def taxels(tips):
    rows = tips.estimator.adopted.taxels(tips.estimator.pose)
    return {name: rows[:, k] for k, name in enumerate(TAXEL_FIELDS)}


def growing(depth=1.2e-3, count=13, start=0):
    return [squeeze(d, stamp=start + k + 1) for k, d in enumerate(np.linspace(0.0, depth, count))]


def test_the_stretch_of_a_tendon_is_no_depth(tips):
    followed(tips, growing(4e-4, 2))
    finger = tips.solver._held.fingers[0]
    pushed = replace(finger, touch=replace(finger.touch, travel=2e-3, force=5.0))
    assert pushed.depth(1e-4) == pytest.approx(2e-3 + finger.offset - 5e-4)


def test_a_watcher_sees_every_iteration_of_a_long_solve(tips):
    beats = []
    tips.solver.tracker.beat = lambda: beats.append(1)
    followed(tips, growing(4e-4, 2))
    state = tips.solver._held.state
    assert len(beats) > state.iterations > 0


def test_contact_regions_grow_and_their_cells_carry_the_push(tips):
    followed(tips, growing(4e-4, 3))
    small = taxels(tips)['area'].sum()
    followed(tips, growing(1.2e-3, 5, 10))
    cells, adopted = taxels(tips), tips.estimator.adopted
    assert cells['area'].sum() > 1.5 * small
    assert len(cells['cell']) == 48
    push = -cells['fx'][cells['finger'] == 1].sum()
    assert push == pytest.approx(adopted.response.force[0], rel=1e-3)
    assert np.all(cells['sticking'] <= cells['area'] * (1.0 + 1e-6))


def test_the_tick_between_two_equilibria_serves_what_the_next_one_will_be(tips):
    samples = growing(1.2e-3, 5)
    followed(tips, samples)
    ahead = squeeze(1.4e-3, stamp=99)
    served = tips.tick(ahead)
    surface, sigma = served.packed[:, :3].copy(), served.packed[:, 7].copy()
    settled = followed(tips, [ahead])[0].packed[:, :3]
    missed = np.linalg.norm(surface - settled, axis=1)
    assert missed.max() < 5e-5
    assert np.all(missed <= 3.0 * sigma + 1e-6)


def torque(tips):
    """About the x axis, of the first finger on the ball."""
    cells = taxels(tips)
    mine = cells['finger'] == 1
    return float((cells['y'] * cells['fz'] - cells['z'] * cells['fy'])[mine].sum())


def test_a_turned_finger_sticks_then_slips_and_gives_no_more_than_its_friction(tips):
    followed(tips, growing())
    rubbed = tips.estimator.adopted.slipping.share[0]
    found = []
    for k, turn in enumerate((0.005, 0.01, 0.2, 0.3)):
        followed(tips, [squeeze(1.2e-3, turn, stamp=100 + k)])
        found.append(torque(tips))
    cells = taxels(tips)
    mine = cells['finger'] == 1
    sticking = cells['sticking'][mine].sum() / cells['area'][mine].sum()
    assert 0.0 < found[0] < found[1] < found[2]
    # What slips all over gives its friction times the arms, which a turned pad changes a little.
    assert found[3] == pytest.approx(found[2], rel=0.15)
    assert sticking < 0.05
    # Pressed in, it rubs outward and pushes with a hundredth by that; once it turns, no more.
    assert 0.98 < rubbed < 0.992
    assert tips.estimator.adopted.slipping.share[0] == pytest.approx(1.0, abs=2e-3)


def test_the_grasp_of_fingertips_is_that_of_their_pressure(tips):
    """Arms, spins and first slip, equal to the tangent solved anew with fingers that stand."""
    followed(tips, growing())
    followed(tips, [squeeze(1.2e-3, 0.01, stamp=100)])
    tick = GraspTick()
    tick.task = GraspTask(friction=MU, mass=0.058)
    rows = tick.rows(tips.estimator)
    assert np.all(np.isfinite(rows))
    told = dict(zip(GRASP_FIELDS, rows[-1].tolist(), strict=True))
    solver, held = tips.solver, tips.solver._held
    patches = held.case.contacts
    grasp = read_grasp(solver.model, patches, held.state, MU)
    found = read_response(EquilibriumSolver(solver.model), patches, held.state, grasp)
    loads = np.zeros((27, 6))
    loads[0, :3], loads[1:, :3] = tick.task.down, DIRECTIONS
    # The gauges say less than the equilibrium: its contacts with their pushes.
    pushed = replace(grasp, push=rows[:2, GRASP_FIELDS.index('push')].astype(float))
    factor = first_slips(slipping_regions(pushed, found.slipping), found.sharing, loads)[0]
    assert told['gravity_slip'] == pytest.approx(factor[0], rel=5e-3)
    assert told['worst_slip'] == pytest.approx(factor[1:].min(), rel=5e-3)
    assert told['closed'] == 1.0
    assert told['gravity_capacity'] == pytest.approx(2.0 * MU * pushed.push.mean(), rel=0.02)
    spin = rows[:2, GRASP_FIELDS.index('spin_modelled')]
    assert spin == pytest.approx(grasp.spin, abs=1e-6)
    assert abs(spin[0]) > 0.05 * MU * grasp.push[0] * grasp.arm[0]
    # A ring, no disc of the 7.5 mm that the message says, and no stress that a shell can tell.
    assert tips.estimator.adopted.arm == pytest.approx(grasp.arm)
    assert tips.estimator.adopted.slipping.share == pytest.approx(found.slipping.share, abs=1e-3)
    assert np.all(found.slipping.share < 0.998)
    assert grasp.arm.max() < 3e-3
    assert told['stress_resolved'] == 0.0


def test_friction_remembers_how_the_finger_came_there(tips):
    followed(tips, growing())
    assert abs(torque(tips)) < 1e-4
    followed(tips, [squeeze(1.2e-3, turn, stamp=50 + k) for k, turn in enumerate((0.05, 0.0))])
    assert torque(tips) < -5e-4
    tips.jump()
    tips.settle(squeeze(1.2e-3, stamp=60))
    assert abs(torque(tips)) < 1e-4


def test_the_same_samples_give_the_same_bytes(model):
    samples = [*growing(), *(squeeze(1.2e-3, 0.02 * k, stamp=70 + k) for k in range(6))]
    runs = []
    for _ in range(2):
        tips = Rehearsal(model, live_hand.Settings(live_hand.SURE), TIPS.loaded())
        runs.append([served.packed.tobytes() for served in followed(tips, samples)])
    assert runs[0] == runs[1]


def test_a_finger_that_joins_leaves_the_friction_of_the_others(tips):
    followed(tips, growing())
    followed(tips, [squeeze(1.2e-3, 0.02, stamp=60)])
    before = torque(tips)
    pair = squeeze(1.2e-3, 0.02, stamp=61)
    third = live_hand.sample(
        [[0.0, 0.0325, 0.0]], [[0.0, -1.0, 0.0]], [0.5], [0.0], fingers=[3], radius=7.5e-3
    )
    joined = replace(
        pair,
        **{
            name: np.concatenate([getattr(pair, name), getattr(third, name)])
            for name in ('finger', 'flags', 'point', 'normal', 'force', 'sigma_normal')
        },
        **{
            name: np.concatenate([getattr(pair, name), getattr(third, name)])
            for name in ('sigma_tangential', 'radius', 'travel', 'sigma_travel', 'along')
        },
    )
    followed(tips, [joined])
    assert tips.estimator.adopted.fingers.tolist() == [1, 2, 3]
    assert before > 5e-4
    assert torque(tips) == pytest.approx(before, rel=0.05)


def test_a_finger_that_starts_inside_is_refused_and_the_last_state_stays(tips):
    followed(tips, growing(6e-4, 4))
    before = tips.estimator.adopted.response.force
    pair = squeeze(6e-4, stamp=40)
    deep = pair.point.copy()
    deep[0] = [0.0275, 0.0, 0.0]
    replaced = replace(pair, point=deep, finger=np.array([3, 4]))
    followed(tips, [replaced])
    adopted = tips.estimator.adopted
    assert adopted.refused
    assert 'finger 3 starts 0.00383 m inside the object' in adopted.message
    np.testing.assert_array_equal(adopted.response.force, before)


def test_fingertips_in_one_place_are_answered_and_hold_nothing(tips):
    pairs = [
        replace(sample.rows(np.array([0, 0])), finger=np.array([1, 2]))
        for sample in growing(3e-4, 2)
    ]
    followed(tips, pairs)
    tick = GraspTick()
    rows = tick.rows(tips.estimator)
    told = dict(zip(GRASP_FIELDS, rows[-1].tolist(), strict=True))
    assert np.all(np.isfinite(rows))
    assert tick.told.startswith('not closed: ')
    assert (told['closed'], told['smallest_stiffness'], told['slip_finger']) == (0.0, 0.0, -1.0)
    free = squeeze(0.0, stamp=50)
    followed(tips, [replace(free, flags=0 * free.flags), *growing(6e-4, 4, 60)])
    assert tips.estimator.adopted.response.force.min() > 0.5
    tick.rows(tips.estimator)
    assert tick.told == 'closed'


def round_fingers(depth, turn):
    """Two round fingers on the z axis, the first turned about it [rad]."""
    touches = []
    for finger, side in ((1, 1.0), (2, -1.0)):
        inward = np.array([0.0, 0.0, -side])
        along = np.array([np.cos(turn), np.sin(turn), 0.0]) if finger == 1 else np.eye(3)[0]
        place = -0.0325 * inward + depth * inward
        touches.append(Touch(finger, place, inward, 8e-3, 1.0, depth, np.nan, along))
    still = np.zeros(6)
    return Load(tuple(touches), 1, 0, still, 0.0, IDENTITY, 0, friction=0.3)


def test_a_free_ball_is_not_thrown_out_from_between_fingers_that_turn(tmp_path):
    file = tmp_path / 'round.yaml'
    file.write_text('name: round\nball: {radius_m: 0.008}\n')
    model = build_model(load_object('tennis_ball'), control_vertices=300)
    solver = FingertipSolver(model, {OTHERS: load_body(file)})
    # Two points of the mesh touch each, all of which slip: friction grows with the push alone.
    for depth, turn in ((0.0, 0.0), (1.5e-3, 0.0), (3e-3, 0.0), (3e-3, 0.05), (3e-3, 0.1)):
        solver.take(round_fingers(depth, turn))
    state = solver._held.state
    assert solver.share == 1.0
    assert state.force.min() > 10.0
    assert np.abs(state.positions - model.rest).max() < 5e-3
    turning = [touch.moment(touch.pose.origin)[2] for touch in state.touches]
    assert turning[0] > 3e-3
    assert turning[1] == pytest.approx(-turning[0], rel=0.01)


def request(depth, fingers=2, friction=MU):
    record = np.zeros(1, REQUEST)
    record['contacts'], record['friction'], record['drive'] = fingers, friction, 1
    record['touch']['finger'][0, :fingers] = np.arange(1, fingers + 1)
    record['touch']['travel'][0] = depth
    record['touch']['point'][0, :, 0] = depth
    record['touch']['normal'][0, :, 0] = 1.0
    record['touch']['along'][0] = np.nan
    return record


def kept(depths, step=STEP):
    path = LoadPath(step, 0.02)
    for depth in depths:
        path.take(request(depth))
    found = []
    while (one := path.next()) is not None:
        found.append(float(one['touch']['travel'][0, 0]))
    return found


def test_a_path_is_thinned_by_its_length_however_dense_its_samples_are():
    coarse, fine = kept(np.linspace(0.0, 2e-3, 41)), kept(np.linspace(0.0, 2e-3, 401))
    np.testing.assert_allclose(coarse, fine, atol=1e-5)
    assert np.diff(coarse).min() >= STEP * (1.0 - 1e-9)


def test_a_path_keeps_where_it_turns_back():
    way = [0.0, 5e-5, 1e-4, 1.5e-4, 1e-4, 5e-5, 0.0]
    assert kept(way) == [0.0, 1.5e-4]


def test_a_path_keeps_a_finger_that_comes_and_another_friction():
    path = LoadPath(STEP, 0.02)
    for record in (request(0.0), request(0.0, 3), request(0.0, 3, 0.5), request(0.0, 3, 0.5)):
        path.take(record)
    assert path.waiting == 3


def test_a_path_ends_where_all_fingers_let_go():
    path = LoadPath(STEP, 0.02)
    for record in (request(0.0), request(1e-3), request(0.0, 0), request(2e-3)):
        path.take(record)
    assert [int(path.next()[0]['contacts']) for _ in range(path.waiting)] == [0, 2]


def test_a_path_that_nobody_follows_is_thinned_and_says_so():
    path = LoadPath(STEP, 0.02)
    for k in range(MOST_WAITING + 1):
        path.take(request(k * 3e-4))
    assert path.waiting <= MOST_WAITING
    assert path.left_out == MOST_WAITING + 1 - path.waiting


TUBE = """
name: held_tube
surface: {cylinder: {outer_diameter_m: 0.042, length_m: 0.08, ends: open}}
thickness_m: 0.002
young_modulus_pa: 3.0e+6
poisson_ratio: 0.45
contacts: [{kind: grip, where: upper}]
control_vertices: 300
source: a test
"""


@pytest.fixture(scope='module')
def tube(tmp_path_factory):
    path = tmp_path_factory.mktemp('tube') / 'tube.yaml'
    path.write_text(TUBE)
    return build_model(load_object(str(path)))


def between(depth, stamp, force=5.0):
    """Two tips on the sides of the tube, along its axis."""
    sample = live_hand.opposed(
        [force] * 2, [depth] * 2, outer_radius=0.021, stamp=stamp, radius=7.5e-3
    )
    return replace(sample, along=np.array([[0.0, 0.0, 1.0]] * 2))


def test_fingertips_rub_on_an_object_whose_grip_turns(tube):
    """What the grip turns with is what the cells of the fingers give, up to their friction."""
    live = Rehearsal(tube, live_hand.Settings(live_hand.SURE), TIPS.loaded())
    path, origin = LoadPath(STEP, 0.0225), tube.grips[0].origin
    for k, depth in enumerate(np.linspace(0.0, 1.5e-3, 6)):
        live.follow(between(depth, k + 1), path, MU)
    torques = []
    for k, angle in enumerate((0.02, 0.2, 0.22)):
        turned = pose_of([*origin, *Rotation.from_rotvec([0.0, 0.0, angle]).as_quat()])
        live.estimator.grips.take(0, turned, IDENTITY)
        ahead = live.tick(between(1.5e-3, 50 + k)).packed.copy()
        served = live.follow(between(1.5e-3, 50 + k), path, MU).packed
        missed = np.linalg.norm(ahead[:, :3] - served[:, :3], axis=1)
        assert np.all(missed <= 3.0 * ahead[:, 7] + 1e-6)
        adopted, cells = live.estimator.adopted, taxels(live)
        assert adopted.share == 1.0
        assert adopted.grip_pose[0, 5] == pytest.approx(angle)
        given = float(np.sum(cells['x'] * cells['fy'] - cells['y'] * cells['fx']))
        torques.append(adopted.grip_wrench[0, 5])
        # A cell tells its force at its middle: the arms are known to a part of its size.
        assert torques[-1] == pytest.approx(-given, rel=0.1)
    arms = np.hypot(cells['x'], cells['y'])
    pushes = np.linalg.norm([cells['fx'], cells['fy'], cells['fz']], axis=0)
    assert 0.0 < torques[0] <= 1.05 * MU * float(pushes @ arms)
    # All of it slips: to turn on takes no more.
    assert torques[2] == pytest.approx(torques[1], rel=0.05)


EGG = """
name: egg
surface: {ellipsoid: {outer_diameters_m: [0.044, 0.044, 0.057]}}
thickness_m: 0.001
young_modulus_pa: 1.0e+7
poisson_ratio: 0.35
source: a test
"""


def test_a_grasp_with_a_loose_direction_is_told_and_loses_no_equilibrium(tmp_path):
    """Two rods that only just touch an egg along its axis: it rolls between them."""
    egg, rod = tmp_path / 'egg.yaml', tmp_path / 'rod.yaml'
    egg.write_text(EGG)
    rod.write_text('name: rod\nrod: {radius_m: 0.005, length_m: 0.02}\n')
    bodies = read_finger_bodies(str(rod))
    places = np.array([[0.022, 0.0, 0.0], [-0.022, 0.0, 0.0]])
    model = build_model(bodies.touching(load_object(str(egg)), places), control_vertices=300)
    live = Rehearsal(model, live_hand.Settings(live_hand.SURE), bodies.loaded())
    path = LoadPath(STEP, 0.015)
    for number, depth in enumerate((0.0, 2e-4)):
        sample = live_hand.opposed(
            [5.0] * 2, [depth] * 2, outer_radius=0.022, stamp=number + 1, radius=5e-3
        )
        live.follow(replace(sample, along=np.array([[0.0, 0.0, 1.0]] * 2)), path, MU)
    adopted, response = live.estimator.adopted, live.solver._held.response
    assert (adopted.share, adopted.message) == (1.0, '')
    assert adopted.response.force.min() > 0.1
    assert np.all(np.isfinite(response.force))
