# SPDX-License-Identifier: Apache-2.0
"""The real node as a process, with a synthetic hand.

One node serves the whole file, so the tests run in order; the ones that end or replace its parts
come last.
"""

import os
import signal
import subprocess
import time
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path

import live_hand
import numpy as np
import pytest
import yaml
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from tests.executables import executable
from tests.patience import Patience
from tests.running import own_domain
from tests.service_calls import answer

from grasp_common.watchdog import end_with_parent
from shell_deform.building import build_model
from shell_deform.identify.force_curve import ForceCurve
from shell_deform.live.tick.sample import FLAG_STALE
from shell_deform.node import parameters
from shell_deform.objects import load_object
from shell_deform.solve.equilibrium import displaced
from shell_deform.solve.newton import EquilibriumSolver

STEP = 10_000_000
PATIENCE = 60.0
OUTWARD = np.array([1.0, 0.0, 0.0])
EXECUTABLE = executable('deformation')
CONFIGURATION = Path(__file__).parents[1] / 'config' / 'deformation.yaml'


class Node:
    """The running executable with its log."""

    def __init__(self, log: Path, *assignments: str) -> None:
        self.log = log
        arguments = [part for one in assignments for part in ('-p', one)]
        with log.open('wb') as stream:
            self.process = subprocess.Popen(
                [EXECUTABLE, '--ros-args', *arguments],
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, 'PYTHONUNBUFFERED': '1'},
                # One that a failing fixture leaves must not answer the tests of the next run.
                preexec_fn=end_with_parent,
            )

    @property
    def text(self) -> str:
        return self.log.read_text(errors='replace')

    def stop(self) -> int:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        patience = Patience(15.0)
        while self.process.poll() is None and not patience.over:
            time.sleep(0.01)
        if self.process.poll() is None:
            self.process.kill()
        return self.process.wait()

    def ended(self) -> int:
        patience = Patience(PATIENCE)
        while self.process.poll() is None:
            assert not patience.over, self.text
            time.sleep(0.01)
        return self.process.returncode


@pytest.fixture(scope='module')
def hand():
    with own_domain():
        observer = live_hand.Observer()
        yield observer
        observer.close()


@pytest.fixture(scope='module')
def node(hand, tmp_path_factory):
    log = tmp_path_factory.mktemp('deformation') / 'log'
    # the mesh stays graded at the contacts of the object file, whose centres are vertices
    running = serving(hand, log, 'follow_contacts:=false')
    yield running
    running.stop()


def serving(hand, log, *assignments):
    """A node that serves the ball and is heard."""
    # what is tried here is the node: a thin wall is solved several times as fast
    running = Node(log, 'theory:=koiter', 'drive:=motion', 'background_niceness:=0', *assignments)
    wait(hand, lambda: 'serving' in running.text)
    wait(hand, lambda: hand.contacts.get_subscription_count() > 0)
    wait(hand, lambda: hand.node.count_publishers('deformation/surface') > 0)
    return running


@pytest.fixture(autouse=True)
def fresh(hand):
    """Forget what earlier tests have received."""
    hand.spin(0.05)
    hand.clear()


def wait(hand, condition, timeout=PATIENCE):
    patience = Patience(timeout)
    while not condition():
        assert not patience.over, (hand.state, hand.diagnostics, hand.summary)
        hand.spin()


def largest(message):
    return float(live_hand.packed(message)[:, 6].max())


def squeezed(depth, force=10.0, start=0):
    """Make samples of a steady squeeze to `depth` [m] per finger."""

    def make(i):
        return live_hand.opposed([force, force], [depth, depth], stamp=(start + i + 1) * STEP)

    return make


def settled(hand, depth, tolerance=2e-5):
    return lambda: bool(hand.nonlinear) and abs(largest(hand.nonlinear[-1]) - depth) < tolerance


def test_every_sample_is_answered_once_with_its_own_stamp(node, hand):
    sent = hand.stream(squeezed(1e-3, 5.0, start=1000), lambda: len(hand.surfaces) >= 100)
    wait(hand, lambda: len(hand.surfaces) >= sent - 2)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in hand.surfaces]
    assert stamps == sorted(set(stamps))
    assert set(stamps) <= {(1000 + i + 1) * STEP for i in range(sent)}


def test_a_steady_squeeze_is_served_as_the_nonlinear_equilibrium(node, hand):
    hand.stream(squeezed(3e-3), settled(hand, 3e-3))
    hand.spin(0.3)
    served = live_hand.packed(hand.surfaces[-1])
    nonlinear = live_hand.packed(hand.nonlinear[-1])
    assert np.linalg.norm(served[:, :3] - nonlinear[:, :3], axis=1).max() < 2e-5
    assert hand.surfaces[-1].header.frame_id == 'hand_base'
    assert [field.name for field in hand.nonlinear[-1].fields][-1] == 'energy_density'
    deepest = np.argmax(nonlinear[:, 6])
    assert nonlinear[deepest, 8] > 10.0 * np.median(nonlinear[:, 8])
    assert 'CONTACT' in hand.states


def test_the_figures_of_the_benchmark_stand_in_the_diagnostics(node, hand):
    hand.diagnostics.clear()
    hand.stream(squeezed(1e-3, 5.0), lambda: 'tick p99 [ms]' in hand.diagnostics)
    told = hand.diagnostics
    for kind in ('tick', 'contacts in to surface out'):
        assert 0.0 < float(told[f'{kind} median [ms]']) <= float(told[f'{kind} p99 [ms]'])
    assert float(told['start to first surface [s]']) > 0.0
    assert float(told['background refresh rate [Hz]']) > 0.0
    assert 50.0 < float(told['memory of node and background [MB]']) < 2000.0


def test_the_numbers_of_an_answer_carry_its_stamp(node, hand):
    hand.stream(squeezed(1e-3, 5.0), lambda: hand.stamped and hand.surfaces)
    found = {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in hand.stamped}
    both = [s for s in hand.surfaces if (s.header.stamp.sec, s.header.stamp.nanosec) in found]
    surface = both[-1]
    numbers = found[surface.header.stamp.sec, surface.header.stamp.nanosec]
    told = dict(zip(numbers.name, numbers.position, strict=True))
    assert told['max_displacement'] == pytest.approx(largest(surface), rel=1e-5)
    assert {'linearity', 'strain_energy', 'nonlinear_age', 'snap_margin'} < told.keys()


def test_every_sample_has_its_grasp_by_field_name(node, hand):
    hand.stream(
        squeezed(4e-3, start=1400),
        lambda: hand.grasps and grasp_of(hand.grasps[-1])['on_deformed_normals'][-1] == 1.0,
    )
    last = hand.grasps[-1]
    rows = grasp_of(last)
    assert rows['finger'].tolist() == [1.0, 2.0, -1.0]
    assert last.header.frame_id == 'hand_base'
    assert rows['closed'][-1] == 1.0
    push = rows['push'][:2]
    lifted = 2.0 * rows['friction_given'][-1] * push.mean()
    assert rows['gravity_capacity'][-1] == pytest.approx(lifted, rel=0.05)
    assert all(np.all(np.isfinite(rows[name])) for name in rows.dtype.names)
    # the number of that sample comes on a topic of its own, perhaps after those of samples before
    mass = pytest.approx(lifted / 9.80665, rel=0.1)
    wait(hand, lambda: hand.numbers.get('grasp/liftable_mass', 0.0) == mass)


@pytest.mark.parametrize(
    ('places', 'start', 'why'),
    [([0], 1500, 'one contact holds nothing'), ([0, 0], 1700, 'all contacts are in one place')],
)
def test_what_holds_nothing_says_why_and_is_served(node, hand, places, start, why):
    def make(i):
        rows = squeezed(2e-3, start=start)(i).rows(np.array(places))
        return replace(rows, finger=np.arange(1, len(places) + 1))

    def told():
        deformed = hand.grasps and grasp_of(hand.grasps[-1])['on_deformed_normals'][-1]
        return deformed and hand.diagnostics.get('grasp') == f'not closed: {why}'

    hand.stream(make, told)
    rows = grasp_of(hand.grasps[-1])
    assert rows['closed'][-1] == 0.0
    assert all(np.all(np.isfinite(rows[name])) for name in rows.dtype.names)
    assert hand.state == 'CONTACT'
    assert 'started over' not in node.text


def grasp_of(message):
    """Rows of a message of the grasp by field name."""
    kinds = np.dtype([(field.name, '<f4') for field in message.fields])
    return np.frombuffer(message.data, kinds)


def test_linear_and_nonlinear_answers_part_at_large_dents(node, hand):
    hand.stream(squeezed(6e-3, 18.0), settled(hand, 6e-3))
    hand.stream(squeezed(6e-3, 18.0), lambda: hand.numbers.get('linearity', 0.0) > 0.2)
    assert largest(hand.linear[-1]) < 0.8 * largest(hand.nonlinear[-1])


def test_a_growing_squeeze_tells_the_modulus_with_its_sigma(node, hand):
    ball = load_object('tennis_ball')
    depth = np.linspace(3e-4, 5e-3, 60)
    force = ForceCurve(ball, 1e-3, control_vertices=250).force(depth, ball.young_modulus_pa)

    def make(i):
        at = min(i // 4, len(depth) - 1)
        return live_hand.opposed([force[at]] * 2, [depth[at]] * 2, stamp=(4000 + i) * STEP)

    hand.stream(
        make,
        lambda: (
            'modulus_sigma' in hand.numbers
            and hand.numbers['modulus_sigma'] < 0.1 * ball.young_modulus_pa
        ),
        rate=50.0,
    )
    assert hand.numbers['modulus'] == pytest.approx(ball.young_modulus_pa, rel=0.2)


def test_silence_is_stale_and_nothing_is_served_meanwhile(node, hand):
    hand.stream(squeezed(1e-3, 5.0), lambda: 'CONTACT' in hand.states and len(hand.surfaces) > 20)
    wait(hand, lambda: hand.state == 'STALE')
    hand.spin(1.0)
    assert hand.state == 'STALE'
    count = len(hand.surfaces)
    hand.spin(0.3)
    assert len(hand.surfaces) == count
    hand.states.clear()
    hand.stream(squeezed(1e-3, 5.0), lambda: hand.state == 'CONTACT')


def test_a_contact_that_slides_keeps_being_served(node, hand):
    def sliding(i):
        angle = 0.01 * min(i, 30)
        outward = np.array(
            [[np.cos(angle), np.sin(angle), 0], [-np.cos(angle), -np.sin(angle), 0]]
        )
        return live_hand.sample(
            0.0325 * outward, -outward, [7.0, 7.0], [1.5e-3] * 2, stamp=(i + 1) * STEP
        )

    direction = np.array([np.cos(0.3), np.sin(0.3), 0.0])

    def followed():
        if not hand.nonlinear:
            return False
        cloud = live_hand.packed(hand.nonlinear[-1])
        rest = cloud[:, :3] - cloud[:, 3:6]
        deepest = rest[np.argmax(cloud[:, 6])]
        return abs(deepest @ direction) > np.cos(0.15) * np.linalg.norm(deepest)

    hand.stream(sliding, followed)
    assert hand.diagnostics.get('load carried', '1') == '1', hand.report()


def test_three_fingers_are_served_together(node, hand):
    outward = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]])

    def three(i):
        return live_hand.sample(
            0.0325 * outward, -outward, [7.0] * 3, [1.5e-3] * 3, stamp=(i + 1) * STEP
        )

    def dented():
        if not hand.nonlinear:
            return False
        cloud = live_hand.packed(hand.nonlinear[-1])
        rest = cloud[:, :3] - cloud[:, 3:6]
        third = np.argmax(rest[:, 1])
        return cloud[third, 6] > 1e-3

    hand.stream(three, dented)


def test_a_fast_squeeze_is_served_within_its_own_sigma_and_settles_on_the_offline_answer(
    node, hand
):
    ball = load_object('tennis_ball')
    model = build_model(ball)
    solver, state = EquilibriumSolver(model), None
    pins = tuple(model.contact(x * OUTWARD, 1e-3) for x in (0.0325, -0.0325))
    depths = np.linspace(0.0, 6e-3, 25)
    forces, surfaces = [], []
    for depth in depths:
        state = solver.solve(displaced(pins, [depth, depth]), state)
        assert state.converged
        forces.append(state.force[0])
        surfaces.append(model.surface.limit_positions(state.positions))

    def squeeze(i):
        at = min(i, len(depths) - 1)
        return live_hand.opposed([forces[at]] * 2, [depths[at]] * 2, stamp=(2000 + i) * STEP)

    def settles():
        return len(hand.surfaces) > 100 and distance(hand.surfaces[-1], surfaces[-1]).max() < 2e-5

    hand.stream(squeeze, settles)
    for message in hand.surfaces:
        at = stamp_of(message) // STEP - 2000
        if at < 0:
            # still an answer to the test before
            continue
        served = live_hand.packed(message)
        error = distance(message, surfaces[min(at, len(depths) - 1)])
        worst = int(np.argmax(error - 3.0 * served[:, 7]))
        told = f'sample {at}: {1e3 * error[worst]:.3f} mm, sigma {1e3 * served[worst, 7]:.3f} mm'
        assert np.all(error < 3.0 * served[:, 7] + 2e-5), told


def stamp_of(message):
    """Its stamp [ns]."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def distance(message, surface):
    """Distances (n,) [m] of the served vertices from those of an offline solution."""
    return np.linalg.norm(live_hand.packed(message)[:, :3] - surface, axis=1)


def test_a_sample_with_nan_is_a_fault_and_is_not_answered(node, hand):
    sent = []

    def broken(i):
        sent.append(i)
        return squeezed(1e-3, float('nan'))(i)

    hand.stream(broken, lambda: hand.state == 'FAULT')
    # Answers to samples of before may still have been on their way.
    hand.clear()
    sent.clear()
    hand.stream(broken, lambda: len(sent) > 30)
    assert not hand.surfaces and hand.state == 'FAULT'
    assert 'force is' in node.text


def test_fingers_that_let_go_leave_the_shell_at_rest(node, hand):
    def free(i):
        return live_hand.opposed([0.0, 0.0], stamp=(i + 1) * STEP, flags=0)

    hand.stream(free, lambda: len(hand.surfaces) > 5 and hand.state == 'FREE')
    assert largest(hand.surfaces[-1]) == 0.0


def test_a_value_outside_its_range_is_refused_with_the_range(node, hand):
    result = set_parameter(hand, Parameter('modulus_sigma', value=-1.0))
    assert not result.successful
    assert 'modulus_sigma' in result.reason
    result = set_parameter(hand, Parameter('object', value='no_such_object'))
    assert not result.successful
    assert 'no_such_object' in result.reason


def test_reset_starts_again_from_the_undeformed_shell(node, hand):
    client = hand.node.create_client(Trigger, 'deformation/reset')
    assert answer(client, Trigger.Request(), partial(wait, hand)).success
    hand.stream(squeezed(1e-3, 5.0), settled(hand, 1e-3))


LATE = 1_000_000


@pytest.mark.parametrize(('first', 'then'), [(LATE, 0), (0, LATE)], ids=['back', 'ahead'])
def test_when_time_jumps_the_contacts_are_answered_anew_from_the_first_sample(
    node, hand, first, then
):
    hand.stream(squeezed(3e-3, start=first), settled(hand, 3e-3))
    hand.clear()
    sent = hand.stream(squeezed(0.5e-3, 3.0, start=then), settled(hand, 0.5e-3))
    wait(hand, lambda: len(hand.surfaces) >= sent - 2)

    def after(messages):
        return [m for m in messages if (m.header.stamp.sec < LATE * STEP // 10**9) == (then == 0)]

    answers = after(hand.surfaces)
    # linear theory from rest, until the equilibrium of this time is there
    assert hand.kinds[-2:] == ['taking up', 'nonlinear']
    assert [largest(m) for m in answers] == pytest.approx([0.5e-3] * len(answers), rel=0.1)
    # what was on its way when time jumped comes first, and nothing of before comes later
    equilibria = after(hand.nonlinear)
    assert equilibria and hand.nonlinear[-len(equilibria) :] == equilibria


def test_one_late_cycle_of_the_hand_changes_nothing_beyond_its_sample(node, hand):
    start = hand.stream(squeezed(2e-3, 8.0), settled(hand, 2e-3))
    stale = live_hand.opposed([8.0, 8.0], [2e-3, 2e-3], stamp=start * STEP + STEP // 2)
    stale.flags[:] |= FLAG_STALE
    hand.clear()
    hand.send(stale)
    wait(hand, lambda: hand.state == 'STALE')
    late = hand.stream(squeezed(2e-3, 8.0, start=start - 1), lambda: len(hand.surfaces) >= 50)
    wait(hand, lambda: len(hand.surfaces) >= late - 2)
    assert min(largest(m) for m in hand.surfaces) > 1.9e-3
    assert hand.state == 'CONTACT'


def test_a_stale_copy_with_the_stamp_of_its_sample_is_told(node, hand):
    start = hand.stream(squeezed(2e-3, 8.0), settled(hand, 2e-3))
    copy = squeezed(2e-3, 8.0)(start - 1)
    copy.flags[:] |= FLAG_STALE
    wait(hand, lambda: hand.surfaces and stamp_of(hand.surfaces[-1]) == start * STEP)
    hand.clear()
    hand.send(copy)
    wait(hand, lambda: hand.state == 'STALE')
    assert not hand.surfaces
    hand.stream(squeezed(2e-3, 8.0, start=start), lambda: hand.surfaces)
    assert largest(hand.surfaces[0]) > 1.9e-3


def test_a_first_touch_anywhere_is_answered_in_its_own_sample(node, hand):
    fingers_off = live_hand.opposed([0.0, 0.0], stamp=500 * STEP, flags=0)
    hand.send(fingers_off)
    wait(hand, lambda: hand.surfaces and hand.state == 'FREE')
    outward = np.array([[0.6, 0.48, 0.64], [-0.6, -0.48, -0.64]])
    hand.clear()
    hand.send(
        live_hand.sample(0.0325 * outward, -outward, [4.0] * 2, [7e-4] * 2, stamp=501 * STEP)
    )
    wait(hand, lambda: hand.surfaces)
    assert largest(hand.surfaces[0]) == pytest.approx(7e-4, rel=0.1)
    # What was told of the sample before may come late.
    wait(hand, lambda: hand.kinds[-1:] == ['taking up'])
    wait(hand, lambda: np.isnan(hand.numbers.get('nonlinear_age', 0.0)))

    def held(i):
        return live_hand.sample(
            0.0325 * outward, -outward, [4.0] * 2, [7e-4] * 2, stamp=(502 + i) * STEP
        )

    hand.stream(held, lambda: hand.kinds[-1] == 'nonlinear')
    wait(hand, lambda: np.isfinite(hand.numbers['nonlinear_age']))


def test_fingers_that_come_back_with_their_travel_make_the_same_dent(node, hand):
    start = hand.stream(squeezed(1.5e-3, 7.0), settled(hand, 1.5e-3))

    def one_lets_go(i):
        sample = squeezed(1.5e-3, 7.0, start=start)(i)
        sample.flags[1] = 0
        return sample

    def renumbered(i):
        sample = squeezed(1.5e-3, 7.0, start=start)(i)
        sample.finger[:] = (5, 6)
        return sample

    for away in (one_lets_go, renumbered):
        hand.nonlinear.clear()
        start += hand.stream(away, lambda: len(hand.nonlinear) > 10)
        hand.nonlinear.clear()
        start += hand.stream(squeezed(1.5e-3, 7.0, start=start), lambda: len(hand.nonlinear) > 20)
        assert largest(hand.nonlinear[-1]) == pytest.approx(1.5e-3, abs=3e-5)


def test_a_stopped_background_process_is_noticed_and_replaced(node, hand):
    start = hand.stream(squeezed(2e-3, 8.0), settled(hand, 2e-3))
    restarts = int(hand.diagnostics['background restarts'])
    os.kill(worker_of(node.process.pid), signal.SIGSTOP)
    hand.clear()
    sent = hand.stream(
        squeezed(2e-3, 8.0, start=start),
        lambda: int(hand.diagnostics['background restarts']) == restarts + 1,
        timeout=10.0,
    )
    wait(hand, lambda: len(hand.surfaces) >= sent - 2)
    assert min(largest(m) for m in hand.surfaces) == pytest.approx(2e-3, abs=1e-4)
    hand.nonlinear.clear()
    hand.stream(squeezed(2.5e-3, 9.0, start=start + sent), settled(hand, 2.5e-3))


def test_losses_are_those_of_the_middleware_however_irregular_the_stamps(node, hand):
    stamps = np.cumsum(np.random.default_rng(0).exponential(STEP, 60)).astype(int) + 3000 * STEP

    def irregular(i):
        return live_hand.opposed([5.0] * 2, [1e-3] * 2, stamp=int(stamps[min(i, 59)]))

    before = hand.diagnostics['lost']
    hand.stream(irregular, lambda: len(hand.surfaces) >= 50)
    hand.diagnostics.clear()
    wait(hand, lambda: 'lost' in hand.diagnostics)
    assert hand.diagnostics['lost'] == before


def test_a_node_that_waits_for_the_take_up_never_serves_less_than_an_equilibrium(node, hand):
    assert set_parameter(hand, Parameter('wait_for_take_up', value=30.0)).successful
    hand.send(live_hand.opposed([0.0, 0.0], stamp=5000 * STEP, flags=0))
    wait(hand, lambda: hand.surfaces and hand.state == 'FREE')
    hand.clear()
    hand.send(live_hand.opposed([16.0] * 2, [5e-3] * 2, stamp=5001 * STEP))
    wait(hand, lambda: hand.surfaces)
    # What was told of the sample before may come late.
    wait(hand, lambda: hand.kinds[-1:] == ['nonlinear'])
    wait(hand, lambda: hand.nonlinear)
    away = live_hand.packed(hand.surfaces[0])[:, :3] - live_hand.packed(hand.nonlinear[-1])[:, :3]
    assert np.linalg.norm(away, axis=1).max() < 5e-5
    assert set_parameter(hand, Parameter('wait_for_take_up', value=0.0)).successful


def test_a_killed_background_process_is_replaced_while_samples_are_answered(node, hand):
    before = hand.stream(squeezed(2e-3, 8.0), settled(hand, 2e-3))
    restarts = int(hand.diagnostics['background restarts'])
    os.kill(worker_of(node.process.pid), signal.SIGKILL)
    hand.surfaces.clear()
    sent = hand.stream(
        squeezed(2e-3, 8.0, start=before),
        lambda: int(hand.diagnostics['background restarts']) > restarts,
    )
    wait(hand, lambda: len(hand.surfaces) >= sent - 2)
    assert largest(hand.surfaces[-1]) == pytest.approx(2e-3, abs=1e-4)
    hand.nonlinear.clear()
    hand.stream(squeezed(2.5e-3, 9.0), settled(hand, 2.5e-3))


def test_the_object_is_changed_while_running(node, hand):
    result = set_parameter(hand, Parameter('object', value='tennis_ball_as_printed'))
    assert result.successful
    hand.stream(squeezed(1e-3, 0.5), settled(hand, 1e-3))
    wait(hand, lambda: hand.diagnostics['object'] == 'tennis_ball_as_printed')


def test_interrupt_ends_node_and_background_process(node, hand):
    worker = worker_of(node.process.pid)
    assert node.stop() == 0
    wait(hand, lambda: not os.path.exists(f'/proc/{worker}'))
    assert 'Traceback' not in node.text


def test_the_mesh_follows_fingers_that_rest_where_it_is_coarse(node, hand, tmp_path):
    node.stop()
    outward = np.array([[0.0, 0.6, 0.8], [0.0, -0.6, -0.8]])
    ball = load_object('tennis_ball')
    truth = build_model(ball, refine_at=0.0325 * outward, refine_radius=1e-3)
    pins = tuple(truth.contact(0.03125 * side, 1e-3) for side in outward)
    state = EquilibriumSolver(truth).solve(displaced(pins, [6e-3, 6e-3]))
    surface = truth.surface.limit_positions(state.positions)
    running = serving(hand, tmp_path / 'log')

    def held(i):
        return live_hand.sample(
            0.0325 * outward, -outward, state.force, [6e-3] * 2, stamp=(1 + i) * STEP
        )

    def followed():
        if 'graded where the fingers are' not in running.text or not hand.nonlinear:
            return False
        now = live_hand.packed(hand.nonlinear[-1])[:, :3]
        return now.shape == surface.shape and np.linalg.norm(now - surface, axis=1).max() < 5e-5

    hand.stream(held, followed, rate=50.0)
    depths = np.array([largest(m) for m in hand.surfaces])
    assert depths[-1] == pytest.approx(6e-3, rel=5e-3)
    # the vertices of the mesh before do not lie under the pins; beyond that nothing jumps
    assert np.abs(np.diff(depths[len(depths) // 2 :])).max() < 8e-4
    assert hand.diagnostics and running.stop() == 0


def test_an_object_file_that_is_gone_for_a_while_is_told_for_that_while(hand, tmp_path):
    file, away = tmp_path / 'ball.yaml', tmp_path / 'away'
    text = (resources.files('shell_deform.objects') / 'tennis_ball.yaml').read_text()
    file.write_text(text.replace('control_vertices: 640', 'control_vertices: 200'))
    running = serving(hand, tmp_path / 'log', f'object:={file}')
    file.rename(away)
    os.kill(worker_of(running.process.pid), signal.SIGKILL)
    wait(hand, lambda: 'no object file' in hand.summary)
    away.rename(file)
    wait(hand, lambda: hand.summary and 'no object file' not in hand.summary)
    assert running.stop() == 0


def test_a_wrong_parameter_ends_the_start_with_one_sentence(hand, tmp_path):
    node = Node(tmp_path / 'log', 'object:=no_such_object')
    assert node.ended() == 1
    assert 'no_such_object' in node.text
    assert 'Traceback' not in node.text


@pytest.mark.parametrize(
    ('name', 'value', 'told'),
    [
        ('drive', 'guess', 'force, motion, fused'),
        ('theory', 'linear', 'koiter'),
        ('pin_radius', 7.0, '0.05'),
        ('object_pose', [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0], 'unit quaternion'),
        ('object', 'no_such_object', 'no_such_object'),
        ('object_pose', [1e300, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], 'within 10 m'),
        ('marker_rate', 1e-300, '0 or at least 0.01'),
        ('control_vertices', 11, '0 or at least 12'),
    ],
)
def test_a_wrong_value_is_refused_with_what_is_allowed(name, value, told):
    with pytest.raises(parameters.ParameterError, match=told):
        parameters.validate({name: value})


def test_the_shipped_configuration_holds_every_parameter_at_its_default():
    shipped = yaml.safe_load(CONFIGURATION.read_text())['deformation']['ros__parameters']
    assert shipped == {p.name: p.default for p in parameters.PARAMETERS}


def worker_of(parent):
    """Process id of the background process of a node."""
    for entry in os.listdir('/proc'):
        if entry.isdigit():
            try:
                fields = Path(f'/proc/{entry}/stat').read_text().rsplit(')', 1)[1].split()
                command = Path(f'/proc/{entry}/cmdline').read_text()
            except OSError:
                continue
            if int(fields[1]) == parent and 'shell_deform.live.background.worker' in command:
                return int(entry)
    raise AssertionError('no background process')


def set_parameter(hand, parameter):
    client = hand.node.create_client(SetParameters, '/deformation/set_parameters')
    request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
    return answer(client, request, partial(wait, hand)).results[0]
