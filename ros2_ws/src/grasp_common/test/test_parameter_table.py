# SPDX-License-Identifier: Apache-2.0
"""Parameter tables: what is allowed passes, what is not is named with what would be."""

from __future__ import annotations

import math
from array import array
from typing import Any

import pytest

from grasp_common.parameter_table import (
    Parameter,
    ParameterError,
    check,
    check_known,
    unknown,
    usage,
)

FORCE = Parameter('close_force', 5.0, 'force at which it stops (N)', 0.1, 25.0)
WORD = Parameter('drive', 'fused', 'what drives', choices=('force', 'fused'))
WORDS = Parameter('feedback', ['strain'], 'what is read', choices=('strain', 'delta'))
PINS = Parameter('pin_length', [0.04] * 3, 'length of each pin (m)', 0.0, 0.2, length=3)
POSE = Parameter('object_pose', [0.0] * 7, 'x y z (m) qx qy qz qw')
TABLE = (FORCE, WORD, WORDS, PINS, POSE)


def test_every_default_is_allowed() -> None:
    check_known(TABLE, {one.name: one.default for one in TABLE})


def test_an_array_of_ros_is_a_list() -> None:
    check(PINS, array('d', [0.1, 0.1, 0.1]))


@pytest.mark.parametrize(
    ('parameter', 'value', 'complaint'),
    [
        (FORCE, 100.0, r'close_force is 100.0; it must lie between 0.1 and 25: force at which'),
        (FORCE, math.nan, 'close_force is nan; it must lie between'),
        (WORD, 'usb', "drive is 'usb'; choose one of force, fused"),
        (WORDS, ['strain', 'smell'], "feedback is 'smell'; choose one of strain, delta"),
        (PINS, [0.1], 'pin_length has 1 values; it needs 3'),
        (PINS, [0.1, 0.1, 9.0], 'pin_length is 9.0'),
        (POSE, [0.0, math.inf], 'object_pose is inf; it must be finite'),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(
    parameter: Parameter, value: Any, complaint: str
) -> None:
    with pytest.raises(ParameterError, match=complaint):
        check(parameter, value)


def test_a_complaint_carries_no_escape_and_no_book() -> None:
    with pytest.raises(ParameterError) as caught:
        check(WORD, '\x1b]0;pwned\x07' + 'x' * 100_000)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 1000


def test_an_unknown_name_is_told_with_the_nearest_known_one() -> None:
    assert unknown('objekt', ['object', 'theory']) == (
        "there is no parameter 'objekt'; did you mean object?"
    )


def test_usage_lists_every_parameter_with_its_limits() -> None:
    text = usage('hand', 'A hand.', TABLE)
    assert text.startswith('usage: hand ')
    assert '  close_force (default 5.0)\n      force at which it stops (N) (0.1 to 25)' in text
    assert 'what drives (one of force, fused)' in text
