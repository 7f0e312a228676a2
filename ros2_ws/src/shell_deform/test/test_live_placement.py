# SPDX-License-Identifier: Apache-2.0
"""Where the object is, from the contacts of first touch."""

import live_hand
import numpy as np
import pytest

from shell_deform.live.background.placement import place
from shell_deform.live.pose import Pose, rotation_of
from shell_deform.objects import object_mesh
from shell_deform.objects.shell_object import Cylinder, Ellipsoid, ShellObject
from shell_deform.surface.limit import LimitSurface

R, H = 31.25e-3, 2.5e-3
POSE = Pose(rotation_of(np.array([0.05, -0.1, 0.08])), np.array([0.12, -0.03, 0.2]))


def surface_of(shape):
    shell = ShellObject('test', shape, H, 1e6, 0.3)
    mesh = object_mesh(shell, control_vertices=200, refine_at=[])
    return LimitSurface(mesh), mesh.vertices


def contacts_on(surface, control_points, directions):
    """Outer points and inward normals (p, 3) where rays along `directions` leave the surface."""
    directions = np.asarray(directions, float)
    found = surface.closest_point(control_points, 0.05 * directions, offset=0.5 * H)
    return POSE.from_object(found.position), -found.normal @ POSE.rotation.T


def test_two_contacts_centre_a_ball_and_leave_its_turns_open(sphere):
    model = sphere(R, H, subdivisions=2)
    points, normals = contacts_on(model.surface, model.rest, [[1, 0, 0], [-1, 0, 0]])
    found = place(model.surface, model.rest, 0.5 * H, list(points), list(normals))
    assert found.pose.translation == pytest.approx(POSE.translation, abs=2e-5)
    assert 'turn about x' in found.open_directions
    assert 'shift' not in found.open_directions
    assert found.misfit < 0.1


def test_a_cylinder_stays_open_along_and_about_its_axis():
    surface, control = surface_of(Cylinder(0.06, 0.1, 'open'))
    points, normals = contacts_on(surface, control, [[1, 0, 0], [-1, 0, 0], [0, 1, 0]])
    found = place(surface, control, 0.5 * H, list(points), list(normals))
    assert 'shift along z' in found.open_directions
    assert 'turn about z' in found.open_directions
    assert found.pose.translation[:2] == pytest.approx(
        (POSE.translation + POSE.rotation[:, 2] * along(found))[:2], abs=3e-4
    )


def along(found):
    """How far the fitted pose lies along the true axis."""
    return (found.pose.translation - POSE.translation) @ POSE.rotation[:, 2]


def test_three_contacts_place_an_ellipsoid_near_its_true_pose():
    surface, control = surface_of(Ellipsoid((0.05, 0.065, 0.085)))
    directions = np.array([[1, 0.4, 0.2], [-1, 0.3, -0.3], [0.2, -1, 0.4], [0.1, 0.3, 1.0]])
    points, normals = contacts_on(surface, control, directions)
    found = place(surface, control, 0.5 * H, list(points), list(normals))
    assert found.misfit < 0.05
    assert found.pose.translation == pytest.approx(POSE.translation, abs=2e-4)
    assert found.pose.rotation == pytest.approx(POSE.rotation, abs=5e-3)
    assert found.open_directions == ''


def test_the_uncertainty_of_the_pose_is_in_sigma(sphere):
    model = sphere(R, H, subdivisions=2, young=12e6)
    sigma = {}
    for given in (True, False):
        pipeline = live_hand.pipeline(model)
        if not given:
            pipeline.estimator.pose = None
        contacts = live_hand.opposed([2.0, 2.0], [3e-4] * 2, 0.0325, radius=3e-3)
        served = pipeline.settle(contacts)
        sigma[given] = float(np.median(served.packed[:, 7]))
    assert sigma[False] > sigma[True] + 1e-4


def test_an_inferred_pose_serves_the_surface_where_the_fingers_are(sphere):
    model = sphere(R, H, subdivisions=2, young=12e6)
    pipeline = live_hand.pipeline(model)
    pipeline.estimator.pose = None
    contacts = live_hand.opposed([2.0, 2.0], [3e-4] * 2, 0.0325, radius=3e-3)
    shift = np.array([0.2, 0.1, -0.3])
    contacts.point[:] += shift
    served = pipeline.settle(contacts)
    assert served.packed[:, :3].mean(axis=0) == pytest.approx(shift, abs=1e-3)
    assert served.max_displacement == pytest.approx(3e-4, rel=0.1)
