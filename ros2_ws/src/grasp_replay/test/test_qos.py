# SPDX-License-Identifier: Apache-2.0
"""QoS profiles: written as rosbag2 version 9, read from every version."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from bag_samples import DATA
from hypothesis import given
from hypothesis import strategies as st

from grasp_replay.bag_reader import open_bag
from grasp_replay.errors import BagError
from grasp_replay.qos import (
    DURABILITIES,
    FOREVER,
    HISTORIES,
    LIVELINESSES,
    RELIABILITIES,
    QosProfile,
    common_offer,
    parse_profile,
    parse_qos_text,
    qos_text,
    read_overrides,
)

NANOSECONDS = st.one_of(st.just(FOREVER), st.integers(1, 2**31 * 10**9 - 1))


@given(
    st.builds(
        QosProfile,
        st.sampled_from(HISTORIES),
        st.integers(0, 2**31 - 1),
        st.sampled_from(RELIABILITIES),
        st.sampled_from(DURABILITIES),
        NANOSECONDS,
        NANOSECONDS,
        st.sampled_from(LIVELINESSES),
        NANOSECONDS,
    )
)
def test_what_is_written_is_read_back(profile: QosProfile) -> None:
    assert parse_qos_text(qos_text(profile)) == [profile]


def test_profiles_of_old_versions_are_read_by_number() -> None:
    with open_bag(DATA / 'talker') as bag:
        (rosout,) = parse_qos_text(bag.topics['/rosout'].qos)
    assert rosout.reliability == 'reliable'
    assert rosout.durability == 'transient_local'
    assert rosout.lifespan == 10 * 10**9
    assert rosout.deadline == FOREVER


def test_no_profile_is_an_empty_list() -> None:
    assert parse_qos_text('') == []


@pytest.mark.parametrize('text', ['[', '{a: 1}', 'hello', '- 3', '- {depth: -1}'])
def test_what_is_no_profile_is_refused(text: str) -> None:
    with pytest.raises(BagError):
        parse_qos_text(text)


def test_an_unknown_word_is_refused_with_the_known_ones() -> None:
    with pytest.raises(
        BagError, match="reliability 'perfect' is none of system_default, reliable"
    ):
        parse_profile({'reliability': 'perfect'})


def test_the_common_offer_is_the_weakest_reliability_and_the_deepest_history() -> None:
    offer = common_offer(
        [
            QosProfile(reliability='reliable', durability='transient_local', depth=50),
            QosProfile(reliability='best_effort', durability='volatile'),
        ]
    )
    assert (offer.reliability, offer.durability, offer.depth) == ('best_effort', 'volatile', 50)


def test_overrides_are_read_by_topic(tmp_path: Path) -> None:
    path = tmp_path / 'qos.yaml'
    path.write_text(yaml.safe_dump({'/x': {'reliability': 'best_effort', 'depth': 3}}))
    assert read_overrides(path) == {'/x': QosProfile(reliability='best_effort', depth=3)}


@pytest.mark.parametrize('text', ['[', 'x', '/x: {depth: many}'])
def test_an_override_file_that_cannot_be_used_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'qos.yaml'
    path.write_text(text)
    with pytest.raises(BagError, match='qos.yaml'):
        read_overrides(path)


def test_a_missing_override_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='nothing.yaml'):
        read_overrides(tmp_path / 'nothing.yaml')
