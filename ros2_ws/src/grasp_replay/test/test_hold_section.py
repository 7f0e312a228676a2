# SPDX-License-Identifier: Apache-2.0
"""A recorded hold of a wall that relaxes: elastic pushes for the solvers, and what was to come."""

from pathlib import Path

import numpy as np
import pytest

from grasp_replay.experiment import read_experiment
from grasp_replay.hold_section import hold_sections
from grasp_replay.holds import holds_of
from grasp_replay.recording import read_recording
from grasp_replay.relaxed import elastic_recording, hold_trace
from shell_deform.objects import load_object

BAG = Path(__file__).parents[4] / 'bags' / 'long_hold'


@pytest.fixture(scope='module')
def recorded():
    recording, experiment = read_recording(BAG), read_experiment(BAG)
    law = load_object(str(BAG / 'object.yaml')).relaxation
    return recording, experiment, law


def held(recording, experiment):
    return next(hold for hold in holds_of(recording, experiment) if hold.contacts is not None)


def test_an_elastic_wall_would_need_one_push_throughout_the_hold(recorded):
    recording, experiment, law = recorded
    felt, needed = recording, elastic_recording(recording, law)
    early = slice(300, 700)
    for before, after in ((felt, 0.97), (needed, 1.0)):
        push = np.array([s.push[:2] for s in before.samples if len(s.finger) > 1], dtype=object)
        rows = np.array([row for row in push if len(row) == 2], dtype=float)
        ratio = rows[-400:].mean() / rows[early].mean()
        assert ratio == pytest.approx(after, abs=0.012)
    contacts = held(needed, experiment).contacts
    assert (contacts.push > 1.08 * held(felt, experiment).contacts.push).all()


def test_the_rest_of_the_hold_is_predicted_from_its_first_tenth(recorded):
    recording, experiment, law = recorded
    trace = hold_trace(recording, held(recording, experiment), law)
    told = trace.to_json()
    assert told['known_until_s'] < 0.12 * told['predicted_at_s']
    for finger in told['fingers']:
        assert finger['predicted_n'] == pytest.approx(finger['felt_n'], rel=0.015)
    assert 0.85 <= told['inside_band'] <= 0.97
    (section,) = hold_sections([(1, trace)])
    assert '<svg' in section.body and '90 % band' in section.body


def test_a_moment_without_a_window_is_no_hold(recorded):
    recording, experiment, law = recorded
    undeformed = next(h for h in holds_of(recording, experiment) if h.contacts is None)
    assert hold_trace(recording, undeformed, law) is None
    assert hold_sections([]) == []
