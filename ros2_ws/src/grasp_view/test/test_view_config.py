"""RViz and Foxglove files show our topics, by fields they have."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

CONFIG = Path(__file__).resolve().parent.parent / 'config'
SURFACE = {'x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma'}
CLOUDS = {
    '/deformation/surface': SURFACE,
    '/deformation/linear': SURFACE,
    '/deformation/nonlinear': SURFACE,
    '/hand/contacts': {
        'x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz', 'sigma_n', 'radius', 'finger', 'flags',
    },
    '/scan/points': {'x', 'y', 'z'},
    '/scan/error': {'x', 'y', 'z', 'distance'},
}  # fmt: skip
NUMBERS = {
    *(
        f'/deformation/{name}'
        for name in (
            'max_displacement', 'linearity', 'strain_energy', 'nonlinear_age', 'snap_margin',
            'contradiction',
        )
    ),
    *(f'/scan/{name}' for name in ('mean_error', 'max_error', 'noise_floor')),
}  # fmt: skip
OTHERS = {
    '/deformation/marker', '/deformation/state', '/object_pose', '/diagnostics',
    *(f'/hand/finger_{n}/wrench' for n in (1, 2, 3)),
}  # fmt: skip
RVIZ = yaml.safe_load((CONFIG / 'grasp.rviz').read_text())['Visualization Manager']
FOXGLOVE = json.loads((CONFIG / 'grasp.foxglove.json').read_text())


def rviz_displays() -> list[dict[str, Any]]:
    return [one for one in RVIZ['Displays'] if 'Topic' in one]


def foxglove_paths() -> Iterator[str]:
    for panel in FOXGLOVE['configById'].values():
        for path in panel.get('paths', []):
            yield path['value']


def test_rviz_shows_only_topics_of_the_contract() -> None:
    shown = {one['Topic']['Value'] for one in rviz_displays()}
    assert shown <= {*CLOUDS, *OTHERS} and {'/deformation/marker', '/scan/error'} <= shown


def test_rviz_colours_clouds_by_fields_they_have() -> None:
    for one in rviz_displays():
        if one['Class'].endswith('PointCloud2') and 'Channel Name' in one:
            assert one['Channel Name'] in CLOUDS[one['Topic']['Value']]


def test_rviz_takes_scans_reliably_streams_best_effort_and_latched_marks_late() -> None:
    for one in rviz_displays():
        topic = one['Topic']
        wanted = {
            '/scan/points': ('Reliable', 'Volatile'),
            '/scan/error': ('Reliable', 'Volatile'),
            '/deformation/marker': ('Reliable', 'Transient Local'),
        }.get(topic['Value'], ('Best Effort', 'Volatile'))
        assert (topic['Reliability Policy'], topic['Durability Policy']) == wanted


def test_rviz_looks_from_the_hand_on_white() -> None:
    assert RVIZ['Global Options']['Fixed Frame'] == 'hand_base'


def test_foxglove_shows_only_topics_of_the_contract() -> None:
    assert set(FOXGLOVE['configById']['3D!grasp']['topics']) <= {*CLOUDS, *OTHERS}
    for path in foxglove_paths():
        topic = path.split('.')[0]
        assert topic in NUMBERS | OTHERS
        if topic in NUMBERS:
            assert path == f'{topic}.data'


def test_foxglove_colours_clouds_by_fields_they_have() -> None:
    for topic, look in FOXGLOVE['configById']['3D!grasp']['topics'].items():
        if look.get('colorMode') == 'gradient':
            assert look['colorField'] in CLOUDS[topic]


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
