# SPDX-License-Identifier: Apache-2.0
"""`import scan_compare`: what a notebook finds there."""

import subprocess
import sys

import numpy as np
import pytest

import scan_compare
import shell_deform


@pytest.fixture(scope='module')
def squeezed():
    ball = shell_deform.load('tennis_ball', theory='koiter', control_vertices=200)
    return ball.squeeze(displacement=3e-3)


@pytest.fixture(scope='module')
def points(squeezed):
    """Points of the outer face of the squeezed ball [m], with the noise of a scanner."""
    surface = squeezed.shell.model.surface
    normals = surface.vertex_normals(squeezed.control_points)
    outer = squeezed.points + 0.5 * squeezed.shell.description.thickness_m * normals
    noise = np.random.default_rng(4).normal(0.0, 0.1e-3, (len(outer), 1))
    return outer + noise * normals


def test_the_import_loads_no_numpy():
    code = 'import scan_compare, sys; print("numpy" in sys.modules)'
    said = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert said.stdout == 'False\n'


def test_everything_promised_is_there_and_documented():
    assert all(getattr(scan_compare, name).__doc__ for name in scan_compare.__all__)
    with pytest.raises(AttributeError, match='no attribute'):
        scan_compare.nothing  # noqa: B018


def test_a_squeezed_shell_is_compared_with_points(squeezed, points):
    comparison = squeezed.compare(points, scanner_sigma=0.1e-3)
    assert comparison.vertex.mean_m == pytest.approx(0.08e-3, rel=0.2)
    assert not comparison.beyond_noise
    assert comparison.surface.max_displacement == pytest.approx(3e-3, rel=0.02)


def test_the_object_at_rest_does_not_fit_its_squeezed_scan(points):
    assert scan_compare.compare(points, 'tennis_ball').beyond_noise


def test_a_file_is_read_in_its_unit(squeezed, points, tmp_path):
    file = tmp_path / 'scan.xyz'
    np.savetxt(file, 1e3 * points)
    given = scan_compare.compare(file, squeezed, unit='mm')
    assert given.source == str(file)
    assert given.vertex.mean_m == pytest.approx(squeezed.compare(points).vertex.mean_m, rel=1e-3)


def test_no_points_are_refused_in_one_sentence(squeezed):
    with pytest.raises(scan_compare.ComparisonError, match='the points given: the scan has no'):
        squeezed.compare(np.zeros((0, 3)))


def test_a_thick_wall_is_compared_by_its_own_outer_face():
    ball = shell_deform.load('tennis_ball', control_vertices=250, theory='thick')
    squeezed = ball.squeeze(displacement=6e-3)
    found = squeezed.compare(squeezed.outer_points, scanner_sigma=1e-5)
    assert np.abs(found.distances.distance).max() < 2e-5
    # half a wall along the normal is elsewhere: the wall is thinner under the pin
    normals = ball.model.surface.vertex_normals(squeezed.control_points)
    half = squeezed.points + 0.5 * ball.description.thickness_m * normals
    assert np.abs(squeezed.compare(half, scanner_sigma=1e-5).distances.distance).max() > 9e-5
