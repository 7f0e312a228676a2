# SPDX-License-Identifier: Apache-2.0
"""The real node, whose mesh goes where fingers with bodies rest: processes and topics."""

import live_hand
import pytest
from sensor_msgs.msg import PointCloud2
from test_deformation_node import serving
from tests.running import own_domain

from shell_deform.building import build_model
from shell_deform.contact.finger_bodies import read_finger_bodies
from shell_deform.live.tick.load_path import LoadPath
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.objects import load_object

STEP = 20_000_000
VERTICES, FRICTION = 250, 0.4


def gripped(number, beyond=0.0):
    """Two tips far from the contacts of the object file; the first turns, then both rest.

    `beyond`: a further turn at the end [rad].
    """
    depth, turn = live_hand.TIPS_WAY[min(number, len(live_hand.TIPS_WAY) - 1)]
    return live_hand.tips_aside((number + 1) * STEP, depth, turn + beyond)


def push(message):
    """Push of the first finger by its cells [N]."""
    names, rows = [field.name for field in message.fields], live_hand.packed(message)
    mine = rows[rows[:, names.index('finger')] == 1]
    force = mine[:, [names.index(name) for name in ('fx', 'fy', 'fz')]].sum(axis=0)
    return float(force @ gripped(0).normal[0])


def spin(message):
    """What friction turns the ball with under the first finger [N m]."""
    names = [field.name for field in message.fields]
    return float(live_hand.packed(message)[0, names.index('spin_modelled')])


def on_a_mesh_made_for_it():
    """The same without node, on a mesh that is graded there from the beginning."""
    bodies = read_finger_bodies('barrett_fingertip')
    first = gripped(0)
    places = first.point - first.travel[:, None] * first.normal
    model = build_model(
        bodies.touching(load_object('tennis_ball'), places), control_vertices=VERTICES
    )
    tips = Rehearsal(model, live_hand.Settings(live_hand.SURE), bodies.loaded())
    path = LoadPath(2e-4, 0.0225)
    for number in range(len(live_hand.TIPS_WAY) + 1):
        tips.follow(gripped(number), path, FRICTION)
    return tips.estimator.adopted.response.force[0]


@pytest.mark.soak
def test_the_node_changes_to_a_mesh_made_for_where_its_fingertips_rest(tmp_path):
    with own_domain():
        hand = live_hand.Observer()
        cells = []
        hand.node.create_subscription(PointCloud2, 'deformation/taxels', cells.append, 100)
        node = serving(
            hand, tmp_path / 'log', 'finger_body:=barrett_fingertip', f'friction:={FRICTION}',
            f'control_vertices:={VERTICES}',
        )  # fmt: skip
        try:
            sent = hand.stream(gripped, lambda: 'graded where the fingers are' in node.text)
            before, count = (push(cells[-1]), spin(hand.grasps[-1])), len(cells)
            hand.stream(lambda k: gripped(sent + k, 0.01), lambda: len(cells) > count)
            after = push(cells[-1]), spin(hand.grasps[-1])
            assert hand.state == 'CONTACT'
        finally:
            node.stop()
            hand.close()
    # The ball's own mesh is made for pins elsewhere, and too stiff here.
    assert before[0] > 1.1 * after[0]
    assert after[0] == pytest.approx(on_a_mesh_made_for_it(), rel=0.02)
    # What friction had wound up stays.
    assert abs(before[1]) > 1e-3
    assert after[1] == pytest.approx(before[1], rel=0.5)
