"""The statistics of a comparison as rows of words and numbers, for terminals and pages."""

from __future__ import annotations

from scan_compare.comparison import Comparison

Row = tuple[str, str, str]


def _millimetres(value: float | None) -> str:
    return '-' if value is None else f'{1e3 * value:.3f}'


def _percent(value: float | None) -> str:
    return '-' if value is None else f'{100.0 * value:.1f}'


def rows(comparison: Comparison) -> list[Row]:
    """Return (what, millimetres, % of the measured maximum displacement) for each statistic."""
    c = comparison
    largest = c.measured_max_displacement_m

    def row(what: str, value: float | None) -> Row:
        share = None if value is None or not largest else value / largest
        return what, _millimetres(value), _percent(share)

    area = c.area
    result = [
        row('mean error (unsigned, scan vertices)', c.vertex.mean_m),
        row('  standard deviation of that mean', c.mean_error_sigma_m),
        row('  without the scanner noise', c.mean_error_noise_free_m),
        row('rms error', c.vertex.rms_m),
        row('median error', c.vertex.median_m),
        row('95 % of errors below', c.vertex.p95_m),
        row(f'max error (mean over {1e3 * c.local.radius_m:.1f} mm discs)', c.max_error_m),
        row('max error (single point)', c.vertex.max_m),
        row('signed mean error', c.vertex.signed_mean_m),
        row('mean error, area-weighted', None if area is None else area.mean_m),
        row('rms error, area-weighted', None if area is None else area.rms_m),
        row('95 %, area-weighted', None if area is None else area.p95_m),
        row('mean error in the dent', None if c.dent is None else c.dent.mean_m),
        row('rms error in the dent', None if c.dent is None else c.dent.rms_m),
        row('mean error outside the dent', c.undeformed_residual_m),
        row('mean distance model to scan', c.model_to_scan.mean_m if c.model_to_scan else None),
        row('noise floor (stated scanner)', c.noise_floor_m),
        row('max displacement, model', c.surface.max_displacement),
        row('max displacement, measured', largest),
    ]
    return result


def coverage_rows(comparison: Comparison) -> list[tuple[str, str]]:
    """Return what share of patch, dent and contact neighbourhood the scan saw, in %."""
    seen = comparison.coverage
    return [
        ('patch seen', _percent(seen.patch)),
        ('dent seen', _percent(seen.dent)),
        ('within 5 mm of a contact seen', _percent(seen.contact)),
    ]


def text_table(comparison: Comparison) -> str:
    """Return the statistics as plain text for a terminal."""
    lines = [f'{"":42s} {"mm":>8s} {"% max":>7s}']
    lines += [f'{what:42s} {value:>8s} {share:>7s}' for what, value, share in rows(comparison)]
    lines += [f'{what:42s} {share:>16s}' for what, share in coverage_rows(comparison)]
    lines += [f'registration: {comparison.registration.text}']
    lines += [f'note: {note}' for note in comparison.notes]
    lines += [verdict(comparison)]
    return '\n'.join(lines)


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
