# SPDX-License-Identifier: Apache-2.0
"""How large a contact region is, read between its points."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.contact.contact_field import Memory
from shell_deform.contact.depth_of_force import depth_of_force
from shell_deform.contact.outer_face import POINTS_PER_TRIANGLE
from shell_deform.contact.region import PARTS, pressed_areas
from shell_deform.surface.quadrature import triangle_rule

CELLS, EDGE = 10, 1e-3
ENDS = 4


@pytest.mark.parametrize('start', [-0.02, 0.0, 0.03])
@pytest.mark.parametrize('power', [1.0, 1.5])
def test_the_depth_of_a_force_is_that_of_its_law_in_few_looks(start, power):
    """A spring and Hertz's law, which push from a depth of 2 mm on, at 5 N."""
    looks = []

    def excess(depth):
        looks.append(depth)
        pressed = max(depth - 2e-3, 0.0)
        rate = 3e4 * power * pressed ** (power - 1.0) if pressed else 0.0
        return 3e4 * pressed**power - 5.0, rate

    found = depth_of_force(excess, start, 5.0, 0.06)
    assert found == pytest.approx(2e-3 + (5.0 / 3e4) ** (1.0 / power), rel=1e-9)
    assert len(looks) < 60
    # What is looked at lies no further away than the bounds had to be widened.
    assert np.ptp([*looks, start]) < 4.0 * (abs(start - found) + 1e-3 * 0.06)


def test_a_force_that_no_depth_gives_ends_within_four_sizes():
    looks = []
    depth_of_force(lambda depth: (looks.append(depth) or -5.0, 0.0), 0.01, 5.0, 0.06)
    assert 4.0 * 0.06 <= max(looks) - 0.01 <= 8.1 * 0.06


def flat_face():
    """A square of triangles of 1 mm in the plane z = 0, with four points on its edge behind."""
    rule, weights = triangle_rule(POINTS_PER_TRIANGLE)
    i, j = np.divmod(np.arange(CELLS**2), CELLS)
    corner = EDGE * np.stack([i, j], axis=1)
    places = np.concatenate([corner[:, None] + EDGE * rule, corner[:, None] + EDGE * (1.0 - rule)])
    places = np.concatenate([places.reshape(-1, 2), np.full((ENDS, 2), -1.0)])
    area = np.concatenate([np.tile(EDGE**2 * weights, 2 * CELLS**2), np.full(ENDS, 1e-8)])
    element = np.concatenate([np.repeat(np.arange(2 * CELLS**2), len(weights)), np.arange(ENDS)])
    return SimpleNamespace(weights=area, element=element), np.pad(places, ((0, 0), (0, 1)))


FACE, PLACES = flat_face()


def touched(distance):
    """The areas of the points that lie below zero of a distance (p,), and these points."""
    at = np.flatnonzero(distance < 0.0)
    touch = SimpleNamespace(body=0, face=SimpleNamespace(at=at), weights=FACE.weights[at])
    return pressed_areas(FACE, Memory(distance[None], PLACES[None]), touch), at


@given(st.floats(1.3 * EDGE, 4.0 * EDGE), st.floats(4.2e-3, 5.8e-3), st.floats(4.2e-3, 5.8e-3))
@settings(max_examples=60, deadline=None)
def test_the_radius_of_a_disc_is_within_one_percent_wherever_its_rim_lies(radius, x, y):
    away = np.linalg.norm(PLACES - [x, y, 0.0], axis=1)
    areas, at = touched((away**2 - radius**2) / (2.0 * radius))
    assert np.sqrt(areas.sum() / np.pi) == pytest.approx(radius, rel=0.01)
    # Every point stands for what lies around it.
    assert areas.max() < 4.0 * FACE.weights[at].max()
    assert areas @ PLACES[at] / areas.sum() == pytest.approx([x, y, 0.0], abs=0.05 * EDGE)


def test_what_is_touched_everywhere_has_the_area_of_its_points_and_edges_their_own():
    areas, at = touched(np.full(len(FACE.weights), -1e-6))
    assert areas.sum() == pytest.approx(FACE.weights[at].sum(), rel=1e-12)
    np.testing.assert_array_equal(areas[-ENDS:], FACE.weights[-ENDS:])


def test_a_single_point_has_an_area_and_none_has_none():
    distance = np.full(len(FACE.weights), 1e-6)
    assert touched(distance)[0].shape == (0,)
    distance[600] = -1e-12
    areas, _ = touched(distance)
    assert 0.5 * EDGE**2 / PARTS**2 <= areas[0] < FACE.weights[600]
