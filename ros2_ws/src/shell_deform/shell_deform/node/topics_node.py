# SPDX-License-Identifier: Apache-2.0
"""The publishers of the deformation node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import Float64, String
from visualization_msgs.msg import Marker

from grasp_common.main_node import status_name
from grasp_common.messages import diagnostics, named_numbers, number
from shell_deform.live.exchange import TAXEL_FIELDS
from shell_deform.live.tick.estimator import Served
from shell_deform.live.tick.grasp import GRASP_FIELDS, PLOTTED
from shell_deform.live.tick.grip_told import GRIP_FIELDS
from shell_deform.live.tick.hold import LATER_FIELDS
from shell_deform.live.tick.modulus import ModulusEstimate
from shell_deform.live.tick.serve_kernel import FIELDS, NONLINEAR_FIELDS, OUTER_FIELDS
from shell_deform.live.tick.states import LiveState
from shell_deform.node import messages

# Answers a slow listener may fall behind before one is overwritten.
STREAM = QoSProfile(depth=100)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
CLOUDS = {'surface': FIELDS, 'linear': FIELDS, 'nonlinear': NONLINEAR_FIELDS}
THIN = ('linear',)
"""Clouds of a theory whose outer face is always half a wall along the normal."""
SCALARS = (
    'max_displacement',
    'linearity',
    'strain_energy',
    'nonlinear_age',
    'snap_margin',
    'contradiction',
)


class DeformationTopics:
    """Publishes answers; what costs something only while somebody listens."""

    def __init__(self, node: Node) -> None:
        """Make the publishers on `node`."""
        self._node = node
        self._writers: dict[str, messages.SurfaceWriter] = {}
        self._state_shown: LiveState | None = None
        self._answer_shown = ''
        self._clouds = {name: self._make(PointCloud2, name) for name in CLOUDS}
        self._scalars = {name: self._make(Float64, name) for name in SCALARS}
        self._grasp = self._make(PointCloud2, 'grasp')
        self._grasp_writers: dict[int, messages.SurfaceWriter] = {}
        self._grasp_scalars = {name: self._make(Float64, f'grasp/{name}') for name in PLOTTED}
        self._taxels = self._make(PointCloud2, 'taxels')
        self._later = self._make(PointCloud2, 'later_force')
        self._grips = self._make(PointCloud2, 'grips')
        self._numbers = self._make(JointState, 'numbers')
        self._modulus = self._make(Float64, 'modulus')
        self._modulus_sigma = self._make(Float64, 'modulus_sigma')
        self._mesh = self._make(Mesh, 'mesh', LATCHED)
        self._marker = self._make(Marker, 'marker', LATCHED)
        self._state = self._make(String, 'state', LATCHED)
        self._answer = self._make(String, 'answer', LATCHED)
        self._diagnostics = self._make(DiagnosticArray, '/diagnostics')

    def _make(self, kind: type, name: str, qos: QoSProfile = STREAM) -> Any:
        topic = name if name.startswith('/') else f'deformation/{name}'
        # The default event callbacks of sixteen publishers, each an entity to wait for, would
        # cost more at every wake-up than the tick. An incompatible listener warns on its side.
        silent = PublisherEventCallbacks(use_default_callbacks=False)
        return self._node.create_publisher(kind, topic, qos, event_callbacks=silent)

    def resize(self, vertices: int, outer: bool) -> None:
        """Answers of a shell of so many vertices come from now on, perhaps with its outer face."""
        self._writers = {
            name: messages.SurfaceWriter(
                vertices, (*fields, *OUTER_FIELDS) if outer and name not in THIN else fields
            )
            for name, fields in CLOUDS.items()
        }

    def wanted(self, name: str) -> bool:
        """Whether somebody listens to the cloud `name`."""
        return bool(self._clouds[name].get_subscription_count())

    def cloud(self, name: str, packed: NDArray[np.float32], stamp: int, frame: str) -> None:
        """One packed surface on the cloud `name`."""
        self._clouds[name].publish(self._writers[name].message(packed, stamp, frame))

    @property
    def grasp_wanted(self) -> bool:
        """Whether somebody listens to the measures of the grasp."""
        listened = (self._grasp, *self._grasp_scalars.values())
        return any(publisher.get_subscription_count() for publisher in listened)

    def grasp(self, packed: NDArray[np.float32], stamp: int, frame: str) -> None:
        """The measures of one grasp: a row a finger, then one for the whole."""
        rows = len(packed)
        if rows not in self._grasp_writers:
            self._grasp_writers[rows] = messages.SurfaceWriter(rows, GRASP_FIELDS)
        self._grasp.publish(self._grasp_writers[rows].message(packed, stamp, frame))
        for name, publisher in self._grasp_scalars.items():
            if publisher.get_subscription_count():
                publisher.publish(number(float(packed[-1, GRASP_FIELDS.index(name)])))

    def taxels(self, packed: NDArray[np.float32], stamp: int, frame: str) -> None:
        """What the touch cells of fingers feel: a row a cell."""
        if len(packed) and self._taxels.get_subscription_count():
            writer = messages.SurfaceWriter(len(packed), TAXEL_FIELDS)
            self._taxels.publish(writer.message(packed, stamp, frame))

    @property
    def later_wanted(self) -> bool:
        """Whether somebody listens to the forces to come."""
        return bool(self._later.get_subscription_count())

    def later(self, packed: NDArray[np.float32], stamp: int, frame: str) -> None:
        """What the fingers will feel if they stay: a row for every finger and time."""
        writer = messages.SurfaceWriter(len(packed), LATER_FIELDS)
        self._later.publish(writer.message(packed, stamp, frame))

    @property
    def grips_wanted(self) -> bool:
        """Whether somebody listens to all grips at once."""
        return bool(self._grips.get_subscription_count())

    def grips(self, packed: NDArray[np.float32], stamp: int, frame: str) -> None:
        """What the grips do: a row a grip."""
        writer = messages.SurfaceWriter(len(packed), GRIP_FIELDS)
        self._grips.publish(writer.message(packed, stamp, frame))

    def numbers(self, served: Served) -> None:
        """The numbers of one answer: each alone for plotting, and all with the answer's stamp."""
        if self._numbers.get_subscription_count():
            values = {name: getattr(served, name) for name in SCALARS}
            self._numbers.publish(named_numbers(values, served.stamp))
        for name, publisher in self._scalars.items():
            if publisher.get_subscription_count():
                publisher.publish(number(getattr(served, name)))

    def modulus(self, found: ModulusEstimate) -> None:
        """The learned modulus."""
        self._modulus.publish(number(found.value))
        self._modulus_sigma.publish(number(found.sigma))

    def mesh(self, triangles: NDArray[np.int32], points: NDArray[np.float64]) -> None:
        """Topology and rest positions, in the same frame as the surface."""
        self._mesh.publish(messages.mesh_message(triangles, points))

    def marker(
        self,
        triangles: NDArray[np.int32],
        packed: NDArray[np.float32],
        stamp: int,
        frame: str,
    ) -> None:
        """Coloured triangles, while somebody looks at them."""
        if self._marker.get_subscription_count():
            self._marker.publish(messages.marker_message(triangles, packed, stamp, frame))

    def state(self, state: LiveState) -> None:
        """The state, when it has changed."""
        if state is not self._state_shown:
            self._state_shown = state
            self._state.publish(messages.text(state.value))

    def answer(self, kind: str) -> None:
        """What kind of answer is served, when it has changed."""
        if kind != self._answer_shown:
            self._answer_shown = kind
            self._answer.publish(messages.text(kind))

    def diagnostics(self, level: str, summary: str, values: Mapping[str, object]) -> None:
        """What /diagnostics says."""
        self._diagnostics.publish(
            diagnostics(
                self._node.get_clock().now().nanoseconds,
                status_name(self._node, 'surface'),
                level,
                summary,
                values,
            )
        )
