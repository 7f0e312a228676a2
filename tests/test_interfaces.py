# SPDX-License-Identifier: Apache-2.0
"""TF and actions of an environment of wheels are on the wire what the apt packages of a cell are.

Two ends of a topic, a service or an action fit only if their type hashes (REP 2016, over the whole
description with everything it refers to) are equal. The wanted ones were not made here: they are
those of builds of ROS itself that others have published, of `control_msgs` by a workspace that was
built from its sources, of `tf2_msgs` by the names that rmw_zenoh gives to `/tf`.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest
import rclpy
from rclpy.action import ActionServer

_BUILD = Path(__file__).resolve().parents[1] / 'requirements' / 'build_interfaces.py'
_SPEC = importlib.util.spec_from_file_location('build_interfaces', _BUILD)
assert _SPEC is not None and _SPEC.loader is not None
build_interfaces = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(build_interfaces)

FROM_ROS = {
    'tf2_msgs/msg/TFMessage': 'e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087',
    'control_msgs/action/FollowJointTrajectory': (
        '738ebcb7a2d7cfa42f9f1001cc99ce3a4383d1cfe508015d9be8485e4b1c66f6'
    ),
    'control_msgs/action/FollowJointTrajectory_FeedbackMessage': (
        '80398fcb9674a79081a9906e2ccf0c804dd7cb15e22e362e606ee87186beab71'
    ),
    'control_msgs/action/GripperCommand': (
        'e17c0e644eccf14bea84a0a93e0977182872c2eb7873ca6694900059b46dbc84'
    ),
    'control_msgs/action/GripperCommand_FeedbackMessage': (
        '392ff03fcd872f9dc2405cbeb2897fcf011ad9998458b6aa85c603b8a49e431d'
    ),
}


@pytest.fixture
def node(domain_id):
    """A node that offers `/tf` and both actions, as the bridge does."""
    messages = pytest.importorskip('tf2_msgs.msg')
    actions = pytest.importorskip('control_msgs.action')
    # Another test of this process may have a context of its own.
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('offers', context=context)
    node.create_publisher(messages.TFMessage, 'tf', 1)
    servers = [
        ActionServer(node, kind, name, lambda handle: None)
        for kind, name in (
            (actions.FollowJointTrajectory, 'follow'),
            (actions.GripperCommand, 'grip'),
        )
    ]
    yield node
    for server in servers:
        server.destroy()
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.mark.parametrize(
    ('topic', 'kind'),
    [
        ('/tf', 'tf2_msgs/msg/TFMessage'),
        ('/follow/_action/feedback', 'control_msgs/action/FollowJointTrajectory_FeedbackMessage'),
        ('/grip/_action/feedback', 'control_msgs/action/GripperCommand_FeedbackMessage'),
    ],
)
def test_what_is_offered_on_the_wire_has_the_hash_of_ros(node, wait_until, topic, kind):
    wait_until(lambda: node.get_publishers_info_by_topic(topic))
    (offered,) = node.get_publishers_info_by_topic(topic)
    assert str(offered.topic_type_hash) == f'RIHS01_{FROM_ROS[kind]}'


def test_the_interfaces_that_are_compiled_here_have_the_hashes_of_ros(tmp_path):
    pytest.importorskip('rosidl_generator_type_description')
    found = {}
    for package in build_interfaces.PACKAGES:
        folder = tmp_path / package
        folder.mkdir()
        _, described = build_interfaces.describe(package, folder)
        for file in described:
            hashes = json.loads(file.read_text())['type_hashes'][0]
            found[hashes['type_name']] = hashes['hash_string']
    assert {kind: found[kind] for kind in FROM_ROS} == {
        kind: f'RIHS01_{number}' for kind, number in FROM_ROS.items()
    }
