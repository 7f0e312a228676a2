# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from scan_shells import BALL_RADIUS, BALL_THICKNESS, ball, half_can, two_dents

from scan_compare.deformed_surface import (
    DeformedSurface,
    SurfaceError,
    surface_from_limit_positions,
    triangle_lattice,
)
from scan_compare.dent import contacts_of
from scan_compare.distance import measure
from scan_compare.model_file import surface_of_object

OUTER_RADIUS = BALL_RADIUS + 0.5 * BALL_THICKNESS


def test_the_outer_face_lies_half_a_thickness_outside_the_middle_surface() -> None:
    samples = ball().samples
    assert np.linalg.norm(samples.position, axis=1) == pytest.approx(OUTER_RADIUS, abs=5e-6)


def test_sample_areas_add_up_to_the_outer_face() -> None:
    assert ball().samples.area.sum() == pytest.approx(4.0 * np.pi * OUTER_RADIUS**2, rel=1e-4)
    can = half_can()
    outer = np.pi * (0.033 + 0.00005) * 0.1
    assert can.samples.area.sum() == pytest.approx(outer, rel=2e-3)


def test_distances_are_signed_and_count_from_the_outer_face() -> None:
    directions = np.random.default_rng(0).standard_normal((500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    heights = np.linspace(-2e-3, 2e-3, 500)
    found = measure(ball(), directions * (OUTER_RADIUS + heights)[:, None])
    assert found.distance == pytest.approx(heights, abs=5e-6)
    assert not found.beyond_edge.any()


def test_points_beyond_the_edge_of_an_open_shell_are_beside_it() -> None:
    found = measure(half_can(), np.array([[0.0, 0.033, 0.06], [0.0, 0.033, 0.0]]))
    assert found.beyond_edge.tolist() == [True, False]


def test_control_vertices_beyond_an_edge_are_no_surface() -> None:
    can = surface_of_object('half_soda_can')
    assert not can.mesh.active.all()
    end = can.samples.position[:, 2].max()
    assert end == pytest.approx(0.06, abs=1e-3)
    found = measure(can, np.array([[0.0, 0.033, end + 5e-3], [0.0, 0.033, end - 5e-3]]))
    assert found.beyond_edge.tolist() == [True, False]
    assert can.max_displacement == 0.0


def test_the_contacts_are_the_deepest_points_of_each_dent_on_the_rest_face() -> None:
    contacts = contacts_of(ball(two_dents(0.006)))
    assert contacts.point == pytest.approx(
        np.array([[0.0, 0, -OUTER_RADIUS], [0.0, 0, OUTER_RADIUS]]), abs=0.3e-3
    )
    assert contacts.inward == pytest.approx(np.array([[0.0, 0, 1], [0.0, 0, -1]]), abs=0.01)


def test_a_shell_at_rest_has_no_dent_and_no_contacts() -> None:
    surface = ball()
    assert surface.max_displacement == 0.0
    assert surface.dent_threshold == np.inf
    assert len(contacts_of(surface).point) == 0


def test_the_dent_threshold_is_a_tenth_of_the_largest_displacement() -> None:
    surface = ball(two_dents(0.006))
    assert surface.max_displacement == pytest.approx(0.006, rel=1e-6)
    assert surface.dent_threshold == pytest.approx(0.0006, rel=1e-6)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'rest': np.zeros((5, 3))}, 'rest control points of shape'),
        ({'deformed': np.full((642, 3), np.nan)}, 'NaN'),
        ({'thickness': -1.0}, 'thickness -1.0'),
    ],
)
def test_what_makes_no_surface_is_refused(change: dict[str, object], words: str) -> None:
    good = ball()
    numbers = {'rest': good.rest, 'deformed': good.deformed, 'thickness': good.thickness}
    with pytest.raises(SurfaceError, match=words):
        DeformedSurface(good.limit, **{**numbers, **change})


def test_a_surface_of_another_mesh_is_refused() -> None:
    with pytest.raises(SurfaceError, match='do not belong together'):
        surface_from_limit_positions(ball().limit, None, np.zeros((12, 3)), 0.0025)


def test_the_lattice_of_a_triangle_is_centred_and_complete() -> None:
    lattice = triangle_lattice(5)
    assert len(lattice) == 25
    assert lattice.mean(axis=0) == pytest.approx([1 / 3, 1 / 3])
