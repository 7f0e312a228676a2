# SPDX-License-Identifier: Apache-2.0
"""What the frames and joints of the hand are called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from barrett_hand_bridge.hand import FINGERS


@dataclass(frozen=True)
class Names:
    """Frames and joints as the node's parameters name them; `prefix` before all other links."""

    hand_frame: str = 'hand_base'
    tip_frames: tuple[str, str, str] = ('finger_1_tip', 'finger_2_tip', 'finger_3_tip')
    joint_names: tuple[str, ...] = (
        'spread',
        *(f'finger_{finger}_{part}' for finger in FINGERS for part in ('inner', 'outer')),
    )
    prefix: str = ''

    @property
    def frames(self) -> list[str]:
        """All links, every one of them a frame of TF that moves with the hand."""
        parts = (self.knuckle, self.inner, self.outer, self.tip)
        return [self.hand_frame, *(part(finger) for finger in FINGERS for part in parts)]

    def knuckle(self, finger: int) -> str:
        """The link that turns with the spread."""
        return f'{self.prefix}finger_{finger}_knuckle'

    def inner(self, finger: int) -> str:
        """The link between joints 2 and 3."""
        return f'{self.prefix}finger_{finger}_inner_link'

    def outer(self, finger: int) -> str:
        """The link behind joint 3."""
        return f'{self.prefix}finger_{finger}_outer_link'

    def tip(self, finger: int) -> str:
        """The frame of a finger's wrench."""
        return self.tip_frames[finger - 1]

    def inner_joint(self, finger: int) -> str:
        """Joint 2."""
        return self.joint_names[2 * finger - 1]

    def outer_joint(self, finger: int) -> str:
        """Joint 3."""
        return self.joint_names[2 * finger]


def names(values: Mapping[str, object]) -> Names:
    """The names from the node's parameters."""

    def words(name: str) -> Sequence[str]:
        found = values[name]
        assert isinstance(found, list)
        return found

    first, second, third = words('tip_frames')
    return Names(
        str(values['hand_frame']),
        (first, second, third),
        tuple(words('joint_names')),
        str(values['link_prefix']),
    )
