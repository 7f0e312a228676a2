# SPDX-License-Identifier: Apache-2.0
"""Grips that turn while the estimator runs: poses in, surface and wrench out."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import replace
from functools import partial

import live_hand
import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.qos import QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from tests.executables import executable
from tests.patience import Patience
from tests.running import own_domain

from shell_deform.building import build_model
from shell_deform.live.background.solving import LiveSolver
from shell_deform.live.grip_motion import GripPlan, GripPoses, followed, topic_of, unwrapped
from shell_deform.live.pose import IDENTITY, pose_of
from shell_deform.live.tick.grasp import GraspTask, contacts_of
from shell_deform.live.tick.grip_told import GRIP_FIELDS, WrenchMemory, grip_rows
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.live.tick.sample import no_contacts
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports.grips import turned_together
from shell_deform.theory.relaxation import log_law

SCANNER = 0.127e-3
LENGTH = 0.08
TUBE = """
name: rubber_tube
surface: {cylinder: {outer_diameter_m: 0.04, length_m: 0.08, ends: open}}
thickness_m: 0.002
young_modulus_pa: 3.0e+6
poisson_ratio: 0.45
contacts:
  - {kind: grip, where: lower}
  - {kind: grip, where: upper}
control_vertices: 250
source: a test
"""
PATIENCE = 60.0


@pytest.fixture(scope='module')
def tube(tmp_path_factory):
    path = tmp_path_factory.mktemp('tube') / 'tube.yaml'
    path.write_text(TUBE)
    return path


@pytest.fixture(scope='module')
def model(tube):
    return build_model(load_object(str(tube)))


def pose_numbers(grip, motion):
    """What an arm says of a grip at `motion` (6,)."""
    return [*(grip.origin + motion[:3]), *Rotation.from_rotvec(motion[3:]).as_quat()]


def placed(live, model, motions, stamp):
    """Ticks `live` once with all grips at `motions` (g, 6)."""
    for number, (grip, motion) in enumerate(zip(model.grips, motions, strict=True)):
        live.estimator.grips.take(number, pose_of(pose_numbers(grip, motion)), IDENTITY)
    return live.tick(no_contacts(stamp))


def twisted(angle):
    return np.array([np.zeros(6), [0.0, 0.0, 0.0, 0.0, 0.0, angle]])


def error(served, model, found):
    return np.linalg.norm(
        served.packed[:, :3] - model.surface.limit_positions(found.positions), axis=1
    )


def test_a_turn_of_three_degrees_between_equilibria_is_served_to_a_scanners_noise(model):
    live, solver, state = Rehearsal(model), EquilibriumSolver(model), None
    for step in range(1, 6):
        motions = twisted(np.radians(3.0 * step))
        served = placed(live, model, motions, step)
        state = solver.solve(gripped(motions), state)
        assert error(served, model, state).max() < 0.5 * SCANNER
        live.refresh()
        assert error(placed(live, model, motions, step), model, state).max() < 1e-7
        told = live.estimator.adopted.grip_wrench[1]
        assert told == pytest.approx(state.grip_wrench[1], rel=1e-4, abs=1e-4 * abs(told[5]))


def test_the_whole_grasp_turned_far_at_once_is_served_as_it_was(model):
    live = Rehearsal(model)
    held = twisted(np.radians(10.0))
    placed(live, model, held, 1)
    live.refresh()
    before = placed(live, model, held, 2)
    energy, shape = before.strain_energy, before.packed[:, :3].astype(float)
    motions = turned_together(model.grips, np.array([0.1, 0.0, 0.0]), np.radians([150.0, 0, 0]))
    turn = Rotation.from_rotvec(motions[0, 3:])
    motions[1, 3:] = (turn * Rotation.from_rotvec(held[1, 3:])).as_rotvec()
    expected = turn.apply(shape - [0.1, 0.0, 0.0]) + [0.1, 0.0, 0.0]
    served = placed(live, model, motions, 3)
    assert np.linalg.norm(served.packed[:, :3] - expected, axis=1).max() < 1e-6
    live.refresh()
    after = placed(live, model, motions, 4)
    assert np.linalg.norm(after.packed[:, :3] - expected, axis=1).max() < 1e-6
    assert after.strain_energy == pytest.approx(energy, rel=1e-6)


def test_sigma_covers_what_the_linear_step_leaves_out(model):
    live, solver, state = Rehearsal(model), EquilibriumSolver(model), None
    for step in range(1, 4):
        motions = twisted(np.radians(4.0 * step))
        placed(live, model, motions, step)
        live.refresh()
        state = solver.solve(gripped(motions), state)
    motions = twisted(np.radians(24.0))
    served = placed(live, model, motions, 9)
    off = error(served, model, solver.solve(gripped(motions), state)).max()
    assert off < 2.0 * served.packed[:, 7].max() < 10.0 * off


def test_a_finger_presses_what_is_twisted(model):
    live = Rehearsal(model)
    motions = twisted(np.radians(8.0))
    placed(live, model, motions, 1)
    live.refresh()
    sample = live_hand.sample([[0.02, 0, 0]], [[-1.0, 0, 0]], [1.0], [1e-3], stamp=2)
    live.settle(sample)
    served = live.tick(sample)
    assert not served.taking_up and len(served.force) == 1
    dented = served.packed[:, :3].astype(float)
    live.settle(no_contacts(3))
    free = live.tick(no_contacts(4)).packed[:, :3]
    assert 0.8e-3 < np.linalg.norm(dented - free, axis=1).max() < 1.2e-3
    assert live.estimator.adopted.grips[1, 5] == pytest.approx(np.radians(8.0))


def test_fingers_that_hold_against_a_turn_give_its_torque_by_friction(tmp_path):
    """A neck turned between three pins: what the grip feels is what their friction gives."""
    path = tmp_path / 'tube.yaml'
    path.write_text(TUBE.replace('  - {kind: grip, where: lower}\n', ''))
    model = build_model(load_object(str(path)))
    live = Rehearsal(model)
    corners = np.radians([0.0, 120.0, 240.0])
    out = np.stack([np.cos(corners), np.sin(corners), 0.0 * corners], axis=1)
    places = 0.02 * out - np.array([0.0, 0.0, 0.02])
    sample = live_hand.sample(places, -out, [0.3] * 3, [np.nan] * 3, stamp=1)
    live.settle(sample)
    motion = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, np.radians(1.5)]])
    live.estimator.grips.take(0, pose_of(pose_numbers(model.grips[0], motion[0])), IDENTITY)
    live.settle(replace(sample, stamp=2))
    estimator = live.estimator
    fingers = contacts_of(estimator, GraspTask(friction=0.5)).grasp
    origins = np.array([grip.origin for grip in model.grips])
    rows = grip_rows(estimator.adopted, estimator.adopted.grip_wrench, origins, IDENTITY, fingers)
    (row,) = rows.astype(float)
    told = dict(zip(GRIP_FIELDS, row, strict=True))
    assert told['rz'] == pytest.approx(np.radians(1.5), rel=1e-5)
    # The normals turn a little under the pins: what presses along them turns the tube, too.
    pressed = np.cross(fingers.point, fingers.push[:, None] * fingers.normal)[:, 2].sum()
    # Fingers touch the outer face, half a wall further out than where the model presses: 5 %.
    assert told['friction_torque'] + pressed == pytest.approx(-told['tz'], rel=0.06)
    assert abs(pressed) < 0.4 * abs(told['tz'])
    assert told['friction_capacity'] == pytest.approx(0.5 * 3 * 0.3 * 0.02, rel=0.06)


class Turned:
    """What an equilibrium tells of one grip."""

    def __init__(self, seconds, torque, turn=0.0):
        self.stamp = round(1e9 * seconds)
        self.grip_pose = np.array([[0.0, 0.0, 0.0, turn, 0.0, 0.0]])
        across = Rotation.from_rotvec([turn, 0.0, 0.0]).apply([0.0, 0.0, torque])
        self.grip_wrench = np.array([[0.0, 0.0, 0.0, *across]])


def test_the_torque_of_a_wall_that_relaxes_falls_as_its_law_says_however_it_is_carried_about():
    law = log_law(0.05, 0.1, 1000.0)
    memory = WrenchMemory(law)
    for seconds in (0.0, 1.0, 60.0, 600.0):
        felt = memory.felt(Turned(seconds, 2.0, turn=0.01 * seconds))
        assert np.linalg.norm(felt[0, 3:]) == pytest.approx(2.0 * float(law(seconds)), rel=1e-9)
    late = memory.felt(Turned(30.0, 9.0))
    assert np.isfinite(late).all()
    again = memory.felt(Turned(600.0, 2.0, turn=6.0))
    assert np.linalg.norm(again[0, 3:]) == pytest.approx(2.0 * float(law(600.0)), rel=1e-9)
    memory.forget()
    fresh = memory.felt(Turned(900.0, 2.0))
    assert np.linalg.norm(fresh) == pytest.approx(2.0 * float(law(0.0)))
    assert WrenchMemory(None).felt(Turned(1.0, 2.0))[0, 5] == 2.0


def test_grips_that_tear_the_object_apart_are_told_and_the_last_good_state_is_kept(model):
    live = Rehearsal(model)
    pulled = np.zeros((2, 6))
    pulled[1, 2] = 0.01
    placed(live, model, pulled, 1)
    live.refresh()
    good = live.estimator.adopted.energy
    pulled[1, 2] = 2.0 * LENGTH
    placed(live, model, pulled, 2)
    live.refresh()
    assert live.estimator.adopted.share < 1.0
    assert 'tear the object apart' in live.solver.message or 'converge' in live.solver.message
    pulled[1, 2] = 0.01
    placed(live, model, pulled, 3)
    live.refresh()
    assert live.estimator.adopted.share == 1.0
    assert live.estimator.adopted.energy == pytest.approx(good, rel=1e-6)


def test_poses_are_taken_in_the_frame_in_which_the_object_lies(model):
    turned = pose_of([0.3, -0.2, 0.1, *Rotation.from_rotvec([0.4, -1.0, 0.7]).as_quat()])
    plan = GripPlan(('lower', 'upper'), np.array([g.origin for g in model.grips]), True)
    poses = GripPoses(plan)
    motion = np.array([0.01, 0.02, -0.003, 0.2, 0.1, -0.3])
    place = turned.from_object((model.grips[1].origin + motion[:3])[None])[0]
    rotation = turned.rotation @ Rotation.from_rotvec(motion[3:]).as_matrix() @ turned.rotation.T
    poses.take(1, pose_of([*place, *Rotation.from_matrix(rotation).as_quat()]), turned)
    assert poses.motion[1] == pytest.approx(motion, abs=1e-12)
    assert not poses.motion[0].any()


def test_a_turn_goes_on_beyond_half_a_turn():
    turn = np.zeros(3)
    for degrees in range(0, 800, 40):
        seen = Rotation.from_rotvec([0.0, 0.0, np.radians(degrees)]).as_rotvec()
        turn = unwrapped(seen, turn)
        assert turn[2] == pytest.approx(np.radians(degrees), abs=1e-9)


def test_names_of_grips_become_names_of_topics():
    assert topic_of('upper') == 'upper'
    assert topic_of('at 0 -0.02 0.08') == 'at_0_minus_0_02_0_08'


def test_more_grips_than_can_be_followed_are_refused(model, monkeypatch):
    monkeypatch.setattr('shell_deform.live.background.gripping.MAX_GRIPS', 1)
    with pytest.raises(ValueError, match='2 grips; at most 1 can be followed'):
        LiveSolver(model)


def test_nothing_moves_between_equal_poses(model):
    plan = GripPlan(('a', 'b'), np.array([g.origin for g in model.grips]), True)
    way = followed(plan, twisted(0.3), twisted(0.3), 0.1, True)
    assert way.step == 0.0 and not way.inputs.any()


class Arm:
    """Moves the upper grip and keeps its wrench."""

    def __init__(self, observer, model):
        self.observer, self.model = observer, model
        self.wrenches: list[WrenchStamped] = []
        many = QoSProfile(depth=500)
        self.rows: list[PointCloud2] = []
        observer.node.create_subscription(PointCloud2, 'deformation/grips', self.rows.append, many)
        self.poses = observer.node.create_publisher(PoseStamped, 'grip/upper/pose', 10)
        observer.node.create_subscription(
            WrenchStamped, 'deformation/grip/upper/wrench', self.wrenches.append, many
        )
        self.sent: dict[int, float] = {}

    def move(self, angle, frame='object', numbers=None):
        stamp = time.time_ns()
        message = PoseStamped()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        p, q = message.pose.position, message.pose.orientation
        values = numbers or pose_numbers(self.model.grips[1], twisted(angle)[1])
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = map(float, values)
        self.poses.publish(message)
        self.sent[stamp] = angle
        return stamp


@pytest.fixture(scope='module')
def arm(tube, model, tmp_path_factory):
    log = tmp_path_factory.mktemp('grips') / 'log'
    with own_domain():
        observer = live_hand.Observer()
        made = Arm(observer, model)
        arguments = ['-p', f'object:={tube}', '-p', 'background_niceness:=0']
        with log.open('wb') as stream:
            process = subprocess.Popen(
                [executable('deformation'), '--ros-args', *arguments],
                stdout=stream, stderr=subprocess.STDOUT,
                env={**os.environ, 'PYTHONUNBUFFERED': '1'},
            )  # fmt: skip
        made.log = log
        wait(made, lambda: made.poses.get_subscription_count() > 0)
        yield made
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0
        observer.close()


def wait(arm, condition, act=lambda: None):
    patience = Patience(PATIENCE)
    while not condition():
        assert not patience.over, arm.observer.report()
        act()
        arm.observer.spin(0.01)


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_every_pose_of_an_arm_is_answered_and_the_served_turn_is_the_converged_one(arm, model):
    hand = arm.observer
    wait(arm, lambda: bool(hand.surfaces), partial(arm.move, 0.0))
    hand.clear()
    arm.sent.clear()
    began = time.monotonic()

    def turn():
        # No further ahead of the last equilibrium than at ten a second, however busy the machine.
        heard = [arm.sent.get(stamp_of(message), 0.0) for message in arm.wrenches]
        ahead = max(heard, default=0.0) + np.radians(3.0)
        arm.move(min(np.radians(30.0) * (time.monotonic() - began), ahead))

    wait(arm, lambda: max(arm.sent.values(), default=0.0) > np.radians(36.0), turn)
    wait(arm, lambda: len(answered(arm)) >= 0.9 * len(arm.sent))
    solver, state, errors = EquilibriumSolver(model), None, []
    for message in answered(arm)[3::6]:
        motions = twisted(arm.sent[stamp_of(message)])
        state = solver.solve(gripped(motions), state)
        truth = model.surface.limit_positions(state.positions)
        off = np.linalg.norm(live_hand.packed(message)[:, :3] - truth, axis=1)
        errors.append(np.percentile(off, 99))
    assert len(errors) > 3
    assert max(errors) < SCANNER
    last = max(arm.sent.values())
    wait(
        arm,
        lambda: (
            bool(arm.wrenches)
            and abs(arm.wrenches[-1].wrench.torque.z / expected(solver, state, last) - 1.0) < 1e-3
        ),
        partial(arm.move, last),
    )
    assert arm.wrenches[-1].header.frame_id == 'object'
    rows = live_hand.packed(arm.rows[-1])
    assert tuple(field.name for field in arm.rows[-1].fields) == GRIP_FIELDS
    assert rows[1, 6] == pytest.approx(last, abs=1e-5) and not rows[0, 4:7].any()
    assert rows[1, 12] == pytest.approx(arm.wrenches[-1].wrench.torque.z, rel=1e-3)
    assert np.isnan(rows[:, 13:]).all()
    assert hand.state == 'NO_HAND' or not hand.state


def answered(arm):
    """Answers to the poses that were sent and are remembered."""
    return [m for m in arm.observer.surfaces if stamp_of(m) in arm.sent]


def expected(solver, state, angle):
    return float(solver.solve(gripped(twisted(angle)), state).grip_wrench[1, 5])


def test_poses_that_are_none_are_told_and_not_used(arm):
    hand = arm.observer
    arm.move(0.3)
    wait(arm, lambda: bool(hand.surfaces), partial(arm.move, 0.3))
    bad = {
        arm.move(0.3, numbers=[0, 0, float('nan'), 0, 0, 0, 1]),
        arm.move(0.3, numbers=[0, 0, 0.04, 0, 0, 0, 0]),
        arm.move(0.3, numbers=[0, 0, 50.0, 0, 0, 0, 1]),
    }
    wait(arm, lambda: 'pose of grip/upper/pose' in arm.log.read_text())
    good = arm.move(0.3)
    wait(arm, lambda: good in map(stamp_of, hand.surfaces), lambda: None)
    assert not bad & set(map(stamp_of, hand.surfaces))
