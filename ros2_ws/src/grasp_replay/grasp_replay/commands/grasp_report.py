# SPDX-License-Identifier: Apache-2.0
"""`grasp_report`: a recorded grasp through the whole pipeline, offline."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp_common.command_line import parse
from grasp_common.options import add
from grasp_common.terminal import complain, progress_bar, say
from grasp_replay.errors import BagError

if TYPE_CHECKING:
    from grasp_replay.campaign import CampaignResult


def build_parser() -> argparse.ArgumentParser:
    """The command line of `grasp_report`."""
    parser = argparse.ArgumentParser(
        prog='grasp_report',
        description='Solve the loads of a recorded grasp by every theory (linear, paper, koiter, '
        'thick), hold the deformed surfaces against its scans, and write results.json, table.csv, '
        'samples.csv, report.html and pictures. A bag with the poses of a grip (grip/NAME/pose) '
        'gives torque against angle with the slip warning instead: turning.json, turning.csv, '
        'turning.html.',
        epilog='Instead of a bag, a published table (bags/published/table1.yaml): what its forces '
        'and displacements say of the modulus, the air and the theories, as table_one.html and '
        'table_one.json. The same bag gives the same bytes. With several bags or a grid each run '
        'gets a folder of its own, named by its content, and campaign.json lists them.',
    )
    own = parser.add_argument
    own(
        'bags',
        nargs='+',
        type=Path,
        metavar='BAG',
        help='bag directory or .mcap file, or one published table (.yaml)',
    )
    add(parser, '--out', required=True)
    add(parser, '--object', ' (default: what experiment.yaml names)')
    own(
        '--modulus',
        default='auto',
        choices=('auto', 'fit', 'object'),
        help="Young's modulus: fitted on the first load of the bag, or the object's own; auto "
        'fits where at least two loads were scanned (default)',
    )
    own(
        '--object-pose',
        type=_object_pose,
        metavar='POSE',
        help='pose of the object in the frame of the contacts: "x y z qx qy qz qw" [m], or '
        '"search" for those at which its scans fit (default: recorded as object_pose, or in '
        'experiment.yaml; where neither is and the object stands elsewhere, it is searched)',
    )
    add(parser, '--scan-unit', ', which are the recorded clouds (default m)', default='m')
    own('--published', type=Path, metavar='FILE', help='published table (YAML) to set beside')
    own('--no-page', action='store_true', help='numbers only: no page, no pictures')
    own('--no-samples', action='store_true', help='leave out linear theory at every sample')
    own(
        '--no-thick',
        action='store_true',
        help='leave out theory thick, which takes most of the time',
    )
    own(
        '--grid',
        action='append',
        default=[],
        metavar='KEY=A,B',
        help='repeat for every value of young_modulus_pa (Pa), thickness_m (m), poisson_ratio or '
        'control_vertices; several grids multiply',
    )
    add(parser, '--processes', ' (default 1)', type=int, default=1)
    add(parser, '--scheduler')
    add(parser, '--json')
    return parser


def _object_pose(text: str) -> tuple[float, ...] | str:
    if text == 'search':
        return text
    try:
        numbers = tuple(float(word) for word in text.replace(',', ' ').split())
    except ValueError:
        numbers = ()
    if len(numbers) != 7 or not any(numbers[3:]):
        raise argparse.ArgumentTypeError(
            f'{text!r} is not "x y z qx qy qz qw" with a quaternion, nor "search"'
        )
    return numbers


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `grasp_report`; returns the exit code."""
    parser = build_parser()
    options = parse('grasp_replay', parser, arguments, {'--young': '--modulus'})
    if options.processes < 1:
        parser.error('--processes must be at least 1')
    # Before numpy is loaded: threads of BLAS would add up in another order every time.
    for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(variable, '1')
    several = len(options.bags) > 1 or options.grid or options.scheduler
    tables = [bag for bag in options.bags if bag.suffix in ('.yaml', '.yml')]
    if tables and several:
        parser.error(f'{tables[0]} is a published table: give it alone')
    try:
        if tables:
            return _published(options)
        if several:
            return _many(options)
        return _one(options) if not _turns(options) else 0
    except BagError as error:
        complain('grasp_report', error)
        return 1


def _turns(options: argparse.Namespace) -> bool:
    """Report a bag that holds the poses of a grip; False for any other."""
    from grasp_replay.turning import is_turn, solve_turn

    if not is_turn(options.bags[0]):
        return False
    with progress_bar('grasp_report', 1.0) as show:
        turn = solve_turn(options.bags[0], options.object, show=show)
    from grasp_replay.turning_page import sentences, write_turn

    page = write_turn(turn, options.out)
    if options.json:
        print(json.dumps(turn, indent=1, allow_nan=False))
    else:
        say('\n'.join(sentences(turn)))
        print(page)
    if turn['message']:
        # What converged has been written: the end comes last.
        raise BagError(turn['message'])
    return True


def _one(options: argparse.Namespace) -> int:
    from grasp_replay.pipeline import PipelineOptions
    from grasp_replay.report_files import Extent, make_report
    from shell_deform.live.pose import PoseError, pose_of

    given = options.object_pose
    try:
        pose = None if given in (None, 'search') else pose_of(list(given))
    except PoseError as error:
        raise BagError(str(error)) from error
    extent = Extent(not options.no_page, not options.no_samples, options.published)
    pipeline = PipelineOptions(
        object_name=options.object,
        object_pose=pose,
        search=given == 'search',
        scan_unit=options.scan_unit,
        young=options.modulus,
        thick=not options.no_thick,
    )
    with progress_bar('grasp_report', 1.0) as show:
        results = make_report(options.bags[0], options.out, pipeline, extent, show)
    if options.json:
        print(json.dumps(results, indent=1, allow_nan=False))
    else:
        print_results(results, options.out)
    return 0


def _published(options: argparse.Namespace) -> int:
    from grasp_replay.results import aligned
    from grasp_replay.table_one.page import lines, write_table_one
    from grasp_replay.table_one.study import table_one

    with progress_bar('grasp_report', 1.0) as show:
        study = table_one(options.bags[0], show)
    page = write_table_one(study, options.out)
    if options.json:
        print(json.dumps(study, indent=1, allow_nan=False))
    else:
        say(aligned(lines(study)))
        print(page)
    return 0


def _many(options: argparse.Namespace) -> int:
    from grasp_replay.campaign import Task, parse_grid, run_campaign

    tasks = [
        Task(
            bag.resolve(),
            changes,
            options.object,
            'object' if any(key == 'young_modulus_pa' for key, _ in changes) else options.modulus,
            not options.no_page,
            not options.no_samples,
            options.published and options.published.resolve(),
            None if options.object_pose == 'search' else options.object_pose,
            options.object_pose == 'search',
            options.scan_unit,
            not options.no_thick,
        )
        for bag in options.bags
        for changes in parse_grid(options.grid)
    ]
    with progress_bar('grasp_report', 1.0) as show:
        result = run_campaign(tasks, options.out, options.processes, options.scheduler, show)
    if options.json:
        print((options.out / 'campaign.json').read_text(), end='')
    else:
        _print_campaign(result, len(tasks), options.out)
    if result.failed:
        number, reason = min(result.failed.items())
        raise BagError(
            f'{len(result.failed)} of {len(tasks)} tasks failed; task {number}: {reason}'
        )
    return 0


def _print_campaign(result: CampaignResult, count: int, out: Path) -> None:
    print(
        f'{len(result.folders)} of {count} tasks done ({result.reused} were there already); '
        f'see {out / "campaign.json"}'
    )


def print_results(results: dict[str, Any], out: Path) -> None:
    """The table on the terminal: recording, verdicts, and the published rows apart."""
    from grasp_replay.results import aligned, published_lines, table_lines
    from grasp_replay.touch_cells import sentence

    label = f' ({results["label"]})' if results['label'] else ''
    say(f'{results["experiment"]}{label}')
    say(
        f'{results["object"]}, E = {results["young_modulus_pa"] / 1e6:.4g} MPa '
        f'({results["young_modulus_from"]}), of the solid '
        f'{results["solid_young_modulus_pa"] / 1e6:.4g} MPa; lengths in mm, outer face'
    )
    say(aligned(table_lines(results)))
    notes = [note for row in results['rows'] for note in row['notes']]
    for note in dict.fromkeys(notes):
        say(f'note: {note}')
    for row in results['rows']:
        say(f'row {row["row"]}: {row["verdict"]}')
        if touch := row['grasp'].get('touch'):
            say(f'row {row["row"]}: touch cells: {sentence(touch)}')
    if results['published']:
        say('published, and what we predict for the published forces (mm):')
        say(aligned(published_lines(results)))
    say(f'files in {out}')


if __name__ == '__main__':
    sys.exit(main())
