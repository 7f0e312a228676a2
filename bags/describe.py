# SPDX-License-Identifier: Apache-2.0
"""Words and truth beside a recording: experiment.yaml, README.md, truth.yaml, two .npz files."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml

from bags.recording import START_NS, TOPICS
from bags.scanner import Scanner
from bags.session import Session

if TYPE_CHECKING:
    from bags.experiments import Experiment

LABEL = (
    'SYNTHETIC: an emulated hand, a simulated scanner and a finite-element solid; '
    'nothing here was measured on a real object'
)
HIDDEN = ('use_sim_time', 'port', 'calibration', 'poll_period')


def write(experiment: Experiment, session: Session, parameters: dict, folder: Path) -> None:
    """Write everything that belongs beside the bag in `folder`."""
    (folder / 'experiment.yaml').write_text(
        _yaml(experiment_document(experiment, session, parameters))
    )
    if experiment.object_file is not None:
        (folder / 'object.yaml').write_text(_yaml(experiment.object_file()))
    (folder / 'truth.yaml').write_text(_yaml(truth_document(experiment, session)))
    (folder / 'README.md').write_text(readme(experiment, session))
    _write_scan_truth(session, folder / 'truth_scans.npz')
    _write_series(session, folder / 'truth_series.npz')


class _Plain(yaml.SafeDumper):
    """Writes repeated values out instead of pointing to the first."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _yaml(document: dict) -> str:
    return yaml.dump(document, Dumper=_Plain, sort_keys=False, width=100)


def experiment_document(experiment: Experiment, session: Session, parameters: dict) -> dict:
    """What a user of the bag needs to know; nothing hidden is in it."""
    stage = session.stage
    told = {key: value for key, value in parameters.items() if key not in HIDDEN}
    return {
        'name': experiment.name,
        'title': experiment.title,
        'label': LABEL,
        'synthetic': True,
        'values': {
            'measured': [],
            'published': [
                f'forces of ../published/table1.yaml row {row}' for row in _published(session)
            ],
            'synthetic': ['every topic of the bag', 'truth.yaml', 'truth_*.npz'],
        },
        'object': experiment.object_name,
        'object_pose': session.rows[0]['object_pose'] if session.rows else _rest_pose(session),
        'object_frame': experiment.frame,
        'frame': session.world.frame,
        'hand': {
            'model': 'BarrettHand BH8-262 (emulated)',
            'fingers': list(stage.fingers),
            'calibration': 'calibration.yaml',
            'bridge_parameters': told,
            'cycles_per_second': round(1.0 / experiment.period_s, 3),
        },
        'scanner': {
            'model': 'NextEngine-like desktop laser scanner (simulated), Macro',
            'noise_sigma_m': experiment.scanner.noise_sigma_m,
            'views': len(experiment.views),
            **_scanner_facts(experiment.scanner),
        },
        **experiment.facts,
        'start_ns': START_NS,
        'duration_s': session.time_s,
        'topics': list(TOPICS),
        'scans': [
            {key: value for key, value in row.items() if key != 'hold'}
            | ({'hold': row['hold']} if 'hold' in row else {})
            for row in session.rows
        ],
        'windows': session.windows,
        'measured_displacement': {
            'scan': 'the pin hides the deepest point: extrapolate the radial dent profile of the '
            'scan to the contact axis (outer face)',
            'pins': 'half of the loss of pin separation since first touch, `travel` of '
            'hand/contacts averaged over the hold',
        },
        'caveats': list(experiment.caveats),
    }


def _rest_pose(session: Session) -> list[float]:
    return [float(value) for value in session.stage.setting.origin] + [0.0, 0.0, 0.0, 1.0]


def _published(session: Session) -> list[int]:
    return [window['published_row'] for window in session.windows if 'published_row' in window]


def _scanner_facts(scanner: Scanner) -> dict:
    facts = asdict(scanner)
    return {
        'working_distance_m': facts['working_distance_m'],
        'baseline_m': facts['baseline_m'],
        'pitch_m': facts['pitch_m'],
        'steepest_incidence_deg': facts['steepest_incidence_deg'],
        'view_registration_sigma': [
            facts['registration_sigma_m'],
            f'{facts["registration_sigma_deg"]} deg',
        ],
        'scan_placement_sigma': [
            facts['placement_sigma_m'],
            f'{facts["placement_sigma_deg"]} deg',
        ],
        'most_points': facts['most_points'],
        'errors': facts['errors'],
        'trimming': 'points on fingers and pins are removed, as an operator does',
    }


def truth_document(experiment: Experiment, session: Session) -> dict:
    """What is hidden from every node: the true loads, poses, pins, gauges and seeds."""
    stage = session.stage
    body = stage.mechanics.body
    kept = stage.setting.truth.data
    return {
        'label': LABEL,
        'seed': experiment.seed,
        'solid': {
            key: kept[key]
            for key in ('what', 'solver', 'young_modulus_pa', 'poisson_ratio', 'gas')
            if key in kept
        }
        | {'file': stage.setting.truth.file},
        'wire': {
            'sha256': stage.hand.digest.hexdigest(),
            'bytes_to_hand': stage.hand.bytes_in,
            'bytes_from_hand': stage.hand.bytes_out,
        },
        'pins': {
            finger: {
                'length_m': round(pin.length_m, 9),
                'lean_rad': round(pin.lean_rad, 9),
                'forward_m': pin.forward_m,
            }
            for finger, pin in body.pins.items()
            if finger in stage.fingers
        },
        'tendon_compliance_rad_per_nm': {
            finger: round(value, 9) for finger, value in body.tendon_compliance_rad_per_nm.items()
        },
        'gauges': {
            finger: {
                key: round(value, 6) if isinstance(value, float) else value
                for key, value in asdict(gauge.character).items()
            }
            for finger, gauge in stage.mechanics.gauges.items()
        },
        'scans': session.truths,
    }


def _write_scan_truth(session: Session, path: Path) -> None:
    """Per scan: true point minus reported point in micrometres (int16), and the view (uint8)."""
    arrays = {}
    for number, scan in enumerate(session.scans):
        error = (scan.true_points - scan.points.astype(float)) * 1e6
        arrays[f'true_minus_reported_um_{number}'] = np.round(error).astype(np.int16)
        arrays[f'view_{number}'] = scan.view
    np.savez_compressed(path, **arrays)


def _write_series(session: Session, path: Path) -> None:
    """Per sample: true force, displacement and gauge drift of the three fingers, object origin."""
    rows = session.stage.rows
    np.savez_compressed(
        path,
        stamp_ns=np.array(session.world.stamps, dtype=np.int64),
        force_n=np.array([row.force_n for row in rows]),
        displacement_outer_m=np.array([row.displacement_m for row in rows]),
        drift_counts=np.array([row.drift_counts for row in rows], dtype=np.float32),
        object_origin_m=np.array([row.origin for row in rows]),
    )


def readme(experiment: Experiment, session: Session) -> str:
    """The README of one recording."""
    truth = session.stage.setting.truth
    lines = [
        f'# {experiment.title}',
        '',
        f'**{LABEL}.**',
        '',
        experiment.story,
        '',
        f'{session.time_s:.1f} s, {round(1 / experiment.period_s)} hand cycles per second, '
        f'{len(session.scans)} scans of at most {experiment.scanner.most_points} points.',
        '',
    ]
    if session.windows:
        lines += [
            '| hold (s) | prescribed force (N) | true displacement, middle / outer face (mm) |',
            '|---|---|---|',
        ]
        for window in session.windows:
            force = window['prescribed_force_n']
            lines.append(
                f'| {window["from_s"]:.2f} - {window["to_s"]:.2f} | {force:.3f} | '
                f'{truth.middle_displacement(force) * 1e3:.3f} / '
                f'{truth.outer_displacement(force) * 1e3:.3f} |'
            )
        lines.append('')
    lines += [
        '| file | content |',
        '|---|---|',
        f'| `{experiment.name}_0.mcap`, `metadata.yaml` | the bag: hand topics, '
        '`object_pose`, `scan/points`, `/diagnostics` |',
        '| `experiment.yaml` | object, poses, hand, scanner, holds, scans: what a node may know |',
        '| `calibration.yaml` | gauge calibration of this emulated hand |',
        '| `truth.yaml` | seeds, true loads and poses, hidden pin and gauge traits, digest of the '
        'wire |',
        '| `truth_series.npz` | true force, displacement, drift, object origin at every sample |',
        '| `truth_scans.npz` | per scan: true minus reported point (micrometres), view of each '
        'point |',
        '',
        f'Shape truth: `../solid/{truth.file}`, a solid model by CalculiX that shares no code '
        'with the shell solver.',
        '',
        'How it was recorded: an emulated hand behind a pty, `hand_bridge` and `record` as '
        'processes of their own, in lockstep on simulated time; then the messages were put in the '
        'order of their stamps. Equal seeds give equal truth, wire bytes and messages, but for '
        '`/diagnostics`. `object_pose` is no sensor: it follows from the positions of the pins.',
        '',
        'The measured maximum displacement is hidden under the pin. Two ways to it are in the '
        'bag: extrapolate the radial profile of the dent in the scan to the contact axis, or take '
        'half of the loss of pin separation since first touch (`travel` of `hand/contacts`).',
        '',
        'What it is not:',
        '',
        *(f'- {caveat}' for caveat in experiment.caveats),
        '',
        f'Made by `python bags/generate.py {experiment.name}`.',
        '',
    ]
    return '\n'.join(lines)
