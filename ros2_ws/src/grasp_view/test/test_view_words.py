# SPDX-License-Identifier: Apache-2.0
"""What the page says: each state in a word and a sentence, and where its numbers come from."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from test_view_section import squeezed

from grasp_view.scene_model import SATURATED, Snapshot
from grasp_view.words import (
    Told,
    header_html,
    largest_html,
    largest_text,
    state_html,
    told,
    with_unit,
)

LONG_AGO = float('inf')
PRESSED = replace(squeezed(4e-3), numbers={'max_displacement': 4e-3})


@pytest.mark.parametrize(
    ('snapshot', 'age', 'word', 'sentence'),
    [
        (Snapshot(), np.nan, 'WAITING', 'to publish its state'),
        (Snapshot(state='NO_HAND'), np.nan, 'NO HAND', 'nobody publishes contacts'),
        (Snapshot(state='FREE'), 0.0, 'FREE', 'no finger touches'),
        (PRESSED, 0.0, 'CONTACT', '2 contacts, the answer follows'),
        (
            replace(PRESSED, answer='taking up'),
            0.1,
            'TAKING UP',
            'linear theory answers',
        ),
        (replace(PRESSED, state='STALE'), 0.84, 'STALE', 'no fresh hand data for 0.8 s'),
        (
            replace(PRESSED, state='FAULT', trouble='no gauge'),
            0.0,
            'FAULT',
            'no gauge; last',
        ),
    ],
)
def test_every_state_is_told_in_a_word_and_a_sentence(
    snapshot: Snapshot, age: float, word: str, sentence: str
) -> None:
    now = told(snapshot, age, LONG_AGO)
    assert now.word == word and sentence in now.sentence


def test_a_jump_of_time_is_told_for_some_seconds() -> None:
    assert told(PRESSED, 0.0, 1.0).word == 'RESET'
    assert (
        told(PRESSED, 0.0, 10.0).word == 'CONTACT' and told(PRESSED, 0.0, np.nan).word == 'CONTACT'
    )


def test_a_saturated_gauge_is_named() -> None:
    assert PRESSED.contacts is not None
    flags = np.array([1, 1 | SATURATED])
    saturated = replace(
        PRESSED, state='SATURATED', contacts=replace(PRESSED.contacts, flags=flags)
    )
    assert told(saturated, 0.0, LONG_AGO).sentence.startswith('gauge of F2 at its end')


def test_the_one_number_has_its_sigma_and_is_never_0_while_a_contact_is_taken_up() -> None:
    now = told(PRESSED, 0.0, LONG_AGO)
    assert '<b>4</b><span> ± 0.2 mm</span>' in largest_html(PRESSED, now)
    taking = replace(PRESSED, answer='taking up', numbers={'max_displacement': 0.0})
    now = told(taking, 0.0, LONG_AGO)
    assert '<b>…</b>' in largest_html(taking, now) and largest_text(taking, now) == ''
    assert 'faded' in largest_html(taking, now)


class Reader(HTMLParser):
    """The tags of a piece of HTML."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)


def test_names_from_topics_stay_text() -> None:
    evil = '<script>alert(1)</script>'
    snapshot = Snapshot(state=evil, object_name=evil, theory=evil, recording=f'{evil}: {evil}')
    shown = header_html(snapshot) + state_html(told(snapshot, 0.0, LONG_AGO))
    shown += state_html(Told('FAULT', 'fault', evil))
    assert 'script' not in Reader(shown).tags


def test_a_synthetic_recording_says_so_before_all_else() -> None:
    snapshot = Snapshot(
        object_name='ball', recording='squeeze: SYNTHETIC: emulated', theory='koiter'
    )
    text = re.sub('<[^>]+>', ' ', header_html(snapshot)).split()
    assert text == ['ball', 'SYNTHETIC', 'koiter', 'squeeze', 'emulated']
    measured = header_html(replace(snapshot, recording='squeeze: measured in May'))
    assert 'SYNTHETIC' not in measured and 'measured in May' in measured


@pytest.mark.parametrize(
    ('value', 'unit', 'text'),
    [
        (0.00935, 'm', '9.35 mm'),
        (0.242, 'J', '242 mJ'),
        (0.02, 's', '20 ms'),
        (1.26, 's', '1.3 s'),
        (0.667, '', '66.7 %'),
    ],
)
def test_numbers_have_the_units_people_read(value: float, unit: str, text: str) -> None:
    assert with_unit(value, unit) == text
