# SPDX-License-Identifier: Apache-2.0
"""One sample of the hand's contacts, as the estimator takes it: arrays, SI units, one row each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLAG_CONTACT = 1
FLAG_SATURATED = 2
FLAG_STALE = 4
FLAG_NOT_TARED = 8
FLAG_FAULT = 16
FLAG_NO_GAUGE = 32


# What no hand of this size does: metres, newtons.
FARTHEST = 10.0
MOST_FORCE = 1000.0
LONGEST_TRAVEL = 0.2
WIDEST_RADIUS = 1.0

SMALLEST_MEAN_NORMAL = 0.3
"""Cells of one finger whose mean normal is shorter lie around the object: they are no finger."""


class SampleError(ValueError):
    """A sample that cannot be used; says which row, which value and what is allowed."""


@dataclass(frozen=True)
class ContactSample:
    """Contacts of one instant in one frame.

    Attributes:
        stamp: time of acquisition [ns].
        finger: (p,) finger numbers, several rows of one finger allowed (tactile cells).
        flags: (p,) bits FLAG_*.
        point: (p, 3) on the object's outer face [m]. normal: (p, 3) inward unit normal.
        force: (p, 3) of the finger on the object [N].
        sigma_normal: (p,) [N]. sigma_tangential: (p,) [N], infinite where not observed.
        radius: (p,) of the contact patch [m].
        travel: (p,) motion along the normal since first touch [m], NaN where unknown.
        sigma_travel: (p,) [m].
        along: (p, 3) direction in the pad to the tip of the finger, NaN where unknown.
        sigma_point: (p,) of the point in each direction [m], NaN where unknown.
    """

    stamp: int
    finger: NDArray[np.int64]
    flags: NDArray[np.int64]
    point: Array
    normal: Array
    force: Array
    sigma_normal: Array
    sigma_tangential: Array
    radius: Array
    travel: Array
    sigma_travel: Array
    along: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sigma_point: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if len(self.along) != len(self.finger):
            object.__setattr__(self, 'along', np.full((len(self.finger), 3), np.nan))
        if len(self.sigma_point) != len(self.finger):
            object.__setattr__(self, 'sigma_point', np.full(len(self.finger), np.nan))

    @property
    def touching(self) -> NDArray[np.bool_]:
        """(p,) rows in contact."""
        return (self.flags & FLAG_CONTACT) != 0

    @property
    def push(self) -> Array:
        """(p,) force along the inward normal [N]."""
        return np.einsum('pi,pi->p', self.force, self.normal)

    def rows(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> ContactSample:
        """The chosen rows."""
        return ContactSample(self.stamp, *(getattr(self, name)[index] for name in COLUMNS))


def no_contacts(stamp: int) -> ContactSample:
    """Nothing touches, at `stamp` [ns]."""
    none, numbers, rows = np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3))
    return ContactSample(
        stamp, numbers, numbers, rows, rows, rows, none, none, none, none, none
    )  # fmt: skip


COLUMNS = (
    'finger',
    'flags',
    'point',
    'normal',
    'force',
    'sigma_normal',
    'sigma_tangential',
    'radius',
    'travel',
    'sigma_travel',
    'along',
    'sigma_point',
)


def check(sample: ContactSample) -> None:
    """Raise SampleError for numbers no contact can have; only rows in contact are looked at."""
    touching = sample.touching
    total = sample.point.sum() + sample.normal.sum() + sample.force.sum() + sample.radius.sum()
    squares = np.einsum('pi,pi->p', sample.normal, sample.normal)
    if (
        np.isfinite(total)
        and (np.abs(squares - 1.0) < 1e-2).all()
        and (np.abs(sample.point) < FARTHEST).all()
        and (np.abs(sample.force) < MOST_FORCE).all()
        and (sample.radius < WIDEST_RADIUS).all()
        and not (np.abs(sample.travel) > LONGEST_TRAVEL).any()
    ):
        return
    for name in ('point', 'normal', 'force', 'radius'):
        values = getattr(sample, name)[touching]
        if not np.all(np.isfinite(values)):
            row = int(np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))[0])
            finger = int(sample.finger[touching][row])
            raise SampleError(
                f'contact of finger {finger}: {name} is {values[row].tolist()}; finite values '
                'are needed, so the sample is not used'
            )
    length = np.linalg.norm(sample.normal[touching], axis=1)
    if np.any(np.abs(length - 1.0) > 1e-2):
        row = int(np.argmax(np.abs(length - 1.0)))
        raise SampleError(
            f'contact of finger {int(sample.finger[touching][row])}: the normal has length '
            f'{length[row]:.4g}; a unit vector is needed, so the sample is not used'
        )
    if np.any(np.abs(sample.point[touching]) >= FARTHEST):
        raise SampleError(
            f'a contact point lies more than {FARTHEST:g} m from its frame; metres are needed'
        )
    for name, most, unit in (
        ('force', MOST_FORCE, 'N'),
        ('radius', WIDEST_RADIUS, 'm'),
        ('travel', LONGEST_TRAVEL, 'm'),
    ):
        sizes = np.nan_to_num(np.abs(getattr(sample, name)[touching]), posinf=np.inf)
        if np.any(sizes > most):
            row = int(np.argmax(sizes.reshape(len(sizes), -1).max(axis=1)))
            raise SampleError(
                f'contact of finger {int(sample.finger[touching][row])}: {name} is '
                f'{sizes[row].max():.4g} {unit}; no hand makes more than {most:g} {unit}, so the '
                'sample is not used'
            )


def check_fingers(sample: ContactSample, most: int) -> None:
    """Raise SampleError for more fingers, a row each, than are solved for: none is left out."""
    if len(sample.finger) > most:
        raise SampleError(
            f'{len(sample.finger)} fingers press at once, at most {most} are solved for, so the '
            'sample is not used; rows of one finger (its cells) carry one number'
        )


def check_served(
    packed: NDArray[np.float32], largest: float = 0.0, widest: float = np.inf
) -> None:
    """Raise SampleError unless an answer, (n, f) numbers, is finite, and one of this object.

    `largest`: displacement in it [m]. `widest`: of the object [m], infinite where it may travel.
    """
    if not np.isfinite(packed).all():
        raise SampleError('the answer to this sample is not finite, so it is not served')
    if largest > widest:
        raise SampleError(
            f'the answer to this sample moves the surface by {1e3 * largest:.0f} mm, more than '
            f'the {1e3 * widest:.0f} mm that the object measures, so it is not served'
        )


def one_row_per_finger(sample: ContactSample, default_radius: float) -> ContactSample:
    """Rows in contact, the cells of one finger merged into its resultant.

    The merged row stands at the centre of pressure with the mean normal, carries the sum of the
    forces, and its patch is as wide as the cells are spread (a uniform disc of radius r has a
    mean squared distance of r^2 / 2). A radius that is not positive becomes `default_radius` [m].

    Raises SampleError for rows of one finger that press against each other.
    """
    touching = sample.touching
    if not touching.all():
        sample = sample.rows(touching)
    if not (sample.radius > 0).all():
        sample = replace(sample, radius=np.where(sample.radius > 0, sample.radius, default_radius))
    if (sample.finger[1:] > sample.finger[:-1]).all():
        return sample
    fingers, first, counts = np.unique(sample.finger, return_index=True, return_counts=True)
    if np.all(counts == 1):
        return sample.rows(first)
    merged = [_resultant(sample.rows(sample.finger == finger)) for finger in fingers]
    return ContactSample(
        sample.stamp,
        *(np.concatenate([getattr(part, name) for part in merged]) for name in COLUMNS),
    )


def _resultant(cells: ContactSample) -> ContactSample:
    if len(cells.finger) == 1:
        return cells
    share = np.maximum(cells.push, 0.0)
    share = share / share.sum() if share.sum() > 0 else np.full(len(share), 1.0 / len(share))
    point = share @ cells.point
    normal = share @ cells.normal
    if np.linalg.norm(normal) < SMALLEST_MEAN_NORMAL:
        raise SampleError(
            f'finger {int(cells.finger[0])} has {len(cells.finger)} rows whose normals point '
            'against each other; give every body that touches its own finger number'
        )
    spread = share @ np.sum((cells.point - point) ** 2, axis=1)
    known = np.isfinite(cells.travel)
    return ContactSample(
        stamp=cells.stamp,
        finger=cells.finger[:1],
        flags=np.bitwise_or.reduce(cells.flags)[None],
        point=point[None],
        normal=(normal / np.linalg.norm(normal))[None],
        force=cells.force.sum(axis=0)[None],
        sigma_normal=np.sqrt(np.sum(cells.sigma_normal**2))[None],
        sigma_tangential=np.sqrt(np.sum(cells.sigma_tangential**2))[None],
        radius=np.sqrt(2.0 * spread + np.mean(cells.radius) ** 2)[None],
        travel=np.array([cells.travel[known].mean() if known.any() else np.nan]),
        sigma_travel=np.array([cells.sigma_travel[known].mean() if known.any() else np.nan]),
        along=cells.along[:1],
        # Cells of one finger are off together.
        sigma_point=cells.sigma_point[np.argmax(share)][None],
    )
