# SPDX-License-Identifier: Apache-2.0
"""A recorded turn: the poses of a grip, solved one after the other, beside the measured torque.

A grip `NAME` of the object file has `grip/NAME/pose` (PoseStamped: where the point about which it
turns is, and how it is turned since it took hold, both in the frame of the object) and, where a
wrist feels it, `grip/NAME/wrench` (WrenchStamped: on the object, about that point, same axes).
Fingers press with the normal force of `hand/finger_N/wrench`, the N-th on the N-th contact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grasp_replay.bag import Bag
from grasp_replay.bag_reader import open_bag
from grasp_replay.cdr import header_stamp
from grasp_replay.errors import BagError
from grasp_replay.experiment import read_experiment
from shell_deform.building import build_model, object_contacts
from shell_deform.contact.friction_share import friction_share
from shell_deform.live.grip_motion import topic_of, unwrapped
from shell_deform.objects import ObjectError, load_object
from shell_deform.readout import passes_through_itself
from shell_deform.solve.equilibrium import Equilibrium, forced, gripped
from shell_deform.solve.newton import EquilibriumSolver
from shell_deform.supports.grips import Grip, GripError

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

MOST_CASES = 30
"""Load cases that are solved; a longer recording is thinned evenly in the turn."""

FINGERS = 3


@dataclass(frozen=True)
class Turned:
    """What a bag says of its one moving grip, s samples in the order of their stamps.

    Attributes:
        grip: its name. time: (s,) since the first [s]. place: (s, 3) of its point [m].
        turn: (s, 3) rotation vector [rad]. torque: (s, 3) [N m] and force (s, 3) [N] that a wrist
            felt, NaN where none is recorded. fingers: (s, 3) normal forces [N], 0 where none.
    """

    grip: str
    time: Array
    place: Array
    turn: Array
    torque: Array
    force: Array
    fingers: Array


def grip_topics(bag: Bag) -> dict[str, str]:
    """Topics with the poses of grips, by the name of the grip."""
    found = {}
    for topic in bag.topics:
        parts = topic.strip('/').split('/')
        if len(parts) >= 3 and parts[-3] == 'grip' and parts[-1] == 'pose':
            found[parts[-2]] = topic
    return found


def is_turn(path: Path) -> bool:
    """Whether a bag holds the poses of a grip."""
    with open_bag(path) as bag:
        return bool(grip_topics(bag))


def read_turn(path: Path) -> Turned:
    """The moving grip of a bag. Raises BagError for poses that are none."""
    with open_bag(path) as bag:
        topics = grip_topics(bag)
        if len(topics) != 1:
            raise BagError(f'{path} has the poses of {len(topics)} grips; one can be followed')
        ((name, topic),) = topics.items()
        felt = topic.removesuffix('pose') + 'wrench'
        stamps, poses = _rows(bag, topic, _pose)
        torque = _held(bag, felt, stamps, _wrench)
        fingers = np.zeros((len(stamps), FINGERS))
        for finger in range(FINGERS):
            wanted = f'hand/finger_{finger + 1}/wrench'
            for other in bag.topics:
                if other.endswith(wanted):
                    fingers[:, finger] = np.abs(_held(bag, other, stamps, _wrench)[:, 2])
    size = np.linalg.norm(poses[:, 3:], axis=1)
    if not (np.isfinite(poses).all() and np.all(size > 1e-6)):
        bad = int(np.flatnonzero(~(np.isfinite(poses).all(axis=1) & (size > 1e-6)))[0])
        raise BagError(f'{path}: pose {bad + 1} of grip {name} is {poses[bad].tolist()}: no pose')
    turns = Rotation.from_quat(poses[:, 3:]).as_rotvec()
    return Turned(
        name,
        1e-9 * (stamps - stamps[0]).astype(float),
        poses[:, :3],
        _unwrapped(turns),
        torque[:, 3:],
        torque[:, :3],
        np.nan_to_num(fingers),
    )


def _rows(bag: Bag, topic: str, read: Any) -> tuple[NDArray[np.int64], Array]:
    found = [(header_stamp(m.data), read(bag.decode(m))) for m in bag.messages([topic])]
    found.sort(key=lambda row: row[0])
    return np.array([stamp for stamp, _ in found]), np.array([row for _, row in found])


def _held(bag: Bag, topic: str, stamps: NDArray[np.int64], read: Any) -> Array:
    """(s, 6) the newest message at each stamp, NaN before the first."""
    result = np.full((len(stamps), 6), np.nan)
    if topic not in bag.topics:
        return result
    times, rows = _rows(bag, topic, read)
    at = np.searchsorted(times, stamps, side='right') - 1
    result[at >= 0] = rows[at[at >= 0]]
    return result


def _pose(message: Any) -> list[float]:
    p, q = message.pose.position, message.pose.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _wrench(message: Any) -> list[float]:
    f, t = message.wrench.force, message.wrench.torque
    return [f.x, f.y, f.z, t.x, t.y, t.z]


def _unwrapped(turns: Array) -> Array:
    """Rotation vectors (s, 3) that go on round instead of jumping by a whole turn."""
    result = turns.copy()
    for k in range(1, len(result)):
        result[k] = unwrapped(result[k], result[k - 1])
    return result


def solve_turn(
    path: Path,
    object_name: str | None = None,
    most_cases: int = MOST_CASES,
    show: Progress = lambda _share, _note: None,
) -> dict[str, Any]:
    """The recorded turn of a bag solved: rows, and what is said of them. Raises BagError.

    `show` is told the share done and what is being done.
    """
    experiment = read_experiment(path)
    name = object_name or experiment.object_file
    if name is None:
        raise BagError(f'{path} does not say what was turned; give --object')
    turned = read_turn(path)
    try:
        described = load_object(name)
        model = build_model(described)
        contacts = object_contacts(described, model)
        grip = _named(model.grips, turned.grip)
    except (ObjectError, GripError) as error:
        raise BagError(str(error)) from error
    if len(contacts) > FINGERS:
        raise BagError(f'{described.name} has {len(contacts)} contacts; a hand has {FINGERS}')
    friction = [contact.friction for contact in described.contacts]
    axis = turned.turn[int(np.argmax(np.linalg.norm(turned.turn, axis=1)))]
    axis = axis / max(float(np.linalg.norm(axis)), 1e-300)
    solver = EquilibriumSolver(model)
    state: Equilibrium | None = None
    rows, message = [], ''
    number = [one.name for one in model.grips].index(grip.name)
    chosen = _chosen(turned, axis, most_cases)
    for done, k in enumerate(chosen):
        show(done / len(chosen), f'pose {done + 1} of {len(chosen)}')
        motion = np.zeros((len(model.grips), 6))
        motion[number] = [*(turned.place[k] - grip.origin), *turned.turn[k]]
        case = gripped(motion)
        if contacts:
            case = replace(
                forced(contacts, turned.fingers[k, : len(contacts)]), grip_motion=motion
            )
        found = solver.solve(case, state)
        if not found.converged:
            message = f'no equilibrium {turned.time[k]:.2f} s after the start: {found.message}'
            break
        if passes_through_itself(model, found.positions) is not None:
            message = f'the wall passes through itself {turned.time[k]:.2f} s after the start'
            break
        state = found
        share = friction_share(state.touches, friction, grip.origin, axis)
        felt = float(turned.torque[k] @ axis)
        rows.append(
            {
                'time_s': round(float(turned.time[k]), 6),
                'turn_rad': float(turned.turn[k] @ axis),
                'torque_nm': float(state.grip_wrench[number, 3:] @ axis),
                'measured_torque_nm': None if np.isnan(felt) else felt,
                'friction_capacity_nm': share.capacity if any(friction) else None,
                'friction_share': share.share if any(friction) else None,
                'slip_warning': share.slips,
            }
        )
    if not rows:
        raise BagError(f'{described.name}: {message}')
    return {
        'bag': experiment.name,
        'object': described.name,
        'grip': grip.name,
        'label': experiment.label,
        'axis': axis.tolist(),
        'rows': rows,
        **_judged(rows),
        'message': message,
    }


def _named(grips: tuple[Grip, ...], name: str) -> Grip:
    for grip in grips:
        if name in (grip.name, topic_of(grip.name)):
            return grip
    known = ', '.join(grip.name for grip in grips) or 'none'
    raise BagError(f'the bag moves a grip {name!r}; the object file has {known}')


def _chosen(turned: Turned, axis: Array, most_cases: int) -> list[int]:
    """Samples to solve, spread evenly over the way that is turned."""
    way = np.abs(np.diff(turned.turn @ axis, prepend=0.0)).cumsum()
    way += 1e-9 * np.arange(len(way))
    wanted = np.linspace(way[0], way[-1], min(most_cases, len(way)))
    return np.unique(np.searchsorted(way, wanted - 1e-12)).tolist()


def _judged(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Largest torques, the error beside the wrist, and when slip was announced."""
    ours = np.array([row['torque_nm'] for row in rows])
    felt = np.array(
        [
            np.nan if row['measured_torque_nm'] is None else row['measured_torque_nm']
            for row in rows
        ]
    )
    result: dict[str, Any] = {'largest_torque_nm': float(np.abs(ours).max())}
    if np.isfinite(felt).any():
        largest = float(np.nanmax(np.abs(felt)))
        result['largest_measured_torque_nm'] = largest
        result['rms_error_nm'] = float(np.sqrt(np.nanmean((ours - felt) ** 2)))
    warned = next((row for row in rows if row['slip_warning']), None)
    if warned is not None:
        slip = max(row['friction_capacity_nm'] for row in rows)
        result['slip_torque_nm'] = float(np.abs(ours[-1]))
        result['warning_at_s'] = warned['time_s']
        result['warning_before_share'] = 1.0 - abs(warned['torque_nm']) / slip
    return result
