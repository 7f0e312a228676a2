# SPDX-License-Identifier: Apache-2.0
"""One run from bag to files: numbers as JSON and tables, the report page and its pictures."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from grasp_replay import scenes
from grasp_replay.errors import BagError
from grasp_replay.experiment import published_source, read_experiment
from grasp_replay.grasp_section import grasp_sections
from grasp_replay.hold_section import hold_sections
from grasp_replay.meanwhile import meanwhile
from grasp_replay.pipeline import Outcome, PipelineOptions, object_file, run
from grasp_replay.published import published_predictions, published_table
from grasp_replay.report import Report, ReportError, write_report
from grasp_replay.results import csv_text, document, json_text, write_file
from grasp_replay.sample_trace import SampleTrace, trace_csv, trace_samples
from shell_deform.objects import load_object

# What the numbers depend on besides the bag.
PROGRAMS = ('grasp_replay', 'shell_deform', 'scan_compare', 'numpy', 'scipy', 'numba')
RESULTS, TABLE, SAMPLES = 'results.json', 'table.csv', 'samples.csv'


@dataclass(frozen=True)
class Extent:
    """What is made besides the numbers.

    Attributes:
        page: the report page and its pictures.
        samples: linear theory at every sample.
        published: the published table; None looks beside the bag's folder.
    """

    page: bool = True
    samples: bool = True
    published: Path | None = None


def make_report(
    bag: Path,
    out: Path,
    options: PipelineOptions,
    extent: Extent,
    show: Callable[[float, str], None] = lambda _share, _note: None,
) -> dict[str, Any]:
    """Run the pipeline and write its files into `out`; returns the document of results.json.

    Files appear as a whole, results.json last: while it is missing the run did not end. Raises
    BagError.
    """
    watch = _Stopwatch(show)
    table = extent.published or published_table(bag)
    with meanwhile(_published, bag, options, table) as later:
        outcome = run(bag, options, lambda share, note: watch(0.6 * share, note))
        name = outcome.shell.shell.name
        watch(0.6, 'published table')
        published = later()
    trace = None
    if extent.samples:
        watch(0.65, 'linear theory at every sample')
        trace = trace_samples(outcome.recording, outcome.shell, outcome.pose)
    results = document(outcome, published)
    part = out / '.part'
    shutil.rmtree(part, ignore_errors=True)
    try:
        part.mkdir(parents=True)
        write_file(part / TABLE, csv_text(results))
        if trace is not None:
            write_file(part / SAMPLES, trace_csv(trace))
        if extent.page:
            watch(0.75, 'report page')
            source = {} if table is None or not published else published_source(table, name)
            _page(outcome, results, published, trace, part, watch.seconds, source)
        write_file(part / RESULTS, json_text(results))
        _move(part, out)
    except OSError as error:
        raise BagError(f'{out} cannot be written: {error.strerror}') from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
    show(1.0, 'done')
    return results


def _published(bag: Path, options: PipelineOptions, table: Path | None) -> list[dict[str, Any]]:
    """The published table beside our predictions; needs nothing of the recording."""
    if table is None:
        return []
    file = object_file(options, read_experiment(bag))
    return published_predictions(table, file, load_object(file).name, options.thick)


class _Stopwatch:
    """Passes progress on and keeps how long each step took, by its name (s)."""

    def __init__(self, show: Callable[[float, str], None]) -> None:
        self.seconds: dict[str, float] = {}
        self._show = show
        self._step, self._since = '', time.perf_counter()

    def __call__(self, share: float, step: str) -> None:
        now = time.perf_counter()
        if self._step not in ('', 'done'):
            self.seconds[self._step] = self.seconds.get(self._step, 0.0) + now - self._since
        self._step, self._since = step, now
        self._show(share, step)


def _page(
    outcome: Outcome,
    results: dict[str, Any],
    published: list[dict[str, Any]],
    trace: SampleTrace | None,
    folder: Path,
    timings: dict[str, float],
    source: dict[str, str],
) -> None:
    drawn, curves = scenes.scenes(outcome), scenes.curves(outcome, published)
    numbers = {scene.key for scene in drawn}
    rows = [row for row in results['rows'] if f'row_{row["row"]}' in numbers]
    try:
        report = Report(
            {**results, 'rows': rows},
            drawn,
            provenance(outcome, results),
            published=scenes.published_rows(published, outcome.shell.shell.name),
            published_in=source,
            curves=curves,
            linearity=None if trace is None else scenes.linearity(trace),
            timings=timings,
            bands=scenes.bands(outcome, curves),
            sections=[*hold_sections(outcome.holds), *grasp_sections(rows)],
        )
        write_report(report, folder)
    except ReportError as error:
        raise BagError(f'the report page cannot be made: {error}') from error


def provenance(outcome: Outcome, results: dict[str, Any]) -> dict[str, Any]:
    """Where every number of the page comes from."""
    experiment = outcome.experiment
    young = (
        f'{results["young_modulus_pa"] / 1e6:.4g} MPa, {outcome.young_from}; of the solid '
        f'{results["solid_young_modulus_pa"] / 1e6:.4g} MPa'
    )
    found: dict[str, Any] = {
        'title': experiment.name,
        'object': {
            'name': results['object'],
            "Young's modulus": young,
            'thickness': f'{1e3 * results["thickness_m"]:.3g} mm',
            "Poisson's ratio": results['poisson_ratio'],
            'gas': results['gas'],
            'source': outcome.shell.shell.source,
        },
        'recording': {
            'sha256 of the bag': outcome.bag_sha256,
            'contact samples': results['samples'],
            'scans under load': len(results['rows']),
            'scanner noise': f'{1e3 * results["scanner_sigma_m"]:.3g} mm (one sigma)',
        },
        'measured max displacement': {
            'scan': 'dent profile of the scan, extrapolated to the contact axis under the pin',
            'pins': 'mean travel of the fingers since first touch, shown beside it',
        },
        'errors': {
            'surface': results['face'],
            'largest mean over a disc of 2 mm': 'of discs with at least 50 points',
        },
    }
    found['versions'] = {
        'Python': platform.python_version(),
        **{name: version(name) for name in PROGRAMS},
        'sha256 of results.json': hashlib.sha256(json_text(results).encode()).hexdigest(),
    }
    if experiment.synthetic:
        found['synthetic'] = experiment.label or 'This recording is synthetic.'
    if experiment.caveats:
        found['what it is not'] = {str(i + 1): text for i, text in enumerate(experiment.caveats)}
    return found


def _move(part: Path, out: Path) -> None:
    """Put the finished files in place, the results last."""
    names = sorted((entry.name for entry in part.iterdir()), key=lambda name: name == RESULTS)
    (out / RESULTS).unlink(missing_ok=True)
    for name in names:
        target = out / name
        if target.is_dir():
            shutil.rmtree(target)
        os.replace(part / name, target)
