# SPDX-License-Identifier: Apache-2.0
"""The real node whose fingers press where their touch cells measure it."""

from dataclasses import replace

import live_hand
import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from test_deformation_fingertips import felt
from test_deformation_node import Node, serving, wait
from tests.running import own_domain

STEP = 10_000_000
HEEL, TIP = 1, 16
"""Cells in the middle of the pad, 12 mm behind and 17 mm before where it touches."""


@pytest.fixture(scope='module')
def hand():
    with own_domain():
        observer = live_hand.Observer()
        observer.tactile = observer.node.create_publisher(PointCloud2, 'hand/tactile', 10)
        yield observer
        observer.close()


@pytest.fixture(scope='module')
def node(hand, tmp_path_factory):
    running = serving(
        hand, tmp_path_factory.mktemp('cells') / 'log', 'finger_body:=barrett_fingertip',
        'load_shape:=cells', 'control_vertices:=250', 'drive:=force',
    )  # fmt: skip
    wait(hand, lambda: hand.tactile.get_subscription_count() > 0)
    yield running
    running.stop()


def pressed(cell):
    """Forces of the cells of both fingers [N], all of it on one of them."""
    forces = np.zeros(48)
    forces[[cell, 24 + cell]] = 5.0
    return forces


def until(hand, numbers, forces, condition):
    """Cells and contacts, sample after sample, until a surface answers that fits."""

    def sent():
        number = next(numbers)
        hand.tactile.publish(felt(number * STEP, forces))
        sample = live_hand.opposed([5.0] * 2, stamp=number * STEP, radius=7.5e-3)
        hand.send(replace(sample, along=np.array([[0.0, 0.0, 1.0]] * 2)))
        hand.spin(0.02)
        return bool(hand.surfaces) and condition()

    wait(hand, sent)


def deepest(hand):
    """Height of the deepest place of the newest surface along the fingers [m]."""
    rows = live_hand.packed(hand.surfaces[-1])
    return rows[np.argmax(rows[:, 6]), 2] - rows[np.argmax(rows[:, 6]), 5]


def test_the_surface_is_deepest_where_the_cells_feel_the_push(node, hand):
    numbers = iter(range(1, 100_000))
    until(hand, numbers, pressed(TIP), lambda: deepest(hand) > 8e-3)
    wait(hand, lambda: hand.diagnostics.get('load by the cells of fingers') == '1, 2')
    until(hand, numbers, pressed(HEEL), lambda: deepest(hand) < -6e-3)
    # Cells that cannot be are told, and the last good ones stay.
    wrong = np.full(48, np.nan)
    until(
        hand, numbers, wrong, lambda: 'measures nan N' in hand.diagnostics.get('hand/tactile', '')
    )
    until(hand, numbers, wrong, lambda: deepest(hand) < -6e-3 and hand.state == 'CONTACT')


@pytest.mark.parametrize(
    ('assignments', 'says'),
    [
        (('load_shape:=cells',), 'finger_body must name a body with touch cells'),
        (('load_shape:=soft',), 'load_shape'),
    ],
)
def test_a_node_refuses_shapes_that_cannot_be(tmp_path, assignments, says):
    with own_domain():
        refused = Node(tmp_path / 'log', *assignments)
        refused.process.wait(60.0)
    assert refused.process.returncode != 0
    assert says in refused.text
