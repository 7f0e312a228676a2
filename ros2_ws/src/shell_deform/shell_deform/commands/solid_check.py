# SPDX-License-Identifier: Apache-2.0
"""What `shell_verify --solid` shows: excess stiffness of thin shells as a table and a plot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grasp_common.terminal import print_table
from shell_deform.theory.thin_wall import excess_stiffness
from shell_deform.verification.solid import SolidSphere

MARKS = 'osD^vP*X'
RULE = (
    'rule: at small loads a thin shell is 1.5 h / (R + h) too stiff against a solid (middle '
    'radius R): {examples}; from R/h 12 on a quarter to a half of it is gone in a dent as deep as '
    'the wall is thick'
)


def rule() -> str:
    """The rule as a sentence with numbers."""
    examples = ', '.join(
        f'{100 * excess_stiffness(1 / ratio):.3g} % at R/h {ratio:g}'
        for ratio in (6, 12.5, 29, 100)
    )
    return RULE.format(examples=examples)


def print_excess(spheres: Sequence[SolidSphere]) -> None:
    """A table of the excess stiffness at some depths, beside the rule."""
    depths = (0.1, 0.5, 1.0, 2.4, 4.0)
    rows = []
    for sphere in spheres:
        reached = sphere.depth[-1]
        rows.append(
            [
                f'{sphere.radius_over_thickness:g}',
                f'{100 * sphere.excess[0]:+.1f} %',
                f'{100 * excess_stiffness(1 / sphere.radius_over_thickness):+.1f} %',
                *(
                    f'{100 * np.interp(depth, sphere.depth, sphere.excess):+.1f} %'
                    if depth <= 1.02 * reached
                    else '-'
                    for depth in depths
                ),
            ]
        )
    headings = ('R/h', 'small loads', 'rule', *(f'w/h {depth:g}' for depth in depths))
    print_table(headings, rows, 'Force of the thin shell over that of the solid at the same depth')


def draw(path: Path, spheres: Sequence[SolidSphere]) -> None:
    """Write the plot: the rule over R/h, and the excess over the depth of the dent."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.5), dpi=140)
    ratios = np.array([sphere.radius_over_thickness for sphere in spheres])
    curve = np.geomspace(ratios.min(), ratios.max(), 100)
    rule_values = [100 * excess_stiffness(1 / ratio) for ratio in curve]
    left.plot(curve, rule_values, 'k-', label='rule 1.5 h / (R + h)')
    first = [100 * sphere.excess[0] for sphere in spheres]
    left.plot(ratios, first, 'ko', mfc='white', label='shell against solid, small loads')
    left.set(xscale='log', yscale='log', xlabel='R / h', ylabel='excess stiffness (%)')
    left.set_xticks(ratios, [f'{ratio:g}' for ratio in ratios])
    left.minorticks_off()
    left.set_yticks([1, 2, 5, 10, 20], ['1', '2', '5', '10', '20'])
    left.grid(alpha=0.3)
    left.legend()
    shades = plt.get_cmap('cividis')(np.linspace(0.0, 0.85, len(spheres)))
    for sphere, mark, shade in zip(spheres, MARKS, shades, strict=False):
        label = f'R/h {sphere.radius_over_thickness:g}'
        right.plot(sphere.depth, 100 * sphere.excess, marker=mark, color=shade, label=label, ms=4)
    right.set(xlabel='depth of the dent w / h', ylabel='excess stiffness (%)', ylim=(0.0, None))
    right.grid(alpha=0.3)
    right.legend(fontsize='small')
    figure.tight_layout()
    figure.savefig(path, metadata={'Software': None})
    plt.close(figure)
