# SPDX-License-Identifier: Apache-2.0
"""RViz and Foxglove files show our topics: by the types, the fields and the QoS they have."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64, String
from visualization_msgs.msg import Marker

ROOT = Path(__file__).resolve().parents[4]
CONFIG = Path(__file__).resolve().parent.parent / 'config'
SURFACE = {'x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma'}
FIELDS = {
    '/deformation/surface': SURFACE,
    '/deformation/linear': SURFACE,
    '/deformation/nonlinear': {*SURFACE, 'energy_density'},
    '/hand/contacts': {
        'x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius', 'finger', 'flags',
        'sigma_t', 'travel', 'sigma_travel', 'sigma_point', 'sigma_normal',
    },
    '/scan/points': {'x', 'y', 'z'},
    '/scan/error': {'x', 'y', 'z', 'distance'},
}  # fmt: skip
TYPES = {
    **dict.fromkeys(FIELDS, PointCloud2),
    **{
        f'/deformation/{name}': Float64
        for name in (
            'max_displacement', 'linearity', 'strain_energy', 'nonlinear_age', 'snap_margin',
            'contradiction',
        )
    },
    **{f'/scan/{name}': Float64 for name in ('mean_error', 'max_error', 'noise_floor')},
    **{f'/hand/finger_{n}/wrench': WrenchStamped for n in (1, 2, 3)},
    '/deformation/marker': Marker,
    '/deformation/state': String,
    '/object_pose': PoseStamped,
    '/diagnostics': DiagnosticArray,
}  # fmt: skip
SHOWN_BY = {
    'rviz_default_plugins/PointCloud2': PointCloud2,
    'rviz_default_plugins/Marker': Marker,
    'rviz_default_plugins/Wrench': WrenchStamped,
    'rviz_default_plugins/Pose': PoseStamped,
}
RVIZ = yaml.safe_load((CONFIG / 'grasp.rviz').read_text())['Visualization Manager']
FOXGLOVE = json.loads((CONFIG / 'grasp.foxglove.json').read_text())


def rviz_displays() -> list[dict[str, Any]]:
    return [one for one in RVIZ['Displays'] if 'Topic' in one]


def foxglove_paths() -> Iterator[str]:
    for panel in FOXGLOVE['configById'].values():
        for path in panel.get('paths', []):
            yield path['value']


def test_the_real_nodes_publish_these_topics_with_these_types_and_fields(
    start, domain_id: int, wait_until
) -> None:
    ball = ('--ros-args', '-p', 'object:=tennis_ball')
    start('deformation', *ball, '-p', 'theory:=koiter').wait_for('serving', 120)
    start('scan_compare', *ball)
    # A second before the first scan of the squeezed ball (the recording's README).
    start('replay', ROOT / 'bags' / 'tennis_ball_two_finger', '--loop', '--start-offset', 5.6)
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('observer', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    seen: dict[str, set[str]] = {}
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    for topic in FIELDS:
        node.create_subscription(
            PointCloud2,
            topic,
            lambda m, of=topic: seen.update({of: {field.name for field in m.fields}}),
            qos,
        )

    wanted = {
        topic: [f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}']
        for topic, kind in TYPES.items()
    }

    def all_there() -> bool:
        executor.spin_once(timeout_sec=0.1)
        if seen.keys() != FIELDS.keys():
            return False
        topics = dict(node.get_topic_names_and_types())
        return {name: topics.get(name) for name in wanted} == wanted

    try:
        wait_until(all_there, 180, lambda: str(seen))
        assert seen == FIELDS
        for one in rviz_displays():
            topic = one['Topic']
            for publisher in node.get_publishers_info_by_topic(topic['Value']):
                offered = publisher.qos_profile
                if topic['Reliability Policy'] == 'Reliable':
                    assert offered.reliability == ReliabilityPolicy.RELIABLE
                if topic['Durability Policy'] == 'Transient Local':
                    assert offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def test_rviz_shows_topics_by_displays_of_their_types() -> None:
    shown = {one['Topic']['Value']: SHOWN_BY[one['Class']] for one in rviz_displays()}
    assert shown.items() <= TYPES.items()
    assert {'/deformation/marker', '/scan/error'} <= shown.keys()


def test_rviz_colours_clouds_by_fields_they_have() -> None:
    for one in rviz_displays():
        if one['Class'].endswith('PointCloud2') and 'Channel Name' in one:
            assert one['Channel Name'] in FIELDS[one['Topic']['Value']]


def test_rviz_takes_scans_reliably_streams_best_effort_and_latched_marks_late() -> None:
    for one in rviz_displays():
        topic = one['Topic']
        wanted = {
            '/scan/points': ('Reliable', 'Volatile'),
            '/scan/error': ('Reliable', 'Volatile'),
            '/deformation/marker': ('Reliable', 'Transient Local'),
        }.get(topic['Value'], ('Best Effort', 'Volatile'))
        assert (topic['Reliability Policy'], topic['Durability Policy']) == wanted


def test_rviz_looks_from_the_hand() -> None:
    assert RVIZ['Global Options']['Fixed Frame'] == 'hand_base'


def test_foxglove_draws_only_types_it_can_place() -> None:
    for topic in FOXGLOVE['configById']['3D!grasp']['topics']:
        assert TYPES[topic] in SHOWN_BY.values()


def test_foxglove_plots_numbers_and_words_that_the_messages_have() -> None:
    for path in foxglove_paths():
        topic, *attributes = path.split('.')
        value: Any = TYPES[topic]()
        for attribute in attributes:
            value = getattr(value, attribute)
        assert isinstance(value, float | str), path


def test_foxglove_colours_clouds_by_fields_they_have() -> None:
    for topic, look in FOXGLOVE['configById']['3D!grasp']['topics'].items():
        if look.get('colorMode') == 'gradient':
            assert look['colorField'] in FIELDS[topic]


def test_foxglove_places_every_panel_it_describes() -> None:
    placed: list[str] = []

    def walk(node: Any) -> None:
        if isinstance(node, str):
            placed.append(node)
            return
        walk(node['first'])
        walk(node['second'])

    walk(FOXGLOVE['layout'])
    assert sorted(placed) == sorted(FOXGLOVE['configById'])
