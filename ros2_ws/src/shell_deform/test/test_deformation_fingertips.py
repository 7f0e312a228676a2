# SPDX-License-Identifier: Apache-2.0
"""The real node with fingers that carry bodies: one process with its background, in order."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from test_deformation_node import Node, serving, wait

STEP = 10_000_000
HELD = 30


@pytest.fixture(scope='module')
def hand():
    with live_hand.own_domain():
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


@pytest.mark.parametrize(
    ('assignment', 'says'),
    [
        ('finger_body:=thumb', "there is no body 'thumb'"),
        ('friction:=-0.1', 'friction out of range'),
        ('friction:=.nan', 'friction out of range'),
    ],
)
def test_a_node_refuses_bodies_and_friction_that_cannot_be(tmp_path, assignment, says):
    with live_hand.own_domain():
        refused = Node(tmp_path / 'log', assignment)
        refused.process.wait(60.0)
    assert refused.process.returncode != 0
    assert says in refused.text
