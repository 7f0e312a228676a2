# SPDX-License-Identifier: Apache-2.0
"""`results.json` and `table.csv`: fixed order, no times, no paths, the same bytes every time."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from grasp_replay.grasp_rows import grasp_document
from grasp_replay.pipeline import Outcome, Row
from grasp_replay.theories import THEORIES
from scan_compare.ranking import rank
from shell_deform.theory import THICK

NEWTON_PER_POUND_FORCE = 4.4482216152605
# Above this relative uncertainty of the force no theory is called the better one.
LARGEST_FORCE_UNCERTAINTY = 0.1

STATISTICS = (
    'mean_error_m',
    'rms_error_m',
    'median_error_m',
    'p95_error_m',
    'max_error_m',
    'raw_max_error_m',
    'signed_mean_error_m',
    'mean_error_sigma_m',
    'mean_error_noise_free_m',
    'dent_mean_error_m',
    'max_displacement_m',
    'mean_error_of_max_displacement',
    'beyond_noise',
    'points_used',
)
TABLE = (
    'mean_error_m',
    'rms_error_m',
    'p95_error_m',
    'max_error_m',
    'dent_mean_error_m',
    'max_displacement_m',
)


def document(outcome: Outcome, published: list[dict[str, Any]]) -> dict[str, Any]:
    """The document of `results.json`; `published` are rows of `published_predictions`."""
    shell, holds = outcome.shell.shell, dict(outcome.holds)
    return {
        'bag_sha256': outcome.bag_sha256,
        'experiment': outcome.experiment.name,
        'label': outcome.experiment.label,
        'synthetic': outcome.experiment.synthetic,
        'object': shell.name,
        'young_modulus_pa': shell.young_modulus_pa,
        'solid_young_modulus_pa': shell.modulus(THICK),
        'young_modulus_from': outcome.young_from,
        'poisson_ratio': shell.poisson_ratio,
        'thickness_m': shell.thickness_m,
        'gas': shell.gas.kind,
        'control_vertices': len(outcome.shell.model.rest),
        'face': 'outer face: middle surface + half the thickness along the deformed normal; of '
        'theory thick its own',
        'scanner_sigma_m': outcome.experiment.scanner_sigma,
        'samples': len(outcome.recording.samples),
        'rows': [
            {
                **row_document(row),
                **({'hold': holds[row.number].to_json()} if row.number in holds else {}),
                'grasp': grasp_document(outcome.shell, row, outcome.experiment),
            }
            for row in outcome.rows
        ],
        'published': published,
    }


def row_document(row: Row) -> dict[str, Any]:
    """One row: load, measured displacement, registration, and the statistics of each theory."""
    reference = row.reference.to_json()
    contacts, felt = row.contacts, row.contacts.felt
    return {
        'row': row.number,
        'published_row': row.hold.entry.published_row,
        'force_n': row.force,
        'contacts': [
            {
                'finger': int(contacts.finger[k]),
                'force_n': float(contacts.push[k] if felt is None else felt[k]),
                **({} if felt is None else {'elastic_force_n': float(contacts.push[k])}),
                'force_sigma_n': float(contacts.sigma[k]),
                'radius_m': float(contacts.radius[k]),
                'at_rest_m': row.patches[k].point.tolist(),
                'travel_m': _number(contacts.travel[k]),
            }
            for k in range(len(contacts.finger))
        ],
        'samples_averaged': contacts.samples,
        'saturated': contacts.saturated,
        'measured_max_displacement_m': reference['measured_max_displacement_m'],
        'measured_max_displacement_sigma_m': reference['measured_max_displacement_sigma_m'],
        'measured_from': 'dent profile of the scan, extrapolated under the pin (outer face)',
        'measured_by_pins_m': _number(float(np.mean(contacts.travel))),
        'profiles': [
            {
                key: profile[key]
                for key in (
                    'max_displacement_m',
                    'max_displacement_sigma_m',
                    'extrapolated',
                    'hidden_radius_m',
                    'deepest_seen_m',
                    'reference',
                    'method',
                    'bent_apex_m',
                )
            }
            for profile in reference['profiles']  # type: ignore[attr-defined]
        ],  # fmt: skip
        'noise_floor_m': reference['noise_floor_m'],
        'undeformed_residual_m': reference['undeformed_residual_m'],
        'coverage': reference['coverage'],
        'registration': reference['registration'],
        'registered_by': row.registered_by,
        'verdict': verdict(row),
        'theories': {name: _theory(row, name) for name in THEORIES},
        'notes': reference['notes'],
    }


def _theory(row: Row, name: str) -> dict[str, Any]:
    comparison, solved = row.compared[name], row.solved[name]
    state = solved.state
    if comparison is None or state is None:
        return {
            **dict.fromkeys(STATISTICS),
            'carried': 0.0 if state is None else state.load_fraction,
            'message': solved.message,
        }
    found = comparison.to_json()
    return {
        **{key: found[key] for key in STATISTICS},
        'contact_displacement_m': [float(value) for value in state.displacement],
        'energy_j': state.energy,
        'gas_pressure_pa': state.gas_pressure,
        'unbalanced_force_n': float(np.linalg.norm(state.unbalance[:3])),
        'iterations': state.iterations,
        'carried': 1.0,
        'message': '',
    }


def verdict(row: Row) -> str:
    """Whether the scan tells koiter and linear theory apart, in a sentence."""
    koiter, linear = row.compared['koiter'], row.compared['linear']
    if koiter is None or linear is None:
        return 'no verdict: one of the theories does not carry the load'
    uncertainty = _force_uncertainty(row)
    if uncertainty > LARGEST_FORCE_UNCERTAINTY:
        return (
            f'no verdict: the force is known to {100 * uncertainty:.0f} % only, which moves the '
            'answer more than the theory does'
        )
    return rank(koiter, linear, ('koiter', 'linear')).text


def _force_uncertainty(row: Row) -> float:
    return float(np.sqrt(np.mean(row.contacts.sigma**2)) / max(abs(row.force), 1e-9))


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def table_lines(results: dict[str, Any]) -> list[list[str]]:
    """The table for people: a heading, then one line per row and theory, lengths in mm."""
    lines = [
        ['force N', 'force lbf', 'measured mm', '+-', 'pins mm', 'theory', 'mean', 'RMS', 'p95',
         'max', 'dent mean', 'max disp.', 'noise floor']
    ]  # fmt: skip
    for row in results['rows']:
        for theory in THEORIES:
            numbers = row['theories'][theory]
            lines.append(
                [
                    f'{row["force_n"]:.3f}',
                    f'{row["force_n"] / NEWTON_PER_POUND_FORCE:.2f}',
                    millimetres(row['measured_max_displacement_m']),
                    millimetres(row['measured_max_displacement_sigma_m']),
                    millimetres(row['measured_by_pins_m']),
                    theory,
                    *(millimetres(numbers[key]) for key in TABLE),
                    millimetres(row['noise_floor_m']),
                ]
            )
    return lines


def published_lines(results: dict[str, Any]) -> list[list[str]]:
    """The published rows and our predictions for their forces, lengths in mm."""
    rows = results['published']
    own = linear_own_modulus(rows)
    predicted = [models_of(row, own) for row in rows]
    models = list(dict.fromkeys(model for row in predicted for model in row))
    return [
        ['force N', 'published', *models],
        *(
            [
                f'{row["force_n"]:.3f}',
                millimetres(row['measured_max_displacement_m']),
                *(millimetres(found.get(model)) for model in models),
            ]
            for row, found in zip(rows, predicted, strict=True)
        ),
    ]


def linear_own_modulus(published: list[dict[str, Any]]) -> float | None:
    """The modulus [Pa] with which linear theory has the published displacement of the first row.

    Its displacements go with the inverse of its modulus.
    """
    if not published or published[0]['predicted_max_displacement_m'].get('linear') is None:
        return None
    first = min(published, key=lambda row: row['force_n'])
    predicted = first['predicted_max_displacement_m']['linear']
    measured = first['measured_max_displacement_m']
    return float(first['young_modulus_pa'] * predicted / measured) if measured else None


def models_of(row: dict[str, Any], linear_own_pa: float | None) -> dict[str, float]:
    """Displacements [m] that each model predicts for a published force; a model names its E."""
    young = float(row['young_modulus_pa'])
    moduli = {THICK: float(row.get('solid_young_modulus_pa', young))}
    found = {
        f'{theory}, E {moduli.get(theory, young) / 1e6:.2f} MPa': value
        for theory, value in row['predicted_max_displacement_m'].items()
        if value is not None
    }
    linear = row['predicted_max_displacement_m'].get('linear')
    if linear is not None and linear_own_pa is not None:
        own = f'linear with its own E {linear_own_pa / 1e6:.2f} MPa, from row 1'
        found[own] = linear * young / linear_own_pa
    return found


def aligned(lines: list[list[str]]) -> str:
    """Cells under each other, right-aligned."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return '\n'.join(
        '  '.join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in lines
    )


def millimetres(value: float | None) -> str:
    """A length in mm with three decimals, a dash for None."""
    return '-' if value is None else f'{1e3 * value:.3f}'


def json_text(results: dict[str, Any]) -> str:
    """The bytes of `results.json`; refuses numbers that are not finite."""
    return json.dumps(results, indent=1, allow_nan=False) + '\n'


def csv_text(results: dict[str, Any]) -> str:
    """The bytes of `table.csv`, SI units."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(
        ['row', 'force_n', 'measured_max_displacement_m', 'measured_max_displacement_sigma_m',
         'measured_by_pins_m', 'noise_floor_m', 'theory', *TABLE]
    )  # fmt: skip
    for row in results['rows']:
        for theory in THEORIES:
            numbers = row['theories'][theory]
            writer.writerow(
                [row['row'], row['force_n'], row['measured_max_displacement_m'],
                 row['measured_max_displacement_sigma_m'], row['measured_by_pins_m'],
                 row['noise_floor_m'], theory]
                + [numbers[key] for key in TABLE]
            )  # fmt: skip
    return stream.getvalue()


def write_file(path: Path, text: str) -> None:
    """Write a file so that it is there as a whole or not at all."""
    temporary = path.with_name(f'.{path.name}.part')
    temporary.write_text(text, encoding='utf-8')
    os.replace(temporary, path)
