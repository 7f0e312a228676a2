# SPDX-License-Identifier: Apache-2.0
"""The whole job offline: a bag's loads solved by every theory and held against its scans.

The same cores as the live nodes, without topics. Nothing here reads a clock or a random number:
the same bag and options give the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_common.formats import RawMesh
from grasp_replay.errors import BagError
from grasp_replay.experiment import Experiment, read_experiment
from grasp_replay.holds import HeldContacts, Hold, holds_of
from grasp_replay.placement import placement
from grasp_replay.recording import Recording, bag_sha256, read_recording
from grasp_replay.relaxed import HoldTrace, elastic_recording, hold_trace
from grasp_replay.theories import THEORIES, Solved, TheorySet, theory_set
from scan_compare.comparison import Comparison, ComparisonError, Setup, compare
from scan_compare.registration import RegistrationError
from scan_compare.rigid import Pose as ScanPose
from scan_compare.scan import Scan
from scan_compare.scan_file import ScanFileError, scan_of
from scan_compare.units import UnitError, metres_per_unit
from shell_deform.contact.finger_bodies import read_finger_bodies
from shell_deform.contact.loads import ContactPatch
from shell_deform.live.pose import Pose
from shell_deform.solve.equilibrium import Equilibrium
from shell_deform.theory import THICK
from shell_deform.theory.relaxation import Relaxation

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

DEFAULT_OBJECT = 'tennis_ball'
BY_CELLS = 'it presses by rigid pins, not where touch cells felt it'
"""Why theory thick has no answer to such a row."""


@dataclass(frozen=True)
class PipelineOptions:
    """What may be chosen about a run.

    Attributes:
        object_name: name or file; None takes the one the recording names.
        object_pose: of the object in the frame of the contacts; None takes the recorded one.
        search: find that pose with the first scan, whatever is recorded.
        scan_unit: of the numbers in the recorded clouds.
        young: 'fit' (on the first held scan), 'object' (as the object file says), or 'auto': fit
            where at least two scans are held, so that the others remain predictions.
        changes: numbers of the object to replace, such as thickness_m.
        thick: solve by theory thick, too, which takes most of the time.
    """

    object_name: str | None = None
    object_pose: Pose | None = None
    search: bool = False
    scan_unit: str = 'm'
    young: str = 'auto'
    changes: dict[str, float] = field(default_factory=dict)
    thick: bool = True

    def __post_init__(self) -> None:
        if self.young not in ('auto', 'fit', 'object'):
            raise BagError(f"young is {self.young!r}; choose 'auto', 'fit' or 'object'")


@dataclass(frozen=True)
class Row:
    """One held scan: its load, and each theory's answer and comparison (None if not carried).

    `registered_by`: the theory with which the pose of the scan was found, one for all.
    """

    number: int
    hold: Hold
    contacts: HeldContacts
    patches: tuple[ContactPatch, ...]
    solved: dict[str, Solved]
    compared: dict[str, Comparison | None]
    registered_by: str

    @property
    def force(self) -> float:
        """Mean push of the fingers, as their gauges felt it [N]."""
        felt = self.contacts.felt
        return float((self.contacts.push if felt is None else felt).mean())

    @property
    def reference(self) -> Comparison:
        """The comparison that found the pose of the scan and its measured profiles."""
        found = self.compared[self.registered_by]
        assert found is not None
        return found


@dataclass(frozen=True)
class Outcome:
    """Everything a run found; `shell` carries the modulus in use and `young_from` its origin.

    `pose`: of the object in the frame of the contacts where it is one for the whole recording.
    """

    bag_sha256: str
    recording: Recording
    experiment: Experiment
    object_name: str
    shell: TheorySet
    young_from: str
    undeformed: Hold | None
    rows: tuple[Row, ...]
    pose: Pose | None = None

    @cached_property
    def holds(self) -> tuple[tuple[int, HoldTrace], ...]:
        """The holds as they were felt and predicted, with the numbers of their rows.

        None of a wall that does not relax.
        """
        law = self.shell.shell.relaxation
        if law is None:
            return ()
        found = ((row.number, hold_trace(self.recording, row.hold, law)) for row in self.rows)
        return tuple((number, trace) for number, trace in found if trace is not None)


def run(
    bag: Path, options: PipelineOptions, show: Progress = lambda _share, _note: None
) -> Outcome:
    """Run the pipeline over one bag; `show` is told the share done and what is being done.

    Raises BagError in one sentence when something is missing or cannot be used.
    """
    show(0.0, 'reading')
    experiment = read_experiment(bag)
    recording = _in_metres(read_recording(bag), options.scan_unit)
    name = object_file(options, experiment)
    place = placement(recording, experiment, name, options.object_pose, options.search)
    recording = place.recording
    holds = holds_of(recording, experiment, place.pose)
    held = [hold for hold in holds if hold.contacts is not None]
    if not held:
        raise BagError(f'{bag} holds no scan under load, so there is nothing to compare')
    show(0.05, 'meshing')
    shell = _meshed(name, held[0], options, experiment)
    holds = _elastic(holds, recording, experiment, place.pose, shell.shell.relaxation)
    notes = (*recording.notes, *place.notes)
    holds = tuple(_welded(hold, shell, notes) for hold in holds)
    held = [hold for hold in holds if hold.contacts is not None]
    undeformed = next((hold for hold in holds if hold.contacts is None), None)
    young_from = f'object {shell.shell.name}'
    if options.young == 'fit' or (options.young == 'auto' and len(held) > 1):
        show(0.1, "fitting Young's modulus")
        shell, young_from = _fitted(shell, held[0], undeformed, experiment, place.scan_start)
    rows: list[Row] = []
    states: dict[str, Equilibrium | None] = dict.fromkeys(THEORIES)
    for number, hold in enumerate(held, 1):
        show(0.2 + 0.8 * (number - 1) / len(held), f'load {number} of {len(held)}')
        setting = _Setting(undeformed, shell, experiment, place.scan_start)
        rows.append(_row(number, hold, setting, states))
    show(1.0, 'done')
    return Outcome(
        bag_sha256(bag),
        recording,
        experiment,
        name,
        shell,
        young_from,
        undeformed,
        tuple(rows),
        place.pose,
    )


def object_file(options: PipelineOptions, experiment: Experiment) -> str:
    """Name or file of the object: the one chosen, else the one that the recording names."""
    return options.object_name or experiment.object_file or DEFAULT_OBJECT


def _in_metres(recording: Recording, unit: str) -> Recording:
    """The recording with its scans scaled from `unit`."""
    try:
        scale = metres_per_unit(unit)
    except UnitError as error:
        raise BagError(str(error)) from error
    if scale == 1.0:
        return recording
    scans = tuple(replace(scan, points=scale * scan.points) for scan in recording.scans)
    return replace(recording, scans=scans)


def _meshed(name: str, first: Hold, options: PipelineOptions, experiment: Experiment) -> TheorySet:
    """The object, meshed finely where the first load touches it."""
    contacts = first.contacts
    assert contacts is not None
    travel = np.nan_to_num(contacts.travel)
    at_rest = contacts.point - travel[:, None] * contacts.normal
    radius = float(contacts.radius.min())
    if not contacts.shapes:
        found = theory_set(name, at_rest, radius, options.changes, options.thick)
        found.pins_slide = experiment.pins_slide
        return found
    bodies = read_finger_bodies(experiment.finger_body)
    found = theory_set(name, at_rest, radius, options.changes, False, bodies)
    found.without = BY_CELLS
    return found


def _welded(hold: Hold, shell: TheorySet, notes: tuple[str, ...]) -> Hold:
    """The hold with its scan as every scan goes in: finite, welded, of the object's size.

    Raises BagError for a scan without points, or so large or small that its unit is wrong.
    """
    surface = shell.model.surface.limit_positions(shell.model.rest)
    size = float(np.ptp(surface, axis=0).max())
    source = f'the scan at {hold.entry.stamp} ns'
    try:
        scan = scan_of(RawMesh(hold.points.copy(), None), source, 'm', size)
    except ScanFileError as error:
        raise BagError(str(error)) from error
    return replace(hold, points=scan.points, notes=(*notes, *hold.notes, *scan.notes))


def _elastic(
    holds: tuple[Hold, ...],
    recording: Recording,
    experiment: Experiment,
    pose: Pose | None,
    law: Relaxation | None,
) -> tuple[Hold, ...]:
    """The holds with the pushes that a wall which does not relax would have needed."""
    if law is None:
        return holds
    needed = holds_of(elastic_recording(recording, law), experiment, pose)
    return tuple(
        hold
        if felt.contacts is None or hold.contacts is None
        else replace(hold, contacts=replace(hold.contacts, felt=felt.contacts.push))
        for hold, felt in zip(needed, holds, strict=True)
    )


@dataclass(frozen=True)
class _Setting:
    """What all rows of a run share."""

    undeformed: Hold | None
    shell: TheorySet
    experiment: Experiment
    scan_start: ScanPose | None


def _fitted(
    shell: TheorySet,
    hold: Hold,
    undeformed: Hold | None,
    experiment: Experiment,
    scan_start: ScanPose | None,
) -> tuple[TheorySet, str]:
    """The shell with the moduli that carry the first load at its measured displacement.

    For the thin walls that of a shell which only bends: they do not know the squeezed material
    under a pin, which the thick one does.
    """
    setting = _Setting(undeformed, shell, experiment, scan_start)
    row = _row(1, hold, setting, dict.fromkeys(THEORIES), ('koiter',))
    profiles = row.reference.profiles
    depths = [profile.bent_apex_m for profile in profiles]
    if not depths or min(depths) <= 0.0:
        raise BagError(
            'the first scan under load shows no dent at the contacts to fit a modulus to; give '
            '--modulus object'
        )
    young = shell.fit_young(row.patches, row.contacts.push, float(np.mean(depths)))
    fitted = shell.with_young(young)
    if THICK in shell.models:
        depth = float(np.mean([profile.apex_m for profile in profiles]))
        solid = shell.fit_young(row.patches, row.contacts.push, depth, THICK)
        fitted = fitted.with_solid_young(solid)
    return fitted, 'fitted on row 1 of this recording with koiter theory'


def _row(
    number: int,
    hold: Hold,
    setting: _Setting,
    states: dict[str, Equilibrium | None],
    theories: tuple[str, ...] = THEORIES,
) -> Row:
    contacts = hold.contacts
    shell = setting.shell
    assert contacts is not None
    patches = shell.patches(contacts)
    if any(state is not None and len(state.force) != len(patches) for state in states.values()):
        states.update(dict.fromkeys(states))
    solved: dict[str, Solved] = {}
    compared: dict[str, Comparison | None] = dict.fromkeys(THEORIES)
    first: Comparison | None = None
    registered_by = ''
    # A scan has one pose: that of the nearest theory which carries the load.
    for theory in (name for name in shell.nearest_first if name in theories):
        solved[theory] = shell.solve(theory, patches, contacts.push, states[theory])
        if solved[theory].surface is None:
            continue
        states[theory] = solved[theory].state
        compared[theory] = _compare(hold, setting, solved[theory], patches, first)
        if first is None:
            first, registered_by = compared[theory], theory
    if first is None:
        raise BagError(
            f'row {number}: no theory carries {np.round(contacts.push, 3).tolist()} N on '
            f'{shell.shell.name} ({solved[theories[0]].message})'
        )
    return Row(number, hold, contacts, patches, solved, compared, registered_by)


def _compare(
    hold: Hold,
    setting: _Setting,
    solved: Solved,
    patches: tuple[ContactPatch, ...],
    first: Comparison | None,
) -> Comparison:
    """Hold a scan against one theory, in the pose found with the `first`, if there is one."""
    assert solved.surface is not None
    undeformed = setting.undeformed
    try:
        return compare(
            _scan(hold),
            solved.surface,
            None if undeformed is None or first is not None else _scan(undeformed),
            Setup(
                scanner_sigma_m=setting.experiment.scanner_sigma,
                start=setting.scan_start,
                contacts=setting.shell.contacts_at_rest(patches),
                registration=None if first is None else first.registration,
            ),
        )
    except (ComparisonError, RegistrationError) as error:
        raise BagError(f'the scan at {hold.entry.stamp} ns: {error}') from error


def _scan(hold: Hold) -> Scan:
    return Scan(hold.points, None, 'm', False, f'scan at {hold.entry.stamp} ns', hold.notes)
