"""shell_identify: modulus and pressure from force-displacement data or a recorded grasp."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from rich.console import Console
from rich.table import Table

from shell_deform.commands.console import CommandError, print_json, progress, run
from shell_deform.force_curve import ForceCurve
from shell_deform.identify import (
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
# A zero that drifts by half a count during a grasp; a calibration with known weights.
DEFAULT_SIGMA_ZERO_N = 0.1
DEFAULT_SIGMA_GAIN = 0.01


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = _parser().parse_args(arguments)
    return run('shell_identify', lambda: _identify(options))


def _identify(options: argparse.Namespace) -> None:
    if options.plot and not options.plot.resolve().parent.is_dir():
        raise CommandError(f'--plot {options.plot}: there is no such folder')
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
        _plot(options.plot, curve, data, found, held_out)
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

        data = read_squeeze(path)
        gain = data.sigma_gain if options.sigma_gain is None else options.sigma_gain
        return replace(data, sigma_zero=options.sigma_zero, sigma_gain=gain)
    table = _table(path)
    return squeeze_data(
        table,
        options.sigma_force,
        options.sigma_displacement,
        options.sigma_zero,
        DEFAULT_SIGMA_GAIN if options.sigma_gain is None else options.sigma_gain,
    )


def _table(path: Path) -> np.ndarray:
    """(n, c) numbers of a CSV file; a first line of headings is left out."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)
            table = np.genfromtxt(path, delimiter=',', comments='#', ndmin=2)
    except UnicodeDecodeError as error:
        raise CommandError(f'{path}: no text; give a CSV table or a bag') from error
    except ValueError as error:
        lines = ' '.join(str(error).split())
        raise CommandError(f'{path}: rows differ in their number of columns: {lines}') from error
    if len(table) and np.isnan(table[0]).all():
        table = table[1:]
    if table.size == 0:
        raise CommandError(f'{path}: holds no numbers; give lines of force_n, displacement_m')
    return np.asarray(table)


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
        'solid_modulus_pa': {
            'value': found.solid_modulus,
            'sigma': found.solid_sigma,
            'interval_90': list(found.interval('solid_modulus_pa')),
        },
        'zero_force_n': found.zero_force,
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
    low, high = found.interval('solid_modulus_pa')
    console.print(
        f'modulus of the material, if its wall is a solid: {found.solid_modulus:.5g} Pa, '
        f'90 % interval {low:.5g} to {high:.5g}'
    )
    if found.zero_force:
        console.print(f'zero of the gauge {found.zero_force:+.3f} N')
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


def _plot(
    path: Path,
    curve: ForceCurve,
    data: SqueezeData,
    found: Identified,
    held_out: tuple[Identified, np.ndarray] | None,
) -> None:
    """Measured points, the fit and what the small loads alone predict, with 90 % bands."""
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
    axes.set_title(f'{curve.shell_object.name}: E = {young / 1e6:.4g} MPa')
    axes.grid(alpha=0.3)
    axes.legend(fontsize='small')
    figure.savefig(path, bbox_inches='tight', metadata={'Software': None})
    plt.close(figure)


def _above_zero(text: str) -> float:
    value = float(text)
    if not 0.0 < value < np.inf:
        raise argparse.ArgumentTypeError(f'{text} is not above zero')
    return value


def _not_negative(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < np.inf:
        raise argparse.ArgumentTypeError(f'{text} is negative')
    return value


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
    parser.add_argument('--pin-radius', type=_above_zero, metavar='M', help='contact radius [m]')
    parser.add_argument(
        '--pressure', action='store_true', help='identify the gauge pressure [Pa] too'
    )
    parser.add_argument(
        '--fit-rows', type=int, metavar='N', help='smallest loads to cross-validate from'
    )
    parser.add_argument(
        '--sigma-force', type=_above_zero, default=DEFAULT_SIGMA_FORCE_N, metavar='N',
        help='gauge uncertainty [N] where the table has none (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--sigma-displacement', type=_above_zero, default=DEFAULT_SIGMA_DISPLACEMENT_M,
        metavar='M',
        help='displacement uncertainty [m] where the table has none (default %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--sigma-zero', type=_not_negative, default=DEFAULT_SIGMA_ZERO_N, metavar='N',
        help="zero of the gauge, the same error in all rows [N] (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        '--sigma-gain', type=_not_negative, metavar='SHARE',
        help="relative uncertainty of the gauge's gain [-] (default: "
        f'{DEFAULT_SIGMA_GAIN} for a table, what its sigma_n says for a bag)',
    )  # fmt: skip
    parser.add_argument('--plot', type=Path, metavar='FILE', help='curves with bands (PNG)')
    parser.add_argument('--json', action='store_true', help='one JSON document on stdout')
    return parser
