# SPDX-License-Identifier: Apache-2.0
"""`grasp_map`: many grasps of one object, squeezed, measured and ranked."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path

from grasp_common.command_line import parse
from grasp_common.terminal import print_table, progress_bar
from shell_deform.commands.console import CommandError, print_json, run
from shell_deform.commands.grasp_map_options import build_parser

SHOWN = 10
DEFAULT_BODY = 'barrett_fingertip'


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    options = parse('shell_deform', build_parser(), arguments)
    # Before numpy is loaded: threads of BLAS would add up in another order every time.
    for variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(variable, '1')
    return run('grasp_map', lambda: _map(options))


def _map(options: argparse.Namespace) -> None:
    from shell_deform.grasp.campaign import CampaignError, run_map
    from shell_deform.grasp.map_files import write_map
    from shell_deform.grasp.mapping import MapRequest, workplace

    named = Path(options.object)
    request = MapRequest(
        object_name=str(named.resolve()) if named.is_file() else options.object,
        hand=options.hand,
        number=options.number,
        seed=options.seed,
        friction=options.mu,
        friction_sigma=options.mu_sigma,
        mass=options.mass,
        down=options.down,
        depth=0.0 if options.force else options.depth or 4e-3,
        force=options.force or 0.0,
        lean=math.radians(options.lean),
        pin_radius=options.pin_radius,
        vertices=options.vertices or 0,
        theory=options.theory,
        strain_limit=options.strain_limit,
        body=_body(options),
    )
    place = workplace(request.object_name, request.vertices, request.theory)
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        with progress_bar('grasp_map', 1.0) as show:
            grasps = run_map(request, options.out, options.processes, options.scheduler, show)
    except CampaignError as error:
        raise CommandError(str(error)) from error
    told = write_map(request, grasps, place, options.out)
    if options.json:
        print_json(told)
    if not told['grasps']:
        raise CommandError(
            f'none of {len(told["failed"])} grasps of {options.object} could be squeezed; '
            f'the first: {told["failed"][0]["failed"]}'
        )
    if options.json:
        return
    print_table(
        ('grasp', 'worst of 26 N', 'lifts kg', 'P(closed)', 'needs mu', 'push N', 'limit'),
        [
            (
                str(one['number']), f'{one["worst_capacity_n"]:.3g}',
                f'{one["liftable_mass_kg"]:.3g}', f'{one["closure_probability"]:.3f}',
                f'{one["needed_friction"]:.3f}', f'{one["push_n"]:.3g}', one['limit'] or '-',
            )
            for one in told['grasps'][:SHOWN]
        ],
    )  # fmt: skip
    print(
        f'{len(told["grasps"])} grasps, {len(told["failed"])} failed: {options.out / "map.html"}'
    )


def _body(options: argparse.Namespace) -> str:
    """What the fingertips carry; refused where nothing carries it, or it cannot be read."""
    from shell_deform.contact.finger_bodies import OTHERS, read_finger_bodies
    from shell_deform.grasp.sampling import FINGERTIPS, HANDS

    body = options.finger_body or DEFAULT_BODY
    carried = read_finger_bodies(body).loaded()
    if options.hand not in FINGERTIPS:
        if options.finger_body is not None:
            raise CommandError(
                f'--finger-body {body}: {options.hand} carry none; give --hand two_fingertips or '
                'three_fingertips'
            )
    elif OTHERS not in carried and not set(range(1, 1 + HANDS[options.hand])) <= set(carried):
        raise CommandError(
            f'--finger-body {body}: not every finger of {options.hand} carries a body; name them '
            'all, or one without a number for the others'
        )
    return body
