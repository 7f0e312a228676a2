# SPDX-License-Identifier: Apache-2.0
"""A label beside its finger: whole in the picture and beside the body, in every size."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_view.force_layer import (
    LABEL_PIXELS,
    LABEL_PIXELS_PER_SIGN,
    arrow_body,
    label_place,
)
from grasp_view.visitors import Visitor, Window

TEXT = 'F2  21.2 ± 0.7 N'
HALF = 0.65


def seen_by(width: int, height: int) -> Visitor:
    """A browser that looks along +y from 4 units away, its picture as the window leaves it."""
    window = Window(width, height)
    camera = SimpleNamespace(
        position=np.array([0.0, -4.0, 0.0]),
        look_at=np.zeros(3),
        up_direction=np.array([0.0, 0.0, 1.0]),
        fov=0.9,
        image_height=height,
    )
    return Visitor(SimpleNamespace(camera=camera), window)  # type: ignore[arg-type]


def span(visitor: Visitor, place: np.ndarray, anchor: str) -> tuple[float, float]:
    """First and last column of the label's box."""
    pixel = 2.0 * (place[1] + 4.0) * np.tan(0.45) / visitor.client.camera.image_height
    x = 0.5 * visitor.window.scene[0] + place[0] / pixel
    wide = LABEL_PIXELS_PER_SIGN * len(TEXT) + LABEL_PIXELS
    start = {'center-left': x, 'center-right': x - wide, 'bottom-center': x - wide / 2}[anchor]
    return start, start + wide


@pytest.mark.parametrize(('width', 'height'), [(390, 844), (1024, 768), (1440, 900)])
@given(x=st.floats(-1.6, 1.6), y=st.floats(-1.0, 1.0))
def test_a_label_is_whole_and_beside_the_body_where_there_is_room(
    width: int, height: int, x: float, y: float
) -> None:
    visitor = seen_by(width, height)
    place, anchor = label_place(visitor, np.array([x, y, 0.3]), np.zeros(3), HALF, TEXT)
    first, last = span(visitor, place, anchor)
    assert first >= 5.0 and last <= visitor.window.scene[0] - 5.0
    if anchor != 'bottom-center':
        pixel = 2.0 * 4.0 * np.tan(0.45) / height
        middle = 0.5 * visitor.window.scene[0]
        assert first >= middle + HALF / pixel or last <= middle - HALF / pixel


def test_an_arrow_is_a_closed_body_from_tail_to_head() -> None:
    tail, head = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.5])
    vertices, triangles = arrow_body(tail, head, 1.0)
    assert vertices[:, 2].min() == pytest.approx(3.0) and vertices[:, 2].max() == pytest.approx(
        3.5
    )
    assert triangles.max() == len(vertices) - 1
    assert np.abs(vertices[:, :2] - [1.0, 2.0]).max() == pytest.approx(0.04)
