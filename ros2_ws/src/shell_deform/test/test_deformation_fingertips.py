# SPDX-License-Identifier: Apache-2.0
"""The real node with fingers that carry bodies: one process with its background, in order."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
import trimesh
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2, PointField
from test_deformation_node import Node, serving, set_parameter, wait
from tests.running import own_domain

STEP = 10_000_000
HELD = 30


@pytest.fixture(scope='module')
def hand():
    with own_domain():
        observer = live_hand.Observer()
        observer.taxels = []
        observer.node.create_subscription(
            PointCloud2, 'deformation/taxels', observer.taxels.append, 100
        )
        yield observer
        observer.close()


@pytest.fixture(scope='module')
def node(hand, tmp_path_factory):
    log = tmp_path_factory.mktemp('tips') / 'log'
    running = serving(
        hand, log, 'finger_body:=barrett_fingertip', 'control_vertices:=250', 'friction:=0.4',
        'wait_for_take_up:=60.0',
    )  # fmt: skip
    wait(hand, lambda: hand.node.count_publishers('deformation/taxels') > 0)
    yield running
    running.stop()


def squeeze(depth, turn, number):
    sample = live_hand.opposed([5.0] * 2, [depth] * 2, stamp=(number + 1) * STEP, radius=7.5e-3)
    along = np.array([[0.0, -np.sin(turn), np.cos(turn)], [0.0, 0.0, 1.0]])
    return replace(sample, along=along)


def programme(first):
    """A squeeze to 0.8 mm, then a turn of one finger: samples from the stamp number `first` on."""
    depths = np.concatenate([np.linspace(0.0, 8e-4, 12), np.full(4, 8e-4)])
    turns = np.concatenate([np.zeros(12), np.linspace(0.01, 0.04, 4)])
    return [
        squeeze(depth, turn, first + k)
        for k, (depth, turn) in enumerate(zip(depths, turns, strict=True))
    ]


def played(hand, samples, pause=0.0):
    """The surfaces that answer samples sent one after the other, `pause` [s] between them."""
    hand.clear()
    for number, sample in enumerate(samples, 1):
        hand.send(sample)
        wait(hand, lambda wanted=number: len(hand.surfaces) >= wanted)
        hand.spin(pause)
    return [bytes(message.data) for message in hand.surfaces]


def refused(hand, make, word):
    """Send `make(number)` again and again until the node faults and says `word`."""
    numbers = iter(range(520, 10_000))

    def sent():
        hand.send(make(next(numbers)))
        return hand.state == 'FAULT' and word in hand.summary

    wait(hand, sent)
    return next(numbers)


def test_a_squeeze_by_fingertips_is_served_with_its_touch_cells(node, hand):
    wait(hand, lambda: 'load cases behind' in hand.diagnostics)
    answers = played(hand, programme(0))
    assert len(answers) == len(programme(0))
    cells = live_hand.packed(hand.taxels[-1])
    names = [field.name for field in hand.taxels[-1].fields]
    assert cells.shape == (48, len(names))
    force = cells[:, [names.index(name) for name in ('fx', 'fy', 'fz')]]
    assert -force[:24, 0].sum() == pytest.approx(force[24:, 0].sum(), rel=1e-3)
    assert force[24:, 0].sum() > 1.0


def felt(stamp, forces):
    """`hand/tactile` of two fingers from the forces (48,) of their cells [N]; fewer lack some."""
    count = len(forces)
    rows = np.zeros(count, np.dtype([(name, 'f4') for name in ('finger', 'cell', 'force')]))
    rows['finger'] = np.repeat([1, 2], 24)[:count]
    rows['cell'] = np.tile(np.arange(24), 2)[:count]
    rows['force'] = forces
    message = PointCloud2(
        height=1,
        width=count,
        fields=[
            PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
            for k, name in enumerate(rows.dtype.names)
        ],
        point_step=12,
        row_step=12 * count,
        data=rows.tobytes(),
    )
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    return message


def test_in_lockstep_the_states_have_the_same_bytes_at_any_speed(node, hand):
    """A release between them clears what friction remembers."""
    runs = []
    for run, pause in enumerate((0.0, 0.05, 0.0)):
        first = 100 * (run + 1)
        free = replace(squeeze(0.0, 0.0, first - 1), flags=np.zeros(2, np.int64))
        played(hand, [free])
        runs.append(played(hand, programme(first), pause))
    assert runs[0] == runs[1] == runs[2]


def test_a_finger_that_turns_by_more_than_its_width_in_one_sample_is_a_fault(node, hand):
    played(hand, programme(500))
    number = refused(hand, lambda number: squeeze(8e-4, 1.2 * (-1) ** number, number), 'turned by')
    # It comes back, and what friction remembered is still there.
    again = [squeeze(8e-4, 0.04, number + k) for k in range(2)]
    answers = played(hand, again)
    assert len(answers) == 2
    wait(hand, lambda: hand.state == 'CONTACT')


def test_a_finger_that_starts_inside_the_object_is_a_fault_in_one_sentence(node, hand):
    def inside(number):
        sample = squeeze(8e-4, 0.04, number)
        point = sample.point.copy()
        point[0] = [0.027, 0.0, 0.0]
        return replace(sample, point=point, finger=np.array([3, 4]))

    number = refused(hand, inside, 'inside the object')
    assert len(played(hand, [squeeze(8e-4, 0.04, number)])) == 1


def test_measured_cells_are_held_against_the_expected_ones_and_name_the_finger(node, hand):
    publisher = hand.node.create_publisher(PointCloud2, 'hand/tactile', 10)
    wait(hand, lambda: publisher.get_subscription_count() > 0)
    played(hand, programme(20_000))
    names = [field.name for field in hand.taxels[-1].fields]
    cells = live_hand.packed(hand.taxels[-1])
    force, normal = (cells[:, [names.index(name + axis) for axis in 'xyz']] for name in ('f', 'n'))
    expected = np.einsum('ci,ci->c', force, normal)
    numbers = iter(range(20_020, 30_000))

    def told(forces, key, wanted):
        """Cells and samples until the diagnostics say what is wanted."""

        def sent():
            number = next(numbers)
            publisher.publish(felt(number * STEP, forces))
            # A step and back: every load case is held against the cells.
            played(hand, [squeeze(8e-4, 0.04 + 0.02 * (number % 2), number)])
            return wanted(hand.diagnostics.get(key, ''))

        wait(hand, sent)

    told(expected, 'touch suspect', lambda said: said == '')
    told(expected, 'touch contradiction', lambda said: said and float(said) < 1.0)
    wrong = expected.copy()
    wrong[24:] *= 2.0
    told(wrong, 'touch suspect', lambda said: 'finger 2' in said)
    told(np.full(48, np.nan), 'hand/tactile', lambda said: 'measures nan N' in said)
    told(expected[:40], 'hand/tactile', lambda said: 'has 16 cells of finger 2' in said)
    told(expected, 'hand/tactile', lambda said: said == '')


def test_a_change_that_cannot_be_leaves_a_running_node_as_it_was(node, hand, tmp_path):
    holed = trimesh.creation.box((12.0, 8.0, 4.0))
    holed.update_faces(np.arange(len(holed.faces)) > 0)
    holed.export(tmp_path / 'holed.stl')
    for name, value, says in (
        ('finger_body', f'{tmp_path}/holed.stl mm', 'the mesh of a finger has holes'),
        ('finger_body', f'{tmp_path}/holed.stl', 'a mesh needs the unit of its numbers'),
        ('finger_body', '1: barrett_fingertip, 1: barrett_fingertip', 'carries two bodies'),
        ('friction', float('nan'), 'friction'),
        ('friction', -0.1, 'friction'),
        ('path_step', 0.0, 'path_step'),
        ('load_shape', 'soft', 'load_shape'),
    ):
        answer = set_parameter(hand, Parameter(name, value=value))
        assert not answer.successful
        assert says in answer.reason
        assert '\n' not in answer.reason
    assert len(played(hand, programme(40_000))) == len(programme(0))


@pytest.mark.parametrize(
    ('assignment', 'says'),
    [
        ('finger_body:=thumb', "there is no body 'thumb'"),
        ('friction:=-0.1', 'friction out of range'),
        ('friction:=.nan', 'friction out of range'),
    ],
)
def test_a_node_refuses_bodies_and_friction_that_cannot_be(tmp_path, assignment, says):
    with own_domain():
        refused = Node(tmp_path / 'log', assignment)
        refused.process.wait(60.0)
    assert refused.process.returncode != 0
    assert says in refused.text
