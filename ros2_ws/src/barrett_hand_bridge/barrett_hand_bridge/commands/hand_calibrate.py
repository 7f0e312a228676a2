# SPDX-License-Identifier: Apache-2.0
"""Fit a calibration file to known weights hung on the fingers."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from barrett_hand_bridge.calibration import (
    NO_GAUGE,
    CalibrationError,
    HandCalibration,
    write_calibration,
)
from barrett_hand_bridge.hand import FINGERS
from barrett_hand_bridge.options import add_hand
from grasp_common.command_line import parse
from grasp_common.options import add
from grasp_common.terminal import complain

if TYPE_CHECKING:
    from barrett_hand_bridge.fit import GaugeFit


RENAMED = {'--out': '--calibration'}
"""What the other commands write is a folder; the node's parameter has this name."""


def build_parser() -> argparse.ArgumentParser:
    """The command line."""
    command = argparse.ArgumentParser(prog='hand_calibrate', description=__doc__)
    command.add_argument(
        'table',
        type=Path,
        help='CSV with the header finger,mass_kg,arm_m,counts,noise_counts: masses in kg hung at '
        'a horizontal arm in m from the outer joint, mean and standard deviation in counts',
    )
    command.add_argument(
        '--calibration', type=Path, metavar='FILE', required=True, help='file to write (YAML)'
    )
    command.add_argument(
        '--serial-number', default='', metavar='NUMBER', help='of the hand (PGET SN)'
    )
    add_hand(command)
    command.add_argument('--kind', choices=('cubic', 'table'), default='cubic', help='law to fit')
    command.add_argument('--degree', type=int, choices=(1, 2, 3), default=3, help='of the law')
    command.add_argument(
        '--zero',
        choices=('difference', 'shift'),
        default='difference',
        help='how a tared zero enters: f(x)-f(x0), or f shifted along the counts',
    )
    add(command, '--plot', ' of fit and residuals')
    add(command, '--json')
    return command


def main(arguments: Sequence[str] | None = None) -> int:
    """Fit and write; returns the exit code."""
    options = parse('barrett_hand_bridge', build_parser(), arguments, RENAMED)
    from barrett_hand_bridge.fit import fit_hand, read_weighings  # not for a usage text: scipy

    try:
        fits = fit_hand(
            read_weighings(options.table),
            kind=options.kind,
            degree=options.degree,
            zero=options.zero,
            highest_count=255 if options.hand == '262' else 4095,
        )
        if options.plot is not None:
            _plot(fits, options.plot)
        gauges = {f: fits[f].gauge if f in fits else NO_GAUGE for f in FINGERS}
        write_calibration(
            HandCalibration(f'BH8-{options.hand}', options.serial_number, gauges),
            options.calibration,
        )
    except (CalibrationError, OSError) as error:
        complain('hand_calibrate', error)
        return 1
    if options.json:
        print(json.dumps(_document(fits, options.calibration)))
    else:
        _print(fits, options.calibration)
    return 0


def _document(fits: Mapping[int, GaugeFit], out: Path) -> dict[str, object]:
    return {
        'calibration': str(out),
        'fingers': {
            str(finger): {
                'counts': [w.counts for w in fit.weighings],
                'torque_nm': [w.torque_nm for w in fit.weighings],
                'residual_nm': list(fit.residuals_nm),
                'scatter_nm': fit.gauge.residual_nm,
                'relative_sigma': fit.gauge.relative_sigma,
                'zero_counts': fit.gauge.reference_counts,
                'valid_torque_nm': fit.gauge.valid_torque_nm,
                'one_way': fit.one_way,
            }
            for finger, fit in fits.items()
        },
    }


def _print(fits: Mapping[int, GaugeFit], out: Path) -> None:
    for finger, fit in fits.items():
        gauge = fit.gauge
        reference = gauge.reference_counts
        print(
            f'finger {finger}: zero {reference:.2f} counts, '
            f'{1e3 * gauge.slope(reference, reference):.3f} mN m per count there, scatter '
            f'{1e3 * gauge.residual_nm:.2f} mN m, valid to {gauge.valid_torque_nm:.3f} N m'
        )
        print('    torque N m   counts   residual mN m')
        for weighing, residual in zip(fit.weighings, fit.residuals_nm, strict=True):
            print(f'    {weighing.torque_nm:10.4f} {weighing.counts:8.2f} {1e3 * residual:15.2f}')
    one_way = ', '.join(str(finger) for finger, fit in fits.items() if fit.one_way)
    if one_way:
        print(
            f'finger {one_way}: the weights were hung in one direction only, so what the gauge '
            'keeps of its last load (hysteresis) is not in the scatter; hang them up and down'
        )
    print(f'written: {out}')


def _plot(fits: Mapping[int, GaugeFit], path: Path) -> None:
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot

    figure, (law, rest) = pyplot.subplots(2, 1, sharex=True, figsize=(7, 7), height_ratios=(2, 1))
    for finger, fit in fits.items():
        counts = [w.counts for w in fit.weighings]
        low, high = min(counts), max(counts)
        line = [low + (high - low) * i / 200 for i in range(201)]
        drawn = law.plot(line, [fit.gauge.law(x) for x in line], label=f'finger {finger}')
        colour = drawn[0].get_color()
        law.plot(counts, [w.torque_nm for w in fit.weighings], 'o', color=colour, markersize=4)
        rest.plot(counts, [1e3 * r for r in fit.residuals_nm], 'o-', color=colour, markersize=4)
    law.set_ylabel('torque about joint 3 (N m)')
    law.legend()
    rest.set_ylabel('fit minus weight (mN m)')
    rest.set_xlabel('gauge reading (counts)')
    rest.axhline(0.0, color='0.7')
    figure.tight_layout()
    try:
        figure.savefig(path, dpi=120)
    except ValueError as error:
        raise CalibrationError(f'picture {path}: {error}') from error
    finally:
        pyplot.close(figure)


if __name__ == '__main__':
    sys.exit(main())
