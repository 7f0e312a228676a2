# SPDX-License-Identifier: Apache-2.0
"""Light on the surface: shape is seen, and no colour is taken for another value's."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from grasp_view.colour_map import TABLE, linear_light
from grasp_view.shading import (
    DARKEST,
    DARKEST_UNREAD,
    Hollow,
    light_on,
    lit_colours,
    normals_of,
)

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.03)
REST, FACES = np.asarray(BALL.vertices), np.asarray(BALL.faces)
# What is left of colours to eyes without green, without red receptors (F. Vienot, H. Brettel and
# J. Mollon 1999, doi:10.1002/(SICI)1520-6378(199908)24:4<243::AID-COL5>3.0.CO;2-3), linear sRGB.
EYES = {
    'all': np.eye(3),
    'no green': np.array([[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]]),
    'no red': np.array([[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]]),
}


def lab(linear: np.ndarray) -> np.ndarray:
    """CIE L*a*b* (n, 3) of linear sRGB, D65."""
    xyz = (
        linear
        @ np.array(
            [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
        ).T
    )
    f = np.cbrt(np.maximum(xyz / [0.9505, 1.0, 1.089], 1e-6))
    return np.stack(
        [116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1
    )


@pytest.mark.parametrize('eye', EYES)
def test_values_a_tenth_apart_differ_under_any_two_lights(eye: str) -> None:
    rows = np.round(np.linspace(0.05, 1.0, 39) * 255).astype(int)
    lights = np.linspace(DARKEST, 1.0, 21)
    seen = [
        lab(np.clip(linear_light(TABLE[r]) * lights[:, None] @ EYES[eye].T, 0, 1)) for r in rows
    ]
    apart = [
        np.linalg.norm(a[:, None] - b[None], axis=2).min()
        for k, a in enumerate(seen)
        for b in seen[k + 4 :]
    ]
    # About 1 is just visible; contour lines carry the value where this is small.
    assert min(apart) > 1.5, min(apart)


def test_light_only_darkens_and_only_so_far() -> None:
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    share = np.where(rng.uniform(size=4000) < 0.2, np.nan, rng.uniform(size=4000))
    light = light_on(normals, rng.normal(size=4000), share)
    assert light.max() <= 1.0 and light.min() >= DARKEST_UNREAD
    assert light[np.nan_to_num(share) >= 0.03].min() >= DARKEST
    assert light[normals[:, 2] > 0.95].mean() > light[normals[:, 2] < -0.95].mean() + 0.2


def test_full_light_leaves_every_colour_and_none_makes_black() -> None:
    assert np.abs(lit_colours(TABLE, np.ones(257)).astype(int) - TABLE).max() <= 1
    assert lit_colours(TABLE, np.zeros(257)).max() == 0


def test_a_dent_is_a_hollow_and_the_rest_shape_has_none() -> None:
    hollow = Hollow(REST, FACES)
    assert np.allclose(hollow.depth(REST, normals_of(REST, FACES)), 0.0)
    near = np.linalg.norm(REST - [0.03, 0, 0], axis=1)
    dented = REST - np.outer(8e-3 * np.exp(-((near / 8e-3) ** 2)), [1.0, 0, 0])
    depth = hollow.depth(dented, normals_of(dented, FACES))
    assert depth[near < 4e-3].min() > 0.1 and np.abs(depth[REST[:, 0] < 0]).max() < 1e-9


def test_normals_of_a_ball_are_its_radii() -> None:
    assert np.allclose(normals_of(REST, FACES), REST / 0.03, atol=1e-2)
