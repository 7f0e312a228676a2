# SPDX-License-Identifier: Apache-2.0
"""Force and displacement pairs from a recorded grasp: travel of the contacts against push."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from shell_deform.identify.force_curve import IdentificationError
from shell_deform.identify.modulus import SqueezeData

Array = NDArray[np.float64]

CONTACT, UNUSABLE = 1, 2 | 4 | 8 | 16 | 32
FLOAT32, UINT8 = 7, 2
# Enough for a smooth curve; each costs an equilibrium per try of the fit.
BINS = 12
# A mean over a bin still feels the width of a count.
OWN_SIGMA_N = 0.05


def read_squeeze(bag: Path, topic: str = '/hand/contacts') -> SqueezeData:
    """Loading data of a bag: while the push grows, averaged over fingers and travel bins.

    Only fingers in contact count whose gauge is tared, fitted, fresh and not saturated. Raises
    IdentificationError when the bag cannot be read, has no such topic, or never squeezes.
    """
    data = binned(*_samples(bag, topic))
    if data is None:
        raise IdentificationError(
            f'{bag}: the contacts of {topic} never travel under load; record a slow squeeze'
        )
    return data


def binned(
    travel: Array, force: Array, sigma_force: Array, sigma_travel: Array
) -> SqueezeData | None:
    """Data of the samples (n,) of one squeeze, averaged over bins of travel; None of too few."""
    edges = np.linspace(0.0, travel.max() * (1.0 + 1e-9), BINS + 1)
    place = np.digitize(travel, edges) - 1
    rows = []
    for k in range(1, BINS):
        inside = place == k
        if inside.sum() < 3:
            continue
        # noise averages out over the bin, quantisation and drift of the gauge do not
        rows.append(
            [
                np.mean(force[inside]),
                np.mean(travel[inside]),
                np.mean(sigma_force[inside]),
                np.mean(sigma_travel[inside]),
            ]
        )
    if len(rows) < 2:
        return None
    force, displacement, sigma_force, sigma_displacement = np.array(rows).T
    # what grows with the force is the gauge's gain, the same in all rows
    gain = float(np.min(sigma_force / force))
    own = np.sqrt(np.maximum(sigma_force**2 - (gain * force) ** 2, OWN_SIGMA_N**2))
    return SqueezeData(force, displacement, own, sigma_displacement, sigma_gain=gain)


def read_pushes(bag: Path, topic: str = '/hand/contacts') -> tuple[Array, Array, Array]:
    """Every sample of a bag: time (n,) [s] from the first, push and travel (n, f).

    NaN where a finger does not push, or its gauge cannot be trusted. Raises IdentificationError as
    `read_squeeze` does.
    """
    stamps: list[float] = []
    found: list[dict[int, tuple[float, float]]] = []
    for stamp, cloud in _clouds(bag, topic):
        finger, rows = _good(cloud)
        stamps.append(stamp)
        found.append({f: (row[0], row[1]) for f, row in zip(finger, rows, strict=True)})
    fingers = sorted({finger for one in found for finger in one})
    if not fingers:
        raise IdentificationError(
            f'{bag}: no sample with travel, a tared gauge and contact; record a grasp that is held'
        )
    nothing = (np.nan, np.nan)
    values = np.array([[one.get(finger, nothing) for finger in fingers] for one in found])
    time = np.array(stamps) - stamps[0]
    return time, values[..., 1], values[..., 0]


def _clouds(bag: Path, topic: str) -> Iterator[tuple[float, Any]]:
    """Stamp [s] and message of every cloud of a topic. Raises IdentificationError."""
    try:
        store = get_typestore(Stores.ROS2_JAZZY)
        with AnyReader([bag], default_typestore=store) as reader:
            connections = [c for c in reader.connections if c.topic == topic]
            if not connections:
                raise IdentificationError(f'{bag}: no topic {topic}')
            for connection, _, raw in reader.messages(connections=connections):
                cloud: Any = reader.deserialize(raw, connection.msgtype)
                stamp = cloud.header.stamp
                yield stamp.sec + 1e-9 * stamp.nanosec, cloud
    except (AnyReaderError, OSError) as error:
        raise IdentificationError(f'{bag} cannot be read: {error}') from error


def _samples(bag: Path, topic: str) -> tuple[Array, Array, Array, Array]:
    parts = [_pushing(cloud) for _, cloud in _clouds(bag, topic)]
    samples = np.concatenate(parts) if parts else np.zeros((0, 4))
    if len(samples) < 10:
        raise IdentificationError(
            f'{bag}: {len(samples)} samples with travel, a tared gauge and contact; a squeeze '
            'needs more'
        )
    rising = _rising(samples[:, 1])
    travel, force, sigma_force, sigma_travel = samples[rising][:, [0, 1, 2, 3]].T
    return travel, force, sigma_force, sigma_travel


def _pushing(cloud: Any) -> Array:
    """One mean sample (1, 4) travel, push, sigma_n, sigma_travel of the fingers that push."""
    rows = _good(cloud)[1]
    return rows.mean(axis=0)[None] if len(rows) else np.zeros((0, 4))


def _good(cloud: Any) -> tuple[list[int], Array]:
    """Fingers that push, and their travel, push, sigma_n, sigma_travel (g, 4)."""
    fields = {field.name: field for field in cloud.fields}
    if 'travel' not in fields:
        return [], np.zeros((0, 4))
    names = (
        'finger',
        'nx',
        'ny',
        'nz',
        'fx',
        'fy',
        'fz',
        'sigma_n',
        'travel',
        'sigma_travel',
        'flags',
    )
    description: Any = {
        'names': list(names),
        'formats': ['u1' if fields[name].datatype == UINT8 else '<f4' for name in names],
        'offsets': [fields[name].offset for name in names],
        'itemsize': cloud.point_step,
    }
    layout = np.dtype(description)
    points: Any = np.frombuffer(bytes(cloud.data), dtype=layout)
    flags = points['flags']
    push = sum(points[f'f{i}'].astype(float) * points[f'n{i}'] for i in 'xyz')
    good = (flags & CONTACT > 0) & (flags & UNUSABLE == 0) & np.isfinite(push)
    good &= np.isfinite(points['travel']) & (points['travel'] > 0)
    columns = [points['travel'], push, points['sigma_n'], points['sigma_travel']]
    rows = np.stack([column[good].astype(float) for column in columns], axis=1)
    return points['finger'][good].tolist(), rows


def _rising(force: Array) -> NDArray[np.bool_]:
    """Samples whose push is about the largest so far: loading, not release."""
    return force >= 0.97 * np.maximum.accumulate(force)
