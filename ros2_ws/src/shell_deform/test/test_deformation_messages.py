# SPDX-License-Identifier: Apache-2.0
"""What RViz and Foxglove get: every field of the marker and of the surface's cloud."""

import numpy as np
import pytest
from sensor_msgs.msg import PointField
from visualization_msgs.msg import Marker

from shell_deform.live.tick.serve_kernel import FIELDS
from shell_deform.node.messages import SurfaceWriter, marker_message

TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
STAMP_NS = 3_000_000_007


def packed_surface(count=4, fields=FIELDS):
    """Rows of numbers that all differ; the displacements are 0, 1, 2, 3 mm ..."""
    rows = np.arange(count * len(fields), dtype=np.float32).reshape(count, len(fields)) * 1e-2
    rows[:, 6] = 1e-3 * np.arange(count)
    return np.ascontiguousarray(rows)


@pytest.fixture
def marker():
    return marker_message(TRIANGLES, packed_surface(), STAMP_NS, 'ball')


def test_a_marker_is_one_list_of_triangles_that_stays_until_the_next(marker):
    assert (marker.type, marker.action) == (Marker.TRIANGLE_LIST, Marker.ADD)
    assert (marker.ns, marker.id) == ('deformation', 0)
    assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)
    assert not marker.frame_locked


def test_a_marker_stands_in_the_surface_frame_at_its_time_unmoved_and_unscaled(marker):
    assert marker.header.frame_id == 'ball'
    assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (3, 7)
    place, turn = marker.pose.position, marker.pose.orientation
    assert (place.x, place.y, place.z) == (0.0, 0.0, 0.0)
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == (1.0, 1.0, 1.0)


def test_a_marker_has_three_points_in_metres_per_triangle_each_with_an_opaque_colour(marker):
    places = packed_surface()[:, :3]
    points = np.array([(p.x, p.y, p.z) for p in marker.points])
    assert np.array_equal(points, places[TRIANGLES.ravel()].astype(float))
    assert len(marker.colors) == len(marker.points) == 6
    assert {colour.a for colour in marker.colors} == {1.0} and marker.color.a == 1.0


def test_a_marker_is_the_lighter_the_larger_the_displacement(marker):
    luminance = [0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b for c in marker.colors]
    by_corner = dict(zip(TRIANGLES.ravel().tolist(), luminance, strict=True))
    assert [by_corner[k] for k in range(4)] == sorted(by_corner.values())
    assert by_corner[3] - by_corner[0] > 0.6


def test_a_surface_at_rest_is_a_marker_of_the_darkest_colour():
    rest = packed_surface()
    rest[:, 6] = 0.0
    colours = marker_message(TRIANGLES, rest, STAMP_NS, 'ball').colors
    assert {(round(c.r, 3), round(c.g, 3), round(c.b, 3)) for c in colours} == {(0, 0.135, 0.305)}


def test_a_marker_sets_nothing_that_only_other_kinds_have(marker):
    assert (marker.text, marker.mesh_resource) == ('', '')
    assert not marker.mesh_use_embedded_materials
    assert len(marker.uv_coordinates) == len(marker.texture.data) == 0
    told = set(Marker.get_fields_and_field_types())
    seen_here = {
        'header', 'ns', 'id', 'type', 'action', 'pose', 'scale', 'color', 'lifetime',
        'frame_locked', 'points', 'colors', 'texture_resource', 'texture', 'uv_coordinates',
        'text', 'mesh_resource', 'mesh_file', 'mesh_use_embedded_materials',
    }  # fmt: skip
    assert told == seen_here and marker.texture_resource == ''
    assert len(marker.mesh_file.data) == 0


@pytest.mark.parametrize('fields', [FIELDS, (*FIELDS, 'energy_density')])
def test_a_surface_cloud_is_one_dense_row_of_little_endian_floats_in_the_order_of_its_fields(
    fields,
):
    packed = packed_surface(5, fields)
    cloud = SurfaceWriter(5, fields).message(packed, STAMP_NS, 'ball')
    assert [f.name for f in cloud.fields] == list(fields)
    assert [f.offset for f in cloud.fields] == [4 * k for k in range(len(fields))]
    assert {(f.datatype, f.count) for f in cloud.fields} == {(PointField.FLOAT32, 1)}
    assert (cloud.height, cloud.width) == (1, 5)
    assert (cloud.point_step, cloud.row_step) == (4 * len(fields), 20 * len(fields))
    assert cloud.is_dense and not cloud.is_bigendian
    assert len(cloud.data) == cloud.row_step
    assert np.array_equal(np.frombuffer(cloud.data, '<f4').reshape(5, -1), packed)
    assert cloud.header.frame_id == 'ball'
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (3, 7)


def test_the_fields_of_a_surface_cloud_are_those_of_the_contract():
    assert FIELDS == ('x', 'y', 'z', 'ux', 'uy', 'uz', 'displacement', 'sigma')
