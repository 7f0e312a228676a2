# SPDX-License-Identifier: Apache-2.0
"""The only place where ROS messages are read (and, for what-if, built)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState, PointCloud2
from shape_msgs.msg import Mesh as MeshMessage

from grasp_common.messages import cloud, nanoseconds
from grasp_common.point_cloud import CloudReader, MessageError

from .curves import GripState, Later
from .grasp_measures import GraspMeasures
from .hand_description import joint_positions
from .poses import FARTHEST_M, Floats, Pose
from .scene_model import Cloud, Contacts, Mesh, Surface

Records = npt.NDArray[Any]

MOST_TRIANGLES = 200_000
"""Of a mesh that is drawn, and of its vertices."""


def seconds(stamp: Time) -> float:
    """A ROS time as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def read_surface(message: PointCloud2) -> Surface:
    """`deformation/surface`, `linear` or `nonlinear`."""
    reader = CloudReader('the surface')
    points = reader.read(message)
    position = reader.columns(points, ('x', 'y', 'z'))
    moved = reader.columns(points, ('ux', 'uy', 'uz'))
    _check_places(position, moved)
    energy = 'energy_density' in (points.dtype.names or ())
    return Surface(
        seconds(message.header.stamp),
        message.header.frame_id,
        position.astype(np.float32),
        moved.astype(np.float32),
        reader.column(points, 'sigma', np.nan).astype(np.float32),
        reader.column(points, 'energy_density').astype(np.float32) if energy else None,
    )


def _check_places(*columns: Floats) -> None:
    """Raise MessageError unless vertices lie, and have moved, within reach."""
    places = np.hstack(columns)
    known = int((np.abs(places) <= FARTHEST_M).all(axis=1).sum())
    if known < len(places):
        raise MessageError(
            f'{len(places) - known} of {len(places)} vertices are not finite or further away '
            f'than {FARTHEST_M:g} m'
        )


def _vectors(reader: CloudReader, points: Records, names: tuple[str, str, str]) -> Floats:
    """What is infinite becomes NaN: turning a vector of it would warn of infinity times zero."""
    found = reader.columns(points, names)
    found[~np.isfinite(found)] = np.nan
    return found


def read_contacts(message: PointCloud2) -> Contacts:
    """`hand/contacts`."""
    reader = CloudReader('hand/contacts')
    points = reader.read(message)
    return Contacts(
        seconds(message.header.stamp),
        message.header.frame_id,
        _vectors(reader, points, ('x', 'y', 'z')),
        _vectors(reader, points, ('nx', 'ny', 'nz')),
        _vectors(reader, points, ('fx', 'fy', 'fz')),
        reader.column(points, 'sigma_n', np.nan),
        reader.column(points, 'radius', 0.0),
        reader.integers(points, 'finger', 0),
        reader.integers(points, 'flags', 0),
    )


def read_grasp(message: PointCloud2) -> GraspMeasures:
    """`deformation/grasp`: a row a finger, and the row of finger -1 for the whole grasp."""
    reader = CloudReader('deformation/grasp')
    points = reader.read(message)
    finger = reader.column(points, 'finger')
    whole = np.flatnonzero(finger < 0)
    if len(whole) != 1:
        raise MessageError(f'{len(whole)} rows of the whole grasp (finger -1); one is needed')

    def of_whole(name: str) -> float:
        return float(reader.column(points, name)[whole[0]])

    def if_told(name: str, otherwise: float) -> float:
        """A field that recordings of earlier versions do not have."""
        return of_whole(name) if name in (points.dtype.names or ()) else otherwise

    own = finger >= 0
    push = reader.column(points, 'push')[own]
    return GraspMeasures(
        message.header.frame_id,
        _vectors(reader, points, ('x', 'y', 'z'))[own],
        _vectors(reader, points, ('nx', 'ny', 'nz'))[own],
        of_whole('on_deformed_normals') > 0.0,
        of_whole('closed') > 0.0,
        of_whole('closure_probability'),
        of_whole('needed_friction'),
        of_whole('needed_friction_sigma'),
        of_whole('friction_given'),
        of_whole('friction_sigma_given'),
        float(push.mean()) if len(push) else 0.0,
        of_whole('least_push'),
        of_whole('most_push'),
        of_whole('liftable_mass'),
        of_whole('mass_given'),
        if_told('gravity_slip', 0.0),
        int(slips) if np.isfinite(slips := if_told('slip_finger', -1.0)) else -1,
        if_told('dent_push', 0.0),
        if_told('stress_resolved', 0.0) > 0.0,
        if_told('liftable_mass_sigma', 0.0),
    )


def read_later(message: PointCloud2) -> Later:
    """`deformation/later_force`; rows that are not finite are left out."""
    reader = CloudReader('deformation/later_force')
    rows = reader.columns(reader.read(message), ('finger', 'later', 'force', 'sigma'))
    rows = rows[np.isfinite(rows).all(axis=1) & (rows[:, 1] > 0.0)].astype(np.float64)
    return Later(*rows.T)


def read_grips(message: PointCloud2) -> tuple[GripState, ...]:
    """`deformation/grips`: a row a grip."""
    reader = CloudReader('deformation/grips')
    points = reader.read(message)
    vectors = [
        reader.columns(points, names).astype(np.float64)
        for names in (('rx', 'ry', 'rz'), ('fx', 'fy', 'fz'), ('tx', 'ty', 'tz'))
    ]
    if not all(np.isfinite(one).all() for one in vectors):
        raise MessageError('a turn or a torque is not finite')
    told = reader.columns(points, ('friction_torque', 'friction_capacity'))
    return tuple(
        GripState(k, *(one[k] for one in vectors), *map(float, told[k]))
        for k in range(len(points))
    )


def read_cloud(message: PointCloud2, most: int) -> Cloud:
    """`scan/points` or `scan/error`, thinned evenly to at most `most` finite points."""
    reader = CloudReader('the cloud')
    points = reader.read(message)
    points = points[:: max(1, -(-len(points) // most))]
    place = reader.columns(points, ('x', 'y', 'z'))
    finite = np.isfinite(place).all(axis=1)
    distance = None
    if 'distance' in (points.dtype.names or ()):
        distance = reader.column(points, 'distance')
        finite &= np.isfinite(distance)
        distance = distance[finite]
    return Cloud(seconds(message.header.stamp), message.header.frame_id, place[finite], distance)


def read_mesh(message: MeshMessage) -> Mesh:
    """`deformation/mesh`; raises MessageError if a triangle names a vertex that is not there.

    And for one that cannot be drawn: without triangles, with too many, or with vertices nowhere.
    """
    count = max(len(message.vertices), len(message.triangles))
    if count > MOST_TRIANGLES:
        raise MessageError(f'the mesh has {count} parts; {MOST_TRIANGLES} are drawn at most')
    rest = np.array([(p.x, p.y, p.z) for p in message.vertices], dtype=np.float64).reshape(-1, 3)
    faces = [t.vertex_indices for t in message.triangles]
    triangles = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if not len(triangles):
        raise MessageError('the mesh has no triangles')
    if int(triangles.max()) >= len(rest):
        raise MessageError(f'a triangle names vertex {triangles.max()} of {len(rest)}')
    _check_places(rest)
    return Mesh(triangles, rest)


def read_joints(message: JointState) -> dict[str, float]:
    """`hand/joint_states` as positions by name."""
    return joint_positions(list(message.name), np.array(message.position, dtype=np.float64))


@dataclass(frozen=True)
class SolverFacts:
    """What a `deformation` node says of itself in its diagnostics."""

    object_name: str
    theory: str
    trouble: str
    closure: str = ''


def read_facts(message: DiagnosticArray, what_if: str, asked: bool) -> SolverFacts | None:
    """The facts of a `deformation` node; None where the message is of another node.

    what_if: the namespace of what-if; asked: whether its node is meant, or the one outside of it.
    """
    for status in message.status:
        values = {entry.key: entry.value for entry in status.values}
        ours = status.name.startswith(f'{what_if.strip("/")}/') == asked
        if 'object' in values and 'background trouble' in values and ours:
            healthy = status.level in (DiagnosticStatus.OK, b'\x00')
            return SolverFacts(
                object_name(values['object']),
                values.get('theory', ''),
                '' if healthy else status.message,
                values.get('grasp', ''),
            )
    return None


def object_name(described: str) -> str:
    """The name of an object that is given by its name or its file."""
    path = Path(described)
    if path.suffix not in ('.yaml', '.yml'):
        return described
    return path.parent.name if path.stem == 'object' and path.parent.name else path.stem


def read_pose(message: PoseStamped) -> Pose:
    """`object_pose`."""
    p, q = message.pose.position, message.pose.orientation
    return Pose.of([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


CONTACT_TYPE = np.dtype(
    [
        *((name, '<f4') for name in ('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz')),
        *((name, '<f4') for name in ('sigma_n', 'radius', 'sigma_t')),
        ('finger', 'u1'),
        ('flags', 'u1'),
    ]
)


def contacts_message(contacts: Contacts, stamp: Time) -> PointCloud2:
    """`hand/contacts` from contacts placed in the page."""
    points = np.zeros(len(contacts.points), dtype=CONTACT_TYPE)
    for names, values in (
        ('xyz', contacts.points),
        (('nx', 'ny', 'nz'), contacts.normals),
        (('fx', 'fy', 'fz'), contacts.forces),
    ):
        for k, name in enumerate(names):
            points[name] = values[:, k]
    points['sigma_n'], points['radius'] = contacts.sigma, contacts.radius
    points['sigma_t'] = np.inf
    points['finger'], points['flags'] = contacts.finger, contacts.flags
    return cloud(points, nanoseconds(stamp), contacts.frame, dense=False)
