# SPDX-License-Identifier: Apache-2.0
"""What the page says: each state in a word and a sentence, and where its numbers come from."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from test_view_section import squeezed

from grasp_view.scene_model import DISPLACEMENT, ENERGY, SATURATED, Snapshot
from grasp_view.surface_layer import Legend
from grasp_view.words import (
    Told,
    header_html,
    largest_html,
    largest_text,
    numbers_html,
    numbers_of,
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


@pytest.mark.parametrize(
    ('kind', 'faded', 'meaning'),
    [
        ('contact', False, 'largest displacement, middle surface'),
        ('saturated', False, 'largest displacement, at least'),
        ('stale', True, 'largest displacement of the last answer'),
        ('fault', True, 'largest displacement of the last answer'),
        ('taking', True, 'largest displacement until the equilibrium is found'),
    ],
)
def test_the_one_number_says_what_it_is_worth(kind: str, faded: bool, meaning: str) -> None:
    now = Told('', kind, '')
    assert f'<p>{meaning}</p>' in largest_html(PRESSED, now)
    assert ('faded' in largest_html(PRESSED, now)) == faded
    assert largest_text(PRESSED, now) == '4 mm'
    nothing = replace(PRESSED, numbers={})
    assert '<b>–</b>' in largest_html(nothing, now) and largest_text(nothing, now) == ''


def test_other_numbers_stand_in_their_units_and_only_what_is_known() -> None:
    known = {'strain_energy': 0.0125, 'nonlinear_age': 2.5, 'mean_error': np.nan}
    lines = numbers_of(replace(PRESSED, numbers=known), Legend(DISPLACEMENT, 5.0, 4.0))
    assert lines['strain energy'] == '12.5 mJ'
    assert lines['nonlinear answer, age'] == '2.5 s'
    assert 'scan to surface, mean' not in lines
    coloured = numbers_of(PRESSED, Legend(ENERGY, 5.0, 3.25))
    assert coloured[f'largest {ENERGY.name}'] == f'3.25 {ENERGY.unit}'
    assert '<dt>strain energy</dt> <dd>12.5 mJ</dd>' in numbers_html(lines)


@pytest.mark.parametrize(
    ('value', 'unit', 'text'),
    [
        (0.0041, 'm', '4.1 mm'),
        (0.25, '', '25 %'),
        (0.999, 's', '999 ms'),
        (1.0, 's', '1.0 s'),
        (2e-3, 'J', '2 mJ'),
    ],
)
def test_a_number_is_told_in_the_unit_that_people_read(value: float, unit: str, text: str) -> None:
    assert with_unit(value, unit) == text


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
