# SPDX-License-Identifier: Apache-2.0
"""A squeezed ball's topics and services from another participant, for the tests of the page."""

from __future__ import annotations

import threading
from array import array
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import rclpy
import trimesh
from geometry_msgs.msg import Point
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from grasp_view.messages import contacts_message
from grasp_view.scene_model import Contacts

RADIUS = 0.03125
SURFACE_FIELDS = ('x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma')


def cloud(columns: np.ndarray, names: tuple[str, ...], stamp: object) -> PointCloud2:
    """Float32 columns (n, f) as a cloud in the object's frame."""
    data = np.ascontiguousarray(columns, dtype='<f4')
    message = PointCloud2(
        height=1,
        width=len(data),
        point_step=4 * len(names),
        row_step=data.nbytes,
        fields=[
            PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
            for k, name in enumerate(names)
        ],
        data=array('B', data.tobytes()),
    )
    message.header.stamp = stamp
    message.header.frame_id = 'object'
    return message


class Grasp:
    """The other nodes of a grasp in one: a squeezed ball's topics and the services."""

    def __init__(self, subdivisions: int = 3) -> None:
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
        self.rest = np.asarray(ball.vertices)
        self.called: list[str] = []
        self._at_rest()
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('grasp', context=self._context)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        make = self._node.create_publisher
        self._clouds = {
            name: make(PointCloud2, name, 10)
            for name in (
                'deformation/surface',
                'deformation/linear',
                'deformation/nonlinear',
                'hand/contacts',
                'scan/error',
                'deformation/later_force',
                'deformation/grips',
            )
        }
        self._joints = make(JointState, 'hand/joint_states', 10)
        self._numbers = {
            name: make(Float64, f'deformation/{name}', 10)
            for name in ('max_displacement', 'linearity')
        }
        self._mesh = make(Mesh, 'deformation/mesh', latched)
        self._state = make(String, 'deformation/state', latched)
        self._mesh.publish(
            Mesh(
                vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in self.rest],
                triangles=[
                    MeshTriangle(vertex_indices=np.asarray(t, dtype=np.uint32)) for t in ball.faces
                ],
            )
        )
        self.state('CONTACT')
        for name in ('hand/tare', 'scan/compare'):
            self._node.create_service(Trigger, name, self._serve(name))
        self._node.create_timer(1 / 30, self._publish)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _at_rest(self) -> None:
        self.depth = 0.0
        self.sigma = 1e-4
        self.energy: float | None = None
        self.turned = False
        self._angle = 0.0

    def rest_again(self) -> None:
        """Everything as it was before anybody squeezed it or called a service."""
        self._at_rest()
        self.called.clear()
        self.state('CONTACT')

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _serve(self, name: str) -> Callable[..., Trigger.Response]:
        def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.called.append(name)
            response.success, response.message = name != 'hand/tare', 'the hand is loaded'
            return response

        return serve

    def state(self, name: str) -> None:
        self._state.publish(String(data=name))

    def _moved(self, depth: float) -> np.ndarray:
        normal = self.rest / RADIUS
        angle = np.arccos(np.clip(np.abs(normal[:, 0]), -1, 1))
        return -normal * (depth * np.exp(-((angle / 0.4) ** 2)))[:, None]

    def _turn(self, stamp: object) -> None:
        """A neck turned on and on, and the forces to come of fingers that stay."""
        self._angle = min(self._angle + 0.01, 0.9)
        push = 2000 * self.depth
        coming = [
            [f, t, share * push, 0.4] for f in (1, 3) for t, share in ((10, 0.97), (600, 0.9))
        ]
        fields = ('finger', 'later', 'force', 'sigma')
        self._clouds['deformation/later_force'].publish(cloud(np.array(coming), fields, stamp))
        row = np.zeros((1, 15))
        row[0, 6], row[0, 12:] = self._angle, (self._angle, -self._angle, 1.0)
        names = ('grip', 'x', 'y', 'z', 'rx', 'ry', 'rz', 'fx', 'fy', 'fz', 'tx', 'ty', 'tz')
        names = (*names, 'friction_torque', 'friction_capacity')
        self._clouds['deformation/grips'].publish(cloud(row, names, stamp))

    def _publish(self) -> None:
        stamp = self._node.get_clock().now().to_msg()
        depth, sigma = self.depth, self.sigma
        for name, share in (('surface', 1.0), ('nonlinear', 1.0), ('linear', 0.5)):
            moved = self._moved(share * depth)
            columns = np.column_stack(
                [
                    self.rest + moved,
                    moved,
                    np.linalg.norm(moved, axis=1),
                    np.full(len(moved), sigma),
                ]
            )
            fields = SURFACE_FIELDS
            if name == 'nonlinear' and self.energy is not None:
                columns = np.column_stack([columns, np.full(len(moved), self.energy)])
                fields = (*fields, 'energy_density')
            self._clouds[f'deformation/{name}'].publish(cloud(columns, fields, stamp))
        at = np.array([[RADIUS - depth, 0, 0], [depth - RADIUS, 0, 0]])
        inward = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
        if self.turned:
            self._turn(stamp)
        self._clouds['hand/contacts'].publish(
            contacts_message(
                Contacts(
                    0.0,
                    'object',
                    at,
                    inward,
                    2000 * depth * inward,
                    np.full(2, 0.2),
                    np.full(2, 1e-3),
                    np.array([1, 3]),
                    np.array([1, 1]),
                ),
                stamp,
            )
        )
        self._joints.publish(
            JointState(name=['finger_1_inner', 'finger_1_outer'], position=array('d', [0.4, 0.1]))
        )
        self._numbers['max_displacement'].publish(Float64(data=float(depth)))
        self._numbers['linearity'].publish(Float64(data=float(30 * depth)))

    def scan(self, error: float) -> None:
        """A compared scan whose every point is `error` m off."""
        columns = np.column_stack([self.rest * 1.02, np.full(len(self.rest), error)])
        stamp = self._node.get_clock().now().to_msg()
        self._clouds['scan/error'].publish(cloud(columns, ('x', 'y', 'z', 'distance'), stamp))

    def close(self) -> None:
        if not self._thread.is_alive():
            return
        self._executor.shutdown()
        self._thread.join(10)
        self._node.destroy_node()
        self._context.try_shutdown()
