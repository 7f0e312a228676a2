# SPDX-License-Identifier: Apache-2.0
"""The finer drawing of a coarse mesh: rounder, and true where a number was published."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from grasp_view.smooth_faces import MOST_VERTICES, SmoothFaces

BALL = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
VERTICES, TRIANGLES = np.asarray(BALL.vertices), np.asarray(BALL.faces)
SMOOTH = SmoothFaces(TRIANGLES, len(VERTICES))


def test_old_vertices_stay_where_they_are() -> None:
    assert np.array_equal(SMOOTH.positions(VERTICES)[: len(VERTICES)], VERTICES)


def test_every_face_becomes_four_that_cover_it() -> None:
    fine = trimesh.Trimesh(SMOOTH.positions(VERTICES), SMOOTH.triangles, process=False)
    assert len(SMOOTH.triangles) == 4 * len(TRIANGLES)
    assert fine.is_watertight and fine.is_winding_consistent


def test_edge_middles_of_a_ball_lie_five_times_nearer_to_it_than_the_chords() -> None:
    middles = SMOOTH.positions(VERTICES)[len(VERTICES) :]
    chord = 1.0 - np.linalg.norm(VERTICES[BALL.edges_unique].mean(axis=1), axis=1)
    assert np.abs(1.0 - np.linalg.norm(middles, axis=1)).max() < chord.max() / 5


def test_a_flat_sheet_stays_flat() -> None:
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = SmoothFaces(np.array([[0, 1, 2], [0, 2, 3]]), 4)
    assert faces.positions(flat)[:, 2] == pytest.approx(0.0)


def test_values_between_vertices_are_means_and_unknown_ones_stay_unknown() -> None:
    faces = SmoothFaces(np.array([[0, 1, 2]]), 3)
    values = faces.values(np.array([1.0, 3.0, np.nan]))
    assert values[:2].tolist() == [1.0, 3.0]
    assert np.isnan(values[2:]).sum() == 3 and 2.0 in values


def test_a_mesh_that_looks_round_already_is_drawn_as_it_is() -> None:
    count = MOST_VERTICES + 1
    faces = SmoothFaces(np.array([[0, 1, 2]]), count)
    assert np.array_equal(faces.triangles, [[0, 1, 2]])
    assert len(faces.positions(np.zeros((count, 3)))) == count
