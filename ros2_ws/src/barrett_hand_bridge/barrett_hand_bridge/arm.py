# SPDX-License-Identifier: Apache-2.0
"""Where the arm holds the hand: poses, and the Adept Cobra 600 of the paper's cell.

The Cobra 600 is a SCARA: two turning links in a horizontal plane, a quill that moves down, and a
turn about the quill. Its lengths are parameters; the defaults (325 mm and 275 mm, 600 mm reach)
must be compared with the plate of the arm in use.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from barrett_hand_bridge.kinematics import Array

FARTHEST_M = 1000.0


class ArmError(ValueError):
    """A pose or a set of joints that cannot be used; the message says which."""


@dataclass(frozen=True)
class Pose:
    """Position in m, (3,), and rotation matrix, (3, 3)."""

    position: Array
    rotation: Array

    def then(self, other: Pose) -> Pose:
        """`other`, given in this pose's frame, in the frame of this pose's parent."""
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)


@dataclass(frozen=True)
class ScaraLengths:
    """Lengths of a SCARA in m: two links, and the flange's height at joint 3 = 0."""

    link_1_m: float = 0.325
    link_2_m: float = 0.275
    height_m: float = 0.387


def scara_flange(lengths: ScaraLengths, joints: Sequence[float]) -> Pose:
    """Pose of the flange of a SCARA from joints 1, 2, 4 (rad) and 3 (m, positive down).

    The flange's z axis points down, its x axis along the forearm when joint 4 is 0.

    Raises:
        ArmError: not four finite numbers.
    """
    if len(joints) != 4 or not all(math.isfinite(value) for value in joints):
        raise ArmError(f'arm joints {list(joints)}: expected four finite numbers')
    if abs(joints[2]) > FARTHEST_M:
        raise ArmError(
            f'arm joint 3 at {joints[2]} m lies beyond the {FARTHEST_M:g} m of any cell'
        )
    first, second, down, last = joints
    elbow = first + second
    position = np.array(
        [
            lengths.link_1_m * math.cos(first) + lengths.link_2_m * math.cos(elbow),
            lengths.link_1_m * math.sin(first) + lengths.link_2_m * math.sin(elbow),
            lengths.height_m - down,
        ]
    )
    turn = elbow + last
    c, s = math.cos(turn), math.sin(turn)
    return Pose(position, np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]))


def rotation_matrix(quaternion: Sequence[float]) -> Array:
    """Rotation matrix of a quaternion x y z w; it is normalised first.

    Raises:
        ArmError: zero length or not finite.
    """
    q = np.asarray(quaternion, dtype=float)
    # hypot scales before it squares: nothing overflows.
    size = math.hypot(*q)
    if not 1e-9 <= size < math.inf:
        raise ArmError(f'quaternion {list(quaternion)} is no rotation')
    x, y, z, w = q / size
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: Array) -> Array:
    """Quaternion x y z w of a rotation matrix, w not negative."""
    trace = float(np.trace(rotation))
    squares = np.array([1.0 + 2.0 * rotation[i, i] - trace for i in range(3)] + [1.0 + trace])
    largest = int(np.argmax(squares))
    r = rotation
    rows = (
        (squares[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]),
        (r[0, 1] + r[1, 0], squares[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]),
        (r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[2], r[1, 0] - r[0, 1]),
        (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]),
    )
    q = np.array(rows[largest])
    q = q / np.sqrt(q @ q)
    return q if q[3] >= 0.0 else -q


def pose_from_numbers(numbers: Sequence[float]) -> Pose:
    """Pose from x y z (m) and a quaternion x y z w.

    Raises:
        ArmError: not seven finite numbers, or no rotation.
    """
    if len(numbers) != 7 or not all(math.isfinite(value) for value in numbers):
        raise ArmError(f'pose {list(numbers)}: expected seven finite numbers, x y z qx qy qz qw')
    if max(abs(value) for value in numbers[:3]) > FARTHEST_M:
        raise ArmError(f'pose {list(numbers[:3])} m lies beyond the {FARTHEST_M:g} m of any cell')
    return Pose(np.asarray(numbers[:3], dtype=float), rotation_matrix(numbers[3:]))


def gravity_in_hand(hand: Pose) -> Array:
    """Direction of gravity in the hand frame when the world's z axis points up, (3,)."""
    return hand.rotation.T @ np.array([0.0, 0.0, -1.0])
