# SPDX-License-Identifier: Apache-2.0
"""A synthetic hand for tests of the live estimator: samples, messages, and a test node."""

from __future__ import annotations

import array
import time
from dataclasses import replace

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Float64, String
from tests.patience import Patience

from shell_deform.live.tick.estimator import Settings
from shell_deform.live.tick.fusion import ErrorModel
from shell_deform.live.tick.rehearsal import Rehearsal
from shell_deform.live.tick.sample import FLAG_CONTACT, ContactSample

SURE = ErrorModel(
    drift=0.0,
    quantum=0.0,
    mounting=1e-7,
    slip=1e-7,
    modulus=1e-4,
    model=0.0,
    outside=1e-3,
    mesh=0.0,
)

FIELDS = [
    *((name, 'f4') for name in ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz')),
    ('sigma_n', 'f4'),
    ('radius', 'f4'),
    ('finger', 'u1'),
    ('flags', 'u1'),
    ('pad', 'u2'),
    ('sigma_t', 'f4'),
    ('travel', 'f4'),
    ('sigma_travel', 'f4'),
    ('sigma_point', 'f4'),
    *((name, 'f4') for name in ('ax', 'ay', 'az')),
]
ROW = np.dtype(FIELDS)
CODES = {'f4': PointField.FLOAT32, 'u1': PointField.UINT8}


def pipeline(model, errors=SURE):
    """Tick and solver in turn, sure of everything unless `errors` says otherwise."""
    return Rehearsal(model, Settings(errors))


def sample(
    points,
    normals,
    forces,
    travel=None,
    stamp=1,
    flags=FLAG_CONTACT,
    fingers=None,
    radius=1e-3,
    sigma_n=0.05,
):
    """A `ContactSample`: outer points at rest (p, 3), inward normals, pushes [N], travel [m]."""
    count = len(points)
    normals = np.asarray(normals, float)
    known = np.full(count, np.nan) if travel is None else np.asarray(travel, float)
    return ContactSample(
        stamp=stamp,
        finger=np.arange(1, count + 1) if fingers is None else np.asarray(fingers),
        flags=np.broadcast_to(np.asarray(flags), (count,)).astype(np.int64),
        point=np.asarray(points, float) + np.nan_to_num(known)[:, None] * normals,
        normal=normals,
        force=np.asarray(forces, float)[:, None] * normals,
        sigma_normal=np.full(count, sigma_n),
        sigma_tangential=np.full(count, np.inf),
        radius=np.full(count, radius),
        travel=known,
        sigma_travel=np.full(count, 2e-5),
    )


def opposed(forces, travel=None, outer_radius=0.0325, **options):
    """Two fingers on the x axis of a ball, pushing towards each other."""
    points = outer_radius * np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    return sample(points, -points / outer_radius, forces, travel, **options)


TIPS_WAY = [(depth, 0.0) for depth in np.linspace(1e-4, 8e-4, 8)]
TIPS_WAY += [(8e-4, turn) for turn in np.linspace(0.01, 0.04, 4)]
"""Depths [m] and turns of the first finger [rad] of `tips_aside`."""


def tips_aside(stamp, depth, turn):
    """Two fingertips on an axis of a ball far from its own contacts, the first one turned."""
    tips = opposed([5.0] * 2, [depth] * 2, stamp=stamp, radius=7.5e-3)
    along = np.array([[0.0, -np.sin(turn), np.cos(turn)], [0.0, 0.0, 1.0]])
    aside = np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0], [0.8, 0.0, 0.6]]).T
    return replace(
        tips,
        point=tips.point @ aside,
        normal=tips.normal @ aside,
        force=tips.force @ aside,
        along=along @ aside,
    )


def cloud(contacts: ContactSample, frame='hand_base') -> PointCloud2:
    """The message of a sample, as the bridge sends it."""
    rows = np.zeros(len(contacts.finger), ROW)
    for i, axis in enumerate('xyz'):
        rows[axis] = contacts.point[:, i]
        rows['n' + axis] = contacts.normal[:, i]
        rows['f' + axis] = contacts.force[:, i]
    rows['sigma_n'], rows['radius'] = contacts.sigma_normal, contacts.radius
    rows['finger'], rows['flags'] = contacts.finger, contacts.flags
    rows['sigma_t'], rows['travel'] = contacts.sigma_tangential, contacts.travel
    rows['sigma_travel'], rows['sigma_point'] = contacts.sigma_travel, contacts.sigma_point
    for i, axis in enumerate('xyz'):
        rows['a' + axis] = contacts.along[:, i]
    message = PointCloud2(
        height=1,
        width=len(rows),
        fields=[
            PointField(name=name, offset=ROW.fields[name][1], datatype=CODES[code], count=1)
            for name, code in FIELDS
            if name != 'pad'
        ],
        point_step=ROW.itemsize,
        row_step=ROW.itemsize * len(rows),
        data=array.array('B', rows.tobytes()),
    )
    message.header.frame_id = frame
    message.header.stamp.sec = int(contacts.stamp // 10**9)
    message.header.stamp.nanosec = int(contacts.stamp % 10**9)
    return message


def packed(message: PointCloud2) -> np.ndarray:
    """(n, f) of a surface message, its fields in their order."""
    return np.frombuffer(message.data, np.float32).reshape(-1, len(message.fields))


class Observer:
    """Publishes contacts and keeps what `deformation` answers."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node('observer')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.surfaces: list[PointCloud2] = []
        self.linear: list[PointCloud2] = []
        self.nonlinear: list[PointCloud2] = []
        self.grasps: list[PointCloud2] = []
        self.states: list[str] = []
        self.kinds: list[str] = []
        self.diagnostics: dict[str, str] = {}
        self.summary = ''
        self.numbers: dict[str, float] = {}
        self.stamped: list[JointState] = []
        self.contacts = self.node.create_publisher(PointCloud2, 'hand/contacts', 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        many = QoSProfile(depth=500)
        listen = self.node.create_subscription
        listen(PointCloud2, 'deformation/surface', self.surfaces.append, many)
        listen(PointCloud2, 'deformation/linear', self.linear.append, many)
        listen(PointCloud2, 'deformation/nonlinear', self.nonlinear.append, many)
        listen(PointCloud2, 'deformation/grasp', self.grasps.append, many)
        listen(String, 'deformation/state', lambda m: self.states.append(m.data), latched)
        listen(String, 'deformation/answer', lambda m: self.kinds.append(m.data), latched)
        listen(DiagnosticArray, '/diagnostics', self._diagnosed, 10)
        listen(JointState, 'deformation/numbers', self.stamped.append, many)
        scalars = ('linearity', 'contradiction', 'max_displacement', 'nonlinear_age')
        for name in (*scalars, 'modulus', 'modulus_sigma', 'grasp/liftable_mass'):
            listen(Float64, f'deformation/{name}', self._keeper(name), many)

    def _keeper(self, name):
        def keep(message):
            self.numbers[name] = message.data

        return keep

    def _diagnosed(self, message: DiagnosticArray) -> None:
        self.summary = message.status[0].message
        self.diagnostics = {value.key: value.value for value in message.status[0].values}

    def _handle(self) -> None:
        """Take what has arrived, so that no queue grows while samples are sent."""
        self.executor.spin_once(timeout_sec=0.001)
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.0)

    def clear(self) -> None:
        """Forget everything received."""
        state = self.states[-1:]
        for kept in (self.surfaces, self.linear, self.nonlinear, self.grasps, self.states):
            kept.clear()
        self.states.extend(state)
        self.numbers.clear()

    def report(self) -> str:
        """What was received, for the message of a failure."""
        deepest = [float(packed(m)[:, 6].max()) for m in self.nonlinear[-3:]]
        return (
            f'{len(self.surfaces)} surfaces, {len(self.nonlinear)} equilibria down to {deepest}, '
            f'states {self.states}, {self.summary}: {self.diagnostics}'
        )

    @property
    def state(self) -> str:
        """The last published state."""
        return self.states[-1] if self.states else ''

    def send(self, contacts: ContactSample) -> None:
        """Publish a sample."""
        self.contacts.publish(cloud(contacts))

    def spin(self, seconds: float = 0.0) -> None:
        """Handle what has arrived, at least once, for `seconds`."""
        deadline = time.monotonic() + seconds
        while True:
            self._handle()
            if time.monotonic() >= deadline:
                return

    def stream(self, make, until, rate=100.0, timeout=60.0):
        """Publish `make(i)` at `rate` [Hz] until `until()`; returns the number sent."""
        start, patience = time.monotonic(), Patience(timeout)
        sent = 0
        while not until():
            if patience.over:
                raise TimeoutError(self.report())
            if time.monotonic() - start >= sent / rate:
                self.send(make(sent))
                sent += 1
            self._handle()
        return sent

    def close(self) -> None:
        """Leave ROS."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
