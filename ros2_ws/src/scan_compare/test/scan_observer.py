# SPDX-License-Identifier: Apache-2.0
"""A test node that plays hand, solver and scanner, and collects what `scan_compare` says."""

from __future__ import annotations

import array
from collections.abc import Callable

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from tests.patience import Patience
from tests.service_calls import answer

from scan_compare.deformed_surface import DeformedSurface

SURFACE_FIELDS = ('x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma')


def cloud(names: tuple[str, ...], rows: np.ndarray, stamp_ns: int, frame: str) -> PointCloud2:
    data = array.array('B')
    data.frombytes(np.ascontiguousarray(rows, '<f4').tobytes())
    message = PointCloud2(
        height=1,
        width=len(rows),
        fields=[
            PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, name in enumerate(names)
        ],
        point_step=4 * len(names),
        row_step=4 * len(names) * len(rows),
        data=data,
        is_dense=True,
    )
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message


class ScanObserver:
    """Publishes surfaces, meshes and scans; keeps the answers."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node('scan_observer')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        reliable = QoSProfile(depth=10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.scans = self.node.create_publisher(PointCloud2, 'scan/points', reliable)
        self.surfaces = self.node.create_publisher(PointCloud2, 'deformation/surface', reliable)
        self.meshes = self.node.create_publisher(Mesh, 'deformation/mesh', latched)
        self.errors: list[PointCloud2] = []
        self.numbers: dict[str, float] = {}
        self.stamped: list[JointState] = []
        self.summary = ''
        self.values: dict[str, str] = {}
        self.node.create_subscription(PointCloud2, 'scan/error', self.errors.append, reliable)
        self.node.create_subscription(JointState, 'scan/numbers', self.stamped.append, reliable)
        for name in ('mean_error', 'max_error', 'noise_floor'):
            self.node.create_subscription(Float64, f'scan/{name}', self._keep(name), reliable)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._health, reliable)
        self.compare = self.node.create_client(Trigger, 'scan/compare')
        self.parameters = self.node.create_client(GetParameters, 'scan_compare/get_parameters')

    def _keep(self, name: str) -> Callable[[Float64], None]:
        def keep(message: Float64) -> None:
            self.numbers[name] = message.data

        return keep

    def _health(self, message: DiagnosticArray) -> None:
        self.summary = message.status[0].message
        self.values = {item.key: item.value for item in message.status[0].values}

    def wait(self, condition: Callable[[], object], timeout: float = 60.0) -> None:
        patience = Patience(timeout)
        while not condition():
            assert not patience.over, (self.summary, self.values)
            self.executor.spin_once(timeout_sec=0.05)

    def connect(self) -> None:
        self.wait(lambda: self.scans.get_subscription_count() > 0)
        self.wait(lambda: self.surfaces.get_subscription_count() > 0)
        self.wait(lambda: self.node.count_publishers('scan/mean_error') > 0)
        self.wait(lambda: self.node.count_publishers('scan/error') > 0)

    def send_mesh(self, surface: DeformedSurface) -> None:
        rest = surface.limit.limit_positions(surface.rest)
        self.meshes.publish(
            Mesh(
                triangles=[
                    MeshTriangle(vertex_indices=row.astype(np.uint32))
                    for row in surface.mesh.triangles
                ],
                vertices=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in rest],
            )
        )

    def send_surface(
        self, surface: DeformedSurface, stamp_ns: int, outer: np.ndarray | None = None
    ) -> None:
        """`outer` (n, 3): the outer face of a thick wall over the vertices [m]."""
        position = surface.limit.limit_positions(surface.deformed)
        moved = position - surface.limit.limit_positions(surface.rest)
        size = np.linalg.norm(moved, axis=1, keepdims=True)
        rows = np.hstack((position, moved, size, np.zeros_like(size)))
        names = SURFACE_FIELDS
        if outer is not None:
            names, rows = (*names, 'ox', 'oy', 'oz'), np.hstack((rows, outer))
        self.surfaces.publish(cloud(names, rows, stamp_ns, 'hand_base'))

    def send_scan(self, points: np.ndarray, stamp_ns: int, frame: str = 'hand_base') -> None:
        self.scans.publish(cloud(('x', 'y', 'z'), points, stamp_ns, frame))

    def call_compare(self) -> Trigger.Response:
        self.wait(self.compare.service_is_ready)
        future = self.compare.call_async(Trigger.Request())
        self.wait(future.done)
        return future.result()

    def get_parameter(self, name: str) -> str:
        request = GetParameters.Request(names=[name])
        return answer(self.parameters, request, self.wait).values[0].string_value

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
