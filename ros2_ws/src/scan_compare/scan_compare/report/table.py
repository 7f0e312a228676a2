# SPDX-License-Identifier: Apache-2.0
"""The statistics of a comparison as rows of words and numbers, for terminals and pages."""

from __future__ import annotations

from scan_compare.comparison import Comparison
from scan_compare.statistics import Summary

Row = tuple[str, str, str, str, str, str, str]
"""What; of the whole scan, in the dent, outside it; their unit; whole and dent in % of the largest
measured displacement. A dash where there is no such number."""

HEADING: Row = (
    'statistic',
    'whole scan',
    'in the dent',
    'outside it',
    'unit',
    '% of max. displacement',
    'in the dent',
)
NONE = '-'


def rows(comparison: Comparison) -> list[Row]:
    """Return every statistic of a comparison, and what the scan saw, as rows of words."""
    c = comparison
    largest = c.measured_max_displacement_m

    def row(what: str, *values: float | None) -> Row:
        whole, dent, outside = (*values, None, None)[:3]
        lengths = [_shown(value, 1e3, 3) for value in (whole, dent, outside)]
        shares = [
            _shown(value / largest if largest and value is not None else None, 100.0, 1)
            for value in (whole, dent)
        ]
        return what, lengths[0], lengths[1], lengths[2], 'mm', shares[0], shares[1]

    vertex, area = (c.vertex, c.dent, c.outside), (c.area, c.dent_area, c.outside_area)

    def of(summaries: tuple[Summary | None, ...], name: str) -> list[float | None]:
        return [None if one is None else getattr(one, name) for one in summaries]

    result = [row('mean error (unsigned, scan vertices)', *of(vertex, 'mean_m'))]
    result += [
        row('  standard deviation of that mean', c.mean_error_sigma_m),
        row('  without the scanner noise', c.mean_error_noise_free_m),
        row('mean error, area-weighted', *of(area, 'mean_m')),
    ]
    for what, name in (
        ('rms error', 'rms_m'),
        ('median error', 'median_m'),
        ('95 % of errors below', 'p95_m'),
    ):
        result.append(row(what, *of(vertex, name)))
        result.append(row(f'{what}, area-weighted', *of(area, name)))
    result += [
        row(
            f'max error (mean over {1e3 * c.local.radius_m:.1f} mm discs)',
            *(c.max_error_m, c.dent_max_error_m, c.outside_max_error_m),
        ),
        row('max error (single point)', *of(vertex, 'max_m')),
        row('signed mean error', *of(vertex, 'signed_mean_m')),
        row('mean distance model to scan', c.model_to_scan.mean_m if c.model_to_scan else None),
        row('noise floor (stated scanner)', c.noise_floor_m),
        row('max displacement, model', c.surface.max_displacement),
        row('max displacement, measured', largest),
        row('  standard deviation of that depth', c.measured_max_displacement_sigma_m),
    ]
    counts = [NONE if one is None else str(one.count) for one in vertex]
    seen = [_shown(share, 100.0, 1) for share in (c.coverage.patch, c.coverage.dent)]
    near = _shown(c.coverage.contact, 100.0, 1)
    result += [
        ('scan points', counts[0], counts[1], counts[2], 'points', NONE, NONE),
        ('coverage: of the patch, of the dent', seen[0], seen[1], NONE, '%', NONE, NONE),
        ('coverage: within 5 mm of a contact', near, NONE, NONE, '%', NONE, NONE),
    ]
    return result


def _shown(value: float | None, factor: float, digits: int) -> str:
    return NONE if value is None else f'{factor * value:.{digits}f}'


def text_table(comparison: Comparison) -> str:
    """Return the statistics as plain text for a terminal."""
    lines = [_line(('', *HEADING[1:5], '% max', 'dent'))]
    lines += [_line(row) for row in rows(comparison)]
    lines += [f'registration: {comparison.registration.text}']
    lines += [f'note: {note}' for note in comparison.notes]
    lines += [verdict(comparison)]
    return '\n'.join(lines)


def _line(row: Row) -> str:
    what, *lengths, unit, share, dent_share = row
    columns = ''.join(f' {cell:>11s}' for cell in lengths)
    return f'{what:40s}{columns} {unit:6s} {share:>6s} {dent_share:>6s}'


def verdict(comparison: Comparison) -> str:
    """Say in one sentence whether the error stands out of the scanner's noise."""
    mean, floor = 1e3 * comparison.vertex.mean_m, 1e3 * comparison.noise_floor_m
    if comparison.beyond_noise:
        text = f'the mean error of {mean:.3f} mm exceeds the noise floor of {floor:.3f} mm'
        residual = comparison.undeformed_residual_m
        if comparison.dent is not None and residual is not None:
            text += (
                f' (in the dent {1e3 * comparison.dent.mean_m:.3f} mm, in the undeformed region '
                f'{1e3 * residual:.3f} mm)'
            )
        return text
    return (
        f'no verdict: the mean error of {mean:.3f} mm is what scanner noise alone produces '
        f'({floor:.3f} mm)'
    )
