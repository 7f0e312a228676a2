# SPDX-License-Identifier: Apache-2.0
"""A label beside its finger: whole in the picture and beside the body, in every size."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_view.force_layer import arrow_body, label_places
from grasp_view.labels import LEAST_TOP, MARGIN, TALL, Box, Outline, label_box
from grasp_view.scene_model import Surface, Touch
from grasp_view.visitors import Visitor, Window

TEXT = 'F2  21.2 ± 0.7 N'
SIZES = [(390, 432), (672, 724), (1088, 644)]
"""Of the scene on a phone, a tablet, a desktop."""

columns, rows = st.floats(-100.0, 1200.0), st.floats(-100.0, 800.0)


def covers(box: Box, body: Outline) -> bool:
    """Whether any of a label's edge points lies in the ellipse."""
    along = np.linspace(box.left, box.right, 40)
    for row in (box.row - 0.5 * TALL, box.row + 0.5 * TALL):
        off = ((along - body.column) / body.half_width) ** 2
        if (off + ((row - body.row) / body.half_height) ** 2 < 1.0).any():
            return True
    return False


@pytest.mark.parametrize(('width', 'height'), SIZES)
@given(column=columns, row=rows, slim=st.floats(0.5, 2.0))
def test_a_label_is_whole_and_never_over_the_body(
    width: int, height: int, column: float, row: float, slim: float
) -> None:
    tall = min(0.2 * width * slim, 0.4 * height)
    body = Outline(0.5 * width, 0.55 * height, 0.2 * width, tall)
    box = label_box(TEXT, np.array([column, row]), body, width)
    assert box.left >= MARGIN - 1e-9 and box.right <= width - MARGIN + 1e-9
    assert box.row >= LEAST_TOP
    if body.row - tall > LEAST_TOP + TALL + 8.0:
        assert not covers(box, body)


def test_labels_that_would_meet_stand_above_each_other() -> None:
    body = Outline(195.0, 216.0, 78.0, 78.0)
    first = label_box(TEXT, np.array([300.0, 220.0]), body, 390)
    second = label_box(TEXT, np.array([310.0, 225.0]), body, 390, [first])
    third = label_box(TEXT, np.array([305.0, 222.0]), body, 390, [first, second])
    assert not (first.meets(second) or first.meets(third) or second.meets(third))


def seen_by(window: Window, ratio: float) -> Visitor:
    """A browser that looks along +y from 4 units away, so many pixels of the display in one."""
    camera = SimpleNamespace(
        position=np.array([0.0, -4.0, 0.0]),
        look_at=np.zeros(3),
        up_direction=np.array([0.0, 0.0, 1.0]),
        fov=0.9,
        image_height=round(ratio * window.height),
    )
    return Visitor(SimpleNamespace(camera=camera), window)  # type: ignore[arg-type]


@pytest.mark.parametrize('ratio', [2.0, 3.0])
def test_a_label_keeps_its_place_whatever_the_pixels_of_the_display(ratio: float) -> None:
    ball = 0.03 * np.concatenate([np.eye(3), -np.eye(3)])
    surface = Surface(0.0, 'object', ball, np.zeros_like(ball), np.zeros(6))
    touch = Touch(ball[0], np.array([-20.0, 0.0, 0.0]), 2, 0.7, (), True)
    place, anchor = label_places(seen_by(Window(390, 800), ratio), [touch], surface)[2]
    plain, same = label_places(seen_by(Window(390, 800), 1.0), [touch], surface)[2]
    assert place == pytest.approx(plain) and anchor == same == 'center-left'


def test_what_is_looked_at_is_in_the_middle_of_the_picture() -> None:
    visitor = seen_by(Window(390, 800), 2.0)
    assert visitor.pixels(np.zeros(3))[0] == pytest.approx([195.0, 400.0])
    beside = visitor.pixels(np.array([0.5, 0.0, 0.25]))[0] - [195.0, 400.0]
    assert beside == pytest.approx([0.5, -0.25] / visitor.pixel_at(np.zeros(3))[0])


def test_an_arrow_is_a_closed_body_from_tail_to_head() -> None:
    tail, head = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.5])
    vertices, triangles = arrow_body(tail, head, 1.0)
    assert vertices[:, 2].min() == pytest.approx(3.0) and vertices[:, 2].max() == pytest.approx(
        3.5
    )
    assert triangles.max() == len(vertices) - 1
    assert np.abs(vertices[:, :2] - [1.0, 2.0]).max() == pytest.approx(0.04)
