# SPDX-License-Identifier: Apache-2.0
"""shell_verify: every reference problem, ours beside the reference."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING

from grasp_common.command_line import parse
from grasp_common.options import add
from grasp_common.terminal import print_table, tracked
from shell_deform.commands.console import CommandError, print_json, run

if TYPE_CHECKING:
    from shell_deform.verification.problem import Verified

# The module of `verification` whose `problems()` a group is; a usage text imports none of them.
GROUPS = {
    'closed': 'closed_forms',
    'linear': 'linear_course',
    'sze': 'sze',
    'snap': 'snap',
    'spheres': 'spheres',
    'plates': 'plates',
    'friction': 'friction',
    'thick': 'thick',
    'turn': 'tubes',
}


def build_parser() -> argparse.ArgumentParser:
    """The command line of `shell_verify`."""
    parser = argparse.ArgumentParser(
        prog='shell_verify',
        description='Solve the published and independent reference problems and compare. '
        'Quantities are in the units of their sources; errors are relative and signed.',
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        '--group', choices=sorted(GROUPS), action='append', help='only these problems'
    )
    which.add_argument(
        '--solid',
        action='store_true',
        help='instead: spheres of R/h 6 to 100 against a 3-D solid, and the rule for thick walls',
    )
    which.add_argument(
        '--references',
        action='store_true',
        help='instead: every reference value, published or own, its source, and why it is scored '
        'or not; solves nothing',
    )
    which.add_argument(
        '--experiments',
        action='store_true',
        help='instead: measured tennis balls, table-tennis ball and eggs of other people, '
        'each with its source and how its modulus is known',
    )
    add(parser, '--plot', ', with --solid')
    parser.add_argument('--all-rows', action='store_true', help='every load, not only the worst')
    add(parser, '--json')
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = build_parser()
    options = parse('shell_deform', parser, arguments)
    if options.plot and not options.solid:
        parser.error('--plot goes with --solid')
    if options.experiments:
        return run('shell_verify', lambda: _experiments(options))
    if options.references:
        return run('shell_verify', lambda: _references(options))
    return run('shell_verify', lambda: _solid(options) if options.solid else _verify(options))


def _experiments(options: argparse.Namespace) -> None:
    from shell_deform.verification.experiments import EXPERIMENTS

    found = [row for group in tracked(EXPERIMENTS, 'experiments') for row in group()]
    if options.json:
        print_json({'experiments': [row.as_dict() for row in found]})
        return
    rows = [
        [
            row.name,
            row.quantity,
            '' if row.measured is None else ' to '.join(f'{m:g}' for m in sorted({*row.measured})),
            f'{row.ours:.4g}',
            row.verdict,
            row.young,
            row.source,
            row.remark,
        ]
        for row in found
    ]
    headings = (
        *('experiment', 'quantity', 'measured', 'ours', 'verdict', 'modulus'),
        *('source', 'remark'),
    )
    print_table(headings, rows, 'Experiments of other people')


def _references(options: argparse.Namespace) -> None:
    from shell_deform.verification.reference_table import reference_table

    table = reference_table()
    if options.json:
        print_json({'references': [row.as_dict() for row in table]})
        return
    told: tuple[str, ...] = ()
    rows = []
    for row in table:
        about = (row.problem, row.status, row.source, row.scored)
        new = about != told
        told = about
        rows.append(
            [
                row.problem if new else '',
                row.quantity,
                '' if row.value is None else f'{row.value:.6g}',
                row.status if new else '',
                row.source if new else '',
                '' if row.goal is None else f'{100 * row.goal:.2g} %',
                row.scored if new else '',
            ]
        )
    headings = ('problem', 'quantity', 'value', 'status', 'source', 'goal [%]', 'scored')
    print_table(headings, rows, 'Reference values; an empty cell is that above it')
    scored = [row for row in table if row.scored.startswith('yes')]
    published = sum(row.status == 'published' for row in table)
    print(
        f'{len(table)} references: {published} published, {len(table) - published} own (solved '
        f'here by another method or code); {len(scored)} scored, {len(table) - len(scored)} not'
    )


def _solid(options: argparse.Namespace) -> None:
    from shell_deform.commands import solid_check
    from shell_deform.verification import solid

    found = [solid.compare(ratio) for ratio in tracked(solid.ratios(), 'spheres')]
    results = [row for sphere in found for row in solid.verified(sphere)]
    if options.plot:
        solid_check.draw(options.plot, found)
    if options.json:
        print_json({'problems': [row.as_dict() for row in results], 'rule': solid_check.rule()})
    else:
        _print_table(results) if options.all_rows else solid_check.print_excess(found)
        print(solid_check.rule())
    _judge(results)


def _verify(options: argparse.Namespace) -> None:
    results: list[Verified] = []
    for group in tracked(options.group or list(GROUPS), 'reference problems'):
        module = import_module(f'shell_deform.verification.{GROUPS[group]}')
        results.extend(module.problems())
    if options.json:
        print_json({'problems': [result.as_dict() for result in results]})
    else:
        _print_table(results if options.all_rows else _worst(results))
    _judge(results)


def _judge(results: list[Verified]) -> None:
    missed = [result for result in results if not result.passed]
    if missed:
        worst = max(missed, key=lambda result: abs(result.error) / (result.goal or 1.0))
        raise CommandError(
            f'{len(missed)} of {len(results)} quantities miss their goal, the worst '
            f'{worst.name}, {worst.quantity}: {worst.value:.6g} against {worst.reference:.6g}'
        )
    print(f'{len(results)} quantities within their goals', file=sys.stderr)


def _worst(results: list[Verified]) -> list[Verified]:
    """Of every problem and quantity kind the row that comes closest to its goal, or misses it."""
    chosen: dict[tuple[str, str], Verified] = {}
    for result in results:
        key = (result.name, result.quantity.split(' at ')[0])
        if key not in chosen or abs(result.error) > abs(chosen[key].error):
            chosen[key] = result
    return list(chosen.values())


def _print_table(results: list[Verified]) -> None:
    rows = [
        [
            result.name,
            result.quantity,
            f'{result.value:.6g}',
            f'{result.reference:.6g}',
            f'{100 * result.error:+.3f} %{"" if result.passed else " !"}',
            '' if result.goal is None else f'{100 * result.goal:.2f} %',
            str(result.vertices),
            f'{result.cpu_seconds:.1f}',
            result.source,
        ]
        for result in results
    ]
    headings = (
        *('problem', 'quantity', 'ours', 'reference', 'error [%]', 'goal [%]'),
        *('vertices', 'CPU [s]', 'source'),
    )
    print_table(headings, rows, 'Reference problems: the largest error of each')
