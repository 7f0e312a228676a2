# SPDX-License-Identifier: Apache-2.0
"""Experiments of other people: what lies within what was measured, and what does not."""

from shell_deform.objects.shell_object import Gas
from shell_deform.verification.experiments import (
    BAND_M,
    Experiment,
    forward_deformation,
    tennis_core,
)


def test_a_pressurised_core_passes_the_acceptance_test_and_a_punctured_one_is_softer():
    blown = forward_deformation(tennis_core(Gas('sealed', 83e3)), vertices=200)
    punctured = forward_deformation(tennis_core(Gas('open')), vertices=200)
    assert BAND_M[0] < blown < BAND_M[1]
    assert punctured > 1.1 * blown


def test_a_number_is_judged_only_where_one_was_read():
    def verdict(measured):
        return Experiment('ball', 'travel', measured, 1.0, 'known', 'someone', '').verdict

    assert verdict((0.9, 1.1)) == 'within'
    assert verdict((1.2, 1.3)) == 'outside'
    assert verdict((1.3, 1.3)) == 'differs by -0.3'
    assert verdict(None) == 'no number to compare with'
