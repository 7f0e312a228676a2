# SPDX-License-Identifier: Apache-2.0
"""What /diagnostics says in which condition."""

import os
from dataclasses import replace
from types import SimpleNamespace

import pytest

from shell_deform.live.tick.diagnosis import Condition, judge, values
from shell_deform.live.tick.health import Figures, process_age, resident
from shell_deform.live.tick.modulus import ModulusEstimate
from shell_deform.live.tick.states import LiveState
from shell_deform.theory.relaxation import log_law


def adopted(share=1.0, crosses=False):
    return SimpleNamespace(share=share, message='the dent snaps through', crosses=crosses)


def served(contradiction=0.0, taking_up=False):
    return SimpleNamespace(contradiction=contradiction, suspect='gauge 2', taking_up=taking_up)


@pytest.fixture
def well():
    worker = SimpleNamespace(
        alive=True,
        theory='koiter',
        theory_reason='thin',
        mesh_warning='',
        process=SimpleNamespace(pid=os.getpid()),
    )
    return Condition(
        state=LiveState.CONTACT,
        figures=Figures(),
        link=SimpleNamespace(worker=worker, restarts=3, trouble='', processes=[os.getpid()]),
        estimator=SimpleNamespace(adopted=None, hold=None),
        served=None,
        modulus=None,
        failure='',
        unusable='',
    )


def test_a_served_contact_is_ok(well):
    assert judge(well) == ('ok', 'CONTACT')


@pytest.mark.parametrize(
    ('change', 'level', 'sentence'),
    [
        ({'failure': 'no such object'}, 'error', 'no such object'),
        ({'state': LiveState.FAULT, 'unusable': 'force is nan'}, 'error', 'force is nan'),
        ({'state': LiveState.FAULT}, 'error', 'a finger reports a fault'),
        ({'state': LiveState.STALE}, 'stale', 'no fresh contacts'),
        ({'estimator': None}, 'warn', 'building the shell'),
        ({'served': served(4.0)}, 'warn', 'contradict: gauge 2'),
        (
            {'estimator': SimpleNamespace(adopted=adopted(0.5), hold=None)},
            'warn',
            'the dent snaps through',
        ),
        (
            {'estimator': SimpleNamespace(adopted=adopted(crosses=True), hold=None)},
            'warn',
            'passes through itself',
        ),
        ({'served': served(taking_up=True)}, 'warn', 'taking up the contacts'),
        ({'state': LiveState.SATURATED}, 'warn', 'a gauge is saturated'),
    ],
)
def test_what_is_wrong_is_told_with_its_reason(well, change, level, sentence):
    found, summary = judge(replace(well, **change))
    assert found == level
    assert sentence in summary


def test_a_hold_beyond_what_the_law_is_known_for_is_told(well):
    hold = SimpleNamespace(law=log_law(0.03, 1.0, 600.0), oldest=900.0)
    found, summary = judge(replace(well, estimator=SimpleNamespace(adopted=None, hold=hold)))
    assert found == 'warn'
    assert '900 s is longer than the 600 s' in summary


def test_a_dead_background_process_is_told(well):
    well.link.trouble = 'ended and is started again'
    assert judge(well) == ('warn', 'the background process ended and is started again')


def test_a_mesh_that_bends_badly_is_told_with_the_way_out(well):
    well.link.worker.mesh_warning = 'the mesh is too coarse beside its contacts; take more'
    assert judge(well) == ('warn', 'the mesh is too coarse beside its contacts; take more')
    assert values(well, 1.0)['trouble of the mesh'].endswith('take more')


def test_a_shell_that_cannot_be_built_outranks_every_state(well):
    assert judge(replace(well, failure='no shell', state=LiveState.STALE)) == ('error', 'no shell')


def test_figures_carry_rates_memory_and_restarts(well):
    well.figures.arrivals = 100
    told = values(well, 1.0)
    assert told['input rate [Hz]'] == pytest.approx(100.0)
    assert told['background restarts'] == 3
    assert told['theory'] == 'koiter'
    assert told['why this theory'] == 'thin'
    assert told['memory of node and background [MB]'] > 10.0
    assert "Young's modulus [Pa]" not in told


def test_a_learned_modulus_is_told_with_its_sigma(well):
    told = values(replace(well, modulus=ModulusEstimate(1e7, 2e5, 4)), 1.0)
    assert told["Young's modulus [Pa]"] == 1e7
    assert told["Young's modulus, sigma [Pa]"] == 2e5


def test_a_process_that_is_gone_holds_no_memory():
    assert resident(2**22 + 1) == 0.0
    assert resident(os.getpid()) > 1e6


def test_this_process_has_an_age():
    assert process_age() > 0.0
