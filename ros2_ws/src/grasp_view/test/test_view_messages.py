# SPDX-License-Identifier: Apache-2.0
"""Messages: fields are found by name, contradictions are refused with the reason."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from sensor_msgs.msg import PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle

from grasp_common.messages import diagnostics
from grasp_common.point_cloud import MessageError
from grasp_view import messages
from grasp_view.messages import (
    contacts_message,
    read_cloud,
    read_contacts,
    read_mesh,
    read_surface,
)
from grasp_view.scene_model import Contacts, Snapshot, friction_cones, touches


def cloud(points: np.ndarray, **changes: object) -> PointCloud2:
    kinds = {'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64, 'u1': PointField.UINT8}
    fields = [
        PointField(
            name=name,
            offset=int(points.dtype.fields[name][1]),
            datatype=kinds[points.dtype[name].str[1:]],
            count=1,
        )
        for name in points.dtype.names
    ]
    message = PointCloud2(
        height=1,
        width=len(points),
        fields=fields,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * len(points),
        data=array('B', points.tobytes()),
    )
    message.header.frame_id = 'object'
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def surface_points(count: int, kind: str = '<f4') -> np.ndarray:
    names = ['ux', 'x', 'uy', 'y', 'uz', 'z', 'displacement', 'sigma']
    points = np.zeros(count, dtype=[(name, kind) for name in names])
    points['uz'] = np.arange(count)
    points['sigma'] = 0.5
    return points


@pytest.mark.parametrize('kind', ['<f4', '<f8'])
def test_a_surface_is_read_by_field_name_in_any_order_and_width(kind: str) -> None:
    surface = read_surface(cloud(surface_points(4, kind)))
    assert surface.moved[:, 2].tolist() == [0, 1, 2, 3] and (surface.sigma == 0.5).all()
    assert surface.frame == 'object' and surface.energy is None


def test_the_energy_density_is_read_where_it_is_published() -> None:
    points = np.zeros(2, dtype=[*surface_points(1).dtype.descr, ('energy_density', '<f4')])
    points['energy_density'] = 7.5
    surface = read_surface(cloud(points))
    assert surface.energy is not None and surface.energy.tolist() == [7.5, 7.5]


def test_a_surface_without_displacement_vectors_is_refused_by_field() -> None:
    points = np.zeros(2, dtype=[('x', '<f4'), ('y', '<f4'), ('z', '<f4')])
    with pytest.raises(MessageError, match='lacks the fields ux, uy, uz; it has x, y, z'):
        read_surface(cloud(points))


def test_big_endian_clouds_are_read() -> None:
    points = surface_points(3, '>f4')
    assert read_surface(cloud(points, is_bigendian=True)).moved[:, 2].tolist() == [0, 1, 2]


def test_rows_of_an_organised_cloud_may_be_padded() -> None:
    points = surface_points(4)
    step = points.dtype.itemsize
    data = points[:2].tobytes() + b'pad!' + points[2:].tobytes() + b'pad!'
    message = cloud(points, height=2, width=2, row_step=2 * step + 4, data=array('B', data))
    assert read_surface(message).moved[:, 2].tolist() == [0, 1, 2, 3]


def test_a_surface_with_nan_is_left_out_with_their_number() -> None:
    points = surface_points(4)
    points['uy'][1] = np.nan
    with pytest.raises(MessageError, match='1 of 4 vertices'):
        read_surface(cloud(points))


def test_an_empty_cloud_is_empty() -> None:
    assert len(read_cloud(cloud(surface_points(0)), 10).points) == 0


def test_a_large_scan_is_thinned_and_nan_points_are_dropped() -> None:
    points = np.zeros(1001, dtype=[(n, '<f4') for n in ('x', 'y', 'z', 'distance')])
    points['x'][::2] = np.nan
    points['distance'] = 0.25
    scan = read_cloud(cloud(points), 100)
    assert 0 < len(scan.points) <= 100 and scan.distance is not None
    assert len(scan.distance) == len(scan.points) and np.isfinite(scan.points).all()


floats = arrays.arrays(np.float32, (3, 3), elements=st.floats(-100, 100, width=32))


@settings(deadline=None)
@given(floats, floats, floats)
def test_contacts_survive_the_wire(
    points: np.ndarray, normals: np.ndarray, forces: np.ndarray
) -> None:
    sent = Contacts(
        2.5,
        'object',
        points.astype(float),
        normals.astype(float),
        forces.astype(float),
        np.array([0.25, 0.5, 1.0]),
        np.full(3, 0.5),
        np.array([1, 2, 3]),
        np.array([1, 3, 255]),
    )
    read = read_contacts(contacts_message(sent, Time(sec=2, nanosec=500_000_000)))
    assert read.stamp == 2.5 and read.frame == 'object'
    for name in ('points', 'normals', 'forces', 'sigma', 'radius', 'finger', 'flags'):
        assert np.array_equal(getattr(read, name), getattr(sent, name))


def test_what_is_infinite_in_a_contact_draws_nothing_and_warns_of_nothing() -> None:
    vectors = np.array([[0.03, 0.0, 0.0], [np.inf, 0.0, 0.0], [0.0, 0.0, 0.0]])
    one, whole = np.ones(3), np.array([1, 2, 3])
    sent = Contacts(
        2.5, 'object', vectors, -vectors / 0.03, vectors, one, one, whole, one.astype(int)
    )
    read = read_contacts(contacts_message(sent, Time(sec=2)))
    with np.errstate(all='raise'):
        snapshot = Snapshot(contacts=read)
        assert len(touches(snapshot)) == 2
        # A cone of 16 sides and their rim, of the one finger whose normal is one.
        assert friction_cones(snapshot, 0.5, 0.01).shape == (32, 2, 3)


def test_a_mesh_that_is_too_large_to_be_drawn_is_refused() -> None:
    with pytest.raises(MessageError, match='200001 parts; 200000 are drawn at most'):
        read_mesh(Mesh(vertices=[Point()] * 200_001))


def test_a_mesh_that_names_a_vertex_it_does_not_have_is_refused() -> None:
    message = Mesh(
        vertices=[Point()] * 3,
        triangles=[MeshTriangle(vertex_indices=np.array([0, 1, 3], dtype=np.uint32))],
    )
    with pytest.raises(MessageError, match='vertex 3 of 3'):
        read_mesh(message)


@pytest.mark.parametrize('x', [np.nan, -np.inf, 1e30])
def test_a_mesh_that_cannot_be_drawn_is_refused(x: float) -> None:
    triangle = MeshTriangle(vertex_indices=np.array([0, 1, 2], dtype=np.uint32))
    message = Mesh(vertices=[Point(), Point(), Point(x=x)], triangles=[triangle])
    with pytest.raises(MessageError, match='1 of 3 vertices are not finite or further'):
        read_mesh(message)
    with pytest.raises(MessageError, match='no triangles'):
        read_mesh(Mesh(vertices=[Point()]))


@pytest.mark.parametrize(
    ('name', 'asked', 'known'),
    [
        ('deformation', False, True),
        ('left/deformation', False, True),
        ('what_if/deformation', False, False),
        ('what_if/deformation', True, True),
        ('deformation', True, False),
    ],
)
def test_object_and_theory_come_from_the_diagnostics_of_the_right_node(
    name: str, asked: bool, known: bool
) -> None:
    values = {'object': '/data/cup/object.yaml', 'theory': 'koiter', 'background trouble': ''}
    values['grasp'] = 'not closed: no contact'
    told = diagnostics(1, name, 'warn', 'no pose', values)
    facts = messages.read_facts(told, '/what_if', asked)
    assert (facts is not None) == known
    if facts is not None:
        assert facts == messages.SolverFacts('cup', 'koiter', 'no pose', values['grasp'])
    other = diagnostics(1, name, 'ok', 'fine', {'browsers': 1})
    assert messages.read_facts(other, '/what_if', asked) is None


@pytest.mark.parametrize(
    ('given', 'shown'),
    [('tennis_ball', 'tennis_ball'), ('/a/my_cup.yaml', 'my_cup'), ('bags/x/object.yaml', 'x')],
)
def test_an_object_given_by_its_file_is_called_by_its_name(given: str, shown: str) -> None:
    assert messages.object_name(given) == shown
