"""shell_identify: modulus and pressure from force-displacement data or a recorded grasp."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from rich.console import Console
from rich.table import Table

from shell_deform.commands.console import CommandError, print_json, progress, run
from shell_deform.identify import (
    ForceCurve,
    Identified,
    SqueezeData,
    cross_validate,
    identify,
    squeeze_data,
    thickness_sensitivity,
)
from shell_deform.objects import load_object

# One count of the 8-bit gauge at 50 mm, as a standard deviation; a twentieth of a millimetre.
DEFAULT_SIGMA_FORCE_N = 0.06
DEFAULT_SIGMA_DISPLACEMENT_M = 5e-5


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(arguments)
    return run('shell_identify', lambda: _identify(options))


def _identify(options: argparse.Namespace) -> None:
    data = _read(options)
    shell_object = load_object(options.object)
    curve = ForceCurve(shell_object, options.pin_radius)
    steps = progress(['fit', 'cross-validation', 'thickness'], 'identifying')
    next(steps)
    found = identify(curve, data, options.pressure)
    next(steps)
    held_out = None
    if len(data.force) > 1 and not options.pressure:
        held_out = cross_validate(curve, data, options.fit_rows or max(1, len(data.force) // 2))
    next(steps)
    exponent = thickness_sensitivity(shell_object, data)
    next(steps, None)
    if options.plot:
        _plot(options.plot, curve, data, found)
    if options.json:
        print_json(_document(data, found, held_out, exponent))
        return
    _print(data, found, held_out, exponent)


def _read(options: argparse.Namespace) -> SqueezeData:
    path: Path = options.data
    if not path.exists():
        raise CommandError(f'{path} does not exist; give a CSV table or a bag')
    if path.is_dir() or path.suffix in ('.mcap', '.db3'):
        from shell_deform.squeeze_bag import read_squeeze

        return read_squeeze(path)
    try:
        table = np.genfromtxt(path, delimiter=',', comments='#', ndmin=2)
        if np.isnan(table[0]).any():
            table = table[1:]
    except ValueError as error:
        raise CommandError(f'{path}: {str(error).splitlines()[0]}') from error
    return squeeze_data(table, options.sigma_force, options.sigma_displacement)


def _document(
    data: SqueezeData,
    found: Identified,
    held_out: tuple[Identified, np.ndarray] | None,
    exponent: float,
) -> dict[str, object]:
    parameters = {
        name: {
            'value': float(value),
            'sigma': float(sigma),
            'interval_90': list(found.interval(name)),
        }
        for name, value, sigma in zip(found.names, found.values, found.sigma, strict=True)
    }
    document: dict[str, object] = {
        'parameters': parameters,
        'correlation': found.correlation.tolist(),
        'reduced_chi_square': found.reduced_chi_square,
        'e_h_2_5_pa_m_2_5': found.stiffness_product,
        'thickness_exponent': exponent,
        'rows': [
            {'displacement_m': float(w), 'force_n': float(f), 'fitted_force_n': float(m)}
            for w, f, m in zip(data.displacement, data.force, found.fitted_force, strict=True)
        ],
        'statement': list(found.statement),
    }
    if held_out is not None:
        small, predicted = held_out
        document['cross_validation'] = {
            'young_modulus_pa': float(small.values[0]),
            'predicted_force_n': [float(value) for value in predicted],
        }
    return document


def _print(
    data: SqueezeData,
    found: Identified,
    held_out: tuple[Identified, np.ndarray] | None,
    exponent: float,
) -> None:
    console = Console()
    table = Table(title='Measured and fitted')
    for heading in ('displacement [mm]', 'measured [N]', 'fitted [N]', 'difference'):
        table.add_column(heading, justify='right')
    for w, f, m in zip(data.displacement, data.force, found.fitted_force, strict=True):
        table.add_row(f'{1e3 * w:.3f}', f'{f:.3f}', f'{m:.3f}', f'{100 * (m / f - 1):+.1f} %')
    console.print(table)
    for name, value in zip(found.names, found.values, strict=True):
        low, high = found.interval(name)
        console.print(f'{name}: {value:.5g}, 90 % interval {low:.5g} to {high:.5g}')
    console.print(f'reduced chi-square {found.reduced_chi_square:.2f}')
    console.print(f'force grows as E h^{exponent:.2f} over these data')
    if held_out is not None:
        small, predicted = held_out
        order = np.argsort(data.displacement)[-len(predicted) :]
        error = predicted / data.force[order] - 1.0
        console.print(
            f'cross-validation: E {small.values[0]:.5g} Pa from the small loads predicts the '
            f'others within {100 * float(np.abs(error).max()):.1f} % of force'
        )
    for sentence in found.statement:
        console.print(sentence)


def _plot(path: Path, curve: ForceCurve, data: SqueezeData, found: Identified) -> None:
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    depth = np.linspace(0.02, 1.1, 24) * data.displacement.max()
    young = float(found.values[0])
    gauge = float(found.values[1]) if len(found.values) > 1 else 0.0
    low, high = found.interval('young_modulus_pa')
    figure, axes = plt.subplots(figsize=(6.5, 4.5), dpi=140)
    axes.fill_between(
        1e3 * depth,
        curve.force(depth, max(low, 1e-3 * young), gauge),
        curve.force(depth, high, gauge),
        alpha=0.3,
        label='90 % band of the modulus',
    )
    axes.plot(1e3 * depth, curve.force(depth, young, gauge), label='nonlinear model')
    axes.errorbar(
        1e3 * data.displacement,
        data.force,
        yerr=data.sigma_force,
        xerr=1e3 * data.sigma_displacement,
        fmt='o',
        capsize=2,
        label='measured',
    )
    axes.set_xlabel('displacement of each contact [mm]')
    axes.set_ylabel('force of each contact [N]')
    axes.set_title(f'{curve.shell_object.name}: E = {young / 1e6:.4g} MPa')
    axes.legend()
    figure.savefig(path, bbox_inches='tight')
    plt.close(figure)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='shell_identify',
        description='Identify the stiffness of a shell from how it was squeezed. SI units.',
    )
    parser.add_argument(
        'data',
        type=Path,
        help='CSV with force_n, displacement_m [, sigma_force_n, sigma_displacement_m] per '
        'contact, or a bag with hand/contacts that carry travel',
    )
    parser.add_argument('--object', required=True, help='name or object file; see shell_objects')
    parser.add_argument('--pin-radius', type=float, metavar='M', help='contact radius [m]')
    parser.add_argument(
        '--pressure', action='store_true', help='identify the gauge pressure [Pa] too'
    )
    parser.add_argument(
        '--fit-rows', type=int, metavar='N', help='smallest loads to cross-validate from'
    )
    parser.add_argument(
        '--sigma-force', type=float, default=DEFAULT_SIGMA_FORCE_N, metavar='N',
        help='gauge uncertainty [N] where the table has none (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--sigma-displacement', type=float, default=DEFAULT_SIGMA_DISPLACEMENT_M, metavar='M',
        help='displacement uncertainty [m] where the table has none (default %(default)s)',
    )  # fmt: skip
    parser.add_argument('--plot', type=Path, metavar='FILE', help='curves with bands (PNG)')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    return parser
