# SPDX-License-Identifier: Apache-2.0
"""Supervisory replies: what is read, and what is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barrett_hand_bridge.gcl.language import (
    HandLinkError,
    HandRestartedError,
    parse_firmware,
    parse_loop_end,
    parse_reply,
    status_text,
)

LINE_ENDS = st.sampled_from([b'\n\r', b'\r\n', b'\n', b'\r'])


@given(values=st.lists(st.integers(-(10**9), 10**9), max_size=8), end=LINE_ENDS)
def test_values_come_back_whatever_the_line_ends(values, end):
    raw = b'FGET P' + end
    if values:
        raw += b' '.join(str(value).encode() for value in values) + end
    reply = parse_reply('FGET P', raw + b'=> ')
    assert reply.integers(len(values)) == tuple(values)
    assert reply.status == 0


@given(status=st.integers(1, 32767))
def test_an_error_reply_carries_its_status_sum(status):
    raw = b'HI\n\rERR ' + str(status).encode() + b'\n\r=> '
    assert parse_reply('HI', raw).status == status


def test_bits_of_a_status_sum_are_named():
    assert status_text(4 + 8192) == 'motor not initialised, over-temperature'


@pytest.mark.parametrize(
    ('raw', 'complaint'),
    [
        (b'FGET P\n\r1 2 3 4\n\r', 'no prompt'),
        (b'FGXT P\n\r1 2 3 4\n\r=> ', 'echo'),
        (b'FGET P1 2 3 4\n\r=> ', 'no line end'),
        (b'FGET P\n\rERR\n\r=> ', 'error without a number'),
        (b'FGET P\n\rERR 0\n\r=> ', 'error without a number'),
        (b'FGET P\n\r1 2\n\rERR 4\n\r=> ', 'values and an error'),
        (b'FGET P\n\r1 \xff\n\r=> ', 'unprintable'),
        (b'', 'no prompt'),
    ],
)
def test_a_broken_reply_is_refused_with_its_reason(raw, complaint):
    with pytest.raises(HandLinkError, match=complaint):
        parse_reply('FGET P', raw)


def test_a_banner_in_mid_stream_means_the_hand_restarted():
    with pytest.raises(HandRestartedError):
        parse_reply('FGET P', b'FGET P\n\rBarrettHand Firmware\n\rVersion 4.4\n\r=> ')


def test_values_of_another_count_are_refused():
    with pytest.raises(HandLinkError, match='expected 3 integers'):
        parse_reply('GFGET SG', b'GFGET SG\n\r120 121\n\r=> ').integers(3)


def test_an_error_inside_the_loop_gives_its_status():
    assert parse_loop_end(b'\n\rERR 8192\n\r=> ') == 8192


def test_garbage_inside_the_loop_is_no_status():
    with pytest.raises(HandLinkError):
        parse_loop_end(b'\n\rERX 8192\n\r=> ')


@pytest.mark.parametrize(
    ('words', 'version'),
    [
        (('BarrettHand', 'Firmware', 'Version', '4.4.0'), (4, 4)),
        (('V4.32', 'BH8-262'), (4, 3)),
        (('4.41b',), (4, 4)),
    ],
)
def test_firmware_version_is_found_among_other_words(words, version):
    assert parse_firmware(words) == version


def test_no_version_number_is_an_error():
    with pytest.raises(HandLinkError, match='no version number'):
        parse_firmware(('BarrettHand',))
