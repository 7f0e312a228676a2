# SPDX-License-Identifier: Apache-2.0
"""Memory shared by the node and the background process.

One anonymous file holds, in this order: the surface at rest, one mailbox for the newest load case,
and four result slots. Each side writes only its own parts; sequence numbers before and after a
record tell a reader whether it caught a complete one. Nobody ever waits for a lock: a reader that
was overtaken reads again. An anonymous file vanishes with its last user, whatever kills it.
"""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shell_deform.live.grip_motion import AFFINE

Array = NDArray[np.float64]

MAX_CONTACTS = 8
MAX_RIGID = 6
MAX_GRIPS = 4
MAX_INPUTS = 3 * MAX_CONTACTS + MAX_RIGID + 1
MAX_PAIRS = MAX_CONTACTS * (MAX_CONTACTS + 1) // 2
MAX_AFFINE = AFFINE * MAX_GRIPS
SLOTS = 4

MAX_TAXELS = 512
MAX_CELLS = 64
"""Touch cells of one finger that may shape its load."""

TAXEL_FIELDS = (
    *('x', 'y', 'z', 'nx', 'ny', 'nz', 'fx', 'fy', 'fz'),
    *('area', 'sticking', 'pressure', 'shear', 'finger', 'cell'),
)
"""One touch cell: where it is and faces [m], the force of the finger on the object there [N], how
much of the object it touches and how much of that sticks [m^2], the means of pressure and friction
over what it touches [Pa], and whose it is. Vectors in the object's frame."""

DRIVE_FORCE = 0
DRIVE_CODES = {'force': DRIVE_FORCE, 'motion': 1, 'fused': 2}
"""What a load case goes by: field `drive` of a request."""

TOUCH = np.dtype(
    [
        ('finger', '<i8'),
        ('point', '<f8', 3),
        ('normal', '<f8', 3),
        ('radius', '<f8'),
        ('force', '<f8'),
        ('travel', '<f8'),
        ('displacement', '<f8'),
        ('along', '<f8', 3),
        ('cells', '<i8'),
        ('cell', '<f8', (MAX_CELLS, 3)),
        ('share', '<f8', MAX_CELLS),
    ]
)
"""One touching finger: in the contacts' frame; `displacement` NaN where it is not prescribed,
`along` the finger NaN where it is not known. Where its push lies as its touch cells felt it, their
number is in `cells`, their centres in the finger's frame, and the share of each; else 0."""

REQUEST = np.dtype(
    [
        ('begin', '<i8'),
        ('stamp', '<i8'),
        ('generation', '<i8'),
        ('resets', '<i8'),
        ('jumps', '<i8'),
        ('contacts', '<i8'),
        ('drive', '<i8'),
        ('placed', '<i8'),
        ('pose', '<f8', 7),
        ('tendon', '<f8'),
        ('friction', '<f8'),
        ('hurried', '<i8'),
        ('rigid', '<f8', MAX_RIGID),
        ('grip', '<f8', (MAX_GRIPS, 6)),
        ('touch', TOUCH, MAX_CONTACTS),
        ('end', '<i8'),
    ]
)

RESULT = np.dtype(
    [
        ('begin', '<i8'),
        ('answers', '<i8'),
        ('stamp', '<i8'),
        ('generation', '<i8'),
        ('contacts', '<i8'),
        ('rigid_count', '<i8'),
        ('share', '<f8'),
        ('stable', '<i8'),
        ('crosses', '<i8'),
        ('snap_margin', '<f8'),
        ('energy', '<f8'),
        ('rest_energy', '<f8'),
        ('seconds', '<f8'),
        ('factorisations', '<i8'),
        ('dropped', '<i8'),
        ('fresh_columns', '<i8'),
        ('finger', '<i8', MAX_CONTACTS),
        ('force', '<f8', MAX_CONTACTS),
        ('displacement', '<f8', MAX_CONTACTS),
        ('travel_offset', '<f8', MAX_CONTACTS),
        ('axis', '<f8', (MAX_CONTACTS, 3)),
        ('lateral', '<f8', (2 * MAX_CONTACTS, 3)),
        ('anchor', '<f8', (MAX_CONTACTS, 3)),
        ('place', '<f8', (MAX_CONTACTS, 3)),
        ('coarseness', '<f8', MAX_CONTACTS),
        ('rigid', '<f8', MAX_RIGID),
        ('rigid_scale', '<f8'),
        ('touch_point', '<f8', (MAX_CONTACTS, 3)),
        ('touch_normal', '<f8', (MAX_CONTACTS, 3)),
        ('reaction', '<f8', 2 * MAX_CONTACTS),
        ('rigid_reaction', '<f8', MAX_RIGID),
        ('displacement_by', '<f8', (MAX_CONTACTS, MAX_INPUTS)),
        ('reaction_by', '<f8', (2 * MAX_CONTACTS, MAX_INPUTS)),
        ('rigid_by', '<f8', (MAX_RIGID, MAX_INPUTS)),
        ('linear_compliance', '<f8', (MAX_CONTACTS, MAX_CONTACTS)),
        ('second_order', '<f8', (MAX_CONTACTS, MAX_PAIRS)),
        ('bend_direction', '<f8', MAX_CONTACTS),
        ('bend_offset', '<f8'),
        ('bend_reach', '<f8'),
        ('third_reach', '<f8'),
        ('push_bend', '<f8', MAX_CONTACTS),
        ('carried', '<f8', 7),
        ('frame', '<f8', (MAX_CONTACTS, 3, 3)),
        ('reach', '<f8', MAX_CONTACTS),
        ('set_doubt', '<f8'),
        ('taxels', '<i8'),
        ('refused', '<i8'),
        ('pose', '<f8', 7),
        ('pose_covariance', '<f8', (6, 6)),
        ('grip', '<f8', (MAX_GRIPS, 6)),
        ('grip_pose', '<f8', (MAX_GRIPS, 6)),
        ('grip_wrench', '<f8', (MAX_GRIPS, 6)),
        ('grip_bend', '<f8'),
        ('displacement_by_grip', '<f8', (MAX_CONTACTS, MAX_AFFINE)),
        ('reaction_by_grip', '<f8', (2 * MAX_CONTACTS, MAX_AFFINE)),
        ('rigid_by_grip', '<f8', (MAX_RIGID, MAX_AFFINE)),
        ('spin', '<f8', MAX_CONTACTS),
        ('arm', '<f8', MAX_CONTACTS),
        ('grasp_known', '<i8'),
        ('centre', '<f8', 3),
        ('share_push', '<f8', (MAX_CONTACTS, 6)),
        ('share_across', '<f8', (MAX_CONTACTS, 3, 6)),
        ('share_spin', '<f8', (MAX_CONTACTS, 6)),
        ('body_compliance', '<f8', (6, 6)),
        ('slip_push', '<f8', MAX_CONTACTS),
        ('slip_arm', '<f8', MAX_CONTACTS),
        ('stress', '<f8'),
        ('stress_doubt', '<f8'),
        ('strain', '<f8'),
        ('message', 'S200'),
        ('end', '<i8'),
    ]
)


@dataclass(frozen=True)
class Layout:
    """Sizes of everything for n vertices and m triangles.

    `outer`: whether the outer face is a field of its own, as that of a thick wall is. `grips`: how
    many hold it.
    """

    vertices: int
    triangles: int
    outer: bool = False
    grips: int = 0

    @property
    def field(self) -> int:
        """Bytes of one vector field (n, 3)."""
        return 24 * self.vertices

    @property
    def static(self) -> int:
        """Bytes of rest surface and triangles."""
        return _round((2 + self.outer + AFFINE * self.grips) * self.field + 12 * self.triangles)

    @property
    def slot(self) -> int:
        """Bytes of one result slot."""
        fields = 3 + MAX_INPUTS + MAX_CONTACTS + 2 * self.outer + AFFINE * self.grips
        taxels = 8 * MAX_TAXELS * len(TAXEL_FIELDS)
        return _round(RESULT.itemsize + fields * self.field + 24 * self.vertices + taxels)

    @property
    def requests(self) -> int:
        """Where the control words and the mailbox stand."""
        return self.static

    @property
    def slots(self) -> int:
        """Where the first slot stands."""
        return self.static + _round(64 + REQUEST.itemsize)

    @property
    def total(self) -> int:
        """Bytes of the whole file."""
        return self.slots + SLOTS * self.slot


def _round(size: int) -> int:
    return (size + 63) // 64 * 64


@dataclass(frozen=True)
class Slot:
    """One result: the record and its arrays, views of the shared memory.

    Attributes:
        record: structured scalar of dtype RESULT; assigning to its fields writes through.
        surface, normals: (n, 3) limit positions [m] and unit normals of the last equilibrium.
        columns: room for (n, 3, j) motions of the limit positions per unit input.
        linear: room for (n, 3, k) motions per unit push from rest.
        bend: (n, 3) [1/m] second-order motion per squared step along `bend_direction`.
        third: (n,) [1/m^2] size of the third-order motion per cubed step.
        energy_density: (n,) strain energy per undeformed area [J/m^2].
        unmodelled: (n,) sigma of what no shell theory has, beside a pin [m].
        taxels: room for (t, f) touch cells, see `TAXEL_FIELDS`.
        outer: (n, 3) of the outer face over the surface [m]; outer_slope: (n, 3) its change per
            step along `bend_direction` [-]. None where it is half a wall along the normal.
        grips: (n, 3, 12 g) motions per unit of each number of the grips' `affine`.
    """

    record: np.void
    surface: Array
    normals: Array
    columns: Array
    linear: Array
    bend: Array
    third: Array
    energy_density: Array
    unmodelled: Array
    taxels: Array
    outer: Array | None
    outer_slope: Array | None
    grips: Array

    def input_columns(self) -> Array:
        """(n, 3, j) view of the columns in use."""
        k, r = int(self.record['contacts']), int(self.record['rigid_count'])
        return _packed(self.columns, len(self.surface), 3 * k + r + 1)

    def linear_columns(self) -> Array:
        """(n, 3, k) view of the linear columns in use."""
        return _packed(self.linear, len(self.surface), int(self.record['contacts']))


def _packed(room: Array, vertices: int, count: int) -> Array:
    return room[: 3 * vertices * count].reshape(vertices, 3, count)


class SharedMemory:
    """The mapped file with views of all parts."""

    def __init__(self, descriptor: int, layout: Layout) -> None:
        """Map `descriptor`; it is closed here, the mapping stays."""
        self.layout = layout
        self._map = mmap.mmap(descriptor, layout.total)
        os.close(descriptor)
        n, m = layout.vertices, layout.triangles
        self.rest = self._view('<f8', 0, 3 * n).reshape(n, 3)
        self.rest_normals = self._view('<f8', layout.field, 3 * n).reshape(n, 3)
        self.rest_outer = (
            self._view('<f8', 2 * layout.field, 3 * n).reshape(n, 3) if layout.outer else None
        )
        affine = AFFINE * layout.grips
        self.rest_grips = self._view(
            '<f8', (2 + layout.outer) * layout.field, 3 * n * affine
        ).reshape(n, 3, affine)
        triangles = (2 + layout.outer + affine) * layout.field
        self.triangles = self._view('<i4', triangles, 3 * m).reshape(m, 3)
        self.control = self._view('<i8', layout.requests, 8)
        self.request = self._view(REQUEST, layout.requests + 64, 1)
        self.slots = tuple(self._slot(i) for i in range(SLOTS))

    def _view(self, kind: str | np.dtype, offset: int, count: int) -> np.ndarray:
        return np.frombuffer(self._map, dtype=kind, count=count, offset=offset)

    def _slot(self, index: int) -> Slot:
        n = self.layout.vertices
        at = self.layout.slots + index * self.layout.slot
        record = self._view(RESULT, at, 1)[0]
        at += RESULT.itemsize
        parts = []
        affine = AFFINE * self.layout.grips
        face = [3 * n, 3 * n] * self.layout.outer
        taxels = MAX_TAXELS * len(TAXEL_FIELDS)
        columns = (3 * n * MAX_INPUTS, 3 * n * MAX_CONTACTS)
        more = (3 * n * affine, taxels)
        sizes = (3 * n, 3 * n, *columns, 3 * n, n, n, n, *more, *face)
        for count in sizes:
            parts.append(self._view('<f8', at, count))
            at += 8 * count
        surface, normals, inputs, linear, bend, third, energy_density, unmodelled = parts[:8]
        outer = [part.reshape(n, 3) for part in parts[10:]] or (None, None)
        return Slot(
            record,
            surface.reshape(n, 3),
            normals.reshape(n, 3),
            inputs,
            linear,
            bend.reshape(n, 3),
            third,
            energy_density,
            unmodelled,
            parts[9].reshape(MAX_TAXELS, len(TAXEL_FIELDS)),
            outer[0],
            outer[1],
            parts[8].reshape(n, 3, affine),
        )

    def beat(self) -> None:
        """The background process gets on: called wherever it goes round a loop."""
        self.control[2] += 1

    @property
    def beats(self) -> int:
        """How often it got on so far."""
        return int(self.control[2])

    def write_request(self, request: np.ndarray, sequence: int) -> None:
        """Put a load case (1,) of dtype REQUEST into the mailbox, over any older one."""
        request['begin'] = sequence
        request['end'] = sequence - 1
        self.request[:] = request
        self.request['end'] = sequence

    def read_request(self) -> np.ndarray | None:
        """A copy (1,) of the newest load case; None while it is being written or there is none."""
        for _ in range(100):
            end = int(self.request['end'][0])
            copy = self.request.copy()
            if int(copy['begin'][0]) == int(copy['end'][0]) == end and end > 0:
                return copy
        return None

    def free_slot(self) -> int:
        """A slot that is neither the newest result nor being read."""
        newest, reading = int(self.control[0]) % SLOTS, int(self.control[1])
        return next(i for i in range(SLOTS) if i not in (newest, reading))

    def publish(self, slot: int, sequence: int) -> None:
        """Make a filled slot the newest result; `sequence` rises by one each time."""
        self.slots[slot].record['begin'] = sequence
        self.slots[slot].record['end'] = sequence
        self.control[0] = sequence * SLOTS + slot

    def newest(self) -> int:
        """Number of the newest result, 0 before the first."""
        return int(self.control[0]) // SLOTS

    @property
    def answered(self) -> int:
        """Which request the newest result answers, 0 before the first."""
        return int(self.slots[int(self.control[0]) % SLOTS].record['answers'])

    def take(self) -> Slot:
        """The newest result, kept from being overwritten until the next `take`."""
        while True:
            state = int(self.control[0])
            self.control[1] = state % SLOTS
            if int(self.control[0]) == state:
                return self.slots[state % SLOTS]


def create(layout: Layout) -> tuple[SharedMemory, int]:
    """New shared memory and a descriptor to hand to the other process."""
    descriptor = os.memfd_create('shell_deform', os.MFD_CLOEXEC)
    os.ftruncate(descriptor, layout.total)
    shared = SharedMemory(os.dup(descriptor), layout)
    shared.control[1] = -1
    return shared, descriptor
