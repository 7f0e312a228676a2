# SPDX-License-Identifier: Apache-2.0
"""`scan_error`: scan files against a deformed surface; statistics, JSON and pictures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from grasp_common.bounded_yaml import regular
from grasp_common.command_line import parse
from grasp_common.terminal import complain, say
from scan_compare.commands.scan_error_options import build_parser
from scan_compare.comparison import Comparison, ComparisonError, Progress, Setup, compare
from scan_compare.deformed_surface import DeformedSurface, SurfaceError
from scan_compare.merge import MergeError, merge
from scan_compare.model_file import surface_of_files, surface_of_object
from scan_compare.ranking import rank
from scan_compare.registration import RegistrationError
from scan_compare.report.files import dump_json, write_report
from scan_compare.report.table import text_table
from scan_compare.rigid import Pose, pose_from_points
from scan_compare.scan import Scan
from scan_compare.scan_file import ScanFileError, read_scan
from scan_compare.units import UnitError
from shell_deform.objects import ObjectError
from shell_deform.surface.control_mesh import MeshError

SAME_POINT = 1e-6
"""A point of the cropped scan is one of the scan within this distance [m]."""

FAILURES = (
    ComparisonError,
    MergeError,
    MeshError,
    ObjectError,
    RegistrationError,
    ScanFileError,
    SurfaceError,
    UnitError,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    options = parse('scan_compare', build_parser(), arguments)
    try:
        with _progress(not options.quiet) as progress:
            comparison = _run(options, progress)
            if options.out is not None:
                progress('report')
                write_report(comparison, options.out)
    except OSError as error:
        complain('scan_error', f'{error.filename}: {error.strerror}')
        return 1
    except FAILURES as error:
        complain('scan_error', error)
        return 1
    if options.json:
        sys.stdout.write(dump_json(comparison))
    else:
        say(text_table(comparison))
    return 0


def _run(options: argparse.Namespace, progress: Progress) -> Comparison:
    progress('object')
    surface: DeformedSurface = surface_of_object(options.object)
    if options.surface is not None:
        surface = surface_of_files(options.surface, options.rest, surface, options.surface_unit)
    progress('scan')
    scan, mask = _read(options.scan, options.unit, surface, options.undeformed_region)
    undeformed = None
    if options.undeformed is not None:
        undeformed, _ = _read(options.undeformed, options.unit, surface.at_rest())
    start, contacts = options.start, None
    if options.contacts is not None:
        start, contacts = _start_from(options.contacts)

    setup = Setup(
        scanner_sigma_m=options.scanner_sigma,
        start=start,
        start_contacts=contacts,
        mask=mask,
        outlier_m=options.outlier,
    )
    found = compare(scan, surface, undeformed, setup, progress)
    if options.against is None:
        return found
    other = surface_of_files(options.against, options.rest, surface, options.surface_unit)
    names = (str(options.surface or options.object), str(options.against))
    second = compare(scan, other, undeformed, setup, progress)
    return replace(found, notes=(*found.notes, rank(found, second, names).text))


def _start_from(path: Path) -> tuple[Pose, np.ndarray]:
    """Read contacts, six numbers a line; the pose that joins both frames, the points (c, 3)."""
    try:
        table = np.loadtxt(regular(path), ndmin=2, delimiter=None)
    except ValueError as error:
        raise ComparisonError(f'{path}: {error}') from None
    if table.shape[1] != 6 or not np.all(np.isfinite(table)):
        raise ComparisonError(
            f'{path}: contacts need six numbers a line: x y z in the scan frame, then x y z in '
            'the object frame [m]'
        )
    return pose_from_points(table[:, :3], table[:, 3:]), table[:, 3:]


def _read(
    paths: list[Path], unit: str | None, surface: DeformedSurface, region: Path | None = None
) -> tuple[Scan, np.ndarray | None]:
    """Read and merge views; which of their points (n,) also stand in the cropped file `region`."""
    views = [read_scan(path, unit, surface.extent) for path in paths]
    mask = None
    if region is not None:
        cropped = cKDTree(read_scan(region, unit, surface.extent).points)
        mask = np.concatenate([cropped.query(view.points)[0] < SAME_POINT for view in views])
        if not mask.any():
            raise ComparisonError(
                f'{region}: none of its points is one of the scan; crop a copy of the scan and '
                'leave the points where they are'
            )
    return (merge(views).scan if len(views) > 1 else views[0]), mask


@contextmanager
def _progress(wanted: bool) -> Iterator[Progress]:
    """Show the stages of the work on a terminal's stderr."""
    if not (wanted and sys.stderr.isatty()):
        yield lambda _: None
        return
    # imported here: the package starts without rich where it is not installed
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task('start')
        yield lambda stage: bar.update(task, description=stage)


if __name__ == '__main__':
    sys.exit(main())
