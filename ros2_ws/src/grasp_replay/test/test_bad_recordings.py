# SPDX-License-Identifier: Apache-2.0
"""Recordings whose numbers cannot be meant: refused with the value and the way out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grasp_samples import write_grasp

from grasp_replay.errors import BagError
from grasp_replay.experiment import read_experiment
from grasp_replay.holds import holds_of
from grasp_replay.pipeline import PipelineOptions, run
from grasp_replay.recording import read_recording


@pytest.mark.parametrize(
    ('scan_unit', 'reason'),
    [
        (1 / 25.4, 'off by the factor 25.4, inches were read as mm before'),
        (1000.0, 'off by the factor 1000, the file is in mm'),
        (1000.0 / 25.4, 'off by the factor 39.37, the file is in inch'),
    ],
)
def test_a_scan_in_another_unit_is_refused_with_the_factor(
    tmp_path: Path, scan_unit: float, reason: str
) -> None:
    grasp = write_grasp(tmp_path / 'grasp', (10.0,), scan_unit)
    with pytest.raises(BagError, match=reason):
        run(grasp, PipelineOptions(changes={'control_vertices': 200}, thick=False))


def test_a_hold_without_usable_forces_is_refused_with_the_first_of_them(tmp_path: Path) -> None:
    grasp = write_grasp(tmp_path / 'grasp', (10.0,))
    recording = read_recording(grasp)
    samples = tuple(
        replace(sample, force=np.full_like(sample.force, np.nan)) for sample in recording.samples
    )
    with pytest.raises(BagError, match=r'unusable: contact of finger 1: force is \[nan'):
        holds_of(replace(recording, samples=samples), read_experiment(grasp))
