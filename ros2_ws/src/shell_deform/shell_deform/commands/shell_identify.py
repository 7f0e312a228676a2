# SPDX-License-Identifier: Apache-2.0
"""shell_identify: modulus, pressure or thickness from a table, its scans, or a recorded grasp."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np

from grasp_common.command_line import parse
from grasp_common.terminal import in_picture, print_table, say, tracked
from shell_deform.building import with_material
from shell_deform.commands.console import CommandError, print_json, run
from shell_deform.commands.shell_identify_hold import relaxation_from
from shell_deform.commands.shell_identify_options import (
    DEFAULT_SIGMA_GAIN,
    RENAMED,
    build_parser,
)
from shell_deform.identify.dent_profile import DentScan, ThicknessFit, fit_thickness
from shell_deform.identify.force_curve import ForceCurve
from shell_deform.identify.modulus import (
    Identified,
    SqueezeData,
    cross_validate,
    identify,
    squeeze_data,
    thickness_sensitivity,
    with_thickness,
)
from shell_deform.identify.squeeze_table import read_table
from shell_deform.objects import load_object
from shell_deform.objects.file_mesh import read_points


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = parse('shell_deform', build_parser(), arguments, RENAMED)
    return run('shell_identify', lambda: _identify(options))


@dataclass(frozen=True)
class _Result:
    """All that is printed; `found` is at the thickness of `curve`, `told` with its posterior."""

    data: SqueezeData
    curve: ForceCurve
    found: Identified
    told: Identified
    held_out: tuple[Identified, np.ndarray] | None
    exponent: float
    thickness: ThicknessFit | None


def _identify(options: argparse.Namespace) -> None:
    if options.plot and not options.plot.resolve().parent.is_dir():
        raise CommandError(f'--plot {options.plot}: there is no such folder')
    if options.relaxation:
        relaxation_from(options)
        return
    data, scans = _read(options)
    result = _result(options, data, scans)
    if options.plot:
        _plot(options.plot, result)
    if options.json:
        print_json(_document(result))
        return
    _print(result)
    if scans and not options.fit_thickness:
        say(f'{options.data} names {len(scans)} scans: --fit-thickness uses them')


def _result(options: argparse.Namespace, data: SqueezeData, scans: list[DentScan]) -> _Result:
    described = with_material(load_object(options.object), poisson_ratio=options.poisson)
    curve = ForceCurve(described, options.pin_radius, options.theory)
    names = ['fit', 'cross-validation', 'thickness']
    steps = tracked(['dents', *names] if options.fit_thickness else names, 'identifying')
    next(steps)
    thickness = None
    if options.fit_thickness:
        deepest = int(np.argmax(data.displacement))
        young = curve.modulus(
            float(data.force[deepest]),
            float(data.displacement[deepest]),
            curve.shell_object.gas.gauge_pressure_pa,
        )
        thickness = fit_thickness(
            curve, scans, young, options.scanner_sigma, options.sigma_registration
        )
        curve = curve.with_thickness(thickness.thickness)
        next(steps)
    found = identify(curve, data, options.fit_pressure)
    next(steps)
    held_out = None
    if len(data.force) > 1 and not options.fit_pressure:
        held_out = cross_validate(curve, data, options.fit_rows or max(1, len(data.force) // 2))
    next(steps)
    exponent = thickness_sensitivity(curve, data)
    next(steps, None)
    told = with_thickness(found, thickness, exponent) if thickness else found
    return _Result(data, curve, found, told, held_out, exponent, thickness)


def _read(options: argparse.Namespace) -> tuple[SqueezeData, list[DentScan]]:
    path: Path = options.data
    if not path.exists():
        raise CommandError(f'{path} does not exist; give a CSV table or a bag')
    if path.is_dir() or path.suffix in ('.mcap', '.db3'):
        from shell_deform.identify.squeeze_bag import read_squeeze

        if options.fit_thickness:
            raise CommandError(
                f'{path}: --fit-thickness needs a table with a column `scan`; `scan_error --out` '
                'registers the scans of a bag to the object'
            )
        data = read_squeeze(path)
        gain = data.sigma_gain if options.sigma_gain is None else options.sigma_gain
        return replace(data, sigma_zero=options.sigma_zero, sigma_gain=gain), []
    table, files = read_table(path)
    if options.fit_thickness and not any(files):
        raise CommandError(
            f'{path}: --fit-thickness needs scans of the squeezed object; add a column `scan` '
            'with their files'
        )
    data = squeeze_data(
        table,
        options.sigma_force,
        options.sigma_displacement,
        options.sigma_zero,
        DEFAULT_SIGMA_GAIN if options.sigma_gain is None else options.sigma_gain,
    )
    scans = [
        DentScan(str(file), read_points(file, options.scan_unit), float(displacement))
        for file, displacement in zip(files, data.displacement, strict=True)
        if file is not None
    ]
    return data, scans


def _document(result: _Result) -> dict[str, object]:
    data, found, held_out = result.data, result.told, result.held_out
    parameters = {
        name: {
            'value': float(value),
            'sigma': float(sigma),
            'interval_90': list(found.interval(name)),
        }
        for name, value, sigma in zip(found.names, found.values, found.sigma, strict=True)
    }
    document: dict[str, object] = {
        'theory': result.curve.theory,
        'theory_reason': result.curve.theory_reason,
        'parameters': parameters,
        'solid_modulus_pa': {
            'value': found.solid_modulus,
            'sigma': found.solid_sigma,
            'interval_90': list(found.interval('solid_modulus_pa')),
        },
        'zero_force_n': found.zero_force,
        'correlation': found.correlation.tolist(),
        'reduced_chi_square': found.reduced_chi_square,
        'e_h_2_5_pa_m_2_5': found.stiffness_product,
        'thickness_exponent': result.exponent,
        'rows': [
            {'displacement_m': float(w), 'force_n': float(f), 'fitted_force_n': float(m)}
            for w, f, m in zip(data.displacement, data.force, found.fitted_force, strict=True)
        ],
        'statement': list(found.statement),
    }
    if result.thickness is not None:
        fit = result.thickness
        document['solid_thickness_m'] = {
            'value': fit.solid_thickness,
            'sigma': fit.solid_sigma,
            'interval_90': list(fit.solid_interval),
        }
        document['dents'] = {
            'depth_m': fit.depth.tolist(),
            'rms_m': fit.rms,
            'reduced_chi_square': fit.reduced_chi_square,
        }
    if held_out is not None:
        small, predicted = held_out
        document['cross_validation'] = {
            'young_modulus_pa': float(small.values[0]),
            'predicted_force_n': [float(value) for value in predicted],
        }
    return document


def _print(result: _Result) -> None:
    data, found, held_out = result.data, result.told, result.held_out
    rows = [
        [f'{1e3 * w:.3f}', f'{f:.3f}', f'{m:.3f}', f'{100 * (m / f - 1):+.1f} %']
        for w, f, m in zip(data.displacement, data.force, found.fitted_force, strict=True)
    ]
    headings = ('displacement [mm]', 'measured [N]', 'fitted [N]', 'difference')
    print_table(headings, rows, f'Measured and fitted, theory {result.curve.theory}')
    if result.curve.theory_reason:
        say(f'theory {result.curve.theory}: {result.curve.theory_reason}')
    for name, value in zip(found.names, found.values, strict=True):
        low, high = found.interval(name)
        say(f'{name}: {value:.5g}, 90 % interval {low:.5g} to {high:.5g}')
    if result.curve.excess_stiffness:
        low, high = found.interval('solid_modulus_pa')
        say(
            f'modulus of the material (solid_young_modulus_pa), if its wall is a solid: '
            f'{found.solid_modulus:.5g} Pa, '
            f'90 % interval {low:.5g} to {high:.5g}'
        )
    if result.thickness is not None:
        fit = result.thickness
        low, high = fit.solid_interval
        say(
            f'thickness of a solid wall: {fit.solid_thickness:.4g} m, 90 % interval {low:.4g} to '
            f'{high:.4g}'
        )
        say(
            f'dents {", ".join(f"{1e3 * depth:.2f}" for depth in fit.depth)} mm deep; rings '
            f'follow the model within {1e6 * fit.rms:.0f} um rms'
        )
    if found.zero_force:
        say(f'zero of the gauge {found.zero_force:+.3f} N')
    say(f'reduced chi-square {found.reduced_chi_square:.2f}')
    say(f'force grows as E h^{result.exponent:.2f} over these data')
    if held_out is not None:
        small, predicted = held_out
        order = np.argsort(data.displacement)[-len(predicted) :]
        error = predicted / data.force[order] - 1.0
        say(
            f'cross-validation: E {small.values[0]:.5g} Pa from the small loads predicts the '
            f'others within {100 * float(np.abs(error).max()):.1f} % of force'
        )
    for sentence in found.statement:
        say(sentence)


def _plot(path: Path, result: _Result) -> None:
    """Measured points, the fit and what the small loads alone predict, with 90 % bands."""
    data, curve, found, held_out = result.data, result.curve, result.found, result.held_out
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    depth = np.linspace(0.02, 1.1, 16) * data.displacement.max()
    young = float(found.values[0])
    own = curve.shell_object.gas.gauge_pressure_pa
    gauge = float(found.values[1]) if len(found.values) > 1 else own
    here = curve.force(depth, young, gauge)
    # Forces are linear in the modulus but for how the gas bends the shell.
    per_modulus = (curve.force(depth, 1.05 * young, gauge) - here) / (0.05 * young)
    figure, axes = plt.subplots(figsize=(6.5, 4.5), dpi=140)
    lines = [(found, 'fitted on all rows', '-', '#00457c')]
    if held_out is not None:
        lines.append((held_out[0], 'predicted from the small loads', '--', '#c05a00'))
    for fit, label, style, colour in lines:
        middle, low, high = (
            here + per_modulus * (value - young)
            for value in (float(fit.values[0]), *fit.interval('young_modulus_pa'))
        )
        axes.fill_between(
            1e3 * depth, low, high, alpha=0.25, color=colour, label=f'90 % band, {label}'
        )
        axes.plot(1e3 * depth, middle, style, color=colour, label=label)
    axes.errorbar(
        1e3 * data.displacement,
        data.force - found.zero_force,
        yerr=data.sigma_force,
        xerr=1e3 * data.sigma_displacement,
        fmt='ko',
        ms=4,
        capsize=2,
        label='measured' + (', zero of the gauge taken off' if found.zero_force else ''),
    )
    axes.set_xlabel('displacement of each contact [mm]')
    axes.set_ylabel('force of each contact [N]')
    axes.set_title(f'{in_picture(curve.shell_object.name)}: E = {young / 1e6:.4g} MPa')
    axes.grid(alpha=0.3)
    axes.legend(fontsize='small')
    figure.savefig(path, bbox_inches='tight', metadata={'Software': None})
    plt.close(figure)
