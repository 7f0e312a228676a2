# SPDX-License-Identifier: Apache-2.0
"""shell_identify --relaxation: how the wall of a held object relaxes, from a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np

from grasp_common.terminal import print_table, progress_bar, say
from shell_deform.commands.console import CommandError, print_json
from shell_deform.identify.relaxation import (
    COUNT_N,
    NINETY,
    HeldPushes,
    RelaxationFit,
    fit_relaxation,
)
from shell_deform.objects import load_object

READ = 20
"""Samples at the end of a hold that are read together."""


def relaxation_from(options: argparse.Namespace) -> None:
    """Read the bag, fit the law, print it. Raises CommandError or IdentificationError."""
    path = options.data
    if not (path.is_dir() or path.suffix in ('.mcap', '.db3')):
        raise CommandError(
            f'{path}: --relaxation needs a bag with hand/contacts that carry travel'
        )
    if not path.exists():
        raise CommandError(f'{path} does not exist; give a bag')
    from shell_deform.identify.squeeze_bag import read_pushes

    load_object(options.object)
    with progress_bar('relaxation'):
        time, push, travel = read_pushes(path)
        # What a gauge says of itself covers its gain and zero, too: noise is what changes at once.
        noise = float(np.sqrt(0.5 * np.nanmedian(np.diff(push, axis=0) ** 2)))
        data = HeldPushes(time, push, travel, noise, COUNT_N, options.sigma_drift)
        fit = fit_relaxation(data, options.until or np.inf)
        predictions = _predictions(data, fit) if options.until else []
    if options.plot:
        _plot(options.plot, data, fit, options.until)
    low, high = fit.interval
    law = fit.law
    if options.json:
        print_json(
            {
                'relaxation': {
                    'kind': 'log', 'share_per_decade': law.per_decade, 'from_s': law.first,
                    'to_s': law.last, 'reference_s': law.reference, 'sigma_per_decade': law.sigma,
                },
                'interval_90': [low, high],
                'levels': [
                    {'began_s': one.began, 'first_s': one.first, 'last_s': one.last,
                     'force_n': float(force)}
                    for one, force in zip(fit.levels, fit.force, strict=True)
                ],
                'separable': fit.separable,
                'sigma_with_free_drift': fit.sigma_free,
                'reduced_chi_square': fit.reduced_chi_square,
                'predicted': predictions,
                'statement': list(fit.statement),
            }
        )  # fmt: skip
        return
    say(
        f'relaxation: {{kind: log, share_per_decade: {law.per_decade:.4g}, from_s: '
        f'{law.first:.3g}, to_s: {law.last:.4g}, sigma_per_decade: {law.sigma:.2g}}}'
    )
    say(f'90 % interval of the share {low:.4g} to {high:.4g}')
    say(f'reduced chi-square {fit.reduced_chi_square:.2f}')
    if predictions:
        print_table(
            ('finger', 'time [s]', 'predicted [N]', 'sigma [N]', 'read [N]'),
            [
                [str(p['finger']), f'{p["time_s"]:.1f}', f'{p["force_n"]:.3f}',
                 f'{p["sigma_n"]:.3f}', f'{p["read_n"]:.3f}']
                for p in predictions
            ],
            'Later pushes',
        )  # fmt: skip
    for sentence in fit.statement:
        say(sentence)


def _predictions(data: HeldPushes, fit: RelaxationFit) -> list[dict[str, float]]:
    """The last push of every finger beside what the earlier ones predict.

    Sigma is of what is read there: the gauge's zero walks on until then.
    """
    rows = []
    noise = np.hypot(data.noise, data.quantum / np.sqrt(12.0)) / np.sqrt(READ)
    for finger in range(data.push.shape[1]):
        known = np.flatnonzero(np.isfinite(data.push[:, finger]))
        known = known[data.time[known] <= fit.levels[-1].last]
        time = float(data.time[known[-1]])
        force, sigma = fit.reading_at(time, finger)
        read = float(data.push[known[-READ:], finger].mean())
        rows.append(
            {'finger': finger + 1, 'time_s': time, 'force_n': force,
             'sigma_n': float(np.hypot(sigma, noise)), 'read_n': read}
        )  # fmt: skip
    return rows


def _plot(path: Path, data: HeldPushes, fit: RelaxationFit, until: float | None) -> None:
    """Pushes over the logarithm of time, the law and its 90 % band; dashed where predicted."""
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    began, end = fit.levels[0].began, fit.levels[-1].last
    times = began + np.geomspace(fit.law.reference, end - began, 60)
    figure, axes = plt.subplots(figsize=(6.5, 4.5), dpi=140)
    for finger, colour in zip(
        range(data.push.shape[1]), ('#00457c', '#c05a00', '#4a7c00'), strict=False
    ):
        held = (data.time >= times[0]) & (data.time <= end)
        axes.plot(data.time[held] - began, data.push[held, finger], '.', ms=1.5, color=colour)
        force, sigma = np.array([fit.reading_at(time, finger) for time in times]).T
        axes.plot(times - began, force, color=colour, label=f'finger {finger + 1}')
        band = NINETY * sigma
        axes.fill_between(times - began, force - band, force + band, alpha=0.25, color=colour)
    if until is not None:
        axes.axvline(until - began, color='k', ls='--', label='known until here')
    axes.set_xscale('log')
    axes.set_xlabel('time since the step [s]')
    axes.set_ylabel('push [N]')
    axes.set_title('Pushes at standing travel, the law and its 90 % band')
    axes.grid(alpha=0.3)
    axes.legend(fontsize='small')
    figure.savefig(path, bbox_inches='tight', metadata={'Software': None})
    plt.close(figure)
