# SPDX-License-Identifier: Apache-2.0
"""Colours: what the legend says is what the surface shows."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib import colormaps

from grasp_view.colour_map import (
    CIVIDIS,
    SIGNED_TABLE,
    TABLE,
    SteadyScale,
    colour_index,
    legend_html,
    linear_light,
    nice_ceiling,
    renderer_colours,
    three_digits,
    tone_curve,
)


def test_the_table_is_cividis() -> None:
    wanted = np.round(np.array(colormaps['cividis'](np.arange(256)))[:, :3] * 255)
    assert np.array_equal(CIVIDIS, wanted)


LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def test_larger_values_are_always_darker() -> None:
    lightness = linear_light(TABLE[:256]) @ LUMINANCE
    assert (np.diff(lightness) < 1e-4).all() and lightness[0] > 20 * lightness[255]


def test_a_signed_value_is_darker_the_larger_it_is_and_its_sign_is_a_hue() -> None:
    lightness = linear_light(SIGNED_TABLE[:256]) @ LUMINANCE
    assert (np.diff(lightness[:128]) > -1e-4).all() and (np.diff(lightness[128:]) < 1e-4).all()
    # Blue against brown: told apart without red or green receptors.
    assert SIGNED_TABLE[30, 2] > SIGNED_TABLE[30, 0] + 60
    assert SIGNED_TABLE[225, 0] > SIGNED_TABLE[225, 2] + 60


def test_the_renderers_tone_curve_turns_our_colours_into_the_legends() -> None:
    for table in (TABLE, SIGNED_TABLE):
        made = tone_curve(renderer_colours(table).astype(float))
        assert np.allclose(made, linear_light(table), atol=1e-6)


@settings(deadline=None)
@given(st.lists(st.integers(0, 255), min_size=3, max_size=3))
def test_greys_and_every_moderate_colour_survive_the_tone_curve(colour: list[int]) -> None:
    mixed = np.array([[80 + c * 0.4 for c in colour]], dtype=np.uint8)
    assert np.allclose(
        tone_curve(renderer_colours(mixed).astype(float)), linear_light(mixed), atol=2e-3
    )


def test_values_map_onto_the_scale_and_gaps_are_grey() -> None:
    values = np.array([-1.0, 0.0, 0.5, 1.0, 9.0, np.nan, np.inf])
    assert colour_index(values, 0.0, 1.0).tolist() == [0, 0, 128, 255, 255, 256, 256]


def test_a_scale_without_width_does_not_divide_by_zero() -> None:
    assert colour_index(np.array([1.0, np.nan]), 1.0, 1.0).tolist() == [0, 0]


@settings(deadline=None)
@given(st.floats(1e-8, 1e8))
def test_the_scale_ends_at_a_round_number_not_far_above(value: float) -> None:
    top = nice_ceiling(value)
    assert value <= top * (1 + 1e-6) and top <= 2.51 * value
    assert float(f'{top:.1e}') == pytest.approx(top)


def test_the_scale_grows_at_once_and_shrinks_only_when_far_too_large() -> None:
    scale = SteadyScale(0.1)
    assert [scale.follow(v) for v in (0.0, 4.3, 3.0, 1.8, 1.9)] == [0.1, 5.0, 5.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ('value', 'text'),
    [(1153.2, '1150'), (0.0123456, '0.0123'), (9.5e-27, '0'), (0.0, '0'), (20.0, '20')],
)
def test_numbers_have_three_digits_and_no_exponent(value: float, text: str) -> None:
    assert three_digits(value) == text


def test_the_legend_names_quantity_unit_and_five_numbers() -> None:
    text = legend_html('displacement', 'mm', 0.0, 5.0, 'lines every 0.5 mm')
    assert 'displacement (mm)' in text and 'lines every 0.5 mm' in text
    assert re.findall(r'<span>([^<]+)</span>', text) == ['0', '1.25', '2.5', '3.75', '5']
    assert '#00224e' in text and '#eceae3' in text
    signed = legend_html('scan error', 'mm', -0.5, 0.5)
    assert re.findall(r'<span>([^<]+)</span>', signed) == ['-0.5', '-0.25', '0', '0.25', '0.5']
