# SPDX-License-Identifier: Apache-2.0
"""The house: which rooms `shell_deform` has, and that imports run one way through them."""

import ast

from docs import rooms

ROS = {
    'rclpy',
    'builtin_interfaces',
    'diagnostic_msgs',
    'geometry_msgs',
    'sensor_msgs',
    'std_msgs',
}


def test_every_module_stands_in_a_room_of_the_house():
    assert {rooms.room(name) for name in rooms.modules()} <= set(rooms.ORDER)


def test_no_import_leads_up_so_none_leads_in_a_circle():
    order = rooms.ORDER
    up = {
        arrow: lines
        for arrow, lines in rooms.arrows().items()
        if order.index(arrow[0]) >= order.index(arrow[1])
    }
    assert not up


def test_the_house_has_at_most_thirteen_floors():
    assert max(rooms.floors(set(rooms.arrows())).values()) < 13


def test_the_picture_in_the_documentation_is_that_of_the_imports():
    text = rooms.PAGE.read_text()
    assert text == rooms.renewed(text), 'renew it by `make tables`'


def test_only_the_room_of_the_node_knows_ros():
    knowing = set()
    for module, path in rooms.modules().items():
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or '']
            if ROS & {name.partition('.')[0] for name in names}:
                knowing.add(rooms.room(module))
    assert knowing == {'node'}
