# SPDX-License-Identifier: Apache-2.0
"""Recorded grasps: record, check, repair, replay, and run the whole pipeline offline.

What a notebook needs, loaded with its first use:

    import grasp_replay

    with grasp_replay.open_bag('bags/tennis_ball_two_finger') as bag:
        print(bag.topics)
    recording = grasp_replay.read_recording('bags/tennis_ball_two_finger')
    recording.samples, recording.scans

Everything else is imported from the modules of the package.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grasp_replay.bag import Bag
    from grasp_replay.bag_reader import open_bag
    from grasp_replay.errors import BagError
    from grasp_replay.recording import Recording, read_recording

_PLACES = {
    'Bag': 'bag',
    'BagError': 'errors',
    'Recording': 'recording',
    'open_bag': 'bag_reader',
    'read_recording': 'recording',
}

__all__ = ['Bag', 'BagError', 'Recording', 'open_bag', 'read_recording']


def __getattr__(name: str) -> Any:
    """Load what is asked for from where it is defined."""
    if name not in _PLACES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_PLACES[name]}'), name)


def __dir__() -> list[str]:
    return __all__
