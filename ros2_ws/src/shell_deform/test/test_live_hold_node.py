# SPDX-License-Identifier: Apache-2.0
"""The node holds what relaxes: forces of later on a topic, no dent of a force that falls."""

from __future__ import annotations

from functools import partial

import live_hand
import numpy as np
import pytest
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from test_deformation_node import Node
from tests.patience import Patience
from tests.running import own_domain

from shell_deform.live.tick.hold import LATER_FIELDS, LATER_S
from shell_deform.objects import load_object

BALL = """
name: rubber_ball
surface: {sphere: {outer_diameter_m: 0.065}}
thickness_m: 0.0035
young_modulus_pa: 12.75e+6
poisson_ratio: 0.49
relaxation: {kind: log, share_per_decade: 0.05, from_s: 0.1, to_s: 10000, reference_s: 1}
control_vertices: 300
source: a test
"""
PUSH, DEPTH = 10.0, 2e-3


@pytest.fixture(scope='module')
def held(tmp_path_factory):
    """An observer of a node that has been told of a grasp of two minutes, and what it heard."""
    folder = tmp_path_factory.mktemp('held')
    path = folder / 'ball.yaml'
    path.write_text(BALL)
    law = load_object(str(path)).relaxation
    with own_domain():
        hand = live_hand.Observer()
        later: list[PointCloud2] = []
        hand.node.create_subscription(
            PointCloud2, 'deformation/later_force', later.append, QoSProfile(depth=500)
        )
        options = ('theory:=koiter', 'drive:=force', 'follow_contacts:=false')
        options += ('background_niceness:=0',)
        node = Node(folder / 'log', f'object:={path}', *options)

        def told(condition, act=lambda: None):
            patience = Patience(60.0)
            while not condition():
                running = node.process.poll() is None
                assert running and not patience.over, (hand.report(), node.text)
                act()
                hand.spin(0.01)

        def sample(seconds):
            push = PUSH * float(law(seconds))
            stamp = 10**9 + round(1e9 * seconds)
            return live_hand.opposed([push, push], [DEPTH, DEPTH], stamp=stamp)

        told(lambda: 'serving' in node.text)
        told(lambda: hand.contacts.get_subscription_count() > 0 and hand.node.count_publishers(
            'deformation/later_force') > 0)  # fmt: skip
        depths = []
        for seconds in np.concatenate([[0.0, 0.2, 0.4, 0.8], np.arange(3.0, 121.0, 3.0)]):
            asked = sample(seconds)
            hand.surfaces.clear()
            hand.send(asked)
            # Until both ends of every topic have met, a sample or its answer may be lost.
            again = (lambda: None) if depths else partial(hand.send, asked)
            told(lambda: bool(hand.surfaces), again)
            depths.append(float(live_hand.packed(hand.surfaces[-1])[:, 6].max()))
            # A busy machine has a quarter of a second a sample for the first equilibrium.
            pause = Patience(0.25)
            while not (dented(hand.nonlinear) or pause.over):
                hand.spin(0.01)
        told(lambda: bool(later) and stamp_of(later[-1]) == asked.stamp)
        yield law, later, depths
        assert node.stop() == 0
        hand.close()


def dented(equilibria):
    return any(live_hand.packed(one)[:, 6].max() > 0.5e-3 for one in equilibria)


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_the_force_of_later_is_published_with_the_stamp_of_its_sample(held):
    law, later, _ = held
    rows = live_hand.packed(later[-1])
    assert tuple(field.name for field in later[-1].fields) == LATER_FIELDS
    assert rows[:, 1].tolist() == sorted(2 * list(LATER_S))
    for finger, after, force, sigma in rows:
        assert finger in (1.0, 2.0)
        assert force == pytest.approx(PUSH * float(law(120.0 + after)), rel=2e-3)
        assert 0.0 < sigma < 0.3 * force


def test_a_force_that_falls_as_the_wall_relaxes_makes_no_dent_shallower(held):
    _, _, depths = held
    late = np.array(depths[20:])
    assert np.ptp(late) < 0.02 * late.mean()
