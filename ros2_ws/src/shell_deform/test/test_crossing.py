# SPDX-License-Identifier: Apache-2.0
"""Surfaces that pass through themselves are found, those that only come near are not."""

import json

import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from shell_deform.building import build_model
from shell_deform.commands import shell_solve
from shell_deform.live.background.self_crossing import LOOK_EVERY_NS, SelfCrossing
from shell_deform.objects import load_object
from shell_deform.surface.crossing import crossing

BALL = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
FACES, POINTS = np.asarray(BALL.faces), np.asarray(BALL.vertices)


def pinched(depth):
    """A ball whose two sides are pushed in by `depth` along x."""
    near = np.exp(-((1.0 - np.abs(POINTS[:, 0])) / 0.3))
    moved = POINTS.copy()
    moved[:, 0] -= np.sign(POINTS[:, 0]) * depth * near
    return moved


@pytest.mark.parametrize(('depth', 'found'), [(0.0, False), (0.95, False), (1.15, True)])
def test_two_sides_that_are_pushed_through_each_other_cross(depth, found):
    at = crossing(FACES, pinched(depth))
    assert (at is not None) == found
    if at is not None:
        assert abs(at[0]) < 0.2


@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(0.0, np.pi))
@settings(max_examples=30, deadline=None)
def test_two_balls_cross_where_they_overlap_and_not_apart(across, up, turn):
    faces = np.concatenate([FACES, FACES + len(POINTS)])
    c, s = np.cos(turn), np.sin(turn)
    other = POINTS @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    for distance, found in ((1.7, True), (2.6, False)):
        points = np.concatenate([POINTS, other + [distance, across, up]])
        assert (crossing(faces, points) is not None) == found


def test_a_can_pressed_through_itself_ends_with_the_rows_before(tmp_path, capsys):
    path = tmp_path / 'tube.yaml'
    tube = {'cylinder': {'outer_diameter_m': 0.02, 'length_m': 0.03, 'ends': 'open'}}
    pins = [{'kind': 'pin', 'at_m': [x, 0, 0], 'radius_m': 2e-3} for x in (0.01, -0.01)]
    path.write_text(
        yaml.safe_dump(
            {'name': 'tube', 'surface': tube, 'thickness_m': 5e-4, 'young_modulus_pa': 1e6,
             'poisson_ratio': 0.4, 'contacts': pins, 'control_vertices': 300}
        )
    )  # fmt: skip
    arguments = ['--object', str(path), '--displacement-sweep', '0:0.012:12', '--json']
    assert shell_solve.main(arguments) == 1
    told = capsys.readouterr()
    rows = json.loads(told.out)['points']
    assert 8 <= len(rows) <= 10 and rows[-1]['displacement_m'] < 0.0101
    assert 'passes through itself' in told.err.splitlines()[-1]


def test_a_live_surface_is_looked_at_twice_a_second():
    """What was seen stays told until the next look, by stamps."""
    model = build_model(load_object('tennis_ball'), control_vertices=250)
    through = model.rest.copy()
    through[:, 2] *= np.where(np.hypot(*through[:, :2].T) < 0.02, -0.5, 1.0)
    seen = SelfCrossing(model)
    assert not seen.found(model.rest, 0)
    assert not seen.found(through, LOOK_EVERY_NS - 1)
    assert seen.found(through, LOOK_EVERY_NS)
    assert seen.found(model.rest, LOOK_EVERY_NS + 1)
    assert not seen.found(model.rest, 0)
