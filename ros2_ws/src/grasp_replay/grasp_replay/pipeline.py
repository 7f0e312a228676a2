"""The whole job offline: a bag's loads solved by every theory and held against its scans.

The same cores as the live nodes, without topics. Nothing here reads a clock or a random number:
the same bag and options give the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_replay.errors import BagError
from grasp_replay.experiment import Experiment, read_experiment
from grasp_replay.holds import HeldContacts, Hold, holds_of
from grasp_replay.recording import Recording, bag_sha256, read_recording
from grasp_replay.theories import THEORIES, Solved, TheorySet, theory_set
from scan_compare.comparison import Comparison, ComparisonError, compare
from scan_compare.registration import RegistrationError
from scan_compare.scan import Scan
from scan_compare.units import UnitError, choose_unit, robust_extent
from shell_deform.contact.loads import ContactPatch
from shell_deform.live.pose import Pose
from shell_deform.solve.equilibrium import Equilibrium

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

DEFAULT_OBJECT = 'tennis_ball'
REGISTERED_BY = ('koiter', 'paper', 'linear')


@dataclass(frozen=True)
class PipelineOptions:
    """What may be chosen about a run.

    Attributes:
        object_name: name or file; None takes the one the recording names.
        object_pose: of the object in the frame of the contacts; None takes the recorded one.
        young: 'fit' (on the first held scan), 'object' (as the object file says), or 'auto': fit
            where at least two scans are held, so that the others remain predictions.
        changes: numbers of the object to replace, such as thickness_m.
    """

    object_name: str | None = None
    object_pose: Pose | None = None
    young: str = 'auto'
    changes: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.young not in ('auto', 'fit', 'object'):
            raise BagError(f"young is {self.young!r}; choose 'auto', 'fit' or 'object'")


@dataclass(frozen=True)
class Row:
    """One held scan: its load, and each theory's answer and comparison (None if not carried)."""

    number: int
    hold: Hold
    contacts: HeldContacts
    patches: tuple[ContactPatch, ...]
    solved: dict[str, Solved]
    compared: dict[str, Comparison | None]

    @property
    def force(self) -> float:
        """Mean push of the fingers [N]."""
        return float(self.contacts.push.mean())

    @property
    def reference(self) -> Comparison:
        """The comparison that found the pose of the scan and its measured profiles."""
        return next(c for c in map(self.compared.get, REGISTERED_BY) if c is not None)


@dataclass(frozen=True)
class Outcome:
    """Everything a run found; `shell` carries the modulus in use and `young_from` its origin."""

    bag_sha256: str
    recording: Recording
    experiment: Experiment
    object_name: str
    shell: TheorySet
    young_from: str
    undeformed: Hold | None
    rows: tuple[Row, ...]


def run(
    bag: Path, options: PipelineOptions, show: Progress = lambda _share, _note: None
) -> Outcome:
    """Run the pipeline over one bag; `show` is told the share done and what is being done.

    Raises BagError in one sentence when something is missing or cannot be used.
    """
    show(0.0, 'reading')
    experiment = read_experiment(bag)
    recording = read_recording(bag)
    holds = holds_of(recording, experiment, options.object_pose)
    held = [hold for hold in holds if hold.contacts is not None]
    if not held:
        raise BagError(f'{bag} holds no scan under load, so there is nothing to compare')
    undeformed = next((hold for hold in holds if hold.contacts is None), None)
    name = options.object_name or experiment.object_file or DEFAULT_OBJECT
    show(0.05, 'meshing')
    shell = _meshed(name, held[0], options)
    for hold in holds:
        _check_size(hold, shell)
    young_from = f'object {shell.shell.name}'
    if options.young == 'fit' or (options.young == 'auto' and len(held) > 1):
        show(0.1, "fitting Young's modulus")
        shell, young_from = _fitted(shell, held[0], undeformed, experiment)
    rows: list[Row] = []
    states: dict[str, Equilibrium | None] = dict.fromkeys(THEORIES)
    for number, hold in enumerate(held, 1):
        show(0.2 + 0.8 * (number - 1) / len(held), f'load {number} of {len(held)}')
        rows.append(_row(number, hold, undeformed, shell, experiment, states))
    show(1.0, 'done')
    return Outcome(
        bag_sha256(bag), recording, experiment, name, shell, young_from, undeformed, tuple(rows)
    )


def _meshed(name: str, first: Hold, options: PipelineOptions) -> TheorySet:
    """The object, meshed finely where the first load touches it."""
    contacts = first.contacts
    assert contacts is not None
    travel = np.nan_to_num(contacts.travel)
    at_rest = contacts.point - travel[:, None] * contacts.normal
    return theory_set(name, at_rest, float(contacts.radius.min()), options.changes)


def _check_size(hold: Hold, shell: TheorySet) -> None:
    """Raise BagError for a scan without points, or so large or small that its unit is wrong."""
    try:
        if not len(hold.points):
            raise UnitError('it has no points')
        surface = shell.model.surface.limit_positions(shell.model.rest)
        choose_unit(robust_extent(hold.points), 'm', float(np.ptp(surface, axis=0).max()))
    except UnitError as error:
        raise BagError(f'the scan at {hold.entry.stamp} ns: {error}') from error


def _fitted(
    shell: TheorySet, hold: Hold, undeformed: Hold | None, experiment: Experiment
) -> tuple[TheorySet, str]:
    """The shell with the modulus that carries the first load at its measured displacement.

    That of a shell which only bends: no theory here knows the squeezed material under a pin.
    """
    row = _row(1, hold, undeformed, shell, experiment, dict.fromkeys(THEORIES), ('koiter',))
    depths = [profile.bent_apex_m for profile in row.reference.profiles]
    if not depths or min(depths) <= 0.0:
        raise BagError(
            'the first scan under load shows no dent at the contacts to fit a modulus to; give '
            '--young object'
        )
    young = shell.fit_young(row.patches, row.contacts.push, float(np.mean(depths)))
    return shell.with_young(young), 'fitted on row 1 of this recording with koiter theory'


def _row(
    number: int,
    hold: Hold,
    undeformed: Hold | None,
    shell: TheorySet,
    experiment: Experiment,
    states: dict[str, Equilibrium | None],
    theories: tuple[str, ...] = THEORIES,
) -> Row:
    contacts = hold.contacts
    assert contacts is not None
    patches = shell.patches(contacts)
    if any(state is not None and len(state.force) != len(patches) for state in states.values()):
        states.update(dict.fromkeys(states))
    solved: dict[str, Solved] = {}
    compared: dict[str, Comparison | None] = dict.fromkeys(THEORIES)
    first: Comparison | None = None
    # A scan has one pose: that of the theory named first in REGISTERED_BY which carries the load.
    for theory in sorted(theories, key=REGISTERED_BY.index):
        solved[theory] = shell.solve(theory, patches, contacts.push, states[theory])
        if solved[theory].surface is None:
            continue
        states[theory] = solved[theory].state
        compared[theory] = _compare(
            hold, undeformed, shell, solved[theory], patches, experiment, first
        )
        first = first or compared[theory]
    if first is None:
        raise BagError(
            f'row {number}: no theory carries {np.round(contacts.push, 3).tolist()} N on '
            f'{shell.shell.name} ({solved[theories[-1]].state.message})'
        )
    return Row(number, hold, contacts, patches, solved, compared)


def _compare(
    hold: Hold,
    undeformed: Hold | None,
    shell: TheorySet,
    solved: Solved,
    patches: tuple[ContactPatch, ...],
    experiment: Experiment,
    first: Comparison | None,
) -> Comparison:
    """Hold a scan against one theory, in the pose found with the `first`, if there is one."""
    assert solved.surface is not None
    try:
        return compare(
            _scan(hold),
            solved.surface,
            None if undeformed is None or first is not None else _scan(undeformed),
            scanner_sigma_m=experiment.scanner_sigma,
            contacts=shell.contacts_at_rest(patches),
            registration=None if first is None else first.registration,
        )
    except (ComparisonError, RegistrationError) as error:
        raise BagError(f'the scan at {hold.entry.stamp} ns: {error}') from error


def _scan(hold: Hold) -> Scan:
    return Scan(hold.points, None, 'm', False, f'scan at {hold.entry.stamp} ns')
